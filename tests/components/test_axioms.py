"""The axioms of a matrix Lie group, on every registered group and for several batch shapes.

The samples hold rotations near 0 and near π, translations within ±2 per coordinate and vectors
within ±1. Each tolerance is at least five times the largest error seen in 1000 samples per group.
"""

from fractions import Fraction
from functools import partial
from itertools import permutations, product
from math import factorial

import numpy as np
import pytest
import scipy.linalg
from case_tables import refusal
from drawn import drawn

from eqt_cli.base.errors import ComponentError, TraceError
from eqt_cli.components.groups import (
    MatrixLieGroup,
    cayley,
    group_named,
    groups,
    log_force,
    screws_of,
)
from eqt_cli.components.matrix_groups import (
    FARTHEST,
    SO3,
    distance_of_turn,
    inverse_jacobian_terms,
    ratio_to_sine,
    stumpff,
    turn_of_distance,
)
from eqt_cli.extend import apply_matrix, dot, transpose

# Tens of last places of numbers up to a hundred; measured 2e-15.
ROUNDING = 1e-13
# SciPy's rigid motions leave their series for closed forms at an angle of 1e-3, where cancellation
# costs three digits; measured 9e-14.
CLOSED_FORMS = 5e-13
# Five-point differences, see the fixture `derivative`; measured 1e-12.
DIFFERENCES = 1e-10


SHAPES = [(), (3,), (2, 3)]
ALL = [group_named(name) for kind in groups.all() for name in kind.examples()]
BATCHES = [
    *((G, SHAPES[k % 3]) for k, G in enumerate(ALL)),
    *((group_named("SO3"), shape) for shape in SHAPES),
]
"""Every group with one of the shapes, and SO(3) with all of them."""

ALIKE = pytest.mark.ci("its kind of group is tried fast")


@pytest.fixture(
    scope="module",
    params=[
        pytest.param(batch, marks=[ALIKE] * (batch[0].name in ("SO2", "R3", "SO3*R3")))
        for batch in dict.fromkeys(BATCHES)
    ],
    ids=lambda batch: f"{batch[0].name}-{batch[1]}",
)
def batch(request):
    return request.param


@pytest.fixture(scope="module")
def G(batch):
    return batch[0]


@pytest.fixture(scope="module")
def shape(batch):
    return batch[1]


def assert_equal(left, right, tolerance=ROUNDING):
    """`right` may lack batch axes that `left` has, and not the other way round."""
    np.testing.assert_allclose(left, np.broadcast_to(right, np.shape(left)), rtol=0, atol=tolerance)


def commutator(A, B):
    return A @ B - B @ A


def angles(G, V):
    """The angle of every rotation in coordinates V, ``(rotations, ...)``."""
    turns = [V[..., part.axes] for part in G.parts if part.velocity_unit == "rad/s"]
    return np.array([np.linalg.norm(turn, axis=-1) for turn in turns])


# The description of a group -----------------------------------------------------------------------


def test_basis_is_orthogonal_with_entries_that_divide_exactly(G):
    assert np.isin(G.basis, [-1.0, 0.0, 1.0]).all()
    flat = G.basis.reshape(G.dimension, -1)
    products = flat @ flat.T
    assert (products == np.diag(products.diagonal())).all()
    assert (products.diagonal() > 0).all()


def test_algebra_is_closed_under_the_bracket(G):
    brackets = commutator(G.basis[:, None], G.basis)
    assert (G.hat(G.vee(brackets)) == brackets).all()


def test_parts_and_names_cover_every_axis_once(G):
    axes = [axis for part in G.parts for axis in range(G.dimension)[part.axes]]
    assert axes == list(range(G.dimension))
    assert len(G.axis_names) == len(set(G.axis_names)) == G.dimension


def test_a_part_that_does_not_turn_has_an_entry_for_every_axis(G):
    for part in G.parts:
        rows, columns = (len(range(G.size)[entries]) for entries in part.entries)
        assert rows * columns == (rows**2 if part.turns else len(range(G.dimension)[part.axes]))
        assert max(entries.stop for entries in part.entries) <= G.size


@drawn()
def test_parts_cover_every_entry_that_can_vary(samples, data):
    G, Q = samples.G, samples.pose(data)
    rest = Q - G.identity
    for part in G.parts:
        rest[(..., *part.entries)] = 0
    assert not rest.any()


