"""Remarks before a run: where the reference itself enters a cone."""

from collections.abc import Iterator
from functools import partial
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.keep_out.cones import OfCones, stretches, vanishing
from eqt_cli.numbers.running import SampledRuns, straightened


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
