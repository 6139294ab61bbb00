"""Figure of an estimate: errors within three standard deviations, and NEES within its limits."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from eqt_cli.core.arrays import Array
from eqt_cli.core.option_types import CountOrNone
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.plots.base import OverTime
from eqt_cli.plots.drawing.cells import scale_log
from eqt_cli.plots.drawing.curves import band_look
from eqt_cli.plots.drawing.labels import axis_labels, in_words, part_name
from eqt_cli.plots.drawing.layout import add_legend, name_scale
from eqt_cli.plots.drawing.style import Width, ink, line_style
from eqt_cli.plots.law_columns import law_columns
from eqt_cli.plots.shown.controllers import Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns

_DEVIATIONS = 3.0
"""Standard deviations from the middle of a band to its edges."""
_OF_ONE, _OF_MEAN = 0.1, 0.28
"""Shares of ink between the limits of a run and between the limits of a mean."""
_ALIKE = 0.05
"""Bands that differ by less than this share of the widest are drawn as the first of them."""
_LINE = 0.8
"""Line width of a coordinate, pt."""


@dataclass(frozen=True)
class EstimateFigure(OverTime):
    """Errors of the estimate in one run within ±3 of its own deviations; NEES with χ² limits.

    A column per law. Errors are those of the pose, in exponential coordinates, and of the
    bias, part by part. Two shades in the lowest panels are 95 % of χ²: that of one run and, darker,
    that of the mean over runs. A filter without a covariance has neither bands nor NEES.

    Attributes
    ----------
    run
        Number of the run.
    """

    name: ClassVar[str] = "estimate"

    run: CountOrNone = 0

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row with its own scale per error, and a column per law."""
        G, shown = self._group(runs), runs.shown
        errors = {
            f"{part_name(part.name)} {'bias' if e == 'bias' else 'error'}": (part, e)
            for e in self._errors(runs, shown)
            for part in G.parts
        }
        judged = {e.label: e for e in shown if e.results.has("nees")}
        names = [*errors, "NEES"] if judged else [*errors]
        drawing, rows = law_columns(
            runs, width, names, lambda row, law: row != "NEES" or law.label in judged
        )
        for row, (part, error) in errors.items():
            unit = part.velocity_unit if error == "bias" else part.error_unit
            alone = error == "bias" and len(G.parts) == 1
            words = "bias error" if alone else f"{row.removesuffix(' error')} error"
            name_scale(rows[row][shown[0].label], in_words(words, unit))
            for ensemble in shown:
                self._fill(rows[row][ensemble.label], runs, ensemble, error, G, part)
        if judged:
            self._judge(runs, {rows["NEES"][label]: e for label, e in judged.items()})
        self._add_legend(drawing, G, bool(judged))
        means = f", and means over {runs.count()}" if judged else ""
        runs.remarks.append(f"Run {self.run}{means}.")
        return drawing

    def _group(self, runs: ShownRuns) -> MatrixLieGroup:
        """Return the group; refuse controllers that read no estimate."""
        for ensemble in runs.shown:
            if not ensemble.results.has("estimated_pose"):
                raise ensemble.results.error(
                    f"figure '{self.name}' finds no estimate, since the laws read measurements; "
                    "set the key 'estimator' and run the experiment again"
                )
        if runs.group is None:
            raise runs.error(
                f"shows no estimate on a group of a plugin, {runs.results[0].group_name}"
            )
        return runs.group

    def _errors(self, runs: ShownRuns, shown: list[Ensemble]) -> list[str]:
        """Return ``pose``, and ``bias`` where there is one, or one is estimated."""
        both = ((e, f"bias_estimate_{kind}") for e in shown for kind in ("error", "std"))
        biased = (np.any(runs.of_run(name, e, self.run)) for e, name in both if e.results.has(name))
        return ["pose", "bias"] if any(biased) else ["pose"]

    def _fill(
        self,
        axes: Axes,
        runs: ShownRuns,
        ensemble: Ensemble,
        error: str,
        G: MatrixLieGroup,
        part: Part,
    ) -> None:
        """Draw the errors in the coordinates of a part, each in its band."""
        times = runs.times(ensemble)
        values = runs.of_run(f"{error}_estimate_error", ensemble, self.run)[:, part.axes]
        reach = np.zeros(values.shape)
        if ensemble.results.has(f"{error}_estimate_std"):
            deviation = runs.of_run(f"{error}_estimate_std", ensemble, self.run)[:, part.axes]
            reach = _DEVIATIONS * deviation
        alike = np.ptp(reach, axis=1).max() < _ALIKE * reach.max()
        for k, axis in enumerate(G.axis_names[part.axes]):
            look = line_style(k)
            if reach[:, k].any() and not (alike and k):
                band = band_look(ink() if alike else look["color"])
                axes.fill_between(times, -reach[:, k], reach[:, k], label=f"3σ {axis}", **band)
            axes.plot(times, values[:, k], label=axis, linewidth=_LINE, **look)

    def _judge(self, runs: ShownRuns, panels: dict[Axes, Ensemble]) -> None:
        """Draw NEES of the run and its mean over runs, each between its limits."""
        seen = []
        for axes, ensemble in panels.items():
            times, values = runs.times(ensemble), runs.values("nees", ensemble)
            degrees = float(runs.of_run("nees_dof", ensemble, self.run)[0])
            for shade, count in ((_OF_ONE, 1), (_OF_MEAN, len(values))):
                low, high = _limits(degrees, count)
                name = f"95 % of χ² over {count}"
                axes.axhspan(low, high, facecolor=ink(shade), linewidth=0, zorder=0, label=name)
                seen += [low, high]
            own, mean = runs.of_run("nees", ensemble, self.run), values.mean(axis=0)
            axes.plot(times, own, label="NEES", **_NEES)
            axes.plot(times, mean, label="mean NEES", color=ink(), linewidth=_LINE)
            seen += [*own[own > 0], *mean[mean > 0]]
        for number, axes in enumerate(panels):
            scale_log(axes, "y", np.array(seen))
            if not number:
                name_scale(axes, "NEES")

    def _add_legend(self, drawing: Drawing, G: MatrixLieGroup, judged: bool) -> None:
        names = axis_labels(G)
        handles: dict[str, Artist] = {
            name: Line2D([], [], linewidth=_LINE, **line_style(k)) for k, name in enumerate(names)
        }
        if judged:
            handles[f"±{_DEVIATIONS:g}σ"] = Patch(**band_look(ink()))
            handles["NEES"] = Line2D([], [], **_NEES)
            handles["mean over runs"] = Line2D([], [], color=ink(), linewidth=_LINE)
            handles[r"95 % of $\chi^2$"] = Patch(facecolor=ink(_OF_ONE), linewidth=0)
            handles["95 % of the mean"] = Patch(facecolor=ink(_OF_MEAN), linewidth=0)
        add_legend(drawing, list(handles.values()), list(handles))


_NEES: dict[str, Any] = {"color": "0.45", "linewidth": 0.6}


def _limits(degrees: float, runs: int) -> Array:
    """Return the central 95 % limits of the mean of `runs` independent χ² variables."""
    from scipy.special import gammaincinv  # slow to import

    return 2 * gammaincinv(runs * degrees / 2, np.array([0.025, 0.975])) / runs
