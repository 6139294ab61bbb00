"""Figures of recordings: a recording beside a run, and how an error grows."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, Remedy
from eqt_cli.base.files import write_all
from eqt_cli.base.option_types import CountOrNone
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.extensions.flights.conditions import OVER, ConditionTable
from eqt_cli.extensions.flights.flights import FlightComparison
from eqt_cli.extensions.flights.measured import measured_runs
from eqt_cli.extensions.flights.prediction import Growth
from eqt_cli.extensions.logs.figures import encoded, thin_curve
from eqt_cli.extensions.logs.recording_check import Recording
from eqt_cli.figures import layout, style
from eqt_cli.figures.figure import Panelled, Timed
from eqt_cli.figures.labels import axis_labels, in_words, part_curves, part_name
from eqt_cli.figures.layout import EMPTY, add_legend, add_title, band_look, name_scale, sheet
from eqt_cli.figures.shown import Chosen, error_of, positions
from eqt_cli.results.result import Result

# Figure of a recording beside a run: pose, error, velocity and wrench over time -------------------


_MEASURED: dict[str, Any] = {"linewidth": 2.4, "zorder": 1.5, "solid_capstyle": "butt"}
_SIMULATED = 0.8
"""Line width of the run, pt; the wider recording is visible on both sides."""
_PALE = 0.35
"""Share of the colour in a measured curve."""


class ShownMeasured:
    """A recording and a simulated run over the same time.

    Parameters
    ----------
    result, measured
        The open result, and a recording on its group.
    figure, chosen
        See `ShownControllers`; the first controller if none is chosen.
    run
        Number of the run.

    Attributes
    ----------
    pair
        The run and the recording.
    group
        The group G.
    times
        The times of the recording, and those of the run.
    curves
        Rows of panels: a name, and values of the recording and of the run, at `times`: poses, or
        coordinates of errors, velocities and wrenches.

    Raises
    ------
    EqtError
        If there is no recording, run or controller, or the recording does not fit the run.
    """

    def __init__(
        self, result: Result, measured: Recording | None, figure: str, chosen: Chosen, run: int
    ) -> None:
        if measured is None:
            text = f"figure '{figure}' shows a recording next to a run, and none is given"
            raise EqtError(text, Remedy("give one with {}", "measured"))
        (places,) = positions([result], figure, chosen.controllers)
        if chosen.controllers and len(places) > 1:
            raise error_of(result, figure, f"shows one controller, got {len(places)}")
        (self.pair,) = measured_runs(result, measured, places[:1], run, f"figure '{figure}'")
        seen, flown, (pose, *_) = self.pair.recording, self.pair.simulated, self.pair.errors
        self.unit, self.group = result.units("time"), seen.group
        fail = partial(error_of, result, figure)
        of_seen, of_flown = (chosen.samples(motion.times, fail) for motion in (seen, flown))
        self.times = seen.times[of_seen], flown.times[of_flown]
        G = self.group
        error = G.log(G.inverse(self.pair.reference.pose) @ flown.pose)
        rows = [
            ("pose", seen.poses, flown.pose),
            ("error", pose.measured, error),
            ("difference", pose.difference, 0 * error),
            ("velocity", seen.velocities, flown.velocity),
            ("wrench", seen.wrenches, flown.wrench),
        ]
        self.curves = [
            (name, recorded[of_seen], simulated[of_flown])
            for name, recorded, simulated in rows
            if not np.isnan(recorded).all()
        ]

    def notes(self) -> list[str]:
        """Return notes on what is shown, how it was aligned, and what was not measured."""
        pair = self.pair
        return [
            f"Lines: {pair.title}, run {pair.run}. Tints: {pair.notes[0]}.",
            *(f"{note}." for note in pair.notes[1:]),
        ]


@dataclass(frozen=True)
class MeasuredFigure(Panelled, Timed[ShownMeasured]):
    """A recording and a run: pose, error, difference, velocity, wrench; a column per part.

    It shows one controller: the first, unless another is chosen. The error is log Q_d⁻¹Q, from the
    reference in the body frame, and the difference is that of the recording from the run. The clock
    of the recording is aligned with that of the run, and its gaps stay empty.

    Attributes
    ----------
    run
        Number of the run.
    degrees
        Angles and rates of rotations in degrees.
    """

    name: ClassVar[str] = "measured"
    shows_recording: ClassVar[bool] = True

    run: CountOrNone = 0
    degrees: bool = False

    def subject(self, results: Sequence[Result], measured: Recording | None) -> ShownMeasured:
        """Return the run of one controller, aligned in time with the recording."""
        shown = self._only(results, "result")
        return ShownMeasured(shown, measured, self.name, self.chosen, self.run)

    def compose(self, shown: ShownMeasured, width: style.Width) -> Drawing:
        """Draw a row for each quantity; the coordinates of a part share a panel."""
        parts, curves, (measured_times, times) = shown.group.parts, shown.curves, shown.times
        wanted = self.picked([name for name, *_ in curves])
        curves = [row for row in curves if row[0] in wanted]
        places = [
            [f"{name} {part.name}" if _is_measured(part, seen) else EMPTY for part in parts]
            for name, seen, _ in curves
        ]
        drawing, panels = sheet(width, places, (float(times[0]), float(times[-1])), shown.unit)
        gaps = shown.pair.recording.gaps + 1
        for row, (name, measured, run) in zip(places, curves, strict=True):
            kind = name if name == "difference" else "measured"
            for panel, part in zip(row, parts, strict=True):
                if panel == EMPTY:
                    continue
                axes = panels[panel]
                values, label = part_curves(shown.group, part, name, run, degrees=self.degrees)
                if name != "difference":
                    self._draw(axes, "simulated", shown.group, part, (times, values))
                near = np.stack([np.interp(measured_times, times, x) for x in values.T], axis=-1)
                seen, _ = part_curves(
                    shown.group, part, name, measured, degrees=self.degrees, near=near
                )
                behind = np.insert(measured_times, gaps, np.nan)
                curve = behind, np.insert(seen, gaps, np.nan, axis=0)
                self._draw(axes, kind, shown.group, part, curve)
                name_scale(axes, label)
        if len(parts) > 1:
            for panel, part in zip(places[0], parts, strict=True):
                if panel != EMPTY:
                    add_title(panels[panel], part_name(part.name))
        names = axis_labels(shown.group)
        lines = [Line2D([], [], **thin_curve(k)) for k in range(len(names))]
        grey = Line2D([], [], color=style.mixed(style.ink(), style.ink(0), _PALE), **_MEASURED)
        add_legend(drawing, [*lines, grey], [*names, "measured"])
        return drawing

    def _draw(
        self, axes: Axes, kind: str, G: MatrixLieGroup, part: Part, curve: tuple[Array, Array]
    ) -> None:
        for k, axis in enumerate(G.axis_names[part.axes]):
            look = thin_curve(k)
            if kind == "measured":
                # Dashes keep apart tints of a colour that the style gives to two coordinates.
                dashes = look["linestyle"] if k >= style.colours_of_style() else "-"
                tint = style.mixed(look["color"], style.ink(0), _PALE)
                look = {"color": tint, "linestyle": dashes, **_MEASURED}
            axes.plot(curve[0], curve[1][:, k], label=f"{kind} {axis}", **look)


def _is_measured(part: Part, values: Array) -> bool:
    """Whether any coordinate of a part was measured, of poses or of coordinates."""
    of_part = values[:, part.axes] if values.ndim == 2 else values[(..., *part.entries)]
    return not np.isnan(of_part).all()


def save_growth(growth: Growth, folder: Path) -> None:
    """Draw and write the figure: rms, quantiles and noise, a panel for each part.

    Raises
    ------
    EqtError
        If a file cannot be written.
    """
    t = growth.horizons
    with style.house_style():
        drawing, panels = layout.sheet(
            "column", layout.rows_of(growth.parts, 1), (float(t[0]), float(t[-1])), "s"
        )
        for k, (part, unit) in enumerate(zip(growth.parts, growth.units, strict=True)):
            axes = panels[part]
            look = style.line_style(0)
            (rms,) = axes.plot(t, growth.rms[k], **look)
            band = axes.fill_between(t, growth.low[k], growth.high[k], **band_look(look["color"]))
            (noise,) = axes.plot(t, growth.noise[k], color=style.ink(), linestyle=(0, (1.2, 1)))
            axes.set_ylim(bottom=0.0)
            layout.name_scale(axes, in_words(part, unit))
        layout.add_legend(drawing, [rms, band, noise], ["rms", "10 % to 90 %", "noise alone, rms"])
        remark = f"Errors of {growth.windows} windows of {growth.name}."
        write_all(encoded(drawing, panels, "horizon", remark, folder / "replay"), folder)


def save_flights(comparison: FlightComparison, folder: Path) -> None:
    """Draw the errors of each flight by its side, and their ratio with its interval.

    Raises
    ------
    EqtError
        If a file cannot be written.
    """
    with style.house_style():
        rows = [[one.metric, f"{one.metric} ratio"] for one in comparison.pairs]
        drawing, panels = layout.blank_sheet("column", rows, 0.95, width_ratios=[1.5, 1])
        thin: Any = {"color": style.ink(0.5), "linewidth": 0.6}
        strong: Any = {"color": style.ink()}
        for one, (left, right) in zip(comparison.pairs, rows, strict=True):
            sides = {s: [x for x in comparison.flights if x.side == s] for s in "BA"}
            errors = [[x.errors[one.metric] for x in side] for side in sides.values()]
            if comparison.paired:
                panels[left].plot(errors, [0, 1], **thin)
            for k, (values, mean) in enumerate(zip(errors, (one.second, one.first), strict=True)):
                colour = style.line_style(k)["color"]
                panels[left].plot(values, [k] * len(values), "o", color=colour, markersize=3)
                panels[left].plot([mean] * 2, [k - 0.3, k + 0.3], **strong)
            change, *ends = 100 * np.array([one.ratio, one.low, one.high]) - 100
            panels[right].axvline(0, **thin)
            panels[right].plot(ends, [0.5] * 2, **strong)
            panels[right].plot(change, 0.5, "o", markersize=3, **strong)
            panels[left].set_xlabel(in_words(f"{one.metric} error", one.unit))
            panels[right].set_xlabel(in_words("A against B", "%"))
            panels[left].set_yticks([0, 1], [*sides])
            panels[right].set_yticks([])
        for panel in panels.values():
            panel.set_ylim(-0.6, 1.6)
            panel.margins(x=0.08)
        means = next(note for note in comparison.notes if note.startswith("A, B:"))
        remark = f"Dots: flights; strokes: means. {means}."
        write_all(encoded(drawing, panels, "", remark, folder / "flights"), folder)


def save_forest(table: ConditionTable, folder: Path) -> None:
    """Draw the ratio of each law in each condition with its interval, and over all of them.

    Raises
    ------
    EqtError
        If a file cannot be written.
    """
    with style.house_style():
        laws = [*dict.fromkeys((cell.metric, cell.law) for cell in table.cells)]
        drawing, panels = layout.blank_sheet("column", [[f"{m} {law}"] for m, law in laws], 1.1)
        names = [*reversed(table.conditions), OVER]
        for metric, law in laws:
            axes = panels[f"{metric} {law}"]
            axes.axvline(0, color=style.ink(0.5), linewidth=0.6)
            cells = [x for x in table.cells if (x.metric, x.law) == (metric, law)]
            for cell in cells:
                at, is_over = names.index(cell.condition), cell.condition == OVER
                value, *ends = 100 * np.array([cell.ratio, cell.low, cell.high]) - 100
                look: Any = {"color": style.ink() if is_over else style.line_style(0)["color"]}
                axes.plot(ends, [at] * 2, linewidth=1.6 if is_over else 0.9, **look)
                marker = "D" if is_over else "o"
                axes.plot(value, at, marker, markersize=4 if is_over else 3, **look)
            axes.set_yticks(range(len(names)), names)
            axes.set_ylim(-0.6, len(names) - 0.4)
            axes.set_xlabel(in_words(f"{law} against {table.base}, {metric} error", "%"))
            axes.margins(x=0.08)
        means = next(note for note in table.notes if note.startswith("errors against"))
        remark = f"Dots: conditions; diamonds: over all. {means.partition('; ✓')[0]}."
        write_all(encoded(drawing, panels, "", remark, folder / "forest"), folder)
