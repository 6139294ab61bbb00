"""The control laws against Hampsey et al. (2025), §3, §6, §7: literal on SO(3), abstract on G ⋉ g*.

The literal formulas are written as the paper writes them, with cross products and transposes, and
share no code with the laws that they check.
"""

import dataclasses

import numpy as np
import pytest
from drawn import drawn
from hypothesis import strategies as st

from eqt_cli.components import mechanics
from eqt_cli.components.groups import group_named, groups
from eqt_cli.components.inertia import FactoredInertia, Inertia, PrescribedInertia
from eqt_cli.components.laws import Family, controllers
from eqt_cli.components.mechanics import Gains, Semidirect, Tracking
from eqt_cli.extend import ClosedLoop, TorqueReference, apply_matrix, dot, parse, transpose

# Tens of last places of torques up to ten; measured 3e-15.
LITERAL = 1e-13
# The same for inertias of up to nine axes, with translations and an inverse; measured 4e-13.
ROUNDING = 1e-11
# Five-point differences (see the fixture `derivative`), relative to the largest value if that is
# above 1, because their errors grow with it.
DIFFERENCES = 1e-8


def on_groups(names, values):
    """All on SO(3) and on a product with all that groups have, the first on every group."""
    alike = ("R3", "SO2", "SO3*R3")  # R1 and SO3, in other sizes
    examples = [name for kind in groups.all() for name in kind.examples() if name not in alike]
    every = [group_named(name) for name in examples]
    pairs = [
        (G, *value)
        for G in every
        for value in (values if G.name in ("SO3", "SE3*SO2") else values[:1])
    ]
    ids = [f"{G.name}-{getattr(value[0], '__name__', value[0])}" for G, *value in pairs]
    return pytest.mark.parametrize(("G", *names), pairs, indirect=["G"], ids=ids)


def assert_equal(left, right, tolerance=ROUNDING):
    np.testing.assert_allclose(left, np.broadcast_to(right, np.shape(left)), rtol=0, atol=tolerance)


def assert_is_difference(value, difference):
    """That `value` is what a five-point difference found."""
    scale = np.maximum(1.0, np.max(np.abs(difference)))
    assert_equal(value / scale, difference / scale, DIFFERENCES)


def tracking(some, data):
    """Any state, desired state, inertia and gains."""
    G = some.G
    inertia = some.positive_definite(data, G.dimension)
    (Q, Qd), (P, Pd, tau_d) = some.poses(data, 2), some.vectors(data, 3)
    return Tracking(
        G=G,
        inertia=Inertia(inertia, np.linalg.inv(inertia)),
        gains=Gains(some.symmetric(data, G.size), some.positive_definite(data, G.dimension)),
        t=0.0,
        Q=Q,
        P=P,
        Qd=Qd,
        Pd=Pd,
        tau_d=tau_d,
    )


def without_gains(s):
    """The same with K = 0 and K_d = 0, which leaves the feedforward terms of a law."""
    return dataclasses.replace(s, gains=Gains(0 * s.gains.K, 0 * s.gains.K_d))


def law(name):
    return controllers.get(name)()


weights = st.floats(-2.0, 2.0)
frames = st.sampled_from(["spatial", "body"])


@st.composite
def members(draw, on_plane):
    """Members of the (g, c, n) family, on the plane c + n = 1 or anywhere."""
    c = draw(weights)
    n = 1 - c if on_plane else draw(weights)
    return Family(draw(weights), c, n, draw(frames))


# §7 on SO(3), literally ---------------------------------------------------------------------------


@dataclasses.dataclass
class Rigid:
    """A rigid body in the symbols of §7."""

    R: np.ndarray
    Rd: np.ndarray
    w: np.ndarray
    wd: np.ndarray
    taud: np.ndarray
    I: np.ndarray
    Kp: np.ndarray
    Kd: np.ndarray

    @property
    def w_(self):
        return self.w - self.wd

    @property
    def proportional(self):
        R_E = self.R @ self.Rd.T
        A = self.Kp @ R_E - R_E.T @ self.Kp.T
        return -self.Rd.T @ np.array([A[2, 1], A[0, 2], A[1, 0]])

    @property
    def spatial_damping(self):
        return -self.Rd.T @ self.Kd @ self.Rd @ self.w_


def eqt(b):
    """Eq. (23)."""
    return (
        b.taud
        + np.cross(b.w_, b.I @ b.wd)
        + np.cross(b.wd, b.I @ b.w_)
        + b.spatial_damping
        + b.proportional
    )


