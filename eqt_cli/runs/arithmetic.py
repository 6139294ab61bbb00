"""The arithmetic of this machine beyond IEEE 754, and what of an experiment depends on it."""

import math
from functools import cache
from hashlib import sha256

import numpy as np

from eqt_cli.base.registry import is_foreign
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.study import Study
from eqt_cli.loop.closed_loop import parts_of

MATRICES, NUMBERS = 100, 2000
"""How many are tried: enough that three kernels of BLAS, two builds of NumPy's loops and the C
library with and without fused products all differed."""


@cache
def arithmetic() -> str:
    """Return a digest of what BLAS, LAPACK, NumPy and the C library make of some numbers here."""
    random = np.random.default_rng(0)
    x, A = random.uniform(0.01, 0.99, NUMBERS), random.normal(size=(MATRICES, 6, 6))
    loops = (np.sin, np.cos, np.tan, np.arcsin, np.arctan, np.sinh, np.tanh, np.exp, np.log)
    library = (math.sin, math.cos, math.exp, math.atan, lambda each: each**0.3)
    results = [
        *(function(x) for function in loops),
        x**0.3,
        (x + 1j * x[::-1]) * (x[::-1] + 1j),
        A @ A[::-1],
        np.linalg.inv(A),
        np.linalg.svd(A)[0],
        [np.linalg.norm(row) for row in A[:, 0]],
        *([function(20 * each) for each in x.tolist()] for function in library),
    ]
    return sha256(b"".join(np.asarray(each).tobytes() for each in results)).hexdigest()[:12]


MOST_POINTS = 1000
"""Most points of a sweep that are looked at: those whose values are not only numbers."""


def dependent(study: Study) -> str:
    """Name what computes numbers of a study by that arithmetic; "" if nothing does.

    These are engines in NumPy, code of the user's own, and components that say `by_processor`.
    """
    points, sweep = [0], study.sweep
    if sweep is not None:
        settings = map(sweep.settings, range(min(len(study), MOST_POINTS)))
        for point, values in enumerate(settings):
            if not all(isinstance(value, int | float) for value in values.values()):
                points.append(point)
    return next(filter(None, map(_dependent, map(study.experiment, points))), "")


def _dependent(experiment: Experiment) -> str:
    engine, start = experiment.engine, experiment.start
    if engine.calls_laws:
        return f"engine {engine.name}"
    for index, loop in enumerate(experiment.loops.values()):
        for part in parts_of(loop, index):
            says = getattr(part.part, "by_processor", False)
            if part.is_foreign or says or getattr(part.part, "code", None) is not None:
                return part.name
    others = [*experiment.metrics, start.poses, start.velocities]
    return next((each.name for each in others if is_foreign(type(each).__module__)), "")
