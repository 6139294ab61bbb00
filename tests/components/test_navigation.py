"""The navigation function Υ: Hampsey et al. (2025), Example 3.4 and eq. (13), and every group."""

import numpy as np
import pytest
from drawn import drawn

from eqt_cli.components.mechanics import gradient, hessian_at_identity, potential
from eqt_cli.extend import apply_matrix, dot, group_named, transpose

# Tens of last places of numbers up to a hundred.
ROUNDING = 1e-13
# Five-point differences, see the fixture `derivative`; measured 1e-12.
DIFFERENCES = 1e-10


def assert_equal(left, right, tolerance=ROUNDING):
    np.testing.assert_allclose(left, np.broadcast_to(right, np.shape(left)), rtol=0, atol=tolerance)


def trace(matrix):
    return np.trace(matrix, axis1=-2, axis2=-1)


def symmetric_weight(samples, data):
    return samples.symmetric(data, samples.G.size)


# On SO(3), as the paper writes it -----------------------------------------------------------------


@drawn()
def test_example_3_4_potential_on_SO3(samples_of, data):
    """Υ = tr(K(I − R)) = −(1 − cos θ) tr(K (n^×)²)."""
    some = samples_of("SO3")
    G, K, turn = some.G, symmetric_weight(some, data), some.coordinates(data)
    R = G.exp(turn)
    assert_equal(potential(G, K, R), trace(K @ (np.eye(3) - R)))
    angle = np.linalg.norm(turn, axis=-1)
    axis = turn / np.where(angle > 0, angle, 1.0)[..., None]
    n = G.hat(axis)
    assert_equal(potential(G, K, R), -(1 - np.cos(angle)) * trace(K @ n @ n))


@drawn()
def test_example_3_4_with_the_identity_as_weight(samples_of, data):
    """2(1 − cos θ): the paper's 1 − cos θ lacks a factor of 2."""
    some = samples_of("SO3")
    turn = some.coordinates(data)
    angle = np.linalg.norm(turn, axis=-1)
    assert_equal(potential(some.G, np.eye(3), some.G.exp(turn)), 2 * (1 - np.cos(angle)))


@drawn()
def test_equation_13_gradient_on_SO3(samples_of, data):
    """L*_R dΥ = (K R − Rᵀ K)^∨."""
    some = samples_of("SO3")
    K, R = symmetric_weight(some, data), some.pose(data)
    A = K @ R - transpose(R) @ K
    vee = np.stack([A[..., 2, 1], A[..., 0, 2], A[..., 1, 0]], axis=-1)
    assert_equal(gradient(some.G, K, R), vee)


def test_eigenvalues_of_the_hessian_on_SO3_are_sums_of_two():
    hessian = hessian_at_identity(group_named("SO3"), np.diag([2.0, -0.5, 7.0]))
    assert_equal(np.linalg.eigvalsh(hessian), [2 - 0.5, 7 - 0.5, 2 + 7])


@pytest.mark.parametrize(
    ("weight", "critical"), [([1.0, 1.0, 1.0], True), ([1.0, 2.0, 3.0], False)]
)
def test_half_turns_about_any_axis_are_critical_for_equal_eigenvalues_only(weight, critical):
    """With K = I the critical set at θ = π is a whole RP², so Υ is no Morse function."""
    G = group_named("SO3")
    half_turn = G.exp(np.pi * np.array([1.0, 2.0, 2.0]) / 3)
    assert (np.linalg.norm(gradient(G, np.diag(weight), half_turn)) < ROUNDING) == critical


# With translations --------------------------------------------------------------------------------


@drawn()
def test_potential_of_a_rigid_motion_is_a_rotation_and_a_spring(samples_of, data):
    """With K = blkdiag(K_R, k): tr(K_R(I − R)) + ½ k |x|²."""
    some = samples_of("SE3")
    Q, K_R, k = some.pose(data), some.symmetric(data, 3), some.numbers(data)
    K = np.zeros((*some.shape, 4, 4))
    K[..., :3, :3], K[..., 3, 3] = K_R, k
    R, x = Q[..., :3, :3], Q[..., :3, 3]
    expected = trace(K_R @ (np.eye(3) - R)) + k * dot(x, x) / 2
    assert_equal(potential(some.G, K, Q), expected)


# On every group -----------------------------------------------------------------------------------


@drawn()
def test_potential_is_positive_away_from_the_identity(samples, data):
    G, K, Q = samples.G, samples.positive_definite(data, samples.G.size), samples.pose(data)
    distance = ((Q - G.identity) ** 2).sum(axis=(-2, -1))
    # Every eigenvalue of K is at least ½.
    assert (potential(G, K, Q) >= distance / 4 - ROUNDING).all()


@drawn()
def test_identity_is_critical(samples, data):
    G, K = samples.G, symmetric_weight(samples, data)
    assert_equal(potential(G, K, G.identity), 0.0, tolerance=0)
    assert_equal(gradient(G, K, G.identity), 0.0, tolerance=0)


@drawn()
def test_gradient_is_the_derivative_of_the_potential(samples, data, derivative):
    """⟨L*_Q dΥ, U⟩ = d/dt Υ(Q exp(tU))."""
    G, K = samples.G, symmetric_weight(samples, data)
    Q, U = samples.pose(data), samples.vector(data)
    rate = derivative(lambda t: potential(G, K, Q @ G.exp(t * U)))
    assert_equal(dot(gradient(G, K, Q), U), rate, DIFFERENCES)


@drawn()
def test_hessian_is_the_derivative_of_the_gradient(samples, data, derivative):
    G, U = samples.G, samples.vector(data)
    K = symmetric_weight(samples, data)[0]
    rate = derivative(lambda t: gradient(G, K, G.exp(t * U)))
    assert_equal(apply_matrix(hessian_at_identity(G, K), U), rate, DIFFERENCES)


@drawn()
def test_each_element_of_a_batch_has_its_own_weight(samples, data):
    G, K, Q = samples.G, symmetric_weight(samples, data), samples.pose(data)
    for k in range(len(Q)):
        assert_equal(potential(G, K, Q)[k], potential(G, K[k], Q[k]))
        assert_equal(gradient(G, K, Q)[k], gradient(G, K[k], Q[k]))
