"""Remarks before a run: where the reference itself enters a cone."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array, norm
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.keep_out.between import straightened
from eqt_cli.extensions.keep_out.cones import Cone, OfCones, stretches, vanishing
from eqt_cli.numbers.running import SampledRuns


@purposes.remarks_on_an_experiment
def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[Any, str]]:
    """Yield where the reference is inside a cone of the first metric of cones."""
    places = [k for k, quantity in enumerate(experiment.metrics) if isinstance(quantity, OfCones)]
    if not places:
        return
    metric = experiment.metrics[places[0]]
    assert isinstance(metric, OfCones)
    shown = shown or experiment.reference_over_horizon()
    if shown.spent is None:
        times = straightened(shown.times, 1, partial(_chords, experiment, metric))
        shown = experiment.reference_over_horizon(times)
    over = SampledRuns(shown.times)
    pairs = metric.pairs(over, shown.pose[None])
    for cone, before, chord in pairs:
        here = "metrics", places[0], "cones", metric.cones.index(cone)
        if (vanishes := vanishing(shown.times, cone.vector(over.time, over.of_times))) is not None:
            yield (
                (*here, "at"),
                f"the direction passes through 0 at {vanishes:.4g} s, where it turns round at once "
                "and the cone has no margin; give expressions that do not vanish together",
            )
            continue
        margin = cone.margin(cone.nearest(before, chord))[0]
        if (free := _free_axis(experiment)) is not None:
            margin = _at_best(cone, free, shown.pose[:, :3, :3] @ free, over)
        for start, end, least in stretches(shown.times, margin):
            yield (
                here,
                f"the reference is inside from {start:.4g} to {end:.4g} s, by up to "
                f"{-least:.3g} deg: no law that follows it stays out",
            )


def _chords(experiment: Experiment, metric: OfCones, times: Array) -> Array:
    """Return the chords of the reference at some times, as `straightened` needs them."""
    shown = experiment.reference_over_horizon(times)
    pose = shown.pose[np.searchsorted(shown.times, times)]
    return metric.lines(SampledRuns(times), pose[None])


def _free_axis(experiment: Experiment) -> Array | None:
    """Return the body axis about which the laws may turn as they like; None if about none."""
    loop = experiment.loop
    if not loop.task.is_whole:
        return np.array(loop.task.axis, dtype=float)
    along = getattr(loop.reference, "direction", ())  # of a body that is pushed along one axis
    flat = loop.reference.flat_output(loop.group, 0.0) if len(along) == 3 else None
    is_free = flat is not None and flat.heading is None
    return np.array(along, dtype=float) if is_free else None


def _at_best(cone: Cone, free: Array, pointed: Array, over: SampledRuns) -> Array:
    """Return the margin of the best turn about an axis, deg.

    With α from that axis to the one of the cone, and β from where it points to the direction, the
    angle between both is at most α + β, or 360° less.
    """
    a = np.array(cone.axis) / norm(np.array(cone.axis))
    d = cone.vector(over.time, over.of_times)
    d = d / norm(d)[..., None]
    alpha, beta = (np.arccos(np.clip(x, -1.0, 1.0)) for x in (a @ free, (pointed * d).sum(axis=-1)))
    largest: Array = np.degrees(np.minimum(alpha + beta, 2 * np.pi - alpha - beta) - cone.angle)
    return largest
