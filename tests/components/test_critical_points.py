"""The critical points of Υ: where they are, what they are, and how far a pose is from them."""

import numpy as np
import pytest
from small_loops import any_matrix

from eqt_cli.components.inertia import (
    _direction,
    common_weight,
    critical_sets,
    distance_to_unstable,
)
from eqt_cli.components.mechanics import gradient
from eqt_cli.extend import MatrixLieGroup, frobenius, group_named

# Hundreds of last places of numbers of order 10.
ROUNDING = 1e-13


def summary(name, K):
    found = critical_sets(group_named(name), K)
    return [(each.name, each.index, each.dimension) for each in found]


FOUR = [
    ("half-turn about (1, 0, 0)", 3, 0),
    ("half-turn about (0, 1, 0)", 2, 0),
    ("half-turn about (0, 0, 1)", 1, 0),
]
CIRCLE = [
    ("half-turns about every axis normal to (0, 0, 1)", 2, 1),
    ("half-turn about (0, 0, 1)", 1, 0),
]


@pytest.mark.parametrize(
    ("name", "weights", "points"),
    [
        ("SO3", [1.0, 1.0, 1.0], [("half-turns about every axis", 1, 2)]),  # Morse-Bott
        ("SO3", [1.0, 2.0, 3.0], FOUR),
        ("SO3", [1e-12, 2e-12, 3e-12], FOUR),
        ("SO3", [-0.5, 2.0, 3.0], FOUR),  # which may leave a minimum at the identity
        ("SO3", [1.0, 1.0, 3.0], CIRCLE),
        ("SO3", [-5.0, -5.0 - 1e-13, -1e-3], None),  # equal by the size of the largest
        ("SO2", [1.0, 1.0], [("half-turn", 1, 0)]),
        ("SE2", [1.0, 1.0, 1.0], [("half-turn", 1, 0)]),
        ("R3", [1.0] * 4, []),
    ],
)
def test_points_beside_the_identity_with_index_and_dimension(name, weights, points):
    first, *others = summary(name, np.diag(weights))
    if points is None:
        assert [each[0] for each in (first, *others)] == ["identity", *(each[0] for each in CIRCLE)]
    else:
        assert (first, others) == (("identity", 0, 0), points)


@pytest.mark.parametrize("name", ["SE3", "SE23"])
def test_translations_add_no_points(name):
    indices = [index for _, index, _ in summary(name, any_matrix(group_named(name).size, 0))]
    assert indices == [0, 3, 2, 1]


def test_products_combine_the_points_of_their_factors():
    weight = np.diag([1.0, 1.0, 3.0, 1.0, 1.0])
    circle = "half-turns about every axis normal to (0, 0, 1)"
    assert summary("SO3*SO2", weight) == [
        ("identity × identity", 0, 0),
        ("identity × half-turn", 1, 0),
        (f"{circle} × identity", 2, 1),
        (f"{circle} × half-turn", 3, 1),
        ("half-turn about (0, 0, 1) × identity", 1, 0),
        ("half-turn about (0, 0, 1) × half-turn", 2, 0),
    ]


def test_a_group_of_unknown_structure_has_no_known_points():
    class Other(MatrixLieGroup):
        name, basis, axis_names = "Other", group_named("SO2").basis, ("ω",)
        parts = ()
        inverse = exp = log = drift = None

    G = Other()
    assert critical_sets(G, np.eye(2)) is None
    assert np.isnan(distance_to_unstable(G, np.eye(2), np.eye(2)[None])).all()


def test_points_are_critical_members_of_the_group(G):
    for seed in range(3):
        K = any_matrix(G.size, seed)
        for each in critical_sets(G, K):
            assert G.violation(each.Q) < ROUNDING
            assert np.abs(gradient(G, K, each.Q)).max() < ROUNDING * np.abs(K).max()


def test_hessians_are_derivatives_of_the_gradient(G, derivative):
    K = any_matrix(G.size, 0)
    for each in critical_sets(G, K):
        columns = [
            derivative(lambda t, Q=each.Q, E=E: gradient(G, K, Q @ G.exp(t * E)))
            for E in np.eye(G.dimension)
        ]
        eigenvalues = np.linalg.eigvalsh(np.array(columns))
        # Five-point differences (see the fixture) of numbers up to a hundred.
        np.testing.assert_allclose(each.hessian, eigenvalues, rtol=0, atol=1e-8)