def gt(b):
    """Eq. (24)."""
    return (
        b.taud
        + b.I @ np.cross(b.w, b.wd) / 2
        + np.cross(b.w, b.I @ b.wd) / 2
        + np.cross(b.wd, b.I @ b.w) / 2
        - np.cross(b.wd, b.I @ b.wd)
        - b.Kd @ b.w_
        + b.proportional
    )


def nog(b):
    return b.taud + np.cross(b.wd, b.I @ b.w_) + b.spatial_damping + b.proportional


def asym(b):
    return (
        b.taud
        + np.cross(b.w_, b.I @ b.wd)
        + np.cross(b.wd, b.I @ b.w_) / 2
        + b.I @ np.cross(b.w, b.wd) / 2
        + b.spatial_damping
        + b.proportional
    )


def covariant_gt(b):
    """The form before eq. (24), with the Levi-Civita connection and ω̇_d of the Euler equations."""
    I_inverse = np.linalg.inv(b.I)
    nabla = (
        np.cross(b.w, b.wd)
        + I_inverse @ np.cross(b.wd, b.I @ b.w)
        + I_inverse @ np.cross(b.w, b.I @ b.wd)
    ) / 2
    wd_dot = I_inverse @ (-np.cross(b.wd, b.I @ b.wd) + b.taud)
    return -b.Kd @ b.w_ + b.proportional + b.I @ (nabla + wd_dot)


@pytest.mark.parametrize(
    ("name", "literal"),
    [("eqt", eqt), ("gt", gt), ("nog", nog), ("asym", asym), ("gt", covariant_gt)],
    ids=["equation_23_eqt", "equation_24_gt", "nog", "asym", "gt_by_covariant_derivative"],
)
@drawn()
def test_laws_of_section_7_on_SO3(samples_of, data, name, literal):
    s = tracking(samples_of("SO3"), data)
    body = Rigid(s.Q, s.Qd, s.V, s.Vd, s.tau_d, s.inertia.matrix, s.gains.K, s.gains.K_d)
    assert_equal(law(name).torque(s), literal(body), LITERAL)


@drawn()
def test_error_state_and_input_of_section_7_on_SO3(samples_of, data):
    """The error input's −R_d(ω − ω_d) × π_d has to be read as R_d(−ω̃ × π_d)."""
    s = tracking(samples_of("SO3"), data)
    S, R, Rd, pi, pi_d = Semidirect(s.G), s.Q, s.Qd, s.P, s.Pd
    w_, tau_ = s.V_tilde, s.P - s.tau_d
    R_E, pi_E = S.error((R, pi), (Rd, pi_d))
    assert_equal(R_E, R @ Rd.T, LITERAL)
    assert_equal(pi_E, Rd @ (pi - pi_d), LITERAL)
    w_E, tau_E = S.Ad((Rd, pi_d), (w_, tau_))
    assert_equal(w_E, Rd @ w_, LITERAL)
    assert_equal(tau_E, Rd @ -np.cross(w_, pi_d) + Rd @ tau_, LITERAL)


@drawn(kappa=st.floats(0.1, 10.0))
def test_homogeneous_damping_on_SO3_knows_no_frame(samples_of, data, kappa):
    s = tracking(samples_of("SO3"), data)
    s = dataclasses.replace(s, gains=Gains(s.gains.K, kappa * np.eye(3)))
    spatial, body = (Family(damping=frame).torque(s) for frame in ("spatial", "body"))
    assert_equal(spatial, body, LITERAL)


# §6 on every group --------------------------------------------------------------------------------


@drawn()
def test_lemma_6_1_error_velocity_and_energy(samples, data):
    """V_E = 𝕀̄⁻¹ P_E with 𝕀̄ = Ad*_{Q_d⁻¹} 𝕀 Ad_{Q_d⁻¹}, and h_E is the kinetic part of L."""
    s = tracking(samples, data)
    _, P_E = Semidirect(s.G).error((s.Q, s.P), (s.Qd, s.Pd))
    S = s.G.Ad_matrix(s.G.inverse(s.Qd))
    inertia_of_error = transpose(S) @ s.inertia.matrix @ S
    assert_equal(apply_matrix(inertia_of_error, s.V_E), P_E)
    potential = mechanics.potential(s.G, s.gains.K, s.Q_E)
    assert_equal(s.lyapunov, dot(P_E, s.V_E) / 2 + potential)


