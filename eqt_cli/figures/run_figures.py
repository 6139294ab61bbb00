"""Figures of single runs, and of estimates."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, Literal

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.patheffects import Normal, Stroke

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems
from eqt_cli.base.option_types import CountOrNone
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.figures import layout
from eqt_cli.figures.cells import scale_log, scale_norm, spans_decade
from eqt_cli.figures.figure import MOST, OverTime, ShownRuns, first_laws, law_columns
from eqt_cli.figures.labels import axis_labels, in_words, part_name
from eqt_cli.figures.layout import THIN, add_legend, band_look, bound_below, name_scale, thin_line
from eqt_cli.figures.shown import Ensemble
from eqt_cli.figures.style import Look, Width, component_style, ink

# Figure of single runs: thin lines under their median, a panel per law ----------------------------


MOST_LINES = 200
"""Most single runs per law, from the first; more give a solid area and a large file."""

_WHOLE = ("pointing_error", "attitude_angle", "position_error", "heading_error", "lyapunov")
"""Signals that have no parts."""

_SHADE = 0.16
"""Share of ink in the shading behind the curves."""


@dataclass(frozen=True)
class RunsFigure(OverTime):
    """Single runs as thin lines and the median over runs, a panel per law.

    Where a norm has parts with units of their own, such as rotation and translation, each part has
    a column of panels. Where a law reads an estimate, the mean error of that is shaded.

    Attributes
    ----------
    signal
        Default: the pose error; on SE(n), the angle of the attitude error and the distance ‖p −
        p_d‖.
    log
        Logarithmic scale. Default: for errors and L that span more than a decade.
    degrees
        With `pose_error`: the angle of the attitude error, in degrees.
    """

    name: ClassVar[str] = "runs"

    signal: Literal[
        "",
        "pose_error",
        "position_error",
        "heading_error",
        "velocity_error",
        "torque_norm",
        "lyapunov",
    ] = ""
    log: bool | None = None
    degrees: bool = False

    def check(self, problems: Problems) -> None:
        """Refuse degrees for signals other than ``pose_error``."""
        if self.degrees and self.signal not in ("", "pose_error"):
            problem = f"applies to signal pose_error only; {self.signal} is not an angle"
            problems.at("degrees").add(problem)

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row per law and a column per part, or else controllers two by two."""
        runs.require_attitude(degrees=self.degrees)
        shown, parts = runs.shown, runs.parts
        if self.signal in _WHOLE:
            parts = [""]
        if self.signal == "lyapunov":
            shown = runs.with_function()
            if not shown:
                raise runs.error("has no L to show: none of these laws claims that its own falls")
        places, estimated = [[f"runs of {e.label}{part}" for part in parts] for e in shown], False
        if len(parts) == 1:
            places = layout.rows_of([name for (name,) in places], 2)
        drawing, panels = layout.sheet(width, places, runs.span, runs.unit("time"))
        for part in parts:
            column = [panels[f"runs of {e.label}{part}"] for e in shown]
            signal = self.signal + part if self.signal else runs.drawn_signal(f"pose_error{part}")
            layout.share_scale(column)
            for ensemble, axes in zip(shown, column, strict=True):
                values = runs.errors(signal, ensemble, degrees=self.degrees)
                self._fill(axes, runs.times(ensemble), values, ensemble.look)
                estimated |= self._shade(axes, runs, ensemble, part)
                if part == parts[0]:  # beside it, the scale names the part
                    layout.add_title(axes, ensemble.title)
                layout.name_scale(axes, runs.error_label(signal, degrees=self.degrees))
            self._scale(column, runs, signal)  # after all curves
        if len(parts) == 1:
            layout.hide_inner_scales(panels, places)
        are_few = all(np.count_nonzero(e.good) <= MOST_LINES for e in shown)
        name = "single runs" if are_few else f"first {MOST_LINES} runs"
        handles: dict[str, Artist] = {name: Line2D([], [], color=ink(0.5), linewidth=2 * THIN)}
        handles["median over runs"] = Line2D([], [], color=ink())
        if estimated:
            handles["mean error of the estimate"] = Patch(facecolor=ink(_SHADE), linewidth=0)
        layout.add_legend(drawing, list(handles.values()), list(handles))
        runs.remarks.append(f"Median over {runs.count()}.")
        runs.note = f"{name} and median, {runs.count()}"
        return drawing

    def _scale(self, panels: Sequence[Axes], runs: ShownRuns, signal: str) -> None:
        """Set one scale; for a torque, which need not converge to zero, linear by default."""
        log = self.log
        if log is None:
            seen = [np.ravel(line.get_ydata()) for axes in panels for line in axes.lines]
            log = self.signal != "torque_norm" and spans_decade(np.concatenate(seen))
        for axes in panels:
            scale_norm(axes, log=log)
        middles = [np.asarray(axes.lines[-1].get_ydata(), float) for axes in panels]
        error = runs.solver_error(signal, np.concatenate(middles), degrees=self.degrees)
        bound_below(panels[0], middles, error)

    def _shade(self, axes: Axes, runs: ShownRuns, ensemble: Ensemble, part: str) -> bool:
        """Shade up to the mean error of the estimate; return whether the law reads one."""
        signal = f"estimate_error{part}"
        if self.signal not in ("", "pose_error") or not ensemble.results.has(signal):
            return False
        angle = self.degrees or (
            not self.signal and runs.drawn_signal(f"pose_error{part}") in _WHOLE
        )
        error = runs.errors(signal, ensemble, degrees=angle).mean(axis=0)
        shade: dict[str, Any] = {"facecolor": ink(_SHADE), "linewidth": 0, "zorder": 0}
        axes.fill_between(runs.times(ensemble), 0.0 * error, error, label="estimate", **shade)
        return True

    def _fill(self, axes: Axes, times: Array, values: Array, look: Look) -> None:
        drawn = values[:MOST_LINES]
        axes.plot(times, drawn.T, **thin_line(look, len(drawn)))
        on_paper = [Stroke(linewidth=2.4, foreground=ink(0)), Normal()]  # visible on dark lines too
        middle = np.median(values, axis=0)
        axes.plot(times, middle, color=ink(), label="median", path_effects=on_paper)


