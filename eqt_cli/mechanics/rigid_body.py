"""Checks by the principal moments whether a rigid body can have an inertia."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw

ROUNDING = 1e-9
"""Tolerance relative to the largest moment, which in a flat body is the sum of the others."""

INSTANTS = 101
"""Number of instants of the horizon at which a varying inertia is checked."""


def not_rigid(G: MatrixLieGroup, law: InertiaLaw, horizon: float) -> str:
    """Describe why no rigid body can have this inertia; empty if one can.

    Principal moments about the centre of mass, J₁ ≤ J₂ ≤ J₃, are sums of squared distances over the
    mass, so that they satisfy the triangle inequality J₁ + J₂ ≥ J₃.
    """
    constant = isinstance(law, Inertia)
    times = np.zeros(1) if constant else np.linspace(0.0, horizon, INSTANTS)
    with np.errstate(all="ignore"):
        matrices = law.matrix_at(times)
    matrices = np.broadcast_to(matrices, (len(times), G.dimension, G.dimension))
    for moments in G.principal_moments(matrices):
        low, middle, high = moments.T
        broken = np.flatnonzero(low + middle < high * (1 - ROUNDING))
        if broken.size:
            when = "" if constant else f" at t = {times[broken[0]]:g} s"
            return _in_words(moments[broken[0]]) + when
    return ""


def _in_words(moments: Array) -> str:
    low, middle, high = (f"{moment:.4g}" for moment in moments)
    return (
        f"principal moments {low}, {middle} and {high} kg m² violate the triangle inequality: "
        f"{low} + {middle} < {high}"
    )
