"""What figures show of results: laws, metrics, sweeps, references."""

import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from matplotlib.colors import is_color_like, to_hex, to_rgba

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.reporting import count_of
from eqt_cli.components.groups import MatrixLieGroup, known_group
from eqt_cli.figures.labels import notation
from eqt_cli.figures.style import CurvePlace, Look, colours_of_style, distinct
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.metrics import RANKED
from eqt_cli.results.quantity import SweptKey
from eqt_cli.results.result import Result, check_stored
from eqt_cli.results.summary import check_metrics, compared_first

# The controllers of single experiments that a figure shows, and why some runs are left out --------


_ROUNDING = 1e-9
"""Tolerance at the ends of a time range, s."""

MOST_COLOURS = 6
"""Largest number of laws with a colour each; the others are grey."""


class Chosen(NamedTuple):
    """What a figure shows.

    Attributes
    ----------
    controllers
        Labels or titles of the controllers to show; all if empty.
    focus
        Controllers to draw in colour; the first `MOST_COLOURS` laws if empty.
    colours
        Colours by label or title; those of the style for the other controllers.
    start, end
        Range of time, s; None for the start or the end of the data.
    """

    controllers: Sequence[str] = ()
    focus: Sequence[str] = ()
    colours: Mapping[str, str] = MappingProxyType({})
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
    note
        What the curves are: the few words within a figure whose caption has all notes.

    Raises
    ------
    EqtError
        If a result is a sweep, the groups differ, a label names no controller, or every run failed.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Chosen = ALL) -> None:
        self.results, self.figure, self.note = results, figure, ""
        self.remarks: list[str] = []
        for result in results:
            result.single(f"figure '{figure}' shows single experiments")
            if result.group_name != results[0].group_name:
                message = (
                    f"shows results on one group; this is on {result.group_name}, and "
                    f"{results[0].path} on {results[0].group_name}"
                )
                raise error_of(result, figure, message)
        places_of = positions(results, figure, chosen.controllers)
        self.ensembles: list[Ensemble] = []
        look = iter(looks(results, places_of, figure, chosen))
        for result, places, name in zip(results, places_of, names(results), strict=True):
            end = f", {name}" if len(results) > 1 else ""
            for k in places:
                label, title = result.labels[k] + end, result.titles[k] + end
                self.ensembles.append(Ensemble(result, k, next(look), label, title, result.good[k]))
        if not self.shown:
            raise self.error("has nothing to show, since every run failed; see `eqt show`")

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    def count(self, most: int | None = None) -> str:
        """Return the number of good runs, ``200 runs``; per law where they differ, up to `most`."""
        counts = {e.title: int(np.count_nonzero(e.good)) for e in self.shown}
        if most and max(counts.values()) > most:
            return f"the first {most} runs"
        if len(set(counts.values())) == 1:
            return count_of(next(iter(counts.values())), "run")
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
        unmatched = [e.title for e in self.shown if e.law in e.results.described.not_matched]
        matched = [f"Gains not matched: {', '.join(unmatched)}."] if unmatched else []
        return failed + matched + self.remarks

    def error(self, message: str) -> EqtError:
        """Return an error of this figure about the results."""
        return error_of(self.results[0], self.figure, message)


def names(results: Sequence[Result]) -> list[str]:
    """Return distinct names of results: titles, else folders, else numbered titles."""
    titles = [result.title for result in results]
    folders = [result.path.parent.resolve().name for result in results]
    for candidates in (titles, folders):
        if len(set(candidates)) == len(results):
            return candidates
    return [f"{title} ({number})" for number, title in enumerate(titles, start=1)]