# Product, inverse, elements -----------------------------------------------------------------------


@drawn()
def test_inverse(samples, data):
    G, Q = samples.G, samples.pose(data)
    assert_equal(Q @ G.inverse(Q), G.identity)
    assert_equal(G.inverse(Q) @ Q, G.identity)


@drawn()
def test_rate_of_QTQ_along_a_motion(samples, data, derivative):
    G, Q, V = samples.G, samples.pose(data), samples.vector(data)

    def product(t):
        moved = Q @ G.exp(t * V)
        return transpose(moved) @ moved

    assert_equal(G.gram_rate(Q, V), derivative(product), DIFFERENCES)


@drawn()
def test_products_and_inverses_stay_in_the_group(samples, data):
    G, (Q, R) = samples.G, samples.poses(data, 2)
    for element in (Q, Q @ R, G.inverse(Q)):
        assert_equal(G.drift(element), np.zeros(samples.shape))
        for matrix in element.reshape(-1, G.size, G.size):
            assert G.violation(matrix) < ROUNDING


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23"])
def test_violation_measures_what_is_no_element(name):
    G = group_named(name)
    n = G.space
    reflection = np.diag([-1.0] + [1.0] * (G.size - 1))
    assert G.violation(reflection) == 2.0
    singular = np.diag([0.0] + [1.0] * (G.size - 1))
    assert G.violation(singular) == 1.0  # RᵀR − I has the only entry −1
    stretched = G.identity.copy()
    stretched[:n, :n] *= 2  # RᵀR − I = 3 I
    assert G.violation(stretched) == pytest.approx(3 * np.sqrt(n), rel=1e-15)
    if G.columns:
        last_row = G.identity.copy()
        last_row[-1, 0] = 0.25
        assert G.violation(last_row) == 0.25


# exp and log --------------------------------------------------------------------------------------


@drawn()
def test_exp_and_its_Ad_are_matrix_exponentials(samples, data):
    G, V = samples.G, samples.coordinates(data)
    assert_equal(G.exp(V), scipy.linalg.expm(G.hat(V)), CLOSED_FORMS)
    assert_equal(G.Ad_matrix(G.exp(V)), scipy.linalg.expm(G.ad_matrix(V)), CLOSED_FORMS)


def test_exp_of_zero_is_the_identity(samples):
    G = samples.G
    assert_equal(G.exp(np.zeros((*samples.shape, G.dimension))), G.identity, tolerance=0)


@drawn()
def test_log_undoes_exp(samples, data):
    G, V = samples.G, samples.coordinates(data)
    assert_equal(G.log(G.exp(V)), V, CLOSED_FORMS)


@pytest.mark.parametrize("angle", [1e-12, 1e-6, 1e-3])
@drawn()
def test_log_keeps_the_digits_of_small_rotations(samples, data, angle):
    G, V = samples.G, samples.coordinates(data, angle)
    # A direction's own rounding, and that of a sine and its inverse: a few last places.
    np.testing.assert_allclose(angles(G, G.log(G.exp(V))), angle, rtol=2e-15)


@drawn()
def test_exp_undoes_log_which_returns_the_smallest_angles(samples, data):
    G, (Q, R) = samples.G, samples.poses(data, 2)
    assert_equal(G.exp(G.log(Q @ R)), Q @ R, CLOSED_FORMS * 4)  # translations up to 8
    assert (angles(G, G.log(Q @ R)) <= np.pi).all()


@drawn()
def test_exp_undoes_log_at_half_turns(samples, data):
    # There log may take either of two opposite axes, so only poses can be compared.
    G, V = samples.G, samples.coordinates(data, angle=np.pi)
    assert_equal(G.exp(G.log(G.exp(V))), G.exp(V), CLOSED_FORMS)


# Algebra ------------------------------------------------------------------------------------------


@drawn()
def test_hat_combines_the_basis_and_vee_undoes_it_exactly(samples, data):
    G, V = samples.G, samples.vector(data)
    combination = sum(V[..., i, None, None] * E for i, E in enumerate(G.basis))
    assert_equal(G.hat(V), combination, tolerance=0)
    assert_equal(G.vee(G.hat(V)), V, tolerance=1e-300)  # where a half may underflow


@drawn()
def test_bracket_is_the_commutator(samples, data):
    G, (V, U) = samples.G, samples.vectors(data, 2)
    assert_equal(G.hat(G.ad(V, U)), commutator(G.hat(V), G.hat(U)))


