"""The share of runs for which an actuator is too weak."""

from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from matplotlib.figure import Figure

from eqt_cli.extend import WIDTHS, OfMetrics, ShownMetrics, Width, line_style


@dataclass(frozen=True)
class Actuator(OfMetrics):
    """The share of runs whose largest torque is above that of an actuator."""

    name: ClassVar[str] = "actuator"

    def compose(self, metrics: ShownMetrics, width: Width) -> Figure:
        """One panel with a line for each law."""
        drawing = Figure(figsize=(WIDTHS[width], 2.4))
        axes = drawing.add_subplot()
        for ensemble in metrics.shown:
            torque = np.sort(ensemble.results.metric("peak_torque", ensemble.controller))
            above = 100 * (1 - np.arange(1, len(torque) + 1) / len(torque))
            axes.step(
                torque, above, where="post", label=ensemble.title, **line_style(ensemble.look)
            )
        axes.set(xlabel="torque of the actuator, N m", ylabel="runs that need more, %")
        axes.legend()
        return drawing
