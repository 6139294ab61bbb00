"""Figures over time: a summary, the paper's, torque, commands and the reference."""

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.option_types import CountOrNone
from eqt_cli.base.reporting import listed, significant
from eqt_cli.base.stored import LAW_OUTPUT, OUTPUT
from eqt_cli.figures import layout
from eqt_cli.figures.cells import Prefixed, number_text, prefix_units, scale_norm, spans_decade
from eqt_cli.figures.figure import (
    MOST,
    NORMS,
    LawRow,
    OfReference,
    OverTime,
    Panelled,
    ShownRuns,
    first_laws,
    law_columns,
)
from eqt_cli.figures.labels import (
    axis_labels,
    force_component,
    free_text,
    in_words,
    part_curves,
    part_name,
    quantity,
)
from eqt_cli.figures.layout import (
    add_legend,
    add_title,
    bound,
    cut_off,
    draw_middle,
    leaving,
    name_scale,
    open_frame,
    sheet,
)
from eqt_cli.figures.many_laws import draw_laws, limit_look, mark_settled
from eqt_cli.figures.shown import MOST_COLOURS, Ensemble, ShownReference, names
from eqt_cli.figures.style import Width, component_style, ink, line_style
from eqt_cli.results.summary import repeats

# Errors, torque norm and L over all runs, and the same as the paper prints them -------------------


_FUNCTION = "lyapunov"
_NAMES = dict(zip(NORMS, ("pose error", "velocity error", "torque norm"), strict=True))
_NAMES[_FUNCTION] = "Lyapunov function"
_DECADES = 100.0
"""Largest value over the smallest from which a scale is logarithmic."""
_TITLES = {
    "pose_error": ("attitude error", "position error", "pose error", "{} error"),
    "velocity_error": ("rate error", "velocity error", "velocity error", "{} rate error"),
    "torque_norm": ("torque", "force", "torque", "{} force"),
}
"""Names of norms in words: of a rotation, of the only vector beside one, of a whole, of a part."""


