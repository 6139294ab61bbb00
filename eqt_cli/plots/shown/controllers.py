"""The controllers of single experiments that a figure shows, and why some runs are left out."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.plots.drawing.style import Look
from eqt_cli.results.result import Result


@dataclass(frozen=True)
class Ensemble:
    """The runs of one controller of a result.

    Attributes
    ----------
    results
        The result that holds them.
    controller
        The controller's position there.
    look
        On what its line style depends: its position; among several results, its law for the colour
        and the result for the dashes, or the result for both where there is one law.
    label, title
        Its name in the result and in figures; both name the result too where there are several.
    good : (runs,)
        Which of the runs ended well; for trajectories, of the runs that have one.
    """

    results: Result
    controller: int
    look: Look
    label: str
    title: str
    good: Array

    @property
    def law(self) -> str:
        """The controller's label in its own result."""
        return self.results.labels[self.controller]

    @property
    def has_function(self) -> bool:
        """Whether its L is to be drawn: it claims that it falls, or no law here does."""
        return self.law not in self.results.without_function

    @property
    def failed(self) -> int:
        """How many runs are left out because they failed."""
        return int(self.good.size - np.count_nonzero(self.good))


class ShownControllers:
    """Controllers of single experiments on one group.

    Parameters
    ----------
    results
        Open.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Attributes
    ----------
    ensembles : list of Ensemble
        The controllers.
    remarks
        What a figure adds to the notes while it is drawn.

    Raises
    ------
    EqtError
        If one is a sweep, they are of several groups, a label is of no controller, or no run of
        any is good.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Sequence[str] = ()) -> None:
        self.results, self.figure = results, figure
        self.remarks: list[str] = []
        for one in results:
            one.single(f"figure '{figure}' shows single experiments")
            if one.group_name != results[0].group_name:
                message = (
                    f"shows results on one group; this is on {one.group_name}, and "
                    f"{results[0].path} on {results[0].group_name}"
                )
                raise error_of(one, figure, message)
        self.ensembles = _ensembles(results, positions(results, figure, chosen))
        if not self.shown:
            raise self.error("has nothing to show, since every run failed; see `eqt show`")

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    def count(self) -> str:
        """How many good runs there are: ``n = 200``, or of each controller where they differ."""
        counts = {e.title: int(np.count_nonzero(e.good)) for e in self.shown}
        if len(set(counts.values())) == 1:
            return f"n = {next(iter(counts.values()))}"
        return f"n = {', '.join(f'{count} ({title})' for title, count in counts.items())}"

    def unit(self, name: str) -> str:
        """The unit of a variable."""
        return self.results[0].units(name)

    def notes(self) -> list[str]:
        """What a reader must know: runs that are not shown, and laws that are not matched."""
        failed = [
            f"{e.title}: {e.failed} of {e.good.size} runs failed; left out."
            for e in self.ensembles
            if e.failed
        ]
        own = [e.title for e in self.shown if e.law in e.results.not_matched]
        matched = [f"Not matched, with gains of their own: {', '.join(own)}."] if own else []
        return failed + matched + self.remarks

    def error(self, message: str) -> EqtError:
        """An error of this figure about the results."""
        return error_of(self.results[0], self.figure, message)


def names(results: Sequence[Result]) -> list[str]:
    """What tells results apart: their titles, else their folders, else numbers as well."""
    titles = [one.title for one in results]
    folders = [one.path.parent.resolve().name for one in results]
    for candidates in (titles, folders):
        if len(set(candidates)) == len(results):
            return candidates
    return [f"{title} ({number})" for number, title in enumerate(titles, start=1)]


def positions(results: Sequence[Result], figure: str, chosen: Sequence[str]) -> list[list[int]]:
    """Where the chosen controllers are in each result, all if none is chosen."""
    known = list(dict.fromkeys(label for one in results for label in one.labels))
    wanted = [{one.label_of(name) for name in chosen} for one in results]
    for label in chosen:
        if not any(one.label_of(label) in one.labels for one in results):
            hint = suggestion(label, known) or f"; the result holds: {', '.join(known)}"
            raise error_of(results[0], figure, f"finds no controller '{label}'{hint}")
    return [
        [k for k, label in enumerate(one.labels) if not chosen or label in here]
        for one, here in zip(results, wanted, strict=True)
    ]


def _ensembles(results: Sequence[Result], kept: Sequence[Sequence[int]]) -> list[Ensemble]:
    """The controllers at these positions of each result."""
    several = len(results) > 1
    laws = list(dict.fromkeys(label for one in results for label in one.labels))
    shown = {one.labels[k] for one, places in zip(results, kept, strict=True) for k in places}
    pairs = (len(laws), len(results)) if len(shown) > 1 else (0, 0)
    found: list[Ensemble] = []
    for number, (one, name) in enumerate(zip(results, names(results), strict=True)):
        end = f", {name}" if several else ""
        for k in kept[number]:
            label, title = one.labels[k], one.titles[k]
            look = Look(len(found), (laws.index(label), number), pairs) if several else Look(k)
            found.append(Ensemble(one, k, look, label + end, title + end, one.good[k]))
    return found


def error_of(result: Result, figure: str, message: str) -> EqtError:
    """An error of a figure about a result."""
    return result.error(f"figure '{figure}' {message}")