# Figure of an estimate: errors within three standard deviations, and NEES within its limits -------


_DEVIATIONS = 3.0
"""Standard deviations from the middle of a band to its edges."""
_OF_ONE, _OF_MEAN = 0.1, 0.28
"""Shares of ink between the limits of a run and between the limits of a mean."""
_LINE = 0.8
"""Line width of a coordinate, pt."""


@dataclass(frozen=True)
class EstimateFigure(OverTime):
    """Errors of the estimate in one run within ±3 predicted deviations; NEES with χ² limits.

    A column per law. Errors are those of the pose, in exponential coordinates, and of the bias,
    part by part, in the band of the coordinate with the largest deviation. Two shades in the lowest
    panels are 95 % of χ²: that of one run and, darker, that of the mean over runs. A filter without
    a covariance has neither bands nor NEES.

    Attributes
    ----------
    run
        Number of the run.
    """

    name: ClassVar[str] = "estimate"

    run: CountOrNone = 0

    def compose(self, runs: ShownRuns, width: Width) -> Drawing:
        """Draw a row with its own scale per error, and a column per law."""
        G, shown = self._group(runs), first_laws(runs, MOST[width])
        errors = {
            f"{part_name(part.name)} {'bias' if e == 'bias' else 'error'}": (part, e)
            for e in self._errors(runs, shown)
            for part in G.parts
        }
        judged = {e.label: e for e in shown if e.results.has("nees")}
        names = [*errors, "NEES"] if judged else [*errors]

        def shows(row: str, law: Ensemble) -> bool:
            return row != "NEES" or law.label in judged

        drawing, rows = law_columns(runs, width, names, shows)
        for row, (part, error) in errors.items():
            unit = part.velocity_unit if error == "bias" else part.error_unit
            alone = error == "bias" and len(G.parts) == 1
            words = "bias error" if alone else f"{row.removesuffix(' error')} error"
            name_scale(rows[row][shown[0].label], in_words(words, unit))
            seen = max(self._fill(rows[row][e.label], runs, e, error, G, part) for e in shown)
            if seen > 0:
                rows[row][shown[0].label].set_ylim(-1.15 * seen, 1.15 * seen)
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
            name = runs.results[0].group_name
            raise runs.error(f"shows no estimate on a group of a plugin, {name}")
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
    ) -> float:
        """Draw the errors in the coordinates of a part in the widest of their bands.

        Return what is to see.

        That is the largest error, and the usual width of the band, which is wide at the start.
        """
        times = runs.times(ensemble)
        values = runs.of_run(f"{error}_estimate_error", ensemble, self.run)[:, part.axes]
        reach = np.zeros(len(times))
        if ensemble.results.has(f"{error}_estimate_std"):
            deviation = runs.of_run(f"{error}_estimate_std", ensemble, self.run)[:, part.axes]
            reach = _DEVIATIONS * deviation.max(axis=1)
            axes.fill_between(times, -reach, reach, label="3σ", **band_look(ink()))
        for k, axis in enumerate(G.axis_names[part.axes]):
            axes.plot(times, values[:, k], label=axis, linewidth=_LINE, **component_style(k))
        return float(max(np.abs(values).max(), np.median(reach)))

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
            nees, mean = runs.of_run("nees", ensemble, self.run), values.mean(axis=0)
            axes.plot(times, nees, label="NEES", **_NEES)
            axes.plot(times, mean, label="mean NEES", color=ink(), linewidth=_LINE)
            seen += [*nees[nees > 0], *mean[mean > 0]]
        for axes in panels:
            scale_log(axes, "y", np.array(seen))
        name_scale(next(iter(panels)), "NEES")

    def _add_legend(self, drawing: Drawing, G: MatrixLieGroup, judged: bool) -> None:
        names = axis_labels(G)
        handles: dict[str, Artist] = {
            name: Line2D([], [], linewidth=_LINE, **component_style(k))
            for k, name in enumerate(names)
        }
        if judged:
            handles[f"±{_DEVIATIONS:g}σ, the widest"] = Patch(**band_look(ink()))
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