@dataclass(frozen=True)
class Summary(Panelled, OverTime):
    """Medians over runs of pose error, velocity error, torque norm and Lyapunov function.

    The function is left out where laws have different ones, which cannot be compared. The shading
    holds the middle half of the runs of the laws in focus, else of the first two. Scales are
    logarithmic where medians span two decades; they end a decade below the medians, or at the error
    of the solver, and ten times above all other laws where a law diverges. Thin dashes mark the
    threshold of `settled`. Laws of one curve are named, and a panel shows their paired differences.
    Of more than six laws, the first quantity is drawn, a panel for each law, before the medians of
    the others.

    Where rotation and translation have units of their own, the norms of both are shown, side by
    side, instead of the mixed ones. The errors of a rigid motion are the angle of its attitude and
    the distance of its position.

    Attributes
    ----------
    log
        Logarithmic or linear scales; of the torque, logarithmic only if it spans a decade.
    degrees
        Attitude error as an angle in degrees, its rate in deg/s. Default: where there is one.
    """

    name: ClassVar[str] = "summary"
    printed: ClassVar[bool] = False
    """Whether means are drawn, in frames without titles."""

    log: bool | None = None
    degrees: bool | None = None

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw two by two panels, or a row per norm and a column per part."""
        runs.require_attitude(degrees=bool(self.degrees))
        degrees = bool(runs.attitude_errors) if self.degrees is None else self.degrees
        one_function = not any(result.lyapunov_functions for result in runs.results)
        has_function = bool(self.panels) or self.printed or one_function
        norms = self.picked((*NORMS, _FUNCTION) if has_function else NORMS)
        if len(runs.shown) > MOST_COLOURS and not self.printed:
            signal = norms[0] if norms[0] != NORMS[0] else ""
            return draw_laws(runs, width, signal, degrees=degrees and not signal, log=self.log)
        drawing = self._draw(runs, width, norms, degrees)
        several = any(np.count_nonzero(e.good) > 1 and not repeats(e.results) for e in runs.shown)
        middle = "mean" if self.printed else "median"
        if not self.printed:
            over = "Medians over runs of" if several else "One run:"
            drawing.set_label(f"{over} {listed([_NAMES[norm] for norm in norms])}.")
        bounded = runs.banded if len(runs.shown) > len(runs.banded) else []
        of = f" of {listed([e.title for e in bounded])}" if bounded else ""
        bands = "" if self.printed else f", quartiles{of}"
        alike = not several and any(np.count_nonzero(e.good) > 1 for e in runs.shown)
        over = f"{middle}{bands}, " if several else ""
        counted = f"{over}{runs.count()}{', all alike' if alike else ''}"
        runs.remarks.append(f"Curves: {counted}.")
        runs.note = ", ".join(filter(None, [counted if several or alike else "", runs.note]))
        return drawing

    def _draw(self, runs: ShownRuns, width: Width, norms: list[str], degrees: bool) -> Drawing:
        parts = runs.parts
        rows = [
            [runs.drawn_signal(norm + end) for end in parts] for norm in norms if norm != _FUNCTION
        ]
        alike = {} if self.printed or not rows else self._one_curve(runs, rows[0], degrees)
        differences = {signal: f"difference of {signal}" for signal in alike}
        if len(parts) > 1:
            mosaic = [*rows, *([_FUNCTION] * len(parts) for norm in norms if norm == _FUNCTION)]
            if alike:
                mosaic.append([differences.get(signal, layout.EMPTY) for signal in rows[0]])
        else:
            shown = [*(row[0] for row in rows), *norms[len(rows) :], *differences.values()]
            mosaic = layout.rows_of(shown, 2)
        drawing, panels = layout.sheet(width, mosaic, runs.span, runs.unit("time"))
        for signal, laws in alike.items():
            _draw_difference(panels.pop(differences[signal]), runs, signal, laws, degrees)
        for signal, axes in panels.items():
            for e in runs.with_function() if signal == _FUNCTION else runs.shown:
                values = runs.errors(signal, e, degrees=degrees)
                middle = "quartiles" if e in runs.banded else "median"
                draw_middle(axes, runs.times(e), values, e, "mean" if self.printed else middle)
        far = leaving(runs, map(_by_label, panels.values())) if self.printed else set[str]()
        for signal, axes in panels.items():
            cut_off(axes, far)
            self._scale(axes, signal, runs, degrees)
            if not self.printed:
                open_frame(axes)
                layout.add_title(axes, _title(runs, signal))
                mark_settled(runs, signal, [axes], degrees)
        if rows and self.printed:
            for signal, part in zip(rows[0], parts, strict=True):
                layout.add_title(panels[signal], part_name(part))
        lines = max(panels.values(), key=lambda axes: len(axes.lines)).lines
        whole = len(runs.shown) // len(runs.results)
        layout.add_legend(drawing, lines, [e.title for e in runs.shown], whole)
        return drawing

    def _one_curve(
        self, runs: ShownRuns, signals: Sequence[str], degrees: bool
    ) -> dict[str, list[Ensemble]]:
        """Return the laws that look alike by the error in which they do, and say who they are."""
        alike, within = dict[str, list[Ensemble]](), dict[str, list[str]]()
        for signal in signals if len(runs.shown) > 1 else []:
            errors = [runs.errors(signal, e, degrees=degrees) for e in runs.shown]
            middles = [np.median(of_law, axis=0) for of_law in errors]
            drawn, scaled = np.concatenate(middles), middles
            if self._is_log(runs, signal, drawn, degrees):
                least = runs.solver_error(signal, drawn, degrees=degrees)
                scaled = [np.log10(np.maximum(middle, least)) for middle in middles]
            if len(laws := _alike(runs, scaled)) > 1:
                of_laws = [middles[runs.shown.index(e)] for e in laws]
                size = float(np.ptp(of_laws, axis=0).max())
                unit = "deg" if degrees and signal in runs.attitude_errors else runs.unit(signal)
                words = f"medians within {significant(size, 1)} {unit}".removesuffix(" 1")
                if size < _ROUNDING * np.max(of_laws):
                    words = "equal to rounding"
                else:  # a panel shows the paired differences
                    alike[signal] = laws
                titles = listed([e.title for e in laws])
                within.setdefault(titles, []).append(words.replace("e-", "e−"))
        # The note names them, where long names are wrapped.
        one = [f"{x}: one curve ({' and '.join(y)})" for x, y in within.items()]
        runs.note = ", ".join(filter(None, [*one, runs.note]))
        return alike

    def _is_log(self, runs: ShownRuns, signal: str, drawn: Array, degrees: bool) -> bool:
        """Whether a scale is logarithmic: if asked, else if curves span two decades."""
        if self.log is not None:
            return self.log
        seen = np.maximum(drawn, runs.solver_error(signal, drawn, degrees=degrees))
        return bool(seen.max() > _DECADES * seen.min())

    def _scale(self, axes: Axes, signal: str, runs: ShownRuns, degrees: bool) -> None:
        drawn = np.concatenate([line.get_ydata() for line in axes.lines])
        log, torque = self._is_log(runs, signal, drawn, degrees), signal.startswith("torque_norm")
        error = runs.solver_error(signal, drawn, degrees=degrees)
        scale_norm(axes, log=log and (not torque or spans_decade(drawn)))
        label = runs.error_label(signal, degrees=degrees)
        if not self.printed:
            bound(axes, error, {e.label: e.title for e in runs.shown})
            label = label.replace("attitude error", "angle")  # the title says which
        layout.name_scale(axes, label)


@dataclass(frozen=True)
class Paper(Summary):
    """Figure 3 of Hampsey et al. (2025) as printed, on any group: means on linear scales.

    Norms of rotation and translation stand side by side where they have units of their own.

    Attributes
    ----------
    degrees
        Attitude error as an angle in degrees, its rate in deg/s.
    """

    name: ClassVar[str] = "paper"
    printed: ClassVar[bool] = True

    log: bool | None = False
    degrees: bool | None = False


def _alike(runs: ShownRuns, scaled: Sequence[Array]) -> list[Ensemble]:
    """Return the most laws whose curves on a scale are nearly always within a line of one law's."""
    line = _A_LINE * float(np.ptp(np.concatenate(scaled)))
    groups: list[list[Ensemble]] = []
    for first, of_first in zip(runs.shown, scaled, strict=True):
        pairs = [
            (e, np.quantile(np.abs(other - of_first), _NEARLY))
            for e, other in zip(runs.shown, scaled, strict=True)
            if other.shape == of_first.shape and np.array_equal(e.good, first.good)
        ]
        groups.append([e for e, apart in pairs if apart < line])
    return max(groups, key=len)