def test_descent_from_anywhere_ends_at_a_listed_point(G):
    """No critical point is missing: where ‖gradient‖ is small, a listed set is near."""
    K = any_matrix(G.size, 0)
    random = np.random.default_rng(1)
    Q = G.exp(random.standard_normal((20, G.dimension)))
    for _ in range(200):  # descent on ½‖gradient‖² by Gauss-Newton, which ends at any index
        slope = gradient(G, K, Q)
        step = 1e-6
        jacobian = np.stack(
            [
                (gradient(G, K, Q @ G.exp(step * E)) - gradient(G, K, Q @ G.exp(-step * E)))
                / (2 * step)
                for E in np.eye(G.dimension)
            ],
            axis=-1,
        )
        damped = jacobian @ jacobian.swapaxes(-1, -2) + 1e-3 * np.eye(G.dimension)
        move = -(jacobian.swapaxes(-1, -2) @ np.linalg.solve(damped, slope[..., None]))[..., 0]
        length = np.linalg.norm(move, axis=-1, keepdims=True)
        Q = Q @ G.exp(move / np.maximum(1, 5 * length))
        if np.abs(slope).max() < 1e-9:
            break
    ended = np.abs(gradient(G, K, Q)).max(axis=-1) < 1e-6
    assert ended.sum() >= 10
    distances = [each.squared_distance(Q[ended]) for each in critical_sets(G, K)]
    assert np.sqrt(np.min(distances, axis=0)).max() < 1e-5


# Distances ----------------------------------------------------------------------------------------


def half_turn(axis):
    return 2 * np.outer(axis, axis) - np.eye(3)


def test_distance_to_isolated_points_is_the_least():
    G, K = group_named("SO3"), np.diag([1.0, 2.0, 3.0])
    Q = G.exp(np.random.default_rng(0).standard_normal((7, 3)))
    every = [frobenius(Q - half_turn(axis)) for axis in np.eye(3)]
    np.testing.assert_allclose(distance_to_unstable(G, K, Q), np.min(every, axis=0), atol=ROUNDING)


@pytest.mark.parametrize(
    "eigenvalues", [[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]], ids=["every axis", "a plane of axes"]
)
@pytest.mark.parametrize("coupled", [False, True])
def test_distance_to_a_manifold_is_the_least_over_its_axes(eigenvalues, coupled):
    G, random = group_named("SE3"), np.random.default_rng(0)
    B = random.standard_normal((3, 1)) * coupled
    K = np.block([[np.diag(eigenvalues) + B @ B.T / 2, B], [B.T, np.array([[2.0]])]])
    Q = G.exp(random.standard_normal(6))
    angles = np.linspace(0, np.pi, 401)
    circle = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1)
    if eigenvalues[2] == 1.0:
        tilted = np.linspace(0, np.pi, 401)[:, None, None]
        planar = circle[None] * np.sin(tilted)
        axes = (planar + np.cos(tilted) * np.eye(3)[2]).reshape(-1, 3)
    else:
        axes = np.concatenate([circle, np.eye(3)[2:]])
    R = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    least = frobenius(Q - G.assemble(R, (np.eye(3) - R) @ B / 2)).min()
    found = distance_to_unstable(G, K, Q)
    # The grid of axes is never closer than the closest, and spaced by 8e-3: squares differ by 1e-4.
    assert found <= least + ROUNDING
    assert found == pytest.approx(least, abs=1e-3)


@pytest.mark.parametrize("eigenvalues", [[1.0, 1.0, 1.0], [1.0, 1.0, 3.0]])
@pytest.mark.parametrize("coupling", [0.0, 0.5])
def test_distance_to_a_manifold_is_zero_on_it(eigenvalues, coupling):
    """Whatever the axis, and not the root of a negative number by rounding."""
    G, B = group_named("SE3"), coupling * np.array([[1.0], [-2.0], [0.5]])
    K = np.block([[np.diag(eigenvalues) + B @ B.T / 2, B], [B.T, np.array([[2.0]])]])
    axes = np.stack([[np.cos(a), np.sin(a), 0.0] for a in np.linspace(0.0, 3.0, 20)])
    R = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    Q = G.assemble(R, (np.eye(3) - R) @ B / 2)
    # The root of the rounding of numbers of order 10.
    np.testing.assert_allclose(distance_to_unstable(G, K, Q), 0.0, atol=1e-6)


def test_multiples_of_the_identity_have_one_weight():
    """Not those of another weight; the distances have the same bits."""
    G, multiples = group_named("SO3"), np.array([[[[1.0]]], [[[0.3]]], [[[7.0]]]]) * np.eye(3)
    Q = G.exp(np.random.default_rng(0).standard_normal((3, 5, 3)))
    for K, shape in ((multiples, (3, 3)), (multiples + np.diag([0, 0, 1]), (3, 1, 3, 3))):
        found = distance_to_unstable(G, common_weight(K), Q)
        assert common_weight(K).shape == shape
        assert found.tobytes() == distance_to_unstable(G, K, Q).tobytes()
    each = [distance_to_unstable(G, K[0], q) for K, q in zip(multiples, Q, strict=True)]
    assert distance_to_unstable(G, multiples[:, 0], Q).tobytes() == np.array(each).tobytes()


