"""Figure of the reference: pose, velocity and torque over time."""

from dataclasses import dataclass
from typing import ClassVar

from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D

from eqt_cli.plots.base import OfReference, Panelled
from eqt_cli.plots.drawing.labels import axis_labels, part_curves, part_name
from eqt_cli.plots.drawing.layout import add_legend, add_title, name_scale, sheet
from eqt_cli.plots.drawing.style import WIDTHS, Width, line_style
from eqt_cli.plots.shown.reference import ShownReference

_ROWS = ("pose", "velocity", "torque")


@dataclass(frozen=True)
class ReferenceOverTime(Panelled, OfReference):
    """Pose, velocity and torque of the reference, a column per part; it needs no run.

    A rotation is drawn as its vector, axis times angle, without jumps by whole turns.

    Attributes
    ----------
    degrees
        Angles and rates of rotations in degrees.
    """

    name: ClassVar[str] = "reference"

    degrees: bool = False

    def compose(self, shown: ShownReference, width: Width) -> Drawing:
        """Draw three rows; the coordinates of a part share a panel."""
        parts = shown.group.parts
        names = self.picked(_ROWS)
        rows = [[f"{row} {part.name}" for part in parts] for row in names]
        span = float(shown.times[0]), float(shown.times[-1])
        drawing, panels = sheet(width, rows, span, "s")
        for place, part in enumerate(parts):
            for row, name in zip(rows, names, strict=True):
                axes, of = panels[row[place]], getattr(shown, name)
                values, label = part_curves(
                    shown.group, part, name, of, degrees=self.degrees, index="d"
                )
                for k, axis in enumerate(shown.group.axis_names[part.axes]):
                    axes.plot(shown.times, values[:, k], label=axis, **line_style(k))
                name_scale(axes, label)
            if len(parts) > 1:
                add_title(panels[rows[0][place]], part_name(part.name), WIDTHS[width] / len(parts))
        axes_of = axis_labels(shown.group)
        lines = [Line2D([], [], **line_style(k)) for k in range(len(axes_of))]
        add_legend(drawing, lines, axes_of)
        return drawing
