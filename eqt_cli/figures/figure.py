"""The base classes of figures, and the trajectories that they draw."""

from abc import abstractmethod
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from typing import Annotated, Any, ClassVar, Generic, Protocol, TypeVar, cast

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from pydantic import Field

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, Problems, suggestion
from eqt_cli.base.option_types import validated
from eqt_cli.base.registry import Component, Registry, blamed
from eqt_cli.base.stored import LAW_OUTPUT, MIXED
from eqt_cli.components.groups import MatrixLieGroup, known_group
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.matrix_groups import distance_of_turn, turn_of_distance
from eqt_cli.components.mechanics import Tracking
from eqt_cli.figures import layout
from eqt_cli.figures.cells import ROUNDING, prefix_units
from eqt_cli.figures.labels import force_component, in_words, signal_label
from eqt_cli.figures.layout import add_letters, add_remarks, freeze
from eqt_cli.figures.shown import (
    ALL,
    Chosen,
    DesiredMotion,
    Ensemble,
    ShownControllers,
    ShownMetrics,
    ShownReference,
    ShownSweep,
    error_of,
    names,
)
from eqt_cli.figures.style import HOUSE, Style, Width, give_letters, house_style, replaced
from eqt_cli.results.result import Result, check_stored

# Trajectories of the runs of one or several results -----------------------------------------------


NORMS = ("pose_error", "velocity_error", "torque_norm")
"""The norms of errors and torque, which also exist for the parts of a group."""


_IN_SPACE = {"pose_error_rotation": "attitude_angle", "pose_error_translation": "position_error"}


