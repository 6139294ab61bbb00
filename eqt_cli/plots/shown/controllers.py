"""The controllers of single experiments that a figure shows, and why some runs are left out."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from matplotlib.colors import is_color_like, to_hex, to_rgba

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.plots.drawing.style import CurvePlace, Look, colours_of_style, distinct
from eqt_cli.results.result import Result
from eqt_cli.tuning.folder import TUNE

_ROUNDING = 1e-9
"""Tolerance at the ends of a time range, s."""

MOST_COLOURS = 6
"""Largest number of laws with a colour each; the others are grey."""


class TimeRange(NamedTuple):
    """Range of time that is shown, s; None for the start or the end of the data."""

    start: float | None = None
    end: float | None = None

    def samples(self, times: Array, problem: Callable[[str], EqtError]) -> Array:
        """Return the indices of the samples in the range.

        Raises
        ------
        EqtError
            If there are fewer than two; `problem` makes the error from a message.
        """
        low = -np.inf if self.start is None else self.start - _ROUNDING
        high = np.inf if self.end is None else self.end + _ROUNDING
        inside = np.flatnonzero((times >= low) & (times <= high))
        if len(inside) < 2:
            start = times[0] if self.start is None else self.start
            end = times[-1] if self.end is None else self.end
            raise problem(
                f"needs two samples or more in the time that it shows, got {start:g} s to {end:g} "
                f"s; the result holds {times[0]:g} s to {times[-1]:g} s"
            )
        return inside


class Chosen(NamedTuple):
    """Which controllers a figure shows.

    Attributes
    ----------
    controllers
        Labels or titles of the controllers to show; all if empty.
    focus
        Controllers to draw in colour; the first `MOST_COLOURS` laws if empty.
    time
        Range of time to show; all by default.
    colours
        Colours by label or title; those of the style for the other controllers.
    """

    controllers: Sequence[str] = ()
    focus: Sequence[str] = ()
    time: TimeRange = TimeRange()
    colours: Mapping[str, str] = MappingProxyType({})


ALL = Chosen()


@dataclass(frozen=True)
class Ensemble:
    """The runs of one controller of a result.

    Attributes
    ----------
    results
        The result that holds the runs.
    controller
        Index of the controller in the result.
    look
        Look, which determines its line style.
    label, title
        Its name in the result and in figures; both name the result too where there are several.
    good : (runs,)
        Whether each run succeeded; for trajectories, of the stored runs only.
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