def positions(results: Sequence[Result], figure: str, chosen: Sequence[str]) -> list[list[int]]:
    """Return the indices of the chosen controllers in each result; all if none is chosen."""
    labels = list(dict.fromkeys(label for result in results for label in result.labels))
    wanted = [{result.label_of(name) for name in chosen} for result in results]
    for label in chosen:
        if not any(result.label_of(label) in result.labels for result in results):
            hint = suggestion(label, labels) or f"; the result holds: {', '.join(labels)}"
            raise error_of(results[0], figure, f"finds no controller '{label}'{hint}")
    return [
        [k for k, label in enumerate(result.labels) if not chosen or label in of_result]
        for result, of_result in zip(results, wanted, strict=True)
    ]


def looks(
    results: Sequence[Result],
    chosen_laws: Sequence[Sequence[int]],
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
        Whether dashes distinguish the variants of a law instead of the laws.
    """
    laws = [_laws(result) for result in results]
    every = list(dict.fromkeys(law for of in laws for law, _ in of))
    most = 1 + max(variant for of in laws for _, variant in of)
    places = [
        (*of[k], number * most) for number, of in enumerate(laws) for k in chosen_laws[number]
    ]
    several = variants and len({start + variant for _, variant, start in places}) > 1
    shown = list(dict.fromkeys(law for law, *_ in places))
    user_colours = {
        _law(results, laws, name, figure, "to colour"): _colour(results, figure, name, colour)
        for name, colour in chosen.colours.items()
    }
    if len(shown) == 1 and several:
        colour = user_colours.get(shown[0], "")
        return distinct([CurvePlace(index, colour=colour) for index in range(len(places))])
    focus = {_law(results, laws, name, figure, "to focus on") for name in chosen.focus}
    coloured = (focus or set(shown[:MOST_COLOURS])) | user_colours.keys()
    colours = _colours([law for law in shown if law in coloured], every)
    curves: list[CurvePlace] = []
    for law, variant, start in places:
        grey = None if law in coloured else sum(place.grey is not None for place in curves)
        position = colours.get(law, every.index(law))
        of_law = (start + variant, most * len(results)) if several else (0, 1)
        curves.append(CurvePlace(position, *of_law, grey, user_colours.get(law, "")))
    return distinct(curves)


def _colour(results: Sequence[Result], figure: str, name: str, colour: str) -> str:
    """Return a colour that a user chose, in hexadecimal digits."""
    if not is_color_like(colour) or to_rgba(colour)[3] == 0:
        expected = "expected a colour as Matplotlib names it, such as '#0A62AE' or tab:blue"
        raise error_of(results[0], figure, f"draws {name}: {expected}, got '{colour}'")
    return to_hex(colour)


def _laws(result: Result) -> list[tuple[str, int]]:
    """Return the law and the variant of each controller: a search has its start and its winners."""
    variants = conclusion_of(result).variants
    return [variants.get(label, (label, 0)) for label in result.labels]


def _law(
    results: Sequence[Result],
    laws: Sequence[list[tuple[str, int]]],
    name: str,
    figure: str,
    purpose: str,
) -> str:
    """Return the law that a user names for a purpose."""
    for result, of in zip(results, laws, strict=True):
        if (label := result.label_of(name)) in result.labels:
            return of[result.labels.index(label)][0]
        if any(law == name for law, _ in of):
            return name
    hint = suggestion(name, results[0].labels) or f"; there are: {', '.join(results[0].labels)}"
    raise error_of(results[0], figure, f"has no controller '{name}' {purpose}{hint}")


def _colours(shown: Sequence[str], every: Sequence[str]) -> dict[str, int]:
    """Return the colour index of each law: its own if the style has it, else one free here."""
    count = min(MOST_COLOURS, colours_of_style())
    indices = {law: every.index(law) for law in shown}
    if max(indices.values(), default=0) < count:
        return indices
    if len(shown) > count:
        return {law: index for index, law in enumerate(shown)}
    within = {law: colour for law, colour in indices.items() if colour < count}
    free = iter(sorted(set(range(count)) - set(within.values())))
    return within | {law: next(free) for law in shown if law not in within}


def error_of(result: Result, figure: str, message: str) -> EqtError:
    """Return an error of a figure about a result."""
    return result.error(f"figure '{figure}' {message}")


# Metrics per run, of one or several results -------------------------------------------------------


@dataclass(frozen=True)
class MetricValues:
    """One metric over the good runs of a controller.

    Attributes
    ----------
    values : (runs,)
        Values in the order of the runs; infinite where a run had not settled by its end.
    """

    values: Array

    @property
    def seen(self) -> Array:
        """The finite values in ascending order."""
        return np.sort(self.values[np.isfinite(self.values)])

    @property
    def censored(self) -> int:
        """Number of runs that had not settled."""
        return int(np.isinf(self.values).sum())

    @property
    def mean(self) -> float:
        """The mean; NaN if some runs had not settled, since their settling times are unknown."""
        return float(np.mean(self.values)) if self.values.size and not self.censored else np.nan

    def quantiles(self, levels: Sequence[float]) -> Array:
        """Return quantiles, interpolated linearly; infinite where this needs an unsettled run."""
        seen = self.seen
        places = (self.values.size - 1) * np.asarray(levels)
        if not seen.size:
            return np.full(len(places), np.inf)
        values = np.interp(places, np.arange(seen.size), seen)
        return np.where(np.ceil(places) < seen.size, values, np.inf)


class ShownMetrics(ShownControllers):
    """Metrics of the runs that did not fail, of one or several results on one group.

    Parameters
    ----------
    metrics
        Metrics to show, by their names in the results; if empty, those by which laws are compared
        first, as far as all results hold them.

    Attributes
    ----------
    metrics : list of str
        The metrics that are shown.

    Raises
    ------
    EqtError
        In the cases of `ShownControllers`, or if a result holds no such metric.
    """

    def __init__(
        self,
        results: Sequence[Result],
        figure: str,
        chosen: Chosen = ALL,
        metrics: Sequence[str] = (),
    ) -> None:
        super().__init__(results, figure, chosen)
        besides = [row.name for row in RANKED if row.role != "error"]
        parts = [part for name in besides for part in results[0].in_parts(name)]
        wanted = dict.fromkeys([*compared_first(results[0]), *parts])
        held = [name for name in wanted if all(name in result.metrics for result in results)]
        without = [name for name in held if not any(_sample(name, e).seen.size for e in self.shown)]
        self.metrics = list(dict.fromkeys(metrics)) or [n for n in held if n not in without] or held
        if without and not metrics:
            self.remarks.append(f"No run has a {', '.join(without)}.".replace("_", " "))
        if not self.metrics:
            message = f"finds none of the metrics {', '.join(besides)}"
            raise self.error(f"{message}; choose others with the option 'metrics'")
        for result in results:
            unknown = [name for name in self.metrics if name not in result.comparable]
            check_metrics(result, unknown, who=f"figure '{figure}'")

    @cached_property
    def samples(self) -> dict[tuple[str, str], MetricValues]:
        """Samples by metric and controller label, without the runs that have no value."""
        return {(name, e.label): _sample(name, e) for name in self.metrics for e in self.shown}

    def end(self, ensemble: Ensemble) -> float:
        """Return the final time of a controller's runs."""
        return float(ensemble.results.times[-1])

    def notes(self) -> list[str]:
        """Return `ShownControllers.notes`, then how many runs have no value."""
        notes = super().notes()
        for name, e in product(self.metrics, self.shown):
            total = int(e.good.sum())
            without = total - self.samples[name, e.label].values.size
            # Other metrics are known only for runs with stored trajectories.
            if without and name in e.results.metrics:
                notes.append(f"{e.title}: {without} of {total} runs have no {name}; left out.")
        return notes


def _sample(name: str, ensemble: Ensemble) -> MetricValues:
    result, controller = ensemble.results, ensemble.controller
    if name in result.metrics:
        measured, late = result.metric(name, controller), result.censored(name, controller)
        good = ensemble.good
    else:  # computed from the trajectories
        of = result.per_run(result.comparable_named(name))
        measured, late = of.values[controller], of.censored[controller]
        good = np.isfinite(measured)
    values = np.where(late, np.inf, measured)
    return MetricValues(values[good & ~np.isnan(values)])


# The points of a sweep, and the metrics at each ---------------------------------------------------


CHOICES = ("gains", "controllers")
"""Configuration sections with design choices: gains, and options of laws."""
SEED = "ensemble.seed"


def are_choices(axes: Sequence[SweptKey]) -> bool:
    """Whether all swept keys are design choices; seeds only repeat a choice and do not count."""
    keys = [axis.key for axis in axes if axis.key != SEED]
    return all(re.split(r"\W", key)[0] in CHOICES for key in keys)


class ShownSweep:
    """A sweep's metrics over all runs of every point.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    controllers : list of int
        Indices of the controllers in the result.
    looks : list of Look
        Looks, which determine their line styles.
    titles : list of str
        Their names in figures.
    remarks, note
        As of `ShownControllers`.

    Raises
    ------
    EqtError
        If the result is not a sweep, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        self.results, self.figure, self._shares = results, figure, False
        if not results.is_sweep:
            message = "shows sweeps, and this is a single experiment; see `eqt sweep --help`"
            raise self.error(message)
        self.controllers = positions([results], figure, chosen.controllers)[0]
        self.looks = looks([results], [self.controllers], figure, chosen)
        self.titles = [results.titles[position] for position in self.controllers]
        self._shown: list[str] = []
        self.remarks: list[str] = []
        self.note = ""

    @property
    def axes(self) -> list[SweptKey]:
        """Swept keys of several values, angles in degrees; keys changed together count as one."""
        return [key.in_degrees for key in self.results.swept_keys]

    def one_or_two(self, instead: str = "") -> list[SweptKey]:
        """Return `axes`, for a figure that has room for at most two.

        Raises
        ------
        EqtError
            If there are more, or none; `instead` ends the message.
        """
        if not 1 <= len(self.axes) <= 2:
            here = f"{len(self.axes)} ({self.keys})"
            raise self.error(f"has room for one or two swept keys, and here are {here}{instead}")
        return self.axes

    @property
    def keys(self) -> str:
        """Names of `axes`, for messages."""
        return ", ".join(axis.key for axis in self.axes) or "none"

    def require_choices(self) -> None:
        """Refuse a trade-off over keys that are no design choices, such as a lag.

        Raises
        ------
        EqtError
            If any swept key is no design choice; the message names the keys.
        """
        if not are_choices(self.axes):
            raise self.error(
                "shows a trade-off between design choices, which are gains and options of laws; "
                f"here is swept: {self.keys}"
            )

    @property
    def error_metric(self) -> str:
        """The name of the error by which laws are compared first."""
        return next(iter(compared_first(self.results)), "mean_pose_error")

    def metric(self, name: str) -> Array:
        """Return a metric of every run, ``(points, shown controllers, runs)``; NaN where it failed.

        Values beyond the horizon count as the horizon.
        """
        check_metrics(self.results, [name], who=f"figure '{self.figure}'")
        self._shown.append(name)
        return self.results.counted(name)[:, self.controllers]

    def means(self, name: str) -> Array:
        """Return means over all runs, ``(points, shown controllers)``; NaN where a run failed.

        Raises
        ------
        EqtError
            If no point has a finite mean.
        """
        means: Array = np.mean(self.metric(name), axis=-1)
        if not np.isfinite(means).any():
            raise self.error(f"finds no point at which every run has a {name}")
        return means

    def notes(self) -> list[str]:
        """Return the notes for the reader about runs without a number."""
        notes, horizon = list(self.remarks), self.results.horizon
        failed = self.results.status[:, self.controllers] != 0
        if number := int(np.count_nonzero(failed)):
            without = failed.any(axis=-1)
            left_out = f"{np.count_nonzero(without)} of {without.size} means left out"
            what = "counted as not settled" if self._shares else left_out
            notes.append(f"{count_of(number, 'run')} failed; {what}.")
        for name in dict.fromkeys(self._shown):
            late = int(np.count_nonzero(self.results.censored(name)[:, self.controllers]))
            if late and horizon is None:
                notes.append(f"{name}: {late} runs unsettled at their end; their means left out.")
            elif late:
                counted = f"{late} runs unsettled at {horizon:g} s count as {horizon:g} s"
                notes.append(f"{name}: {counted}; means are lower bounds.")
        return notes

    @property
    def count(self) -> str:
        """Number of runs of each point: ``20 runs``."""
        return count_of(self.results.runs, "run")

    def settled(self, by: float) -> Array:
        """Return whether each run has settled by a time, or by its end if 0; failed runs have not.

        Raises
        ------
        EqtError
            If the runs are shorter, or the result holds no settling times.
        """
        horizon = self.results.horizon
        if horizon is not None and by > horizon:
            raise self.error(f"option 'by': the runs last {horizon:g} s, got {by:g}")
        check_metrics(self.results, ["settling_time"], who=f"figure '{self.figure}'")
        self._shares = True
        times = self.results.metric("settling_time")[:, self.controllers]
        return times <= (by or np.inf)  # False for NaN: not settled

    def error(self, message: str) -> EqtError:
        """Return an error of this figure about this result."""
        return error_of(self.results, self.figure, message)


# The desired motion, of a result or before anything is run ----------------------------------------


MOST_REMARKS = 3
"""Largest number of remarks on a reference below its figure."""


@dataclass(frozen=True)
class DesiredMotion:
    """The reference of a configuration, before anything is run.

    Attributes
    ----------
    name, path, digest
        Name of the experiment, its configuration, and the hash of all that affects its numbers.
    group
        The group G.
    motion
        Times, poses, velocities and torques, as of `ShownReference`.
    remarks
        Times at which it is not finite, and at which it jumps.
    """

    name: str
    path: str
    digest: str
    group: MatrixLieGroup
    motion: tuple[Array, Array, Array, Array]
    remarks: Sequence[str] = ()


class ShownReference:
    """The desired motion of an experiment, from a result or before anything is run.

    Parameters
    ----------
    source
        The open result, or the reference of a configuration.
    figure, chosen
        See `ShownControllers`; the reference is the same for all controllers.

    Attributes
    ----------
    group
        The group G.
    times : (n,)
        Sample times, s.
    pose : (n, d, d)
        Desired poses Q_d.
    velocity, torque : (n, m)
        Desired velocity V_d and torque τ_d, body frame.

    Raises
    ------
    EqtError
        If the result is a sweep, lacks the reference or is on an unknown group.
    """

    def __init__(self, source: Result | DesiredMotion, figure: str, chosen: Chosen = ALL) -> None:
        if isinstance(source, DesiredMotion):
            self._remarks, place = source.remarks, "the reference"
            self.group, motion = source.group, source.motion
        else:
            self._remarks, place = (), str(source.path)
            source.single(f"figure '{figure}' shows single experiments")
            positions([source], figure, chosen.controllers)
            desired = ("desired_pose", "desired_velocity", "desired_torque")
            check_stored(source, *desired, who=f"figure '{figure}' needs")
            group = known_group(source.group_name)
            if group is None:
                message = f"does not know group '{source.group_name}' of a plugin"
                raise error_of(source, figure, message)
            pose, velocity, torque = (source[name] for name in desired)
            self.group, motion = group, (source.times, pose, velocity, torque)
        samples = chosen.samples(
            motion[0], lambda message: EqtError(f"{place}: figure '{figure}' {message}")
        )
        self.times, self.pose, self.velocity, self.torque = (part[samples] for part in motion)

    def notes(self) -> list[str]:
        """Return the first remarks: where the reference is not finite, and where it jumps."""
        shown = [f"The reference: {notation(text)}." for text in self._remarks[:MOST_REMARKS]]
        left = len(self._remarks) - len(shown)
        return [*shown, f"And {left} more jumps."] if left else shown