def test_distance_in_a_product_adds_the_squares_of_its_blocks():
    G = group_named("SO3*SO2")
    K = np.eye(5)
    Q = G.exp(np.random.default_rng(0).standard_normal((6, 4)))
    turn, wheel = Q[:, :3, :3], Q[:, 3:, 3:]
    to_half_turns = 2 + 2 * np.trace(turn, axis1=1, axis2=2)
    to_half_turn = ((wheel + np.eye(2)) ** 2).sum(axis=(1, 2))
    to_identity = ((turn - np.eye(3)) ** 2).sum(axis=(1, 2))
    wheel_identity = ((wheel - np.eye(2)) ** 2).sum(axis=(1, 2))
    every = [to_identity + to_half_turn, to_half_turns + wheel_identity]
    every.append(to_half_turns + to_half_turn)
    expected = np.sqrt(np.min(every, axis=0))
    np.testing.assert_allclose(distance_to_unstable(G, K, Q), expected, atol=ROUNDING)


def test_distance_is_zero_at_the_points_and_positive_at_the_identity(G):
    K = any_matrix(G.size, 0)
    found = critical_sets(G, K)
    if len(found) > 1:
        at_points = distance_to_unstable(G, K, np.array([each.Q for each in found[1:]]))
        np.testing.assert_allclose(at_points, 0.0, atol=1e-7)  # a square root of rounding
        assert distance_to_unstable(G, K, G.identity) > 1.0
    else:
        assert np.isnan(distance_to_unstable(G, K, G.identity))


def test_weights_may_differ_from_run_to_run():
    G = group_named("SO3")
    weights = np.array([np.eye(3), np.diag([1.0, 2.0, 3.0])])
    Q = G.exp(np.random.default_rng(0).standard_normal((2, 5, 3)))
    found = distance_to_unstable(G, weights[:, None], Q)
    for k, K in enumerate(weights):
        np.testing.assert_array_equal(found[k], distance_to_unstable(G, K, Q[k]))


@pytest.mark.parametrize(("name", "size"), [("R3", 4), ("SE3", 3)])
def test_without_unstable_points_and_with_a_weight_of_another_group_there_is_no_distance(
    name, size
):
    """As with that of the attitude law in a cascade."""
    Q = np.broadcast_to(np.eye(4), (2, 5, 4, 4))
    found = distance_to_unstable(group_named(name), np.eye(size), Q)
    assert found.shape == (2, 5) and np.isnan(found).all()


def test_runs_that_failed_have_no_distance():
    G = group_named("SO3")
    Q = np.stack([np.full((3, 3), np.nan), np.eye(3)])
    for K in (np.eye(3), np.diag([1.0, 1.0, 3.0]), np.diag([1.0, 2.0, 3.0])):
        found = distance_to_unstable(G, K, Q)
        assert np.isnan(found[0]) and np.isfinite(found[1])


@pytest.mark.parametrize("sign", [1, -1])
def test_an_axis_is_named_with_its_largest_entry_positive(sign):
    """Eigenvectors come with either sign."""
    assert _direction(sign * np.array([-0.8, 0.6, 0.0])) == "(0.8, -0.6, 0)"
    assert _direction(sign * np.array([1.0, 2.0, 2.0]) / 3) == "(0.333, 0.667, 0.667)"


def test_the_distance_to_half_turns_about_axes_in_a_turned_plane():
    """The nearest of 20,000 of them, whose angles are 8e-5 rad from one another at most."""
    G = group_named("SO3")
    turn, Q = G.exp(np.random.default_rng(4).standard_normal((2, 3)))
    angles = np.linspace(0, np.pi, 20000)
    axes = np.stack([np.cos(angles), np.sin(angles), 0 * angles], axis=-1) @ turn.T
    half_turns = 2 * axes[:, :, None] * axes[:, None, :] - np.eye(3)
    single = 2 * np.outer(turn[:, 2], turn[:, 2]) - np.eye(3)
    expected = min(frobenius(Q - half_turns).min(), frobenius(Q - single))
    K = turn @ np.diag([1.0, 1.0, 3.0]) @ turn.T
    assert distance_to_unstable(G, K, Q[None]) == pytest.approx([expected], abs=1e-6)


@pytest.mark.parametrize(
    ("weights", "nullities"), [([1, 1, 1], [0, 2]), ([1, 1, 3], [0, 1, 0]), ([1, 2, 3], [0] * 4)]
)
def test_the_nullity_counts_what_neither_rises_nor_falls(weights, nullities):
    G = group_named("SO3")
    found = critical_sets(G, np.diag(weights).astype(float))
    assert sorted(each.nullity for each in found) == sorted(nullities)
    for turn in G.exp(np.random.default_rng(0).standard_normal((5, 3))):  # zeros but for rounding
        turned = critical_sets(G, turn @ np.diag(weights) @ turn.T)
        assert [each.nullity for each in turned] == [each.nullity for each in found]
        assert [each.index for each in turned] == [each.index for each in found]