def _draw_difference(
    axes: Axes, runs: ShownRuns, signal: str, laws: Sequence[Ensemble], degrees: bool
) -> None:
    """Draw the paired differences of laws from the first: medians, of two laws with quartiles."""
    first, *others = laws
    of_first = runs.errors(signal, first, degrees=degrees)
    axes.axhline(0.0, label=layout.NO_NUMBERS, **limit_look())
    for law in others:
        apart = runs.errors(signal, law, degrees=degrees) - of_first
        draw_middle(axes, runs.times(law), apart, law, "median" if others[1:] else "quartiles")
    open_frame(axes)
    layout.add_title(axes, f"{others[0].title if not others[1:] else 'others'} − {first.title}")
    label = runs.error_label(signal, degrees=degrees)
    layout.name_scale(axes, label.replace("attitude error", "paired difference"))


def _by_label(axes: Axes) -> dict[str, Array]:
    """Return the sizes along each curve of a panel."""
    return {str(x.get_label()): np.abs(np.asarray(x.get_ydata(), float)) for x in axes.lines}


def _title(runs: ShownRuns, signal: str) -> str:
    """Return a signal in words; nothing where the user's own name is on the scale."""
    if signal in runs.results[0].custom_names:
        return ""
    norm = next((norm for norm in NORMS if signal.startswith(norm)), "")
    if not norm:
        others = {"attitude_angle": "attitude error", _FUNCTION: "Lyapunov function"}
        return others.get(signal, signal.replace("_", " "))
    suffix, parts = signal.removeprefix(norm), runs.results[0].described.parts
    part = next((part for part in parts if f"_{part.name}" == suffix or len(parts) == 1), None)
    of_rotation, of_vector, whole, of_part = _TITLES[norm]
    if part is not None and part.turns:
        return of_rotation
    if part is not None and suffix and len(parts) == 2 and part.pose_unit == "m":
        return of_vector
    return of_part.format(part_name(suffix)) if suffix else whole


# Figure of torque components: root mean squares over runs of every law, a panel per axis ----------


_DESIRED: dict[str, Any] = {"linewidth": 2.2, "zorder": 1.5}
_PALE = 0.25
"""Share of ink in the reference torque, which lies behind the curves."""
_MOST_RUNS = 1000
"""Largest number of runs of a law, from the first, whose torques are drawn."""
_ACROSS = 3
"""Most axes of a part side by side on a page."""


