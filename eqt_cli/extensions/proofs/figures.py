"""Figure of certified rates, and what is proved of the laws of a sweep."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from fractions import Fraction
from typing import Any, ClassVar

import numpy as np
from matplotlib.figure import Figure as Drawing

from eqt_cli.base import purposes
from eqt_cli.base.option_types import Count
from eqt_cli.extensions.proofs.certified import box_of, rates_of
from eqt_cli.figures.figure import Figure
from eqt_cli.figures.layout import add_legend, one_panel
from eqt_cli.figures.shown import ShownControllers, ShownSweep
from eqt_cli.figures.style import Width, line_style
from eqt_cli.figures.sweep_figures import HEIGHTS
from eqt_cli.results.result import Result


@purposes.figure_certified
def proved(swept: ShownSweep, angle: float) -> Iterator[str]:
    """Yield what is proved of each law for starts within an angle, where the runs only find."""
    first = swept.results.point(0)
    box = box_of(first["desired_velocity"])
    for k, title in zip(swept.controllers, swept.titles, strict=True):
        label = swept.results.labels[k]
        law_rates = rates_of(label, first.loops[label], [box], start=angle)
        said = law_rates.refused or law_rates.rates[0].region
        yield f"{title}, proved for the loop and the reference of the first point: {said}."


# Figure of certified rates: what is proved for bounded references, over the bound -----------------


@dataclass(frozen=True)
class Rates(Figure[ShownControllers]):
    """Certified rates of small errors over the bound v of the desired velocity.

    Thick: proved along every reference with |V_d,i| ≤ v. Thin: the slowest constant V_d of these.
    Laws without a certificate are named.

    Attributes
    ----------
    velocity
        Largest v. 0: the largest |V_d,i| of the reference.
    bounds
        Number of values of v, from 0.
    """

    name: ClassVar[str] = "rates"

    velocity: float = 0.0
    bounds: Count = 13

    def subject(self, results: Sequence[Result], measured: Any) -> ShownControllers:
        """Return the controllers of one result."""
        return ShownControllers([self._only(results, "result")], self.name, self.chosen)

    def compose(self, shown: ShownControllers, width: Width) -> Drawing:
        """Draw two curves per law, computed here from the loops of the result."""
        [result] = shown.results
        fastest = self.velocity or float(np.nanmax(np.abs(result["desired_velocity"])))
        grid = np.linspace(0, fastest, self.bounds)
        axes = len(result.coordinate("axis"))
        boxes = [[(-Fraction(v), Fraction(v))] * axes for v in grid.tolist()]
        laws = [(e, rates_of(e.label, result.loops[e.law], boxes)) for e in shown.shown]
        (drawing, panel), titles = one_panel(width, HEIGHTS[width]), []
        for law, law_rates in laws:
            if law_rates.refused:
                shown.remarks.append(f"{law.title} {law_rates.refused}.")
            else:
                titles.append(law.title)
                rates = [float(one.rate or np.nan) for one in law_rates.rates]
                panel.plot(grid, rates, label=f"{law.title}, proved", **line_style(law.look))
        for law, law_rates in laws:
            rates, look = [one.slowest_rate for one in law_rates.rates], line_style(law.look)
            panel.plot(grid[: len(rates)], rates, label=f"{law.title}, constant", lw=0.5, **look)
        if not titles:
            raise shown.error(f"has nothing to show: {' '.join(shown.remarks)}")
        unit = result.units("desired_velocity")
        bound = f"bound of each component of the desired velocity ({unit})"
        panel.set(xlabel=bound.removesuffix(" (mixed)"), xlim=(0, fastest or 1))
        panel.set(ylabel="rate of small errors (1/s)", ylim=(0, None))
        add_legend(drawing, panel.lines[: len(titles)], titles)
        shown.note = "thick: proved for all references; thin: slowest constant velocity"
        shown.remarks.append(f"{shown.note.capitalize()}.")
        return drawing