# Adjoint maps -------------------------------------------------------------------------------------


@drawn()
def test_Ad_is_conjugation_and_has_a_matrix(samples, data):
    G, Q, V = samples.G, samples.pose(data), samples.vector(data)
    assert_equal(G.hat(G.Ad(Q, V)), Q @ G.hat(V) @ np.linalg.inv(Q))
    assert_equal(apply_matrix(G.Ad_matrix(Q), V), G.Ad(Q, V))


@drawn()
def test_equation_21_derivative_of_Ad_of_the_inverse(samples, data, derivative):
    """With Q̇ = Q V^ and S = Ad_{Q⁻¹}, Ṡ = −ad_V S = −S ad_{Ad_Q V}."""
    G, Q, (V, U) = samples.G, samples.pose(data), samples.vectors(data, 2)
    rate = derivative(lambda t: G.Ad(G.inverse(Q @ G.exp(t * V)), U))
    S = G.inverse(Q)
    assert_equal(rate, -G.ad(V, G.Ad(S, U)), DIFFERENCES)
    assert_equal(rate, -G.Ad(S, G.ad(G.Ad(Q, V), U)), DIFFERENCES)


# Dual maps ----------------------------------------------------------------------------------------


@drawn()
def test_equation_1_dual_of_Ad(samples, data):
    G, Q, (P, U) = samples.G, samples.pose(data), samples.vectors(data, 2)
    assert_equal(dot(G.Ad_star(Q, P), U), dot(P, G.Ad(Q, U)))


@drawn()
def test_equation_2_dual_of_ad(samples, data):
    G, (V, P, U) = samples.G, samples.vectors(data, 3)
    bracket = G.vee(commutator(G.hat(V), G.hat(U)))
    assert_equal(dot(G.ad_star(V, P), U), dot(P, bracket))


@drawn()
def test_contract_is_the_trace_with_the_algebra(samples, data):
    G, U = samples.G, samples.vector(data)
    M = samples.numbers(data, G.size, G.size)
    assert_equal(dot(G.contract(M), U), np.trace(transpose(M) @ G.hat(U), axis1=-2, axis2=-1))


# Compact states -----------------------------------------------------------------------------------


@drawn()
def test_unpack_undoes_pack_exactly(samples, data):
    G, Q = samples.G, samples.pose(data)
    packed = G.pack(Q)
    assert packed.shape == (*samples.shape, G.pose_length)
    assert_equal(G.unpack(packed), Q, tolerance=0)
    assert_equal(G.pack(G.unpack(packed)), packed, tolerance=0)


@drawn()
def test_pack_keeps_every_velocity(samples, data):
    """Q̇ = Q V^ has nothing in the entries that pack leaves out."""
    G, Q, V = samples.G, samples.pose(data), samples.vector(data)
    Q_dot = Q @ G.hat(V)
    assert_equal(G.unpack(G.pack(Q_dot)) - G.unpack(G.pack(0 * Q_dot)), Q_dot, tolerance=0)


# Batches and symbols ------------------------------------------------------------------------------


@drawn()
def test_one_element_acts_on_a_batch(samples, data):
    G, Q, V = samples.G, samples.pose(data), samples.vector(data)
    one = np.zeros(len(samples.shape), dtype=int)
    first_pose, first_vector = Q[(*one,)], V[(*one,)]
    assert_equal(G.Ad(first_pose, V)[(*one,)], G.Ad(first_pose, first_vector))
    assert_equal(G.Ad_star(first_pose, V)[(*one,)], G.Ad_star(first_pose, first_vector))
    assert_equal(G.Ad(Q, first_vector)[(*one,)], G.Ad(first_pose, first_vector))
    assert_equal(G.ad_star(first_vector, V)[(*one,)], G.ad_star(first_vector, first_vector))


