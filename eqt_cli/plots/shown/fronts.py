"""Pareto fronts of a search with two objectives."""

from collections.abc import Sequence
from dataclasses import replace

from eqt_cli.core.arrays import Array
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, looks, positions
from eqt_cli.results.origin import label_named, law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.folder import TUNE
from eqt_cli.tuning.fronts import Front, fronts
from eqt_cli.tuning.held_out import held_out


class ShownFronts:
    """Pareto fronts of a search with two objectives, on its held-out runs.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    fronts : list of Front
        One front per law.
    titles : list of str
        Titles of the laws.
    looks : list of Look
        Looks, which determine the line styles of the laws.
    objectives : list of str
        The two metrics.

    Raises
    ------
    EqtError
        If the result is not of a search with two objectives, or there is no such law.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        record = TUNE.beside(results)
        self.results = results = held_out(results, record) if record else results
        laws = [law["label"] for law in record["laws"]] if record else []
        wanted = [_law_of(name, laws) for name in chosen.controllers]
        positions([results], figure, [name for name in wanted if name not in laws])
        if record is None or len(record["objectives"]) < 2:
            raise error_of(
                results,
                figure,
                "shows the fronts of `eqt tune` with two `objectives`; this is none",
            )
        self.objectives = list(record["objectives"])
        found = [front for front in fronts(results, record) if not wanted or front.law in wanted]
        if not found:
            raise error_of(results, figure, "finds no front with two points")
        self.fronts = found
        firsts = [results.labels.index(front.labels[0]) for front in found]
        self.looks = [
            replace(look, variant=0, variants=1)
            for look in looks([results], [firsts], figure, chosen.focus)
        ]
        self.titles = [results.given_names.get(front.law, law_title(front.law)) for front in found]
        self.starts = {law["label"]: results.labels.index(law["start"]) for law in record["laws"]}

    def values(self, front: Front) -> list[Array]:
        """Return both metrics of all winners of a law, ``(winners, runs)`` each."""
        rows = [self.results.labels.index(label) for label in front.labels]
        return [self.results.counted(name)[rows] for name in self.objectives]

    def start(self, front: Front) -> list[float]:
        """Return the means of both metrics at the starting gains of a law."""
        row = self.starts[front.law]
        return [float(self.results.means(name)[row]) for name in self.objectives]

    def notes(self) -> list[str]:
        """Return the notes for the reader about the points."""
        return [
            f"Means over {self.results.runs} held-out runs with 95 % intervals. Hollow: found by "
            "the search, but dominated on these runs. Crosses: starting gains."
        ]


def _law_of(name: str, laws: Sequence[str]) -> str:
    """Return the label of the law of the search that a user names by label or title."""
    return label_named(name, {law: law_title(law) for law in laws})
