"""The arithmetic of this machine beyond IEEE 754, and what of an experiment depends on it."""

import math
from functools import cache
from hashlib import sha256

import numpy as np

from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.engines.engine import Compiled
from eqt_cli.loop.closed_loop import LoopPart, parts_of

MATRICES, NUMBERS = 50, 1000
"""How many are tried: seven settings of kernels, loops and C library all differed."""


@cache
def arithmetic() -> str:
    """Return a digest of what BLAS, LAPACK, NumPy and the C library make of some numbers here."""
    random = np.random.default_rng(0)
    x, A = random.uniform(0.01, 0.99, NUMBERS), random.normal(size=(MATRICES, 6, 6))
    loops = [*(function(x) for function in (np.sin, np.exp, np.tanh, np.arctan)), x**0.3]
    matrices = [A @ A[::-1], np.linalg.inv(A), np.linalg.svd(A)[0], *map(np.linalg.norm, A[:, 0])]
    numbers, product = (20 * x).tolist(), (x + 1j * x[::-1]) * (x[::-1] + 1j)
    library = [*map(math.sin, numbers), *map(math.exp, numbers), *map(math.atan, numbers)]
    results = [*loops, product, *matrices, library]
    return sha256(b"".join(np.asarray(array).tobytes() for array in results)).hexdigest()[:12]


def by(study: Study) -> dict[str, str]:
    """Return the arithmetic of this processor, and whether numbers of a study depend on it."""
    processor, of = arithmetic(), dependent(study)
    return {"processor": processor, "arithmetic": f"{processor} by {of}" if of else "any"}


MOST_POINTS = 1000
"""Most points of a sweep that are looked at: those whose values are not only numbers."""


def dependent(study: Study) -> str:
    """Name what computes numbers of a study by that arithmetic; "" if nothing does.

    These are engines in NumPy, code of the user's own, and components that say `by_processor`.
    """
    points, sweep = [0], study.sweep
    if sweep is not None:
        for point in range(min(len(study), MOST_POINTS)):
            if not all(isinstance(value, int | float) for value in sweep.settings(point).values()):
                points.append(point)
    return next(filter(None, map(_dependent, map(study.experiment, points))), "")


def _dependent(experiment: Experiment) -> str:
    engine, start, parts = experiment.engine, experiment.start, list[LoopPart]()
    if not isinstance(engine, Compiled):
        return f"engine {engine.name}"
    for index, loop in enumerate(experiment.loops.values()):
        parts += parts_of(loop, index)
    starts = (*getattr(start.poses, "factors", (start.poses,)), start.velocities)
    parts += [LoopPart(distribution, ("initial",), "the start") for distribution in starts]
    for part in [*parts, *(LoopPart(metric, (), metric.name) for metric in experiment.metrics)]:
        if part.is_foreign or getattr(part.part, "by_processor", False):
            return part.name
    return ""
