"""Inertia tensors that vary in time: rate, inverse, and the force that makes up for the change."""

import dataclasses

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from small_loops import closed_loop, expressions

from eqt_cli.components.groups import principal_moments
from eqt_cli.components.inertia import FactoredInertia, Inertia, PrescribedInertia, not_rigid
from eqt_cli.components.laws import controllers
from eqt_cli.extend import Gains, Tracking, dot, group_named, inverse_spd, parse, transpose

EXAMPLES = settings(max_examples=10)

# Tens of last places of numbers of order 10.
ROUNDING = 1e-13
# Five-point differences (see the fixture `derivative`).
DIFFERENCES = 1e-9

INITIAL = np.array([[2.0, 0.0, 0.3], [0.0, 3.0, 0.0], [0.3, 0.0, 4.0]])
FACTOR = [["1 + t/4", "sin(t)/5", "0"], ["0", "exp(-t/3)", "t/9"], ["t**2/20", "0", "cos(t/2)"]]
TENSOR = [["3 + sin(t)", "t/5", "0.1"], ["t/5", "4", "0"], ["0.1", "0", "2 + exp(-t)"]]

times = st.floats(0.0, 2.0)


FACTORED = FactoredInertia(INITIAL, expressions(FACTOR))
PRESCRIBED = PrescribedInertia(expressions(TENSOR))
CONSTANT = Inertia(INITIAL, np.linalg.inv(INITIAL))


@pytest.fixture(params=[FACTORED, PRESCRIBED], ids=["factored", "prescribed"])
def law(request):
    return request.param


def as_tensor(law, t):
    """The same tensor near t, prescribed: 𝕀 and 𝕀̇ as numbers, so that A = ½𝕀̇."""
    now = law.at(t)
    return dataclasses.replace(now, change=(now.change + transpose(now.change)) / 2)


# The tensor, its rate, its inverse ----------------------------------------------------------------


@EXAMPLES
@given(t=times)
def test_factored_inertia_is_the_congruence_of_theorem_3_2(t):
    S = FACTORED.factor_at(t)
    np.testing.assert_allclose(FACTORED.at(t).matrix, S.T @ INITIAL @ S, rtol=0, atol=ROUNDING)


@pytest.mark.parametrize("law", [FACTORED, PRESCRIBED], ids=["factored", "prescribed"])
@EXAMPLES
@given(t=times)
def test_change_adds_up_to_the_rate_of_the_tensor(law, t, derivative):
    """A + Aᵀ = d𝕀/dt."""
    rate = derivative(lambda h: law.at(t + h).matrix)
    change = law.at(t).change
    np.testing.assert_allclose(change + change.T, rate, rtol=0, atol=DIFFERENCES)


def test_constant_inertia_needs_no_compensation():
    V = np.ones(3)
    assert CONSTANT.feedforward(V) == 0.0
    assert CONSTANT.rate_force(V) == 0.0
    assert CONSTANT.at(3.0) is CONSTANT


def test_momentum_and_velocity_undo_each_other(law):
    now, V = law.at(0.7), np.array([1.0, -2.0, 0.5])
    np.testing.assert_allclose(now.velocity(now.momentum(V)), V, rtol=0, atol=ROUNDING)