class ShownControllers:
    """Controllers of single experiments on one group.

    Parameters
    ----------
    results
        The open results.
    figure
        Name of the figure, for messages.
    chosen
        The controllers to show.

    Attributes
    ----------
    ensembles : list of Ensemble
        The controllers.
    remarks
        Notes that a figure adds while it is drawn.

    Raises
    ------
    EqtError
        If a result is a sweep, the groups differ, a label names no controller, or every run failed.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Chosen = ALL) -> None:
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
        kept = positions(results, figure, chosen.controllers)
        self.ensembles: list[Ensemble] = []
        look = iter(looks(results, kept, figure, chosen))
        for one, places, name in zip(results, kept, names(results), strict=True):
            end = f", {name}" if len(results) > 1 else ""
            for k in places:
                label, title = one.labels[k] + end, one.titles[k] + end
                self.ensembles.append(Ensemble(one, k, next(look), label, title, one.good[k]))
        if not self.shown:
            raise self.error("has nothing to show, since every run failed; see `eqt show`")

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    def count(self) -> str:
        """Return the number of good runs, ``200 runs``; per law where they differ."""
        counts = {e.title: int(np.count_nonzero(e.good)) for e in self.shown}
        if len(set(counts.values())) == 1:
            return f"{next(iter(counts.values()))} runs"
        return f"runs: {', '.join(f'{count} ({title})' for title, count in counts.items())}"

    def unit(self, name: str) -> str:
        """Return the unit of a variable."""
        return self.results[0].units(name)

    def notes(self) -> list[str]:
        """Return the notes for the reader: runs left out, and laws whose gains are not matched."""
        failed = [
            f"{e.title}: {count} of {e.good.size} runs failed; left out."
            for e in self.ensembles
            if (count := np.count_nonzero(~e.good))
        ]
        own = [e.title for e in self.shown if e.law in e.results.not_matched]
        matched = [f"Gains not matched: {', '.join(own)}."] if own else []
        return failed + matched + self.remarks

    def error(self, message: str) -> EqtError:
        """Return an error of this figure about the results."""
        return error_of(self.results[0], self.figure, message)


def names(results: Sequence[Result]) -> list[str]:
    """Return distinct names of results: titles, else folders, else numbered titles."""
    titles = [one.title for one in results]
    folders = [one.path.parent.resolve().name for one in results]
    for candidates in (titles, folders):
        if len(set(candidates)) == len(results):
            return candidates
    return [f"{title} ({number})" for number, title in enumerate(titles, start=1)]


def positions(results: Sequence[Result], figure: str, chosen: Sequence[str]) -> list[list[int]]:
    """Return the indices of the chosen controllers in each result; all if none is chosen."""
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


def looks(
    results: Sequence[Result],
    kept: Sequence[Sequence[int]],
    figure: str = "",
    chosen: Chosen = ALL,
    *,
    variants: bool = True,
) -> list[Look]:
    """Return the looks of the controllers at these positions of each result, as one list.

    A law has one colour in all results and variants; where only one law is shown, each of its
    variants has its own. A law keeps the colour that it has among all laws, as far as the style has
    enough. The looks are those of the style in force.

    Parameters
    ----------
    variants
        Whether the variants of a law differ in their dashes, and not the laws.
    """
    laws = [_laws(one) for one in results]
    every = list(dict.fromkeys(law for of in laws for law, _ in of))
    most = 1 + max(variant for of in laws for _, variant in of)
    places = [(*laws[number][k], number * most) for number, of in enumerate(kept) for k in of]
    several = variants and len({start + variant for _, variant, start in places}) > 1
    shown = list(dict.fromkeys(law for law, *_ in places))
    own = {
        _law(results, laws, name, figure, "to colour"): _colour(results, figure, name, colour)
        for name, colour in chosen.colours.items()
    }
    if len(shown) == 1 and several:
        colour = own.get(shown[0], "")
        return distinct([CurvePlace(index, colour=colour) for index in range(len(places))])
    focus = {_law(results, laws, name, figure, "to focus on") for name in chosen.focus}
    coloured = (focus or set(shown[:MOST_COLOURS])) | own.keys()
    colours = _colours([law for law in shown if law in coloured], every)
    curves: list[CurvePlace] = []
    for law, variant, start in places:
        grey = None if law in coloured else sum(place.grey is not None for place in curves)
        position = colours.get(law, every.index(law))
        of_law = (start + variant, most * len(results)) if several else (0, 1)
        curves.append(CurvePlace(position, *of_law, grey, own.get(law, "")))
    return distinct(curves)


def _colour(results: Sequence[Result], figure: str, name: str, colour: str) -> str:
    """Return a colour that a user chose, in hexadecimal digits."""
    if not is_color_like(colour) or to_rgba(colour)[3] == 0:
        expected = "expected a colour as Matplotlib names it, such as '#0A62AE' or tab:blue"
        raise error_of(results[0], figure, f"draws {name}: {expected}, got '{colour}'")
    return to_hex(colour)


def _laws(result: Result) -> list[tuple[str, int]]:
    """Return the law and the variant of each controller: a search has its start and its winners."""
    record = TUNE.beside(result)
    laws: dict[str, tuple[str, int]] = {}
    for law in record["laws"] if record else ():
        winners = [winner["label"] for winner in law["winners"]]
        others = [each["label"] for each in law["searches"]]
        variants = list(dict.fromkeys([*winners[:1], law["start"], *winners[1:], *others]))
        laws |= {label: (law["label"], number) for number, label in enumerate(variants)}
    return [laws.get(label, (label, 0)) for label in result.labels]


def _law(
    results: Sequence[Result],
    laws: Sequence[list[tuple[str, int]]],
    name: str,
    figure: str,
    purpose: str,
) -> str:
    """Return the law that a user names for a purpose."""
    for one, of in zip(results, laws, strict=True):
        if (label := one.label_of(name)) in one.labels:
            return of[one.labels.index(label)][0]
        if any(law == name for law, _ in of):
            return name
    hint = suggestion(name, results[0].labels) or f"; there are: {', '.join(results[0].labels)}"
    raise error_of(results[0], figure, f"has no controller '{name}' {purpose}{hint}")


def _colours(shown: Sequence[str], every: Sequence[str]) -> dict[str, int]:
    """Return the colour index of each law: its own if the style has it, else one free here."""
    count = min(MOST_COLOURS, colours_of_style())
    own = {law: every.index(law) for law in shown}
    if max(own.values(), default=0) < count:
        return own
    if len(shown) > count:
        return {law: index for index, law in enumerate(shown)}
    kept = {law: colour for law, colour in own.items() if colour < count}
    free = iter(sorted(set(range(count)) - set(kept.values())))
    return kept | {law: next(free) for law in shown if law not in kept}


def error_of(result: Result, figure: str, message: str) -> EqtError:
    """Return an error of a figure about a result."""
    return result.error(f"figure '{figure}' {message}")