@dataclass(frozen=True)
class Torque(Panelled, OverTime):
    """Root mean square over runs of the torque, a panel per axis of the body.

    Of a single run, the torque itself. Forces have panels of their own. The torque of the reference
    is drawn beside the whole torque and the feedforward. Of more than six laws, the norm of the
    whole torque is drawn, a panel for each law.

    Attributes
    ----------
    share
        ``total``; ``feedforward``, the part without gains, of laws where it is known in an ideal
        loop; or ``feedback``, the rest.
    """

    name: ClassVar[str] = "torque"

    share: Literal["total", "feedback", "feedforward"] = "total"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a panel per axis."""
        if len(runs.shown) > MOST_COLOURS and self.share == "total" and not self.panels:
            return draw_laws(runs, width, "torque_norm")
        shown = first_laws(runs, MOST_COLOURS)
        values = {e.label: self._share_of(runs, e) for e in shown}
        wanted = self.picked([name for name, _ in runs.axes])
        wanted = runs.pushed(wanted, values.values()) if not self.panels else wanted
        units = {name: unit for name, unit in runs.axes if name in wanted}
        several = max(map(len, values.values())) > 1
        share = "" if self.share == "total" else f"{self.share} "
        over = f"root mean square of the {share or 'torque '}over " if several else ""
        counted = f"{over}{runs.count(_MOST_RUNS)}"
        runs.remarks.append(f"Curves: {counted}.")
        runs.note = ", ".join(filter(None, [counted if several else "", runs.note]))
        drawing, panels = layout.sheet(width, _places(units, width), runs.span, runs.unit("time"))
        for k, (name, _) in enumerate(runs.axes):
            if name in wanted:
                for ensemble in runs.shown:
                    component = values[ensemble.label][..., k]
                    shown = np.sqrt(np.mean(component**2, axis=0)) if several else component[0]
                    look = line_style(ensemble.look)
                    panels[name].plot(runs.times(ensemble), shown, label=ensemble.label, **look)
        lines = panels[wanted[0]].lines
        handles: dict[str, Artist] = dict(zip((e.title for e in runs.shown), lines, strict=False))
        sizes = [*map(_by_label, panels.values())]
        if self.share != "feedback":
            handles |= _draw_desired(runs, panels, signed=not several)
        far = leaving(runs, sizes)
        for axes in panels.values():
            cut_off(axes, far)
            open_frame(axes)
            if several:
                axes.set_ylim(bottom=0)
        for name, unit in units.items():
            label = quantity(force_component(name, unit), unit)
            layout.name_scale(panels[name], f"{'rms ' if several else ''}{share}{label}")
        layout.add_legend(drawing, list(handles.values()), list(handles))
        what = "Root mean square over runs of the" if several else "The"
        drawing.set_label(f"{what} {share}torque, a panel per axis of the body.")
        return drawing

    def _share_of(self, runs: ShownRuns, ensemble: Ensemble) -> Array:
        """Return the share of a law's torques that is drawn, ``(runs, samples, axes)``."""
        if self.share == "feedforward":
            return runs.feedforward(ensemble, _MOST_RUNS)
        torque = runs.values("torque", ensemble, _MOST_RUNS)
        return torque if self.share == "total" else torque - runs.feedforward(ensemble, _MOST_RUNS)


def _draw_desired(
    runs: ShownRuns, panels: Mapping[str, Axes], *, signed: bool
) -> dict[str, Artist]:
    """Draw the reference torque of each result in every panel; return the last line by name."""
    line: Artist = Line2D([], [])
    places = [name for name, _ in runs.axes]
    for result, name in zip(runs.results, names(runs.results), strict=True):
        first = next((e for e in runs.shown if e.results is result), None)
        if first is None:
            continue
        desired = runs.desired("torque", first)
        ends = runs.limits(first, 0, "torque")
        label = f"desired, {name}" if len(runs.results) > 1 else "desired"
        look: dict[str, Any] = {"label": label, "color": ink(_PALE), **_DESIRED}
        for axis, panel in panels.items():
            drawn = desired[:, k := places.index(axis)]
            if ends is not None and ends[0][k] == ends[1][k] == 0:
                continue  # no vehicle could give it
            (line,) = panel.plot(runs.times(first), drawn if signed else abs(drawn), **look)
    is_torque = len({unit for _, unit in runs.axes}) == 1
    return {quantity(r"\tau_d", "") if is_torque else "reference": line}


def _places(axes: Mapping[str, str], width: Width) -> layout.Mosaic:
    """Return the panels by axis, with torques and forces in separate rows or columns."""
    units = dict.fromkeys(axes.values())
    parts = [[axis for axis, of in axes.items() if of == unit] for unit in units]
    if width != "column":
        across = min(_ACROSS, max(map(len, parts)))
        rows = [row for part in parts for row in layout.rows_of(part, across)]
        return [row + [layout.EMPTY] * (across - len(row)) for row in rows]
    if len(parts) == 1:
        return [[axis] for axis in parts[0]]
    tallest = max(map(len, parts))
    return [[part[k] if k < len(part) else layout.EMPTY for part in parts] for k in range(tallest)]


# Figure of commanded and delivered torque, thrust or momentum of wheels in a single run -----------


_A_LINE, _NEARLY, _ROUNDING = 0.01, 0.9, 1e-12
"""Share of a scale by which curves in one line are apart, share of the samples in which they are
in one line that look alike, and least difference that is no rounding, over the largest value."""
_COMMAND: dict[str, Any] = {"linewidth": 2.0, "zorder": 1.6, "solid_capstyle": "butt"}
_ASKED = 0.4
"""Share of ink in what a law asks for, behind what the actuators give."""
_ANY = 0.7
"""Share of ink in the grey that stands for every controller's colour in the legend."""
_SHADE = 0.13
"""Share of ink in the shading behind the curves."""
_SEEN = 2.0
"""Multiple of the largest torque in a row up to which its limits are drawn."""
_BRIEF, _SPIKE = 0.02, 0.75
"""Share of the samples of a row that do not set its scale where they lie outside of the others by
more than this share of their range."""
_WORTH = 2.0
"""Least range of all samples, over that of the scale without its peaks, for which they leave it."""
NEAR = 1e-6
"""Relative tolerance within which a limit counts as reached."""
LEAST_SHADE = 0.02
"""Least width of the shading at a limit, as a share of the time: less is not seen."""
Limits = tuple[Array, Array] | None