@drawn(examples=3)  # objects are slow
def test_operators_take_batches_and_object_arrays(samples, data):
    G, Q, (V, U) = samples.G, samples.pose(data), samples.vectors(data, 2)
    one = (0,) * len(samples.shape)
    operators = [
        *((G.inverse, Q), (G.hat, V), (G.vee, G.hat(V)), (G.contract, Q), (G.ad, V, U)),
        *((G.ad_star, V, U), (G.Ad, Q, V), (G.Ad_star, Q, V), (G.pack, Q)),
        *((G.unpack, G.pack(Q)), (G.exp, V), (G.log, Q), (partial(log_force, G), V, U)),
        *((partial(cayley, G), V), (G.gram_rate, Q, V), (G.drift, Q), (G.jacobian, V)),
    ]
    for operator, *arguments in operators:
        result = operator(*arguments)
        assert_equal(result[one], operator(*(argument[one] for argument in arguments)))
        of_objects = operator(*(argument.astype(object) for argument in arguments))
        assert_equal(np.asarray(of_objects, dtype=float), result, CLOSED_FORMS)


# The conventions of the paper and of the configuration --------------------------------------------


@drawn()
def test_example_3_1_operators_on_SO3(samples_of, data):
    some = samples_of("SO3")
    G, R, (u, v, p) = some.G, some.pose(data), some.vectors(data, 3)
    assert_equal(G.ad(u, v), np.cross(u, v))
    assert_equal(G.ad_star(u, p), -np.cross(u, p))
    assert_equal(G.Ad(R, u), (R @ u[..., None])[..., 0])
    assert_equal(G.Ad_star(R, p), (transpose(R) @ p[..., None])[..., 0])


@pytest.mark.parametrize(
    ("name", "matrix"),
    {
        "SO2": [[0, -1], [1, 0]],
        "SE2": [[0, -1, 2], [1, 0, 3], [0, 0, 0]],
        "SO3": [[0, -3, 2], [3, 0, -1], [-2, 1, 0]],
        "SE3": [[0, -3, 2, 4], [3, 0, -1, 5], [-2, 1, 0, 6], [0, 0, 0, 0]],
        "SE23": [[0, -3, 2, 4, 7], [3, 0, -1, 5, 8], [-2, 1, 0, 6, 9], [0, 0, 0, 0, 0],
            [0, 0, 0, 0, 0]],
    }.items(),
)  # fmt: skip
def test_coordinates_are_rotation_then_columns(name, matrix):
    G = group_named(name)
    assert G.hat(np.arange(1.0, G.dimension + 1)).tolist() == matrix


@pytest.mark.parametrize(
    ("name", "compact"),
    [
        *(("SO2", True), ("SO3", True), ("SE2", False), ("SE3", False), ("SE23", False)),
        *(("R3", False), ("SO3*SO2", True), ("SO3*R3", False)),
    ],
)
def test_a_group_knows_whether_it_is_compact(name, compact):
    assert group_named(name).compact == compact


@pytest.mark.parametrize("angle", [0.0, 1e-6, 1.0, 3.0, np.pi])
def test_a_turn_and_its_distance_undo_each_other(angle):
    found = turn_of_distance(np.array([distance_of_turn(angle), FARTHEST * (1 + 1e-15)]))
    assert found == pytest.approx([angle, np.pi], rel=1e-12)  # rounding may go beyond a half-turn


def test_the_series_of_a_jacobian_is_exact_up_to_its_bound():
    """About e_z, where ‖ad_x‖ is θ = 4: sin θ / θ and (1 − cos θ) / θ in the plane."""
    turn = 4.0
    a, b = np.sin(turn) / turn, (1 - np.cos(turn)) / turn
    found = MatrixLieGroup.jacobian(group_named("SO3"), np.array([0.0, 0.0, turn]))
    assert_equal(found, [[a, -b, 0], [b, a, 0], [0, 0, 1]], 1e-14)


class Plain(SO3):
    """As a group of a plugin may be."""

    name = "plain"
    cayley = screw = along = exp_along = None


@pytest.mark.parametrize("angle", [0.0, 0.7])
def test_a_group_without_screws_moves_by_its_exponential(angle):
    G, V = Plain(), np.array([0.3, -0.5, 0.8])
    frame, numbers, rates = screws_of(G).screw(V)
    assert_equal(frame @ screws_of(G).exp_along(numbers, angle * rates), G.exp(angle * V))


def test_cayleys_transform_of_a_group_that_gives_none_of_its_own():
    G, V = Plain(), np.array([[0.3, -0.5, 0.8], [1.0, 2.0, -0.1]])
    expected = [np.linalg.solve(np.eye(3) - U, np.eye(3) + U) for U in G.hat(V)]
    assert_equal(cayley(G, V), expected, 1e-14)


