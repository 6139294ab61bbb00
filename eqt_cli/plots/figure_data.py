"""What of results a figure shows, and what it leaves out; it must not know how they are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from eqt_cli.analysis.certificates import Row, Verdict
from eqt_cli.closed_loop.signals import MIXED
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.problems import Problems
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.horizon import check_reference, reference_over_horizon
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.groups.angles import turn_of_distance
from eqt_cli.plots.drawing.labels import in_words, notation, signal_label
from eqt_cli.plots.drawing.style import Look
from eqt_cli.results.result import Result, SweptKey, law_title
from eqt_cli.tuning.folder import record_beside
from eqt_cli.tuning.fronts import Front, fronts

DEFAULT_METRICS = (
    "effort",
    "early_torque",
    "peak_torque",
    "mean_pose_error",
    "final_pose_error",
    "settling_time",
)
"""The metrics that are shown unless told otherwise, those of them that all results hold."""

MOST_REMARKS = 3
"""Lines about one reference, below its figure."""

_NORMS = ("pose_error", "velocity_error", "torque_norm")
_DECIDED = (Verdict.HOLDS, Verdict.FAILS)


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
                raise _error(one, figure, message)
        self.ensembles = _ensembles(results, _positions(results, figure, chosen))
        if not self.shown:
            raise self.error("has nothing to show, since every run failed; see `eqt show`")

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

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
        return _error(self.results[0], self.figure, message)


class ShownRuns(ShownControllers):
    """Trajectories of the runs, of one or several results on one group, that did not fail.

    Raises
    ------
    EqtError
        As `ShownControllers`; and if a result holds no trajectories, or of failed runs only.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Sequence[str] = ()) -> None:
        super().__init__(results, figure, chosen)
        for one in results:
            self._check_stored(one, "lyapunov")
            if len(one.times) < 2:
                message = (
                    "needs trajectories of two samples or more, and the result holds one; "
                    "decrease store.decimate and run the experiment again"
                )
                raise _error(one, figure, message)
        self.ensembles = [
            replace(e, good=e.results.good_stored(e.controller)) for e in self.ensembles
        ]
        if not self.shown:
            raise self.error("has nothing to show: every run whose trajectory is stored failed")

    def with_function(self) -> list[Ensemble]:
        """The controllers whose L is drawn; a remark names the others."""
        others = [e.title for e in self.shown if not e.has_function]
        if others:
            named = ", ".join(others)
            self.remarks.append(f"Without L, since the law does not claim that it falls: {named}.")
        return [e for e in self.shown if e.has_function]

    @property
    def span(self) -> tuple[float, float]:
        """The first and the last time of all results."""
        ends = [one.times[[0, -1]] for one in self.results]
        return float(np.min(ends)), float(np.max(ends))

    def times(self, ensemble: Ensemble) -> Array:
        """The sample times of a controller's runs."""
        return ensemble.results.times

    def values(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """One signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            How many runs to read, the first ones; all if None.

        Raises
        ------
        EqtError
            If the result does not hold the signal over time.
        """
        self._check_stored(ensemble.results, signal)
        return ensemble.results.trajectories(signal, ensemble.controller, most)

    def of_run(self, signal: str, ensemble: Ensemble, run: int) -> Array:
        """One signal of one run of a controller, ``(samples, …)``.

        Raises
        ------
        EqtError
            If the run failed, or the result does not hold its trajectory.
        """
        found: Array = ensemble.results.trajectory(signal, run)[ensemble.controller]
        if not ensemble.results.good[ensemble.controller, run]:
            raise self.error(f"cannot show run {run} of {ensemble.label}, which failed")
        return found

    def errors(self, signal: str, ensemble: Ensemble, *, degrees: bool) -> Array:
        """`values` of a norm; those that are distances of rotations as angles, if in `degrees`."""
        values = self.values(signal, ensemble)
        if degrees and signal in self.results[0].attitude_errors:
            return np.degrees(turn_of_distance(values))
        return values

    def error_label(self, signal: str, *, degrees: bool) -> str:
        """The label of an axis along which `errors` are drawn."""
        if degrees and signal in self.results[0].attitude_errors:
            return in_words("attitude error", "deg")
        return signal_label(self.results[0], signal)

    def require_attitude(self, *, degrees: bool) -> None:
        """Refuse to show in degrees what is no angle."""
        if degrees and not self.results[0].attitude_errors:
            group = self.results[0].group_name
            raise self.error(f"finds no attitude error on {group} to show in degrees")

    def numbers(self, ensemble: Ensemble, most: int | None = None) -> Array:
        """The numbers of the good runs of a controller, as `values` takes them."""
        return ensemble.results.stored_runs[ensemble.good][:most]

    def desired(self, signal: str, ensemble: Ensemble) -> Array:
        """A signal of the reference at the sample times, ``(samples, …)``: ``torque`` for τ_d."""
        self._check_stored(ensemble.results, f"desired_{signal}")
        return ensemble.results[f"desired_{signal}"]

    @cached_property
    def parts(self) -> list[str]:
        """Suffixes of the norms with units of their own, ``_rotation``; else one empty suffix."""
        first = self.results[0]
        suffixes = [f"_{part}" for part in first.parts(_NORMS[0])]
        return [end for end in suffixes if all(first.has(norm + end) for norm in _NORMS)] or [""]

    @property
    def group(self) -> MatrixLieGroup | None:
        """The group of all results; None if it is of a plugin, which need not be loaded here."""
        return self.results[0].group

    @cached_property
    def axes(self) -> list[tuple[str, str]]:
        """Name and torque unit of every algebra coordinate."""
        axes = [str(name) for name in self.results[0].coordinate("axis")]
        units = [self.unit("torque")] * len(axes)
        if MIXED in units and self.group is not None:
            for part in self.group.parts:
                units[part.axes] = [part.force_unit] * len(axes[part.axes])
        return list(zip(axes, units, strict=True))

    def notes(self) -> list[str]:
        """As `ShownControllers.notes`, after what flies and how many runs have trajectories."""
        return [*self._loops(), *self._thinned(), *super().notes()]

    def _loops(self) -> Iterator[str]:
        """What the loops have that the paper's has not."""
        found = {
            name: one.loop_in_words
            for one, name in zip(self.results, names(self.results), strict=True)
        }
        for name, words in found.items():
            if words:
                yield f"{name}: {words}" if len(self.results) > 1 else words

    def _thinned(self) -> Iterator[str]:
        for one, name in zip(self.results, names(self.results), strict=True):
            if len(one.stored_runs) < one.runs:
                whose = f" of {name}" if len(self.results) > 1 else ""
                yield f"Trajectories of the first {len(one.stored_runs)} of {one.runs} runs{whose}."

    def _check_stored(self, result: Result, signal: str) -> None:
        result.check_stored(signal, who=f"figure '{self.figure}' needs")


@dataclass(frozen=True)
class Sample:
    """One metric over the good runs of a controller.

    Attributes
    ----------
    values : (runs,)
        In the order of the runs; infinite where a run had not settled by its end.
    """

    values: Array

    @property
    def seen(self) -> Array:
        """The finite values, rising."""
        return np.sort(self.values[np.isfinite(self.values)])

    @property
    def censored(self) -> int:
        """How many runs had not settled."""
        return int(np.isinf(self.values).sum())

    @property
    def mean(self) -> float:
        """NaN where runs had not settled, since nobody knows when they would."""
        return float(np.mean(self.values)) if self.values.size and not self.censored else np.nan

    def quantiles(self, levels: Sequence[float]) -> Array:
        """By linear interpolation between runs; infinite where that takes one not settled."""
        seen = self.seen
        places = (self.values.size - 1) * np.asarray(levels)
        if not seen.size:
            return np.full(len(places), np.inf)
        found = np.interp(places, np.arange(seen.size), seen)
        return np.where(np.ceil(places) < seen.size, found, np.inf)


class ShownMetrics(ShownControllers):
    """Metrics of the runs, of one or several results on one group, that did not fail.

    Parameters
    ----------
    metrics
        What to show, by names in the results; `DEFAULT_METRICS` if empty.

    Attributes
    ----------
    metrics : list of str
        What is shown.

    Raises
    ------
    EqtError
        As `ShownControllers`; and if a result holds no such metric.
    """

    def __init__(
        self,
        results: Sequence[Result],
        figure: str,
        chosen: Sequence[str] = (),
        metrics: Sequence[str] = (),
    ) -> None:
        super().__init__(results, figure, chosen)
        held = [name for name in DEFAULT_METRICS if all(name in one.metrics for one in results)]
        self.metrics = list(dict.fromkeys(metrics)) or held
        if not self.metrics:
            message = f"finds none of the metrics {', '.join(DEFAULT_METRICS)}"
            raise self.error(f"{message}; choose others with the option 'metrics'")
        for one in results:
            one.check_metrics(self.metrics, who=f"figure '{figure}'")

    @cached_property
    def samples(self) -> dict[tuple[str, str], Sample]:
        """What is shown, by metric and the controller's label; runs without a value left out."""
        return {(name, e.label): _sample(name, e) for name in self.metrics for e in self.shown}

    def end(self, ensemble: Ensemble) -> float:
        """The last time of a controller's runs."""
        return float(ensemble.results.times[-1])

    def notes(self) -> list[str]:
        """As `ShownControllers.notes`, before how many runs have no value."""
        return [*super().notes(), *self._without_value()]

    def _without_value(self) -> Iterator[str]:
        for name in self.metrics:
            for ensemble in self.shown:
                total = int(ensemble.good.sum())
                without = total - self.samples[name, ensemble.label].values.size
                if without:
                    yield f"{ensemble.title}: {without} of {total} runs have no {name}; left out."


def _sample(name: str, ensemble: Ensemble) -> Sample:
    result, controller = ensemble.results, ensemble.controller
    values = np.where(result.censored(name, controller), np.inf, result.metric(name, controller))[
        ensemble.good
    ]
    return Sample(values[~np.isnan(values)])


class ShownSweep:
    """A sweep's metrics over all runs of every point.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        As for `ShownControllers`.

    Attributes
    ----------
    controllers : list of int
        The positions of the controllers, on which their line styles depend.
    titles : list of str
        Their names in figures.

    Raises
    ------
    EqtError
        If the result is not one of a sweep, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Sequence[str] = ()) -> None:
        self.results, self.figure, self._shares = results, figure, False
        if not results.is_sweep:
            raise self.error(
                "shows sweeps, and this is a single experiment; see `eqt sweep --help`"
            )
        self.controllers = _positions([results], figure, chosen)[0]
        self.titles = [results.titles[position] for position in self.controllers]
        self._shown: list[str] = []

    @property
    def axes(self) -> list[SweptKey]:
        """The swept keys that take more than one value; one for keys that change together."""
        return self.results.swept_keys

    def metric(self, name: str) -> Array:
        """A metric of every run, ``(points, shown controllers, runs)``; NaN where one failed.

        The horizon stands for what lies beyond it.
        """
        self.results.check_metrics([name], who=f"figure '{self.figure}'")
        self._shown.append(name)
        return self.results.counted(name)[:, self.controllers]

    def means(self, name: str) -> Array:
        """The means over all runs, ``(points, shown controllers)``; NaN where one failed.

        Raises
        ------
        EqtError
            If none of the points has one.
        """
        found: Array = np.mean(self.metric(name), axis=-1)
        if not np.isfinite(found).any():
            raise self.error(f"finds no point at which every run has a {name}")
        return found

    @property
    def failed_runs(self) -> Array:
        """How many runs failed, ``(points, shown controllers)``."""
        found: Array = np.count_nonzero(self.results.status, axis=-1)[:, self.controllers]
        return found

    def beyond(self, name: str) -> Array:
        """Of how many runs a metric lies beyond the horizon, ``(points, shown controllers)``."""
        found: Array = self.results.censored(name).sum(axis=-1)[:, self.controllers]
        return found

    def laws(self, shown: int) -> dict[int, str]:
        """The points where a controller, the n-th of those shown, is a law with a name of its own.

        Empty where the sweep is not over the controllers' options.
        """
        return self.results.laws(self.controllers[shown])

    def point_name(self, point: int) -> str:
        """What is swept at a point: ``kp 2, kd 0.5``."""
        return self.results.point_name(point)

    def notes(self) -> list[str]:
        """What a reader must know about the runs that have no number."""
        return [*self._failed(), *self._censored()]

    def _failed(self) -> Iterator[str]:
        failed = self.results.status[:, self.controllers] != 0
        without = failed.any(axis=-1)
        if without.any():
            left_out = f"{np.count_nonzero(without)} of {without.size} means left out"
            count = f"{np.count_nonzero(failed)} runs failed"
            yield f"{count}; {'they count as not settled' if self._shares else left_out}."

    def _censored(self) -> Iterator[str]:
        horizon = self.results.horizon
        for name in dict.fromkeys(self._shown):
            late = int(np.count_nonzero(self.results.censored(name)[:, self.controllers]))
            if late and horizon is None:
                yield f"{name}: {late} runs unsettled at their end; their means left out."
            elif late:
                end = f"{horizon:g} s"
                counted = f"{late} runs unsettled at {end} count as {end}"
                yield f"{name}: {counted}; means are lower bounds."

    def settled(self, by: float) -> Array:
        """Which runs have settled by a time, or by their end if it is 0; no failed run has.

        Raises
        ------
        EqtError
            If runs do not last that long, or the result does not tell.
        """
        horizon = self.results.horizon
        if horizon is not None and by > horizon:
            raise self.error(f"option 'by': the runs last {horizon:g} s, got {by:g}")
        self.results.check_metrics(["settling_time"], who=f"figure '{self.figure}'")
        self._shares = True
        times = self.results.metric("settling_time")[:, self.controllers]
        found: Array = times <= (by or np.inf)  # NaN, of a run that has not settled, is not
        return found

    def error(self, message: str) -> EqtError:
        """An error of this figure about this result."""
        return _error(self.results, self.figure, message)


class ShownCertificates:
    """Certificates that have a number and a bound: those of identities and of trajectories.

    Parameters
    ----------
    results
        The open result.
    rows
        What was found about it.
    figure, chosen
        As for `ShownControllers`.

    Attributes
    ----------
    names : list of str
        Of the certificates, in the paper's order.
    laws : list of Ensemble
        The controllers.

    Raises
    ------
    EqtError
        As `ShownControllers`; and if there are no certificates.
    """

    def __init__(
        self, results: Result, rows: Sequence[Row], figure: str, chosen: Sequence[str] = ()
    ) -> None:
        self.laws = ShownControllers([results], figure, chosen).ensembles
        labels = ["", *(law.label for law in self.laws)]
        judged = [row for row in rows if row.kind != "hypothesis" and row.controller in labels]
        self._shown = [row for row in judged if _has_place(row)]
        self._left_out = [row for row in judged if row not in self._shown]
        if not self._shown:
            raise _error(results, figure, "finds no certificate to show; see `eqt verify`")
        self.names = list(dict.fromkeys(row.name for row in self._shown))

    def rows(self, name: str) -> list[Row]:
        """The rows of a certificate, one per law where it is about laws."""
        return [row for row in self._shown if row.name == name]

    def notes(self) -> list[str]:
        """What was checked and has no number."""
        open_ends = [str(row.verdict) for row in self._shown if row.verdict not in _DECIDED]
        notes = [f"Hollow markers: {', '.join(dict.fromkeys(open_ends))}."] if open_ends else []
        if any(row.verdict is Verdict.FAILS for row in self._shown):
            notes.append("Crosses: fails.")
        for row in self._left_out:
            law = f" ({row.controller})" if row.controller else ""
            why = f", {row.remark}" if row.remark else ""
            notes.append(f"{notation(row.name)}{law}: {row.verdict}{why}.")
        return notes


class ShownReference:
    """The desired motion of an experiment, from a result or before anything is run.

    Parameters
    ----------
    source
        The open result, or the experiment.
    figure, chosen
        As for `ShownControllers`; the reference is the same for all controllers.

    Attributes
    ----------
    group
        G.
    times : (n,)
        s.
    pose : (n, d, d)
        Q_d.
    velocity, torque : (n, m)
        V_d and τ_d, body frame.

    Raises
    ------
    EqtError
        If the result is a sweep's, lacks the reference or is on a group that is not known.
    """

    def __init__(
        self, source: Result | Experiment, figure: str, chosen: Sequence[str] = ()
    ) -> None:
        self._remarks: list[str] = []
        if isinstance(source, Experiment):
            found = reference_over_horizon(source)
            self.group, self.times = source.group, found.times
            self.pose, self.velocity, self.torque = found.pose, found.velocity, found.torque
            problems = Problems(lambda path: "")
            jumps = check_reference(found, None, problems)
            self._remarks += [problem.message for problem in problems] + jumps
            return
        source.single(f"figure '{figure}' shows single experiments")
        _positions([source], figure, chosen)
        needed = ("desired_pose", "desired_velocity", "desired_torque")
        source.check_stored(*needed, who=f"figure '{figure}' needs")
        if source.group is None:
            raise _error(source, figure, f"does not know group '{source.group_name}' of a plugin")
        self.group, self.times = source.group, source.times
        self.pose, self.velocity, self.torque = (source[name] for name in needed)

    def notes(self) -> list[str]:
        """Where the reference leaves the real numbers, and where it jumps; the first places."""
        shown = [f"The reference: {remark}." for remark in self._remarks[:MOST_REMARKS]]
        left = len(self._remarks) - len(shown)
        return [*shown, f"And {left} more jumps."] if left else shown


class ShownFronts:
    """The fronts of a search with two objectives, on its held-out runs.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        As for `ShownControllers`.

    Attributes
    ----------
    fronts : list of Front
        Of the laws.
    positions : list of int
        Those of the laws in the search, on which their line styles depend.
    objectives : list of str
        The two metrics.

    Raises
    ------
    EqtError
        If the result is not of such a search, or there is no such law.
    """

    def __init__(self, results: Result, figure: str, chosen: Sequence[str] = ()) -> None:
        self.results = results
        _positions([results], figure, [label for label in chosen if label not in _laws(results)])
        record = None if results.is_sweep else record_beside(results)
        if record is None or len(record["objectives"]) < 2:
            raise _error(
                results,
                figure,
                "shows the fronts of `eqt tune` with two `objectives`; this is none",
            )
        self.objectives = list(record["objectives"])
        laws = [law["label"] for law in record["laws"]]
        found = [front for front in fronts(results, record) if not chosen or front.law in chosen]
        if not found:
            raise _error(results, figure, "finds no front with two points")
        self.fronts, self.positions = found, [laws.index(front.law) for front in found]
        self.starts = {law["label"]: results.labels.index(law["start"]) for law in record["laws"]}

    @property
    def titles(self) -> list[str]:
        """How the laws are written."""
        return [law_title(front.law) for front in self.fronts]

    def values(self, front: Front) -> list[Array]:
        """Both metrics of all winners of a law, ``(winners, runs)``."""
        rows = [self.results.labels.index(label) for label in front.labels]
        return [self.results.counted(name)[rows] for name in self.objectives]

    def start(self, front: Front) -> list[float]:
        """Both means at the starting gains of a law."""
        row = self.starts[front.law]
        return [float(self.results.means(name)[row]) for name in self.objectives]

    def notes(self) -> list[str]:
        """What a reader must know about the points."""
        return [
            f"Means over {self.results.runs} held-out runs with 95 % intervals. Hollow: points of "
            "the search that others better there. Crosses: starting gains."
        ]


def _laws(results: Result) -> list[str]:
    """The labels of the laws of a search."""
    record = None if results.is_sweep else record_beside(results)
    return [law["label"] for law in record["laws"]] if record else []


def names(results: Sequence[Result]) -> list[str]:
    """What tells results apart: their titles, else their folders, else numbers as well."""
    titles = [one.title for one in results]
    folders = [one.path.parent.resolve().name for one in results]
    for candidates in (titles, folders):
        if len(set(candidates)) == len(results):
            return candidates
    return [f"{title} ({number})" for number, title in enumerate(titles, start=1)]


def _positions(results: Sequence[Result], figure: str, chosen: Sequence[str]) -> list[list[int]]:
    """Where the chosen controllers are in each result, all if none is chosen."""
    known = list(dict.fromkeys(label for one in results for label in one.labels))
    for label in chosen:
        if label not in known:
            hint = suggestion(label, known) or f"; the result holds: {', '.join(known)}"
            raise _error(results[0], figure, f"finds no controller '{label}'{hint}")
    return [
        [k for k, label in enumerate(one.labels) if not chosen or label in chosen]
        for one in results
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


def _has_place(row: Row) -> bool:
    """Whether it has a ratio of measured to bound; 0 over 0, an exact equality, counts as 0."""
    if row.measured is None or row.bound is None:
        return False
    return row.bound != 0 or row.measured == 0


def _error(result: Result, figure: str, message: str) -> EqtError:
    return result.error(f"figure '{figure}' {message}")
