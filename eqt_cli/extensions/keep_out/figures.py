"""Figure `keep_out`: angles between axes of the body and directions that they must stay off."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import Kind
from eqt_cli.extensions.keep_out.cones import Cone, OfCones
from eqt_cli.figures import layout
from eqt_cli.figures.figure import OverTime, ShownRuns
from eqt_cli.figures.shown import error_of
from eqt_cli.figures.style import Width, ink, line_style
from eqt_cli.loop.signals import metrics
from eqt_cli.numbers.running import SampledRuns
from eqt_cli.results.result import Result

KINDS = ("keep_out_time", "keep_out_margin")


def cones_of(result: Result, figure: str) -> list[Cone]:
    """Return the cones of a result's configuration.

    Raises
    ------
    EqtError
        If it has none.
    """
    for entry in result.config.get("metrics") or ():
        if isinstance(entry, Mapping) and entry.get("kind") in KINDS:
            metric = Kind(metrics).read(dict(entry), Problems(str))
            if isinstance(metric, OfCones):
                return metric.cones
    needs = f"needs a metric with cones, {' or '.join(KINDS)}, which the result does not have"
    raise error_of(result, figure, needs)


@dataclass(frozen=True)
class KeepOut(OverTime):
    """The angle between an axis and a direction that it must stay off, a panel for each cone.

    Of each law, the median over runs, and the least angle of all runs, dotted. The cone is grey.
    """

    name: ClassVar[str] = "keep_out"

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a panel for each cone of the first result."""
        cones = cones_of(runs.results[0], self.name)
        names = [f"cone {k + 1}" for k in range(len(cones))]
        drawing, panels = layout.sheet(
            width, layout.rows_of(names, min(len(names), 2)), runs.span, runs.unit("time")
        )
        for name, cone in zip(names, cones, strict=True):
            axes, edge = panels[name], float(np.degrees(cone.angle))
            for law in runs.shown:
                times, look = runs.times(law), dict[str, Any](line_style(law.look))
                over = SampledRuns(times)
                R = runs.values("pose", law)[..., :3, :3]
                angles = edge + cone.margin(cone.chord(R, over.time, over.of_times))
                axes.plot(times, np.median(angles, axis=0), label=law.label, **look)
                least = look | {"linestyle": ":", "linewidth": 0.6}
                axes.plot(times, angles.min(axis=0), label=f"least of {law.label}", **least)
            axes.axhspan(0.0, edge, color=ink(), alpha=0.12, linewidth=0, label="cone")
            axes.set_ylim(bottom=0.0)
            layout.open_frame(axes)
            if len(names) > 1:
                layout.add_title(axes, name)
            layout.name_scale(axes, "angle to the direction (deg)")
        lines = panels[names[0]].lines[::2]
        layout.add_legend(drawing, lines, [e.title for e in runs.shown])
        runs.remarks.append(f"Curves: median over {runs.count()}; dotted: least; grey: the cone.")
        return drawing
