"""Keep-out cones in the block diagram, at the reference, which is looked at for them, too."""

import re
from collections.abc import Iterator

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.config.experiment import Experiment
from eqt_cli.extensions.keep_out.cones import Cone, OfCones


@purposes.boxes_of_a_diagram
def boxes(experiment: Experiment) -> Iterator[tuple[str, str, list[str]]]:
    """Yield the stage, the title and the lines of the cones of an experiment."""
    measures = [metric for metric in experiment.metrics if isinstance(metric, OfCones)]
    lines = dict.fromkeys(_in_words(cone) for metric in measures for cone in metric.cones)
    if lines:
        yield "reference", "keep-out cones", [*lines, "measured; no law reads them"]


def _in_words(cone: Cone) -> str:
    moves = cone.at is None or any(re.search(r"\bt\b", str(entry)) for entry in cone.at)
    where = "a moving direction" if moves else _listed(cone.at or [])
    return f"axis {_listed(cone.axis)}: {np.degrees(cone.angle):g}\u00a0deg off {where}"


def _listed(entries: object) -> str:
    assert isinstance(entries, list | tuple)
    texts = (f"{x:g}" if isinstance(x, int | float) else str(x) for x in entries)
    return "(" + ",\u00a0".join(texts) + ")"