_OUTPUT = {"torque": "given", "wheel_momentum": "momentum", LAW_OUTPUT: "number of the law"}
_STEP = 0.03
"""Least step of a curve that counts, as a share of its range."""
_MOST_TURNS, _BINS = 200, 150
"""Most turns of a curve in a panel, and parts of a range over time."""
_SKIPPED = 1.5
"""Periods of the control between two samples from which they hide what is between them."""
_BEYOND = "limits beyond some scales: "
_FEW = 4
"""Most thrusters or wheels with curves; of more, a map shows which share of a limit they take."""
_MOST_PANELS = 12
"""Most panels of axes; of more, a row shows the norm over the axes of a part."""
_MOST_NAME = 12
"""Most characters in a line of the name of a thruster."""


@dataclass(frozen=True)
class Commands(Panelled, OverTime):
    """Commands of a law and outputs of its actuators in one run; shaded: at a limit.

    A row per axis and a column per law, with the limits of each axis. Limits of other kinds,
    such as of the norm, shade all axes. Instead of more than twelve panels, a row shows the norm of
    a part; of more than four thrusters or wheels, a panel per law shows which share of its limit
    each one takes, and when. The option `panels` draws chosen ones.

    Attributes
    ----------
    run
        Number of the run.
    thrusters
        Show thrusts instead, one row each.
    wheels
        Show wheel momenta instead, one row each.
    law_outputs
        Show the memory and other outputs of each law instead, one row each.
    signal
        Show a signal of thrusters, wheels, gyros, … by its name instead, such as gimbal_angle.
    """

    name: ClassVar[str] = "commands"

    run: CountOrNone = 0
    thrusters: bool = False
    wheels: bool = False
    law_outputs: bool = False
    signal: str = ""

    @property
    def _signal(self) -> str:
        """The signal whose rows are shown."""
        chosen = {"thrust": self.thrusters, "wheel_momentum": self.wheels}
        chosen[LAW_OUTPUT] = self.law_outputs
        wanted = (signal for signal, is_wanted in chosen.items() if is_wanted)
        return next(wanted, self.signal or "torque")

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row with its own scale per axis, and a column per law."""
        signal = self._signal
        if signal == "torque" and not any(e.results.has("command") for e in runs.shown):
            raise runs.error(
                "finds no actuators in this loop, so what a law asks for is what acts; figure "
                "'torque' shows it"
            )
        axes, units = self._rows(runs), dict(runs.axes)
        if loads := self._loads(runs, width, list(axes)):
            return loads
        if signal != LAW_OUTPUT:
            first_laws(runs, MOST[width])
            self._note_sampling(runs)
        if self._is_grouped(runs):
            units = {f"torque_norm{end}": runs.unit(f"torque_norm{end}") for end in runs.parts}
            axes = {name: runs.error_label(name, degrees=False) for name in units}
            runs.remarks.append("Norms over the axes of a part; option 'panels' draws axes.")
        members = self._with_values(runs, list(axes))
        places = {name: list(axes).index(name) for name in self.picked(members)}
        drawing, rows = self._panels(runs, width, places)
        kinds, peaks = set[str](), dict[tuple[Axes, float], str]()
        for name, k in places.items():
            name_scale(next(iter(rows[name].values())), axes[name])
            row = [e for e in runs.shown if e.label in rows[name]]
            reach = self._reach(runs, row, k)
            for e in row:
                panel = rows[name][e.label]
                kinds |= self._fill(panel, runs, e, k, reach)
                panel.tick_params(labelbottom=name == [*places][-1])
            if signal == "torque":
                peaks |= dict.fromkeys(_bound_spikes(rows[name].values()), units[name])
        prefix_units(drawing.axes)
        for (panel, peak), unit in peaks.items():
            _write_peak(panel, peak, unit)
            kinds.add("spike")
        self._add_legend(drawing, runs, kinds)
        return drawing

    def _is_grouped(self, runs: ShownRuns) -> bool:
        """Whether there are too many axes and laws for a panel each."""
        panels = 0 if self.panels or self._signal != "torque" else len(runs.axes) * len(runs.shown)
        return panels > _MOST_PANELS

    def _with_values(self, runs: ShownRuns, members: list[str]) -> list[str]:
        """Return the axes along which something pushes, or the numbers that a law holds."""
        if self._signal == "torque" and not self.panels and not self._is_grouped(runs):
            return runs.pushed(members, [of for e in runs.shown for of in self._values(runs, e)])
        if self._signal == LAW_OUTPUT:
            held = np.any([self._holds(runs, e) for e in runs.shown], axis=0)
            return [name for name, is_held in zip(members, held, strict=True) if is_held]
        return members

    def _reach(self, runs: ShownRuns, row: Sequence[Ensemble], k: int) -> float:
        """Return up to where limits are drawn; of thrusters and wheels they always are."""
        if self._signal not in ("torque", LAW_OUTPUT):
            return np.inf
        outputs = np.array([np.abs(self._values(runs, e)[0][:, k]).max() for e in row])
        return float(_SEEN * np.max(outputs, initial=0.0, where=np.isfinite(outputs)))

    def _loads(self, runs: ShownRuns, width: Width, members: list[str]) -> Drawing | None:
        """Return a map of many thrusters or wheels with limits; None for others."""
        chosen = {name: members.index(name) for name in self.picked(members)}
        if self._signal in ("torque", LAW_OUTPUT) or len(chosen) <= _FEW:
            return None
        limited = all(runs.limits(e, self.run, self._signal) is not None for e in runs.shown)
        draws = functions_for(purposes.figure_of_loads) if limited else ()
        return next((draw(runs, width, chosen, self._signal, self.run) for draw in draws), None)

    def _rows(self, runs: ShownRuns) -> dict[str, str]:
        """Return the labels of axes, thrusters, wheels or numbers of laws; drop laws without."""
        if self._signal == "torque":
            return {name: quantity(force_component(name, unit), unit) for name, unit in runs.axes}
        names, signal = runs.members(self._signal), self._signal
        units = [runs.unit(signal)] * len(names)
        if signal == LAW_OUTPUT:
            units = runs.results[0].units(OUTPUT).split("; ")
            runs.ensembles = [e for e in runs.shown if self._holds(runs, e).any()]
            if not runs.ensembles:
                raise runs.error("finds no numbers of these laws, which have no memory")
        labels = dict[str, str]()
        for name, unit in zip(names, units, strict=True):
            words = name.replace("_", " ") if signal == LAW_OUTPUT else name
            labels[name] = in_words(free_text(words, _MOST_NAME), unit)
        return labels

    def _holds(self, runs: ShownRuns, ensemble: Ensemble) -> Array:
        """Return which of the numbers of all laws a law holds."""
        held: Array = np.any(np.isfinite(runs.of_run(LAW_OUTPUT, ensemble, self.run)), axis=0)
        return held

    def _panels(
        self, runs: ShownRuns, width: Width, places: Mapping[str, int]
    ) -> tuple[Drawing, dict[str, LawRow]]:
        """Return the figure and its panels: a column per law, or one for numbers of laws."""
        if self._signal != LAW_OUTPUT:
            return law_columns(runs, width, list(places))
        drawing, panels = sheet(width, [[name] for name in places], runs.span, runs.unit("time"))
        rows: dict[str, LawRow] = {}
        for name, k in places.items():
            laws = [e for e in runs.shown if self._holds(runs, e)[k]]
            rows[name] = {e.label: panels[name] for e in laws}
        return drawing, rows

    def _values(self, runs: ShownRuns, ensemble: Ensemble) -> tuple[Array, Array]:
        """Return what axes, parts, thrusters or wheels give, and what the law asks for."""
        output, command = self._along_axes(runs, ensemble)
        if not self._is_grouped(runs):
            return output, command
        parts = runs.results[0].described.parts if len(runs.parts) > 1 else []
        ends = np.cumsum([part.dimension for part in parts])[:-1]
        norms = [
            np.array([np.linalg.norm(of, axis=1) for of in np.split(values, ends, axis=1)]).T
            for values in (output, command)
        ]
        return norms[0], norms[1]

    def _along_axes(self, runs: ShownRuns, ensemble: Ensemble) -> tuple[Array, Array]:
        output = runs.of_run(self._signal, ensemble, self.run)
        if self._signal == "torque" and ensemble.results.has("command"):
            return output, runs.of_run("command", ensemble, self.run)
        return output, output

    def _at_limit(self, runs: ShownRuns, ensemble: Ensemble, k: int, ends: Limits) -> Array:
        """Return at which samples an axis, any axis of a norm, a thruster or a wheel is at one."""
        command = self._along_axes(runs, ensemble)[1]
        if ends is not None:
            low, high = ends
            beyond = command <= low + NEAR * np.abs(low)
            beyond |= command >= high - NEAR * np.abs(high)
            return np.any(beyond, axis=1) if self._is_grouped(runs) else beyond[:, k]
        if ensemble.results.has("at_limit") and self._signal == "torque":
            return runs.of_run("at_limit", ensemble, self.run) > 0
        return np.zeros(len(command), dtype=bool)

    def _note_sampling(self, runs: ShownRuns) -> None:
        """Note that commands change between samples."""
        for e in runs.shown:
            control, stored = e.results.loops[e.law].vehicle.control, np.diff(runs.times(e))[0]
            if control and stored > _SKIPPED * control.period:
                words = f"Stored every {stored:.3g} s, commanded every {control.period:.3g} s"
                runs.remarks.append(f"{words}: faster motion is not seen.")
                return

    def _fill(
        self, axes: Axes, runs: ShownRuns, ensemble: Ensemble, k: int, reach: float
    ) -> set[str]:
        """Draw one axis, thruster or wheel of a controller; shade where it is at a limit.

        Return the names of what the legend explains.
        """
        times, signal = runs.times(ensemble), self._signal
        output, command = (value[:, k] for value in self._values(runs, ensemble))
        ends = runs.limits(ensemble, self.run, signal)
        beyond = self._at_limit(runs, ensemble, k, ends)
        low, high = -np.inf, np.inf
        if ends is not None and not self._is_grouped(runs):
            low, high = float(ends[0][k]), float(ends[1][k])
        for start, end in stretches(times, beyond):
            end = max(end, start + LEAST_SHADE * float(np.ptp(runs.span)))
            axes.axvspan(start, end, facecolor=ink(_SHADE), linewidth=0, zorder=0)
        kinds = {"at a limit"} if beyond.any() else set()
        ends_there = [(k, end) for k, end in enumerate((low, high)) if np.isfinite(end)]
        if any(abs(end) <= reach for _, end in ends_there):
            kinds.add("limit")
            for number, end in ends_there:
                axes.axhline(end, label=f"limit {number}", **limit_look())
        elif len(ends_there) == 2 and reach:
            unit = runs.axes[k][1] if signal == "torque" else runs.unit(signal)
            text = f"±{high:.3g}" if low == -high else f"{low:.3g} to {high:.3g}"
            kinds.add(f"{_BEYOND}{text} {unit}".replace("-", "−"))
        label = _OUTPUT.get(signal, signal.replace("_", " "))
        fast = _draw(axes, times, output, color=ensemble.look.colour, label=label)
        if signal == "torque":
            held = ensemble.results.loops[ensemble.law].vehicle.control
            look = _COMMAND | {"drawstyle": "steps-post" if held else "default"}
            fast |= _draw(axes, times, command, color=ink(_ASKED), label="asked", **look)
        return kinds | {"range"} if fast else kinds

    def _add_legend(self, drawing: Drawing, runs: ShownRuns, kinds: set[str]) -> None:
        alone = runs.shown[0].look.colour if len(runs.shown) == 1 else ink(_ANY)
        words = {**_OUTPUT, "torque": "given by the actuators"}
        output = words.get(self._signal, self._signal.replace("_", " "))
        handles: dict[str, Artist] = {output: Line2D([], [], color=alone)}
        if self._signal == LAW_OUTPUT:
            handles = {e.title: Line2D([], [], color=e.look.colour) for e in runs.shown}
        if self._signal == "torque":
            handles["asked by the law"] = Line2D([], [], color=ink(_ASKED), **_COMMAND)
        if "range" in kinds:
            handles["range within each drawn step"] = Patch(**_range({"color": alone}))
        if "limit" in kinds:
            handles["limit"] = Line2D([], [], **limit_look())
        if "at a limit" in kinds:
            handles["at a limit"] = Patch(facecolor=ink(_SHADE), linewidth=0)
        add_legend(drawing, list(handles.values()), list(handles))
        ends = [x.removeprefix(_BEYOND) for x in sorted(kinds) if x.startswith(_BEYOND)]
        beyond = [f"{_BEYOND}{', '.join(ends)}"] if ends else []
        notes = [*beyond, *(["numbers: brief peaks beyond the scale"] if "spike" in kinds else [])]
        runs.remarks += [f"{note[0].upper()}{note[1:]}." for note in [*notes, f"run {self.run}"]]
        runs.note = ", ".join(filter(None, [f"run {self.run}", *notes, runs.note]))
        if self._is_grouped(runs):
            drawing.set_label("Norms of commands and outputs in one run; shaded: at a limit.")
        elif self._signal != "torque":
            member = runs.results[0].dims(self._signal)[-1].replace("_", " ")
            drawing.set_label(f"The {output} of each {member} in one run; shaded: at a limit.")


def _bound_spikes(panels: Iterable[Axes]) -> list[tuple[Axes, float]]:
    """Set the scale that panels share by what lasts; return the brief peaks beyond it."""
    curves = {axes: [np.asarray(x.get_ydata(), float) for x in axes.lines] for axes in panels}
    for axes, drawn in curves.items():
        drawn += [np.asarray(x.get_paths()[0].vertices)[:, 1] for x in axes.collections]
    sampled = np.concatenate([y for of in curves.values() for y in of if len(y) > 2])
    seen = sampled[np.isfinite(sampled)]
    if not seen.size:
        return []
    low, high = np.quantile(seen, (_BRIEF / 2, 1 - _BRIEF / 2))
    ends = [y for of in curves.values() for y in of if len(y) == 2]  # limits
    low, high = (f([end, *map(f, ends)]) for f, end in ((np.min, low), (np.max, high)))
    room = _SPIKE * (high - low)
    if not (seen.min() < low - room or seen.max() > high + room) or room == 0:
        return []
    bottom, top = max(seen.min(), low - room), min(seen.max(), high + room)
    if np.ptp(seen) < _WORTH * (top - bottom):
        return []
    beyond = []
    for axes, drawn in curves.items():
        axes.set_ylim(bottom, top)
        peaks = [float(f(y[np.isfinite(y)])) for f in (np.max, np.min) for y in drawn if len(y) > 2]
        outer = (max(peaks, default=0.0), min(peaks, default=0.0))
        beyond += [(axes, peak) for peak in outer if not bottom <= peak <= top]
    return beyond


def _write_peak(axes: Axes, peak: float, unit: str) -> None:
    """Write a peak beyond a scale, in the unit of the scale."""
    of_scale = axes.yaxis.get_major_formatter()
    if isinstance(of_scale, Prefixed):
        peak, unit = peak * of_scale.factor, f"{of_scale.prefix}{unit}"
    is_above = peak > 0
    text = f"{number_text(float(f'{peak:.2g}'))} {unit}".replace("-", "−")
    place: dict[str, Any] = {"va": "top" if is_above else "bottom", "xycoords": "axes fraction"}
    axes.annotate(text, (0.97, 0.95 if is_above else 0.05), ha="right", fontsize="small", **place)


def _turns(values: Array) -> int:
    """Return how often values turn back, in steps that are seen."""
    seen = values[np.isfinite(values)]
    steps = np.diff(np.round(seen / ((_STEP * np.ptp(seen) if seen.size else 0.0) or 1.0)))
    return int(np.count_nonzero(np.diff(np.sign(steps[steps != 0]))))


def _draw(axes: Axes, times: Array, values: Array, **look: Any) -> bool:
    """Draw a curve, or its mean and range if it is too fast for a panel; return whether it is."""
    if fast := _turns(values) > _MOST_TURNS:
        starts, low, high = _ranges(values)
        counts = np.diff(np.append(starts, len(times)))
        times, values = (np.add.reduceat(column, starts) / counts for column in (times, values))
        axes.fill_between(times, low, high, label=f"{look['label']}, range", **_range(look))
    axes.plot(times, values, **look)
    return fast


def _ranges(values: Array) -> tuple[Array, Array, Array]:
    """Return starts, least and largest values of equal stretches."""
    starts = np.unique(np.linspace(0, len(values), _BINS, endpoint=False).astype(int))
    return starts, np.fmin.reduceat(values, starts), np.fmax.reduceat(values, starts)


def _range(look: Mapping[str, Any]) -> dict[str, Any]:
    return {"facecolor": (look["color"], 0.35), "linewidth": 0}


def stretches(times: Array, inside: Array) -> list[tuple[float, float]]:
    """Return start and end of each stretch of samples inside, extended by half a step."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
    between = np.concatenate([times[:1], (times[:-1] + times[1:]) / 2, times[-1:]])
    return [(float(between[a]), float(between[b])) for a, b in edges.reshape(-1, 2)]