def test_symbols_need_a_motion_along_an_element_of_their_own():
    """Whether the element or the way along it is a symbol."""
    G, one = Plain(), np.ones(3)
    for numbers, angles in ((one.astype(object), one), (one, one.astype(object))):
        with pytest.raises(TraceError, match="group 'plain' has no method `exp_along`"):
            screws_of(G).exp_along(numbers, angles)


TURN, PLACE = ("1", "rad/s", "N m"), ("m", "m/s", "N")


@pytest.mark.parametrize(
    ("name", "axes", "parts"),
    [
        ("SO2", "ω", [("rotation", 0, 1, 0, 0, TURN)]),
        ("SE2", "ω vx vy", [("rotation", 0, 1, 0, 0, TURN), ("translation", 1, 3, 0, 2, PLACE)]),
        ("SE23", "ωx ωy ωz ax ay az vx vy vz",
         [("rotation", 0, 3, 0, 0, TURN), ("velocity", 3, 6, 0, 3, ("m/s", "m/s^2", "N s")),
         ("position", 6, 9, 0, 4, PLACE)]),
        ("R2", "v1 v2", [("translation", 0, 2, 0, 2, PLACE)]),
        ("SE3*SO2", "ωx₁ ωy₁ ωz₁ vx₁ vy₁ vz₁ ω₂",
         [("rotation_1", 0, 3, 0, 0, TURN), ("translation_1", 3, 6, 0, 3, PLACE),
         ("rotation_2", 6, 7, 4, 4, TURN)]),
    ],
)  # fmt: skip
def test_names_axes_entries_and_units_of_the_parts(name, axes, parts):
    """Tables, figures and files are written by them."""
    G = group_named(name)
    assert " ".join(G.axis_names) == axes
    found = [
        (part.name, part.axes.start, part.axes.stop, *(e.start for e in part.entries), units)
        for part in G.parts
        for units in [(part.pose_unit, part.velocity_unit, part.force_unit)]
    ]
    assert found == parts


@pytest.mark.parametrize(
    ("name", "translation"),
    [("SO3", None), ("SE3", "translation"), ("SE23", "position"), ("SE3*R3", None)],
)
def test_the_translation_of_a_group_is_the_only_one(name, translation):
    assert getattr(group_named(name).translation, "name", None) == translation