@drawn()
def test_theorem_6_2_through_the_semidirect_group_is_eqt(samples, data):
    """τ = τ_d + Ad^τ_{X_d⁻¹}(V_E, τ_E), eq. (20), with τ_E = τ_E,ff + τ_E,pd of eq. (22)."""
    s = tracking(samples, data)
    G, S, X_d = s.G, Semidirect(s.G), (s.Qd, s.Pd)
    Q_E, P_E = S.error((s.Q, s.P), X_d)
    V_E, _ = S.Ad(X_d, (s.V - s.Vd, s.tau_d))
    feedforward = -G.ad_star(G.Ad(s.Qd, s.Vd), P_E)
    feedback = -apply_matrix(s.gains.K_d, V_E) - mechanics.gradient(G, s.gains.K, Q_E)
    V_tilde, tau_tilde = S.Ad(S.inverse(X_d), (V_E, feedforward + feedback))
    assert_equal(V_tilde, s.V - s.Vd)
    assert_equal(law("eqt").torque(s), s.tau_d + tau_tilde)


# §7 on every group --------------------------------------------------------------------------------


@drawn()
def test_gt_by_the_levi_civita_connection(samples, data):
    """Feedforward 𝕀(∇_V V_d + V̇_d) with ∇_V W = ½[V, W] − ½𝕀⁻¹(ad*_V 𝕀W + ad*_W 𝕀V)."""
    s = without_gains(tracking(samples, data))
    G, I, V, Vd = s.G, s.inertia, s.V, s.Vd
    nabla = (G.ad(V, Vd) - I.velocity(G.ad_star(V, s.Pd) + G.ad_star(Vd, s.P))) / 2
    Vd_dot = I.velocity(G.ad_star(Vd, s.Pd) + s.tau_d)
    assert_equal(law("gt").torque(s), I.momentum(nabla + Vd_dot))


@drawn(member=members(on_plane=True))
def test_power_of_the_feedforward_on_the_plane(samples, data, member):
    """⟨τ_ff − τ_d, Ṽ⟩ = ⟨𝕀Ṽ, ad_V V_d⟩; on SO(3), (𝕀ω̃)ᵀ(ω × ω_d)."""
    s = without_gains(tracking(samples, data))
    power = dot(member.torque(s) - s.tau_d, s.V_tilde)
    assert_equal(power, dot(s.P_tilde, s.G.ad(s.V, s.Vd)))


@on_groups(
    ["name", "member"],
    [
        ("eqt", Family(1.0, 1.0, 0.0, "spatial")),
        ("gt", Family(0.5, 0.5, 0.5, "body")),
        ("nog", Family(0.0, 1.0, 0.0, "spatial")),
        ("asym", Family(1.0, 0.5, 0.5, "spatial")),
        ("family", Family(1.0, 1.0, 0.0, "spatial")),
        ("lee2010", Family(1.0, 1.0, 0.0, error="body", quadratic=1.0)),
        ("lee2012", Family(0.0, 0.0, 1.0, error="body")),
        ("bullo_murray", Family(0.5, 0.5, 0.5, error="body")),
    ],
)
@drawn()
def test_named_laws_are_points_of_the_family(samples, data, name, member):
    s = tracking(samples, data)
    assert_equal(law(name).torque(s), member.torque(s), tolerance=0)


@drawn(member=members(on_plane=False))
def test_family_is_equivariant_under_a_change_of_body_frame(samples, data, member):
    """With X → X Y, and every tensor of the body frame moved along, τ → Ad*_Y τ."""
    s, Y = tracking(samples, data), samples.pose(data)
    G, A = s.G, s.G.Ad_matrix(Y)

    def pulled_back(tensor):
        return transpose(A) @ tensor @ A

    K_d = s.gains.K_d if member.damping == "spatial" else pulled_back(s.gains.K_d)
    inertia = pulled_back(s.inertia.matrix)
    moved = Tracking(
        G=G,
        inertia=Inertia(inertia, np.linalg.inv(inertia)),
        gains=Gains(s.gains.K, K_d),
        t=0.0,
        Q=s.Q @ Y,
        P=G.Ad_star(Y, s.P),
        Qd=s.Qd @ Y,
        Pd=G.Ad_star(Y, s.Pd),
        tau_d=G.Ad_star(Y, s.tau_d),
    )
    assert_equal(member.torque(moved), G.Ad_star(Y, member.torque(s)))


