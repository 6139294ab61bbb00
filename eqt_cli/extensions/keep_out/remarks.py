"""Remarks before a run: where the reference itself enters a cone."""

from collections.abc import Iterator
from typing import Any

from eqt_cli.config.experiment import Experiment
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.keep_out.cones import OfCones, stretches, vanishing
from eqt_cli.numbers.running import SampledRuns


def remarks(experiment: Experiment, shown: Horizon | None) -> Iterator[tuple[Any, str]]:
    """Yield where the reference is inside a cone of the first metric of cones."""
    places = [k for k, quantity in enumerate(experiment.metrics) if isinstance(quantity, OfCones)]
    if not places:
        return
    shown = shown or experiment.reference_over_horizon()
    metric = experiment.metrics[places[0]]
    assert isinstance(metric, OfCones)
    over = SampledRuns(shown.times)
    for number, cone in enumerate(metric.cones):
        margin = cone.margin(shown.pose[:, :3, :3], over.time, over.of_times)
        here = "metrics", places[0], "cones", number
        if (vanishes := vanishing(shown.times, cone.vector(over.time, over.of_times))) is not None:
            yield (
                (*here, "at"),
                f"the direction passes through 0 at {vanishes:.4g} s, where it turns round at once "
                "and the cone has no margin; give expressions that do not vanish together",
            )
            continue
        for start, end, least in stretches(shown.times, margin):
            yield (
                here,
                f"the reference is inside from {start:.4g} to {end:.4g} s, by up to "
                f"{-least:.3g} deg: no law that follows it stays out",
            )