def test_many_instants_are_as_many_single_ones(law):
    t = np.linspace(0.0, 2.0, 5)
    together = law.at(t)
    np.testing.assert_allclose(law.matrix_at(t), together.matrix, rtol=0, atol=ROUNDING)
    for k, instant in enumerate(t):
        alone = law.at(float(instant))
        np.testing.assert_allclose(together.matrix[k], alone.matrix, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(together.inverse[k], alone.inverse, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(together.change[k], alone.change, rtol=0, atol=ROUNDING)


def test_tensor_alone_needs_no_inverse():
    singular = PrescribedInertia(expressions([["t", "0"], ["0", "1"]]))
    np.testing.assert_array_equal(singular.matrix_at(0.0), [[0.0, 0.0], [0.0, 1.0]])


@pytest.mark.parametrize("n", [1, 2, 3, 6, 9])
@EXAMPLES
@given(seed=st.integers(0, 2**32 - 1))
def test_traced_inverse_is_that_of_lapack(n, seed):
    A = np.random.default_rng(seed).uniform(-1.0, 1.0, (4, n, n))
    A = A @ transpose(A) + np.eye(n) / 2  # eigenvalues from ½ to about n, so cond(A) < 50
    traced = inverse_spd(A.astype(object))
    assert traced.dtype == object
    np.testing.assert_allclose(traced.astype(float), np.linalg.inv(A), rtol=0, atol=1e-12)


def test_inverse_leaves_its_argument_alone():
    A = INITIAL.astype(object)
    inverse_spd(A)
    np.testing.assert_array_equal(A, INITIAL)


def test_other_functions_of_time_are_asked_for_once_each():
    """Of a matrix that is symmetric one for each pair of axes."""

    def numbered():
        count = iter(range(100))
        return lambda: parse(str(next(count)))

    found = FACTORED.with_functions(numbered()).factor_at(0.0)
    np.testing.assert_array_equal(found, [[0, 1, 2], [3, 4, 5], [6, 7, 8]])
    found = PRESCRIBED.with_functions(numbered()).matrix_at(0.0)
    np.testing.assert_array_equal(found, [[0, 1, 3], [1, 2, 4], [3, 4, 5]])
    assert CONSTANT.with_functions(numbered()) is CONSTANT


# What of the compensation is determined -----------------------------------------------------------


@EXAMPLES
@given(t=times)
def test_both_choices_of_the_factor_have_the_same_power(t):
    """The skew part of A is gyroscopic: S is not unique, and neither is the torque."""
    V = np.array([1.0, -2.0, 0.5])
    factored, symmetric = FACTORED.at(t), as_tensor(FACTORED, t)
    power = dot(factored.feedforward(V), V)
    assert power == pytest.approx(dot(symmetric.feedforward(V), V), abs=ROUNDING)
    assert power == pytest.approx(dot(factored.rate_force(V), V) / 2, abs=ROUNDING)


@EXAMPLES
@given(t=times)
def test_feedforward_makes_up_for_the_explicit_change_of_the_energy(t, derivative):
    """∂h/∂t + ⟨τ_ff, V⟩ = 0 at fixed P, Hampsey et al. (2025), eq. (10)."""
    P = np.array([1.0, -2.0, 0.5])
    rate = derivative(lambda h: dot(P, FACTORED.at(t + h).velocity(P)) / 2)
    now = FACTORED.at(t)
    V = now.velocity(P)
    assert rate == pytest.approx(-dot(now.feedforward(V), V), abs=DIFFERENCES)


# Tracking with an inertia that varies by itself ---------------------------------------------------


@pytest.mark.needs("proofs")
@pytest.mark.parametrize("law", [FACTORED, PRESCRIBED], ids=["factored", "prescribed"])
@EXAMPLES
@given(data=st.data(), t=times)
def test_theorem_6_2_with_a_varying_inertia_is_eqt(samples_of, data, law, t):
    """With S̄ = S Ad_{Q_d⁻¹} in eq. (22) and (20), the control is EqT with + Ṡ*S⁻* P̃."""
    from eqt_cli.extensions.proofs.identities import tracking_control

    some = samples_of("SO3")
    (Q, Qd), (P, Pd, tau_d) = some.poses(data, 2), some.vectors(data, 3)
    gains = Gains(some.symmetric(data, 3), some.positive_definite(data, 3))
    s = Tracking(some.G, law.at(t), gains, t, Q, P, Qd, Pd, tau_d)
    eqt = controllers.get("eqt")().torque(s)
    np.testing.assert_allclose(eqt, tracking_control(s), rtol=0, atol=1e-12)
    constant = Inertia(s.inertia.matrix, s.inertia.inverse)
    without = controllers.get("eqt")().torque(dataclasses.replace(s, inertia=constant))
    force = s.inertia.feedforward(s.V_tilde)
    np.testing.assert_allclose(eqt - without, force, rtol=0, atol=1e-12)


@EXAMPLES
@given(data=st.data(), t=times)
def test_rate_of_the_error_inertia(samples_of, data, t, derivative):
    """d𝕀̄/dt = Ā + Āᵀ with Ā = Ad*_{Q_d⁻¹}(A − ad*_{V_d}𝕀) Ad_{Q_d⁻¹}, from S̄ = S Ad_{Q_d⁻¹}."""
    some = samples_of("SO3")
    G, Qd, Vd = some.G, some.pose(data), some.vector(data)

    def error_inertia(h):
        A = G.Ad_matrix(G.inverse(Qd @ G.exp(h * Vd)))
        return transpose(A) @ FACTORED.at(t + h).matrix @ A

    A, now = G.Ad_matrix(G.inverse(Qd)), FACTORED.at(t)
    change = transpose(A) @ (now.change - transpose(G.ad_matrix(Vd)) @ now.matrix) @ A
    rate = derivative(error_inertia)
    np.testing.assert_allclose(change + transpose(change), rate, rtol=0, atol=1e-8)


# Rigid bodies -------------------------------------------------------------------------------------


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
    law = PrescribedInertia(expressions(rows))
    G = group_named("SO3")
    assert not_rigid(G, law, 4.0) == ""
    assert not_rigid(G, law, 8.0).endswith(": 1 + 1 < 2.02 at t = 4.08 s")


def test_moments_are_what_a_turn_meets_where_all_else_may_move():
    """Then velocities are 𝕀⁻¹P, of whose rotations only a moment without a force remains."""
    A = np.random.default_rng(0).standard_normal((6, 6))
    inertia = A @ A.T + np.eye(6)
    free = np.linalg.inv(inertia)[:3, :3]
    [moments] = principal_moments(group_named("SE3"), inertia)
    assert moments == pytest.approx(np.linalg.eigvalsh(np.linalg.inv(free)), rel=1e-12)


# What a law reads of the desired motion -----------------------------------------------------------


T = 0.7
RATES = np.array([1 + T, T**2, -0.5])
"""V_d(t) = (1 + t, t², −½)."""
ACCELERATION = np.array([1.0, 2 * T, 0.0])


def test_the_desired_acceleration_is_that_of_the_velocity_while_the_inertia_varies():
    """d(𝕀V_d)/dt = τ_d + ad*_{V_d} 𝕀V_d, of an 𝕀 and a V_d that are written out."""
    G = group_named("SO3")
    rows = [["2 + t**2", "0", "0"], ["0", "3", "t"], ["0", "t", "5"]]
    law = PrescribedInertia(expressions(rows))
    matrix = np.array([[2 + T**2, 0, 0], [0, 3, T], [0, T, 5]])
    change = np.array([[2 * T, 0, 0], [0, 0, 1], [0, 1, 0]])
    momentum = matrix @ RATES
    torque = change @ RATES + matrix @ ACCELERATION + np.cross(RATES, momentum)
    gains = Gains(np.eye(3), np.eye(3))
    s = Tracking(G, law.at(T), gains, T, np.eye(3), momentum, np.eye(3), momentum, torque)
    assert s.Vd_dot == pytest.approx(ACCELERATION, abs=1e-12)
    again = s.following(RATES, ACCELERATION)
    assert again.Pd == pytest.approx(momentum, abs=1e-12)
    assert again.tau_d == pytest.approx(torque, abs=1e-12)


def test_the_cancelling_feedforward_is_that_with_the_weights_1_1_0_1():
    """Also while the inertia varies, by a factor that is written out."""
    G, random = group_named("SO3"), np.random.default_rng(0)
    rows = [["1 + t/4", "0", "0"], ["sin(t)/5", "1", "0"], ["0", "0", "exp(-t/9)"]]
    factor = expressions(rows)
    inertia = FactoredInertia(np.diag([1.0, 2.0, 3.0]), factor).at(T)
    P, Pd, torque = random.standard_normal((3, 3))
    Q, Qd = G.exp(random.standard_normal((2, 3)))
    s = Tracking(G, inertia, Gains(np.eye(3), np.eye(3)), T, Q, P, Qd, Pd, torque)
    assert np.abs(s.inertia_force).max() > 0.01
    assert s.cancelling_feedforward == pytest.approx(s.feedforward(1, 1, 0, 1), abs=1e-14)


# Mass that leaves ---------------------------------------------------------------------------------

LIGHTER = expressions([["exp(-t)" if i == j else "0" for j in range(6)] for i in range(6)])
ROCKET = """
group: R1
inertia: {{{inertia}, leaves: true}}
gains: {{kp: 20, kd: 30}}
reference: {{torque: ["200"]}} # N
controllers: [gt]
initial: {{velocity: {{kind: normal, std: 1}}}}
ensemble: {{runs: 1, seed: 1}}
time: {{duration: 50, samples: 51}}
solver: {{engine: {engine}, rtol: 1.0e-10, atol: 1.0e-10}}
"""


@pytest.mark.parametrize(
    ("engine", "inertia"),
    [
        ("solve_ivp", "matrix: [['100 - t']]"),
        pytest.param(
            "native",
            "initial: 100, factor: [['sqrt(1 - t/100)']]",
            marks=pytest.mark.ci("compiles the law"),
        ),
    ],
)
def test_a_rocket_follows_its_equation_and_its_error_newtons(solved, engine, inertia):
    """v = 200 ln(100/m); of the error, m ẍ = −30ẋ − 20x, and dL/dt = −30ẋ² + ½ṁẋ²."""
    problem, solution = solved(ROCKET.format(engine=engine, inertia=inertia), "gt")
    t = problem.times
    s, work = problem.loop.tracking(t, solution.states), problem.loop.work(solution.states)[0]
    reached, mass = 200 * np.log(100 / (100 - t)), 100 - t
    flown = 200 * t - mass * reached
    assert (reached[-1], flown[-1]) == pytest.approx((138.6294, 3068.528), rel=1e-6)
    # Ten thousand times the engine's tolerance, for 50 s.
    np.testing.assert_allclose(s.Vd[0, :, 0], reached, rtol=1e-6)
    np.testing.assert_allclose(s.Qd[0, :, 0, 1], flown, rtol=1e-6)

    def literal(t, y):
        x, v, _ = y
        return v, (-30 * v - 20 * x) / (100 - t), 30 * v**2 + v**2 / 2

    start = 0.0, float(s.V[0, 0, 0]), 0.0
    error = solve_ivp(literal, (0.0, 50.0), start, t_eval=t, rtol=1e-10, atol=1e-12).y
    found = np.array([s.Q[0, :, 0, 1] - flown, s.V[0, :, 0] - reached, work])
    np.testing.assert_allclose(found, error, atol=1e-5)


@pytest.mark.parametrize(
    "name", ["eqt", "lee2010", "goodarzi2013", "maithripala2006", "slotine_li"]
)
def test_mass_that_leaves_takes_the_energy_of_its_error_along(name, derivative):
    loop = closed_loop(
        group_named("SE3"), controllers.get(name)(), inertia=PrescribedInertia(LIGHTER, leaves=True)
    )
    a, V, b, Vd = np.random.default_rng(0).standard_normal((4, 6))
    state = loop.initial_state(loop.group.exp(a), V, loop.group.exp(b), Vd, T)
    rate = loop.vector_field(T, state)

    def L(h):
        return loop.lyapunov(loop.tracking(T + h, state + h * rate))

    work = rate[loop.layout.slices["work"]]
    assert work == pytest.approx(-derivative(L), rel=1e-8)  # five-point differences


def test_every_theorem_that_needs_a_momentum_is_not_claimed_of_mass_that_leaves(experiment_of):
    loop = experiment_of(ROCKET.format(engine="solve_ivp", inertia="matrix: [['100 - t']]")).loop
    assert (loop.departures, loop.claims_decrease) == ("mass that leaves", None)