@pytest.mark.parametrize("name", ["SO2", "SO3"])
@pytest.mark.parametrize("angle", [0.0, 1e-3, 2.0, np.pi])
def test_the_distance_of_a_turn_is_that_of_its_matrix(name, angle):
    G = group_named(name)
    R = G.exp(angle * np.eye(G.dimension)[-1])
    assert distance_of_turn(angle) == pytest.approx(np.linalg.norm(G.identity - R), rel=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
@pytest.mark.parametrize("axis", [0, 1, 2])
def test_the_frame_of_a_turn_about_an_axis_of_space_has_no_other_entries(sign, axis):
    """Zeros cost nothing once compiled."""
    G, V = group_named("SE3"), np.array([0.0, 0.0, 0.0, 1.0, 2.0, 3.0])
    V[axis] = 0.7 * sign
    frame, numbers, rates = G.screw(V)
    assert np.isin(frame, [-1.0, 0.0, 1.0]).all()
    assert np.linalg.det(frame) == 1.0
    assert_equal(G.Ad(frame, G.along(numbers, rates)), V)


@pytest.mark.parametrize("angle", [0.5, 1.0, 2.0, 3.0, np.pi])
def test_terms_of_the_inverse_jacobian_are_those_of_the_cotangent(angle):
    """ψ = (1 − x cot x)/θ² with x = θ/2, and dψ/dθ² by hand."""
    x, square = angle / 2, angle**2
    cot, squared_sine = np.cos(x) / np.sin(x), np.sin(x) ** 2
    psi, slope = inverse_jacobian_terms(square)
    assert psi == pytest.approx((1 - x * cot) / square, rel=1e-13)
    # Differences of numbers of order 1, over θ⁴.
    expected = (x / squared_sine - cot) / (8 * x * square) - (1 - x * cot) / square**2
    assert slope == pytest.approx(expected, abs=1e-14 / square**2)


@pytest.mark.parametrize("square", [0.0, 1e-3, 0.9, 1.0, 1.9, 9.8, 40.0])
def test_the_functions_of_an_exponential_are_their_series(square):
    """c_k = Σ (−θ²)ⁿ/(2n + k)!, in exact fractions; their differences lose two digits."""
    found = stumpff(np.array([square]))
    assert len(found) == 6
    for k, c in enumerate(found):
        terms = (Fraction(-square) ** n / factorial(2 * n + k) for n in range(40))
        assert c == pytest.approx([float(sum(terms))], rel=0, abs=2e-14 / factorial(k))


@pytest.mark.parametrize("G", dict.fromkeys(ALL), ids=lambda G: G.name)
def test_a_covector_of_the_logarithm_has_the_power_of_its_rate(G, derivative):
    """⟨f, V⟩ = ⟨p, d/dt log(Q exp(tV))⟩."""
    x, p, V = np.random.default_rng(5).uniform(-1, 1, (3, 20, G.dimension))
    rate = derivative(lambda t: dot(p, G.log(G.exp(x) @ G.exp(t * V))))
    np.testing.assert_allclose(dot(log_force(G, x, p), V), rate, rtol=0, atol=DIFFERENCES)


@pytest.mark.parametrize("angle", [0.1, 1.0, 1.5])
def test_the_ratio_to_the_sine_is_found_from_the_cosine(angle):
    assert ratio_to_sine(np.cos(angle)) == pytest.approx(angle / np.sin(angle), rel=1e-14)


NEARLY_AXES = [
    np.array(signs) * sizes
    for sizes in permutations([1.0, 1e-3, 1e-7])
    for signs in product([1.0, -1.0], repeat=3)
]
"""Directions near every axis of space, leaning to either side."""


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1.0, np.pi / 2, 2.0, 2.2, 3.0, np.pi - 1e-7])
def test_a_half_turn_is_twice_a_unit_quaternion(angle):
    """cos(θ/2) and 2 sin(θ/2) times the axis, whichever entry of the quaternion is the largest."""
    G, vectors = group_named("SO3"), np.array([*NEARLY_AXES, [1.0, 1.0, 1.0], [-1.0, 1.0, 0.5]])
    axes = vectors / np.linalg.norm(vectors, axis=1, keepdims=True)
    found, twice = G.half_turn(G.exp(angle * axes))
    assert_equal(found, np.cos(angle / 2), 1e-15)
    assert_equal(twice, 2 * np.sin(angle / 2) * axes, 2e-15)


@pytest.mark.parametrize("angle", [0.0, 1e-7, 1.0, 2.0, 2.2, np.pi - 1e-7])
@pytest.mark.parametrize("sign", [1, -1])
def test_a_half_turn_of_the_plane_is_twice_a_sine(angle, sign):
    G = group_named("SE2")
    found, twice = G.half_turn(G.exp(np.array([sign * angle, 1.0, 2.0])))
    assert_equal(found, np.cos(angle / 2), 1e-15)
    assert_equal(twice, [2 * np.sin(sign * angle / 2)], 2e-15)


@pytest.mark.parametrize("name", ["SO2", "SO3"])
def test_quarter_turns_and_half_turns_are_exact(name):
    """Of whole numbers, as a user writes them."""
    G = group_named(name)
    quarter, half = G.identity.copy(), G.identity.copy()
    quarter[:2, :2], half[:2, :2] = [[0, -1], [1, 0]], [[-1, 0], [0, -1]]
    for R, angle in ((quarter, np.pi / 2), (half, np.pi)):
        np.testing.assert_allclose(G.log(R)[-1:], [angle], rtol=1e-15)
        assert not G.log(R)[:-1].any()


def test_a_product_has_64_axes_at_most():
    assert group_named("*".join(["R1"] * 64)).dimension == 64
    assert refusal(ComponentError, group_named, "*".join(["R1"] * 65)) == (
        "group 'R1*…': its 65 factors have more than 64 axes; expected at most 64"
    )


@pytest.mark.parametrize("name", ["SE2", "SE3", "SE23"])
def test_a_screw_without_a_rotation_has_the_rate_1(name):
    """And its numbers are the velocities themselves."""
    G = group_named(name)
    turns = G.parts[0].axes.stop
    V = np.append(np.zeros(turns), np.arange(1.0, G.dimension - turns + 1))
    frame, numbers, rates = G.screw(V)
    assert rates.tolist() == [1.0]
    assert numbers[0] == 0.0
    assert_equal(G.Ad(frame, G.along(numbers, rates)), V)
    assert np.abs(numbers[1:]).max() == np.abs(V).max()