class ShownRuns(ShownControllers):
    """Trajectories of the runs that did not fail, of one or several results on one group.

    Raises
    ------
    EqtError
        In the cases of `ShownControllers`, or if a result holds no trajectories of good runs.
    """

    def __init__(self, results: Sequence[Result], figure: str, chosen: Chosen = ALL) -> None:
        super().__init__(results, figure, chosen)
        self.chosen = chosen
        for result in results:
            self._check_stored(result, "lyapunov")
            if len(result.times) < 2:
                message = (
                    "needs trajectories of two samples or more, and the result holds one; "
                    "decrease store.decimate and run the experiment again"
                )
                raise error_of(result, figure, message)
        self.ensembles = [
            replace(e, good=e.results.good[e.controller][e.results.stored_runs])
            for e in self.ensembles
        ]
        if not self.shown:
            raise self.error("has nothing to show: every run whose trajectory is stored failed")

    def with_function(self) -> list[Ensemble]:
        """Return the controllers whose L is drawn; add a remark that names the others."""
        without = ", ".join(e.title for e in self.shown if e.law in e.results.without_function)
        remark = f"Without L, since the law does not claim that it falls: {without}."
        if without and remark not in self.remarks:
            self.remarks.append(remark)
        return [e for e in self.shown if e.law not in e.results.without_function]

    @property
    def banded(self) -> list[Ensemble]:
        """The laws with a band: those in focus, else those that are compared first."""
        focus = [e for e in self.shown if e.law in map(e.results.label_of, self.chosen.focus)]
        return (focus or self.shown)[: layout.BANDS]

    @property
    def span(self) -> tuple[float, float]:
        """First and last time of all results."""
        ends = [result.times[self._samples(result)[[0, -1]]] for result in self.results]
        return float(np.min(ends)), float(np.max(ends))

    def times(self, ensemble: Ensemble) -> Array:
        """Return the sample times of a controller's runs."""
        return ensemble.results.times[self._samples(ensemble.results)]

    def _samples(self, result: Result) -> Array:
        """Return the indices of the samples that are shown."""
        return self.chosen.samples(result.times, partial(error_of, result, self.figure))

    def values(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return a signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            Largest number of runs to read, from the first; all if None.

        Raises
        ------
        EqtError
            If the result does not hold the signal over time.
        """
        return self._stored(signal, ensemble, most) * ensemble.results.factor(signal)

    def _stored(self, signal: str, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return `values` in the unit of the file."""
        self._check_stored(ensemble.results, signal)
        every = ensemble.results.trajectories(signal, ensemble.controller, most)
        return every[:, self._samples(ensemble.results)]

    def of_run(self, signal: str, ensemble: Ensemble, run: int) -> Array:
        """Return a signal of one run of a controller, ``(samples, …)``.

        Raises
        ------
        EqtError
            If the run failed, or the result does not hold its trajectory.
        """
        values: Array = ensemble.results.trajectory(signal, run)[ensemble.controller]
        if not ensemble.results.good[ensemble.controller, run]:
            raise self.error(f"cannot show run {run} of {ensemble.label}, which failed")
        return values[self._samples(ensemble.results)] * ensemble.results.factor(signal)

    def errors(
        self, signal: str, ensemble: Ensemble, *, degrees: bool, run: int | None = None
    ) -> Array:
        """Return `values` of a norm, or `of_run`; with `degrees`, angles of rotations and deg/s."""
        if run is None:
            values = self.values(signal, ensemble)
        else:
            values = self.of_run(signal, ensemble, run)
        turns = signal.replace("estimate_error", "pose_error") in self.attitude_errors
        if degrees and turns:
            _, factor = self.results[0].shown_in("", "deg")
            return np.degrees(turn_of_distance(values)) * factor
        return np.degrees(values) if degrees and self._turns_at(signal) else values

    def error_label(self, signal: str, *, degrees: bool) -> str:
        """Return the label of the scale of `errors`."""
        if signal == "attitude_angle" or (degrees and signal in self.attitude_errors):
            return in_words("attitude error", self.results[0].shown_in("", "deg")[0])
        label = signal_label(self.results[0], signal)
        return label.replace("rad/s", "deg/s") if degrees and self._turns_at(signal) else label

    def _turns_at(self, signal: str) -> bool:
        """Whether a signal is the norm of angular velocities in rad/s."""
        of_pose = signal.replace("velocity_error", "pose_error")
        turns = of_pose != signal and of_pose in self.attitude_errors
        return turns and self.unit(signal) == "rad/s"

    def solver_error(self, signal: str, drawn: Array, *, degrees: bool) -> float:
        """Return how far errors of a solver and of rounding may carry what is drawn from 0.

        The usual estimate over the runs; else the difference of the cross-check, or the tolerance.
        """
        errors = []
        for result in self.results:
            has_estimate = result.has("error_estimate")
            estimates = result.metric("error_estimate") if has_estimate else np.empty(0)
            compared = result.attributes.get("cross_check_difference") or result.described.rtol
            finite = estimates[np.isfinite(estimates)]
            errors.append(float(np.median(finite) if finite.size else compared or 0.0))
        largest = max(*errors, float(np.finfo(float).eps))
        if signal == "attitude_angle" or (degrees and signal in self.attitude_errors):
            return float(np.degrees(turn_of_distance(np.array(largest))))
        largest = np.degrees(largest) if degrees and self._turns_at(signal) else largest
        if signal == "lyapunov":  # which is quadratic, and a difference of terms of its peak
            return max(largest**2, ROUNDING * float(np.nanmax(drawn)))
        return largest

    def settled_below(self, signal: str, *, degrees: bool) -> float:
        """Return the threshold of `errors` below which runs are settled; NaN where it has none."""
        thresholds: list[Any] = [result.config.get("settling_threshold") for result in self.results]
        below, parts = thresholds[0], self.results[0].described.parts
        if self._turns_at(signal) and isinstance(below, Mapping) and "rate" in below:
            return float(np.degrees(below["rate"]) if degrees else below["rate"])
        ends = zip(self.parts, parts, strict=True) if len(self.parts) == len(parts) else ()
        part = {self.drawn_signal(f"pose_error{end}"): part for end, part in ends}.get(signal)
        if part is None or below is None or any(other != below for other in thresholds):
            return np.nan
        if isinstance(below, Mapping):
            below = below.get(part.name, np.nan)
            if self.results[0].described.axis:
                return float(np.degrees(below)) * self.results[0].factor(signal)
            below = distance_of_turn(below) if part.turns else below
        elif len(parts) > 1:
            return np.nan
        if signal == "attitude_angle" or (degrees and signal in self.attitude_errors):
            _, factor = self.results[0].shown_in("", "deg")
            return float(np.degrees(turn_of_distance(np.array(below))) * factor)
        return float(below) * self.results[0].factor(signal)

    @cached_property
    def attitude_errors(self) -> list[str]:
        """Stored norms that are distances ‖I − R‖_F of rotations, from which angles follow."""
        result, parts = self.results[0], self.results[0].described.parts
        turns = [f"_{part.name}" if len(parts) > 1 else "" for part in parts if part.turns]
        return [name for end in turns if result.is_over_time(name := f"pose_error{end}")]

    def require_attitude(self, *, degrees: bool) -> None:
        """Refuse degrees where there is no attitude error."""
        if degrees and not self.attitude_errors:
            group = self.results[0].group_name
            raise self.error(f"finds no attitude error on {group} to show in degrees")

    def desired(self, signal: str, ensemble: Ensemble) -> Array:
        """Return a signal of the reference, ``(samples, …)``: ``torque`` for τ_d."""
        self._check_stored(ensemble.results, f"desired_{signal}")
        values = self._desired(signal, ensemble)
        return values * ensemble.results.factor(f"desired_{signal}")

    def _desired(self, signal: str, ensemble: Ensemble) -> Array:
        return ensemble.results[f"desired_{signal}"][self._samples(ensemble.results)]

    def feedforward(self, ensemble: Ensemble, most: int | None = None) -> Array:
        """Return the feedforward torque of the good runs, body frame, ``(runs, samples, m)``.

        Raises
        ------
        EqtError
            If the law has no separate feedforward, the loop is not ideal, or the experiment cannot
            be built.
        """
        result = ensemble.results
        if result.described.loop:
            raise self.error(
                f"separates feedforward from feedback in ideal loops only. {result.described.loop}"
            )
        loop = result.loops[ensemble.law]
        poses, velocities = (self._stored(name, ensemble, most) for name in ("pose", "velocity"))
        desired = [self._desired(name, ensemble) for name in ("pose", "velocity", "torque")]
        torque = np.empty_like(velocities)
        for k, t in enumerate(self.times(ensemble)):
            inertia = loop.inertia.at(t)
            Qd, Vd, tau_d = (values[k] for values in desired)
            state = Tracking(
                G=loop.group,
                inertia=inertia,
                gains=loop.gains,
                t=t,
                Q=poses[:, k],
                P=inertia.momentum(velocities[:, k]),
                Qd=Qd,
                Pd=inertia.momentum(Vd),
                tau_d=tau_d,
            )
            applied = loop.controller.feedforward_torque(state)
            if applied is None:
                raise self.error(
                    f"cannot separate the feedforward of {ensemble.title}: the law does not say "
                    "which of its terms are feedforward; choose others with the option "
                    "'controllers'"
                )
            torque[:, k] = applied
        return torque * result.factor("torque")

    @cached_property
    def parts(self) -> list[str]:
        """Suffixes of the norms per part, such as ``_rotation``; else one empty suffix."""
        first = self.results[0]
        suffixes = [f"_{part}" for part in first.parts(NORMS[0])]
        return [end for end in suffixes if all(first.has(norm + end) for norm in NORMS)] or [""]

    def drawn_signal(self, error: str) -> str:
        """Return the signal that is drawn for an error, which a reader knows better.

        On SE(n), it is the attitude angle for ‖I − R_E‖ and ‖p − p_d‖ for ‖p_E‖; of `task: point`,
        the pointing error.
        """
        plain, first = _IN_SPACE.get(error, ""), self.results[0]
        if first.has("pointing_error") and error.removesuffix("_rotation") == "pose_error":
            return "pointing_error"
        return plain if plain and first.has("position_error") and first.has(plain) else error

    @cached_property
    def group(self) -> MatrixLieGroup | None:
        """The group of all results; None if it is of a plugin that is not loaded."""
        return known_group(self.results[0].group_name)

    def known_group(self) -> MatrixLieGroup:
        """Return `group`; refuse that of a plugin that is not loaded."""
        if self.group is None:
            name = self.results[0].group_name
            raise self.error(f"does not know group '{name}', which a plugin of the result defines")
        return self.group

    @cached_property
    def axes(self) -> list[tuple[str, str]]:
        """Name and torque unit of each algebra coordinate."""
        axes = [str(name) for name in self.results[0].coordinate("axis")]
        units = [self.unit("torque")] * len(axes)
        if MIXED in units:
            parts, shown_in = self.results[0].described.parts, self.results[0].shown_in
            pairs = [(shown_in("torque", part.force_unit), part.dimension) for part in parts]
            units = [unit for (unit, _), count in pairs for _ in range(count)] or units
        return list(zip(axes, units, strict=True))

    def pushed(self, wanted: Sequence[str], torques: Iterable[Array]) -> list[str]:
        """Return the wanted axes with a torque above rounding; name the others in a remark."""
        sizes = np.max([np.abs(of).max(axis=tuple(range(of.ndim - 1))) for of in torques], axis=0)
        of_axes = [(*axis, size) for axis, size in zip(self.axes, sizes, strict=True)]
        largest = {unit: max(x for _, u, x in of_axes if u == unit) for _, unit, _ in of_axes}
        still = {
            name: f"${force_component(name, unit)}$"
            for name, unit, size in of_axes
            if size <= ROUNDING * largest[unit] and name in wanted
        }
        if not 0 < len(still) < len(wanted):
            return list(wanted)
        self.remarks.append(f"Nothing pushes along {', '.join(still.values())}.")
        return [name for name in wanted if name not in still]

    def members(self, signal: str) -> list[str]:
        """Return the names of the thrusters, wheels, … or numbers of laws that have the signal.

        Raises
        ------
        EqtError
            If a vehicle has none, or its names differ from the first vehicle's.
        """
        for result in self.results:
            if not (result.has(signal) and len(result.dims(signal)) == 4):
                members = {"thrust": "thrusters", "wheel_momentum": "wheels"}.get(signal, signal)
                message = f"finds no {members} on this vehicle; leave out the option '{members}'"
                if signal == LAW_OUTPUT:
                    message = "finds no numbers of laws: none has memory, or store.memory is off"
                elif members == signal:
                    message = f"finds no signal '{signal}' with a row for each member"
                raise error_of(result, self.figure, message)
        member = self.results[0].dims(signal)[-1]
        names = [[str(name) for name in result.coordinate(member)] for result in self.results]
        if any(of_result != names[0] for of_result in names):
            raise self.error(f"has a row for each {member}, and the results have other {member}s")
        return names[0]

    def limits(self, ensemble: Ensemble, run: int, signal: str) -> tuple[Array, Array] | None:
        """Return the smallest and largest torque of each axis in a run, or signal of each member.

        None if the vehicle has no such limits.
        """
        if signal == LAW_OUTPUT:
            return None
        result = ensemble.results
        loop = result.loops[ensemble.law]
        random_of = partial(generator_at, result.described.seed, Stream.VEHICLE, run)
        flying = loop.vehicle.of_run(loop.group, random_of)
        limits = flying.range_of(signal)
        if limits is None:
            return None
        factor = ensemble.results.factor(signal)
        return limits[0] * factor, limits[1] * factor

    def notes(self) -> list[str]:
        """Return notes on loops and stored runs, then `ShownControllers.notes`."""
        loops, thinned, several = list[str](), list[str](), len(self.results) > 1
        for result, name in zip(self.results, names(self.results), strict=True):
            if words := result.described.loop:  # how it differs from the paper's ideal loop
                loops.append(f"{name}: {words}" if several else words)
            stored, whose = len(result.stored_runs), f" of {name}" if several else ""
            if stored < result.runs:
                thinned.append(f"Trajectories of the first {stored} of {result.runs} runs{whose}.")
        return [*loops, *thinned, *super().notes()]

    def _check_stored(self, result: Result, signal: str) -> None:
        check_stored(result, signal, who=f"figure '{self.figure}' needs")


# Grid of panels over time: a row for each quantity, and a column for each law ---------------------


MOST: dict[Width, int] = {"column": 4, "page": 8, "slide": 6}
"""Most laws side by side."""

LawRow = dict[str, Axes]
"""Panels of a row, by label of the law."""


def first_laws(shown: ShownControllers, most: int) -> list[Ensemble]:
    """Show only the first laws, and name the others in a remark."""
    total = len(shown.shown)
    which = f"The first {most} laws", f"first {most} of {total} laws"
    return keep_laws(shown, shown.shown[:most], *which)


def keep_laws(
    shown: ShownControllers, laws: list[Ensemble], which: str, note: str
) -> list[Ensemble]:
    """Show only these laws, name the others in a remark after `which`, and set the note."""
    labels = [e.label for e in laws]
    if others := [f"“{e.title}”" for e in shown.shown if e.label not in labels]:
        shown.ensembles, shown.note = laws, note
        shown.remarks.append(f"{which}; no room for {', '.join(others)}.")
    return laws


def law_columns(
    runs: ShownRuns,
    width: Width,
    rows: Sequence[str],
    shows: Callable[[str, Ensemble], bool] = lambda row, law: True,
) -> tuple[Drawing, dict[str, LawRow]]:
    """Return the figure and the panels of each row, which share the scale of its first panel.

    Parameters
    ----------
    rows
        Names of the rows.
    shows
        Whether a row shows a law.
    """
    laws = runs.shown
    mosaic = [[f"{row} {e.label}" if shows(row, e) else layout.EMPTY for e in laws] for row in rows]
    drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"))
    by_row = dict[str, LawRow]()
    for row in rows:
        by_row[row] = {e.label: panels[f"{row} {e.label}"] for e in laws if shows(row, e)}
        layout.share_scale(by_row[row].values())
    for k, law in enumerate(laws):
        top = next((names[k] for names in mosaic if names[k] != layout.EMPTY), layout.EMPTY)
        if top != layout.EMPTY:
            layout.add_title(panels[top], law.title)
    for axes in panels.values():
        layout.open_frame(axes)
    layout.hide_inner_scales(panels, mosaic)
    return drawing, by_row


# Base classes of figures, by the data of a result that they show ----------------------------------


class Subject(Protocol):
    """Data of results that a figure shows."""

    def notes(self) -> list[str]:
        """Return the notes for the reader about data that is not shown."""


S = TypeVar("S", bound=Subject)

_TYPED = str.maketrans({"ω": "w"})
"""Letters in names of panels, and how users type them."""


@dataclass(frozen=True)
class Figure(Component, Generic[S]):
    """A picture of results: a frozen dataclass whose fields are its options.

    Attributes
    ----------
    name
        Name after ``--figure`` and of the files.
    controllers
        Labels of the laws to show. Default: all.
    focus
        Laws in colour; the others are grey. Default: the first six.
    colours
        Colours by law, as Matplotlib names them.
    """

    needs_runs: ClassVar[bool] = True
    shows_recording: ClassVar[bool] = False
    """Whether the figure shows results, and not an experiment that has not been run."""

    controllers: Sequence[str] = ()
    focus: Sequence[str] = ()
    colours: Mapping[str, str] = field(default_factory=dict)

    def draw(
        self,
        results: Sequence[Result | DesiredMotion],
        width: Width = "column",
        *,
        style: Style | None = None,
        measured: Any = None,
        arranged: bool = True,
        captions: list[str] | None = None,
        axes: Any = None,
    ) -> Drawing:
        """Draw the data that `subject` takes from results, with remarks on what it leaves out.

        Parameters
        ----------
        results
            Open results; they may be closed afterwards. A figure without runs takes a reference.
        width
            One ``column`` of a journal (3.5 in), the ``page`` (7.16 in) or a ``slide`` (13.3 in).
        style
            Style of the figure; eqt's own if None.
        measured
            A recording on the group of the results, which some figures show beside them.
        arranged
            Whether to arrange the panels. The numbers behind the curves do not need it, and it
            takes half of the time.
        captions
            List that receives the remarks, but for a few words below the panels; all go there if
            None.
        axes
            Axes of a user's own to draw into, in the user's layout.

        Raises
        ------
        EqtError
            If an option is invalid, the results lack what the figure shows, or it cannot be drawn
            in this style.
        """
        problems = Problems(lambda path: f"figure '{self.name}'")
        validated(type(self), vars(self), problems)
        self.check(problems)
        problems.raise_if_any()
        not_run = [source.path for source in results if isinstance(source, DesiredMotion)]
        if self.needs_runs and not_run:
            others = [name for name in figures.names() if not figures.get(name).needs_runs]
            raise EqtError(
                f"{not_run[0]}: figure '{self.name}' shows results, and this is a "
                f"configuration; run it first, or draw what needs no run: {', '.join(others)}"
            )
        with house_style(replace(style or HOUSE, width=width)), replaced(layout, "own_axes", axes):
            for result in (x for x in results if isinstance(x, Result)):
                give_letters([*result.titles, *result.custom_names.values()])
            shown = self.subject(cast(Sequence[Result], results), measured)
            with blamed():
                drawing = self.compose(shown, width)
            if isinstance(drawing, layout.OwnPage):
                return drawing.finish(shown.notes())
            if axes is not None:
                raise EqtError(f"axes: figure '{self.name}' makes its own panels; leave out axes")
            add_letters(drawing)
            prefix_units(drawing.axes)
            if captions is None:
                add_remarks(drawing, shown.notes())
            else:
                captions += shown.notes()
                add_remarks(drawing, [note] if (note := getattr(shown, "note", "")) else [])
            if arranged:
                freeze(drawing)
        return drawing

    def check(self, problems: Problems) -> None:
        """Add problems of the options that their types cannot exclude."""

    @property
    def chosen(self) -> Chosen:
        """Selection of controllers and their colours."""
        return Chosen(self.controllers, self.focus, self.colours)

    def _only(self, results: Sequence[Result], what: str) -> Result:
        """Return the only result; refuse several."""
        if len(results) > 1:
            raise results[1].error(f"figure '{self.name}' shows one {what} at a time")
        return results[0]

    @abstractmethod
    def subject(self, results: Sequence[Result], measured: Any) -> S:
        """Return the data of the results that is shown."""

    @abstractmethod
    def compose(self, shown: S, width: Width) -> Drawing:
        """Draw panels and legend, within the style sheet; `draw` adds the remarks."""


@dataclass(frozen=True)
class Timed(Figure[S]):
    """A figure over time.

    Attributes
    ----------
    start, end
        Time range, s. Default: all.
    """

    start: float | None = None
    end: float | None = None

    @property
    def chosen(self) -> Chosen:
        """Selection of controllers, colours and range of time."""
        return super().chosen._replace(start=self.start, end=self.end)


@dataclass(frozen=True)
class Panelled:
    """Mixin of figures whose panels can be chosen.

    Attributes
    ----------
    panels
        Names of the panels. Default: all.
    """

    name: ClassVar[str]

    panels: Sequence[str] = ()

    def picked(self, names: Sequence[str]) -> list[str]:
        """Return the names of the panels to draw, in their order.

        Raises
        ------
        EqtError
            If there is no panel of a chosen name.
        """
        plain = {panel.translate(_TYPED): panel for panel in names}
        wanted = [plain.get(panel.translate(_TYPED), "") for panel in self.panels]
        for panel, chosen in zip(self.panels, wanted, strict=True):
            if not chosen:
                hint = suggestion(panel, list(plain)) or f"; there are: {', '.join(plain)}"
                raise EqtError(f"figure '{self.name}': panels: no panel '{panel}'{hint}")
        return [panel for panel in names if not wanted or panel in wanted]


@dataclass(frozen=True)
class OverTime(Timed[ShownRuns]):
    """A figure of trajectories, of one result or several."""

    def subject(self, results: Sequence[Result], measured: Any) -> ShownRuns:
        """Return the runs that did not fail."""
        return ShownRuns(results, self.name, self.chosen)


@dataclass(frozen=True)
class OfMetrics(Figure[ShownMetrics]):
    """A figure of metrics of single runs, of one result or several; it needs no trajectories.

    Attributes
    ----------
    metrics
        Names of metrics in the result. Default: a selection.
    """

    metrics: Sequence[str] = ()

    def subject(self, results: Sequence[Result], measured: Any) -> ShownMetrics:
        """Return the metrics of the runs that did not fail."""
        return ShownMetrics(results, self.name, self.chosen, self.metrics)


@dataclass(frozen=True)
class OfSweep(Figure[ShownSweep]):
    """A figure of the metrics of one sweep."""

    def subject(self, results: Sequence[Result], measured: Any) -> ShownSweep:
        """Return the points and the metrics at each."""
        return ShownSweep(self._only(results, "sweep"), self.name, self.chosen)


@dataclass(frozen=True)
class OfOneMetric(OfSweep):
    """A figure of one metric of a sweep.

    Attributes
    ----------
    metric
        Name of a metric in the result. Default: the error that laws are compared by, the rms of ‖p
        − p_d‖, the mean attitude angle, or the mean pose error.
    """

    metric: str = ""

    def metric_of(self, swept: ShownSweep) -> str:
        """Return the name of the metric that is shown."""
        return self.metric or swept.error_metric


@dataclass(frozen=True)
class OfDifferences(OfOneMetric):
    """A figure of differences between laws in one metric of a sweep.

    Attributes
    ----------
    confidence
        Confidence of each interval; of a map, 1 minus the probability of any false win.
    """

    confidence: Annotated[float, Field(gt=0, lt=1)] = 0.95


@dataclass(frozen=True)
class OfReference(Timed[ShownReference]):
    """A figure of the desired motion, of one result or of an experiment before it is run."""

    needs_runs: ClassVar[bool] = False

    def subject(self, results: Sequence[Result | DesiredMotion], measured: Any) -> ShownReference:
        """Return the reference in the chosen range of time."""
        if len(results) > 1:
            raise EqtError(f"figure '{self.name}' shows one reference at a time")
        return ShownReference(results[0], self.name, self.chosen)


# In this module, so that a plugin that imports the base class is registered here.
figures = Registry(
    "figure",
    "figures",
    Figure,
    tuple(f"figures.{x}_figures" for x in "time run comparison sweep".split()),
)
