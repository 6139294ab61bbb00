"""A reference that keeps its velocity, whatever its inertia does."""

import numpy as np
import pytest

from eqt_cli.core.expressions import parse
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia, PrescribedInertia
from eqt_cli.references.constant import ConstantReference

VELOCITY = np.array([0.3, 0.2, -0.1])


def torque(law, t=0.7):
    reference = ConstantReference(velocity=VELOCITY.tolist())
    return reference.desired(group_named("SO3"), law.at(t), t, None, None).tau


def test_a_constant_inertia_takes_what_turns_the_momentum():
    """τ_d = ω × 𝕀ω."""
    matrix = np.diag([1.0, 2.0, 4.0])
    expected = np.cross(VELOCITY, matrix @ VELOCITY)
    assert torque(Inertia(matrix, np.linalg.inv(matrix))) == pytest.approx(expected, rel=1e-14)


def test_a_varying_inertia_takes_its_own_change_as_well():
    """d(𝕀ω)/dt = 𝕀̇ω at constant ω."""
    rows = [["2 + t**2", "0", "0"], ["0", "3", "t"], ["0", "t", "5"]]
    law = PrescribedInertia(tuple(tuple(parse(entry) for entry in row) for row in rows))
    t = 0.7
    matrix = np.array([[2 + t**2, 0, 0], [0, 3, t], [0, t, 5]])
    change = np.array([[2 * t, 0, 0], [0, 0, 1], [0, 1, 0]])
    expected = change @ VELOCITY + np.cross(VELOCITY, matrix @ VELOCITY)
    assert torque(law, t) == pytest.approx(expected, rel=1e-12)