# Figure of the reference: pose, velocity and torque over time -------------------------------------


_ROWS = ("pose", "velocity", "torque")


@dataclass(frozen=True)
class ReferenceOverTime(Panelled, OfReference):
    """Pose, velocity and torque of the reference, a column per part; it needs no run.

    A rotation is drawn as its vector, axis times angle, without jumps by whole turns.

    Attributes
    ----------
    degrees
        Angles and rates in degrees.
    """

    name: ClassVar[str] = "reference"

    degrees: bool = False

    def compose(self, shown: ShownReference, width: Width) -> Drawing:
        """Draw three rows; the coordinates of a part share a panel."""
        G, parts, names = shown.group, shown.group.parts, self.picked(_ROWS)
        rows = [[f"{row} {part.name}" for part in parts] for row in names]
        span = float(shown.times[0]), float(shown.times[-1])
        drawing, panels = sheet(width, rows, span, "s")
        for place, part in enumerate(parts):
            for row, name in zip(rows, names, strict=True):
                axes, of = panels[row[place]], getattr(shown, name)
                values, label = part_curves(G, part, name, of, degrees=self.degrees, index="d")
                for k, axis in enumerate(G.axis_names[part.axes]):
                    axes.plot(shown.times, values[:, k], label=axis, **component_style(k))
                name_scale(axes, label)
            if len(parts) > 1:
                add_title(panels[rows[0][place]], part_name(part.name))
        axes_of = axis_labels(G)
        lines = [Line2D([], [], **component_style(k)) for k in range(len(axes_of))]
        if len(axes_of) > 1:
            add_legend(drawing, lines, axes_of)
        return drawing
