"""Whether an inertia can be that of a rigid body, by its principal moments."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.mechanics.inertia import Inertia, InertiaLaw

ROUNDING = 1e-9
"""Of the largest moment; a flat body's is the sum of the other two."""

INSTANTS = 101
"""How many instants of the horizon a varying inertia is looked at."""


def not_rigid(G: MatrixLieGroup, law: InertiaLaw, horizon: float) -> str:
    """Why no rigid body has this inertia, in words; empty where one can have it.

    Its principal moments about the centre of mass, J₁ ≤ J₂ ≤ J₃, are sums over its mass of squared
    distances, so that J₁ + J₂ ≥ J₃: the triangle inequality.
    """
    constant = isinstance(law, Inertia)
    times = np.zeros(1) if constant else np.linspace(0.0, horizon, INSTANTS)
    with np.errstate(all="ignore"):
        found = law.matrix_at(times)
    matrices = np.broadcast_to(found, (len(times), G.dimension, G.dimension))
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
