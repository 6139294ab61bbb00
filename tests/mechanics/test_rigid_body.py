"""An inertia that no rigid body has is told by its principal moments."""

import numpy as np
import pytest

from eqt_cli.core.expressions import parse
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia, PrescribedInertia, not_rigid

TURN = np.array([[0.6, -0.8, 0.0], [0.8, 0.6, 0.0], [0.0, 0.0, 1.0]])


def constant(matrix):
    return Inertia(np.asarray(matrix, float), np.linalg.inv(matrix))


def told(group, matrix):
    return not_rigid(group_named(group), constant(matrix), 10.0)


def body(moments, mass=10.0, centre=(0.0, 0.0, 0.0)):
    """The inertia of a rigid body about a point that its centre of mass is `centre` away from."""
    x, y, z = centre
    C = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    J = np.diag(moments) + mass * C @ C.T
    return np.block([[J, mass * C], [mass * C.T, mass * np.eye(3)]])


def test_the_moments_and_the_inequality_are_named():
    turned = TURN @ np.diag([1.0, 2.0, 3.5]) @ TURN.T
    assert told("SO3", turned) == (
        "principal moments 1, 2 and 3.5 kg m² violate the triangle inequality: 1 + 2 < 3.5"
    )


@pytest.mark.parametrize("moments", [[1, 1, 1], [1, 2, 2.9], [1, 2, 3], [0.1, 0.2, 0.3]])
def test_bodies_and_flat_bodies_are_rigid(moments):
    assert told("SO3", np.diag(moments)) == ""


def test_moments_are_taken_about_the_centre_of_mass():
    """Far from it those of any mass obey the inequality, or nearly."""
    assert told("SE3", body([1, 1, 1.9], centre=(1.0, 2.0, 3.0))) == ""
    assert told("SE3", body([1, 1, 2.5], centre=(1.0, 2.0, 3.0))).startswith(
        "principal moments 1, 1 and 2.5 kg m²"
    )


def test_every_body_of_a_product_is_looked_at():
    two = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 5.0])
    assert "1 + 1 < 5" in told("SO3*SO3", two)
    assert told("R3*SO3", np.diag([1.0, 1.0, 9.0, 1.0, 1.0, 1.0])) == ""
    assert "1 + 1 < 9" in told("R3*SO3", np.diag([1.0, 1.0, 1.0, 1.0, 9.0, 1.0]))


@pytest.mark.parametrize("group", ["SO2", "SE2", "R3", "SE23"])
def test_other_groups_know_no_moments(group):
    G = group_named(group)
    assert told(group, np.diag(10.0 ** np.arange(G.dimension))) == ""


def test_a_varying_inertia_says_when():
    rows = [["1", "0", "0"], ["0", "1", "0"], ["0", "0", "1 + t/4"]]
    law = PrescribedInertia(tuple(tuple(parse(text) for text in row) for row in rows))
    G = group_named("SO3")
    assert not_rigid(G, law, 4.0) == ""
    assert not_rigid(G, law, 8.0).endswith(": 1 + 1 < 2.02 at t = 4.08 s")


def test_moments_are_what_a_turn_meets_where_all_else_may_move():
    """Then velocities are 𝕀⁻¹P, of whose rotations only a moment without a force remains."""
    A = np.random.default_rng(0).standard_normal((6, 6))
    inertia = A @ A.T + np.eye(6)
    free = np.linalg.inv(inertia)[:3, :3]
    [moments] = group_named("SE3").principal_moments(inertia)
    assert moments == pytest.approx(np.linalg.eigvalsh(np.linalg.inv(free)), rel=1e-12)