@drawn()
def test_torque_on_the_desired_trajectory_is_the_desired_one(samples_and_law, data):
    samples, name = samples_and_law
    if "track" not in law(name).tasks:
        pytest.skip("the law follows no reference")
    if name == "pd":
        pytest.skip("the law has no feedforward")
    s = tracking(samples, data)
    memory = law(name).memory(s.G)
    s = dataclasses.replace(s, memory={key: np.zeros_like(s.P) for key in memory})
    s = dataclasses.replace(s, Q=s.Qd, P=s.Pd)
    assert_equal(law(name).torque(s), s.tau_d)


# Theorems 3.2 and 6.2: the rate of L --------------------------------------------------------------


def constant(some, data):
    matrix = some.positive_definite(data, some.G.dimension)
    return Inertia(matrix, np.linalg.inv(matrix))


def expressions(entry, m):
    return tuple(tuple(parse(entry(i, j)) for j in range(m)) for i in range(m))


def factored(some, data):
    """𝕀_t = S* 𝕀_0 S with an S that is not symmetric and does not commute with its rate."""

    def entry(i, j):
        on_diagonal, above_it = f"1 + {0.2 * (-1) ** i}*sin(t)", "0.3*sin(2*t)"
        return on_diagonal if i == j else above_it if j == i + 1 else "0"

    m = some.G.dimension
    return FactoredInertia(some.positive_definite(data, m), expressions(entry, m))


def prescribed(some, data):
    def entry(i, j):
        return f"2 + 0.5*cos({i}*t)" if i == j else "0.4*sin(t)" if abs(i - j) == 1 else "0"

    return PrescribedInertia(expressions(entry, some.G.dimension))


inertias = on_groups(["inertia"], [(factored,), (constant,), (prescribed,)])


def rate_of_L(some, data, controller, inertia, derivative):
    """dL/dt and dW/dt of a closed loop at any state, and what its law may read there."""
    G, t = some.G, 0.5
    at_rest = "track" not in controller.tasks
    (Q, Qd), (V, Vd) = some.poses(data, 2), some.vectors(data, 2)
    loop = ClosedLoop(
        group=G,
        inertia=inertia(some, data),
        gains=Gains(some.symmetric(data, G.size), some.positive_definite(data, G.dimension)),
        reference=TorqueReference([0.0 if at_rest else "0.5 + t"] * G.dimension),
        controller=controller,
    )
    state = loop.initial_state(Q, V, Qd, 0 * Vd if at_rest else Vd, t)
    field = loop.vector_field(t, state)
    rate = derivative(lambda h: loop.lyapunov(loop.tracking(t + h, state + h * field)))
    return rate, loop.work(field), loop.tracking(t, state)


@drawn()
def test_equation_11_feedforward_of_a_factored_inertia(samples, data, derivative):
    """τ_ff = Ṡ* S⁻* P."""
    inertia, V, t = factored(samples, data), samples.vector(data), 0.5
    S, S_dot = inertia.factor_at(t), derivative(lambda h: inertia.factor_at(t + h))
    P = inertia.at(t).momentum(V)
    expected = apply_matrix(S_dot.T @ np.linalg.inv(S.T), P)
    assert_is_difference(inertia.at(t).feedforward(V), expected)


@drawn()
def test_feedforward_of_a_prescribed_inertia_is_the_symmetric_one(samples, data, derivative):
    """τ_ff = ½𝕀̇V, from the choice Ṡ = ½S𝕀⁻¹𝕀̇."""
    inertia, V, t = prescribed(samples, data), samples.vector(data), 0.5
    rate = derivative(lambda h: inertia.matrix_at(t + h))
    assert_is_difference(inertia.at(t).feedforward(V), apply_matrix(rate / 2, V))


@inertias
@drawn(member=members(on_plane=True))
def test_rate_of_L_on_the_plane_is_the_damping(samples, data, member, inertia, derivative):
    rate, _, s = rate_of_L(samples, data, member, inertia, derivative)
    velocity = s.V_E if member.damping == "spatial" else s.V_tilde
    assert_is_difference(-dot(apply_matrix(s.gains.K_d, velocity), velocity), rate)


@inertias
@drawn()
def test_theorem_3_2_rate_of_L_is_the_damping(samples, data, inertia, derivative):
    rate, _, s = rate_of_L(samples, data, law("stabilising"), inertia, derivative)
    assert_is_difference(-dot(apply_matrix(s.gains.K_d, s.V), s.V), rate)


@inertias
@drawn()
def test_closed_loop_integrates_the_rate_of_L_without_feedforward(
    samples, data, inertia, derivative
):
    controller = controllers.get("stabilising")(feedforward=False)
    rate, power, _ = rate_of_L(samples, data, controller, inertia, derivative)
    assert_is_difference(power, -rate)
