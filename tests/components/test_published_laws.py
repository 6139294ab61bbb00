"""The laws of other papers: literally on SO(3), near an error angle of π, and by both engines.

The literal formulas are written in the symbols of their papers, with cross products and transposes,
one state at a time, and share no code with the laws.
"""

import dataclasses

import numpy as np
import pytest
from case_tables import in_ci
from plain import hat
from scipy.linalg import logm
from scipy.spatial.transform import Rotation
from small_loops import any_matrix, closed_loop

from eqt_cli.components.laws import Family, controllers, fits
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.engines.native import SMALLEST_RTOL, Native
from eqt_cli.extend import (
    SO3,
    ConstantForce,
    ConstantReference,
    Gains,
    Inertia,
    Problem,
    Problems,
    SolveIvp,
    Tracking,
    group_named,
    norm,
)

# Torques of about ten, by a hundred operations each; measured 4e-14.
LITERAL = 1e-12

TEN = "lee2010 lee2012 bullo_murray goodarzi2013 maithripala2006 slotine_li sliding".split()
TEN += ["logarithmic", "quaternion", "pd"]


def law(name, **options):
    return controllers.get(name)(**options)


EVEN = Gains(np.eye(3), any_matrix(3, 3))


def any_states(loop, runs, seed=1):
    G, random = loop.group, np.random.default_rng(seed)
    Q, Qd = G.exp(random.standard_normal((2, runs, G.dimension)))
    V, Vd = random.standard_normal((2, runs, G.dimension))
    return loop.initial_state(Q, V, Qd, Vd)


# Literally on SO(3) -------------------------------------------------------------------------------


def vee(U):
    return np.array([U[2, 1], U[0, 2], U[1, 0]])


@dataclasses.dataclass
class Attitude:
    """R, Ω, J and the desired motion in the symbols of Lee and others."""

    R: np.ndarray
    Rd: np.ndarray
    W: np.ndarray
    Wd: np.ndarray
    taud: np.ndarray
    J: np.ndarray
    K: np.ndarray
    kW: np.ndarray

    def __post_init__(self):
        self.Wd_dot = np.linalg.solve(self.J, np.cross(self.J @ self.Wd, self.Wd) + self.taud)
        self.RL = self.Rd.T @ self.R
        self.xi = self.RL.T @ self.Wd
        self.eW = self.W - self.xi
        self.xi_dot = self.RL.T @ self.Wd_dot - np.cross(self.eW, self.xi)
        # k_R e_R of a matrix of weights; ½k_R (R_dᵀR − RᵀR_d)^∨ with K = ½k_R I
        self.kR_eR = vee(self.K @ self.RL - self.RL.T @ self.K)
        self.eR = vee(self.RL - self.RL.T) / 2
        self.H = np.trace(self.K) * np.eye(3) - self.K

    def connection(self, V, W):
        """𝕀∇_V W."""
        return (self.J @ np.cross(V, W) + np.cross(V, self.J @ W) + np.cross(W, self.J @ V)) / 2


def lee2010(b, options, memory):
    transport = hat(b.W) @ b.R.T @ b.Rd @ b.Wd - b.R.T @ b.Rd @ b.Wd_dot
    return -b.kR_eR - b.kW @ b.eW + np.cross(b.W, b.J @ b.W) - b.J @ transport


def lee2012(b, options, memory):
    desired = b.R.T @ b.Rd @ b.Wd
    forward = hat(desired) @ b.J @ desired + b.J @ b.R.T @ b.Rd @ b.Wd_dot
    return -b.kR_eR - b.kW @ b.eW + forward


def bullo_murray(b, options, memory):
    return b.J @ b.xi_dot + b.connection(b.W, b.xi) - b.kW @ b.eW - b.kR_eR


def goodarzi2013(b, options, memory):
    return lee2012(b, options, memory) - options["ki"] * memory["integral"]


def maithripala2006(b, options, memory):
    RE = b.R @ b.Rd.T
    proportional = b.Rd.T @ vee(b.K @ RE - RE.T @ b.K)
    forward = b.J @ b.Wd_dot + b.connection(b.W, b.Wd)
    return forward - proportional - options["damping_rate"] * b.J @ (b.W - b.Wd)


def sliding_variable(b, options):
    rate = b.RL @ hat(b.eW)
    kR_eR_dot = vee(b.K @ rate - rate.T @ b.K)
    Wr = b.xi - options["slope"] * b.kR_eR
    Wr_dot = b.xi_dot - options["slope"] * kR_eR_dot
    return b.J @ Wr_dot + np.cross(Wr, b.J @ b.W), b.W - Wr


def slotine_li(b, options, memory):
    forward, s = sliding_variable(b, options)
    return forward - b.kW @ s


def sliding(b, options, memory):
    forward, s = sliding_variable(b, options)
    return forward - options["gain"] * np.tanh(s / options["layer"])


def logarithmic(b, options, memory):
    """With J_r⁻ᵀ = J_l⁻¹ in closed form by the angle (Chirikjian), and the matrix logarithm."""
    r = vee(np.real(logm(b.RL)))
    angle, S = np.linalg.norm(r), hat(r)
    weight = 1 / angle**2 - (1 + np.cos(angle)) / (2 * angle * np.sin(angle))
    left = np.eye(3) - S / 2 + weight * S @ S  # its transposed inverse is that of the right one
    forward = b.J @ b.xi_dot + np.cross(b.W, b.J @ b.W)
    return forward - b.kW @ b.eW - left @ b.H @ r


def quaternion(b, options, memory):
    q = Rotation.from_matrix(b.RL).as_quat(canonical=True)
    forward = b.J @ b.xi_dot + np.cross(b.W, b.J @ b.W)
    return forward - b.kW @ b.eW - 2 * b.H @ q[:3]


def pd(b, options, memory):
    return -b.kR_eR - b.kW @ b.eW


def attitude(s, k):
    tau_d = np.broadcast_to(s.tau_d, s.P.shape)[k]
    return Attitude(
        s.Q[k], s.Qd[k], s.V[k], s.Vd[k], tau_d, s.inertia.matrix, s.gains.K, s.gains.K_d
    )


@pytest.mark.parametrize("name", TEN)
def test_literal_form_on_SO3(name):
    loop = closed_loop(group_named("SO3"), law(name))
    states = any_states(loop, 12)
    random = np.random.default_rng(2)
    for key, where in loop.layout.slices.items():
        if key.startswith("controller."):
            states[:, where] = random.standard_normal((12, 3))
    s = loop.tracking(0.7, states)
    torque, options = loop.command(s), vars(loop.controller)
    for k in range(12):
        memory = {key: value[k] for key, value in s.memory.items()}
        literal = globals()[name](attitude(s, k), options, memory)
        np.testing.assert_allclose(torque[k], literal, rtol=0, atol=LITERAL)


def test_integral_of_goodarzi_on_SO3():
    loop = closed_loop(group_named("SO3"), law("goodarzi2013", c2=0.7))
    states = any_states(loop, 20)
    rates = loop.layout.split(loop.vector_field(0.7, states))["controller.integral"]
    s = loop.tracking(0.7, states)
    for k in range(20):
        b = attitude(s, k)
        np.testing.assert_allclose(rates[k], b.eW + 0.7 * b.eR, rtol=0, atol=LITERAL)


# Points of the family, options, groups ------------------------------------------------------------


def test_cancelling_feedforward_is_the_point_of_lee2010(G):
    loop = closed_loop(G, law("lee2010"))
    r = loop.tracking(0.3, any_states(loop, 4)).relative
    expected = r.feedforward(1.0, 1.0, 0.0, 1.0)
    np.testing.assert_allclose(r.cancelling_feedforward, expected, rtol=0, atol=LITERAL)


def test_quadratic_term_has_no_power(G):
    loop = closed_loop(G, Family())
    s = loop.tracking(0.3, any_states(loop, 4))
    change = Family(quadratic=2.0).torque(s) - Family().torque(s)
    # Of torques up to some hundred, in nine coordinates.
    np.testing.assert_allclose((change * s.V_tilde).sum(-1), 0.0, atol=1e-11)


def test_body_errors_have_body_damping():
    loaded, _ = Family(error="body").loaded(None, group_named("SO3"), Problems())
    assert loaded.damping == "body"
    with pytest.raises(ValueError, match="error: body always has damping: body; leave damping out"):
        Family(error="body", damping="spatial")


def test_members_of_one_frame_are_solved_together():
    assert law("lee2012").structure == law("bullo_murray").structure
    assert law("lee2010").structure != law("lee2012").structure  # its quadratic term
    assert law("eqt").structure == law("gt").structure != law("lee2012").structure


@pytest.mark.parametrize("name", ["SO2", "SE2", "SE3", "R3"])
def test_quaternions_are_for_rotations_of_space(name):
    problems = Problems()
    law("quaternion").check(group_named(name), problems)
    expected = f"quaternion is a law for SO3 only; this experiment has group {name}"
    assert [problem.message for problem in problems] == [expected]
    assert fits(law("quaternion"), group_named("SO3"))


@pytest.mark.parametrize("name", [name for name in TEN if name != "quaternion"])
def test_laws_are_for_every_group(G, name):
    assert fits(law(name), G)


class WithoutDerivative(SO3):
    """As a group of a plugin may be."""

    name = "without"
    log_force = None


def test_logarithms_need_a_derivative():
    problems = Problems()
    law("logarithmic").check(WithoutDerivative(), problems)
    expected = "group 'without' has no derivative of the logarithm"
    assert [problem.message for problem in problems] == [expected]


def test_quaternion_claims_nothing_for_uneven_stiffness():
    even, uneven = np.eye(3), np.diag([1.0, 2.0, 3.0])
    G, claims = group_named("SO3"), law("quaternion").claims
    assert claims(G, Gains(even, even)) is True
    assert claims(G, Gains(uneven, even)) is None
    assert claims(G, Gains(1e-8 * uneven, even)) is None
    assert claims(G, Gains(1e8 * np.diag([1.0, 1.0, 1 + 1e-14]), even)) is True  # but for rounding


# Near an error angle of π -------------------------------------------------------------------------


def at_angle(angle, axis=(0.6, -0.48, 0.64)):
    """At rest, turned by an angle from a desired attitude at rest, with K = I."""
    G, zero = group_named("SO3"), np.zeros(3)
    inertia = Inertia(np.eye(3), np.eye(3))
    gains, Q = Gains(np.eye(3), np.eye(3)), G.exp(angle * np.array(axis))
    memory = {"integral": zero}
    return Tracking(G, inertia, gains, 0.0, Q, zero, G.identity, zero, zero, memory)


# ‖τ‖ in N m for K = I, h = 2: 2 sin θ, 4 sin(θ/2), 2θ.
APPROACHES = {
    "lee2010": 0.0,
    "lee2012": 0.0,
    "bullo_murray": 0.0,
    "goodarzi2013": 0.0,
    "maithripala2006": 0.0,
    "slotine_li": 0.0,
    "sliding": 0.0,
    "logarithmic": 2 * np.pi,
    "quaternion": 4.0,
}


@pytest.mark.parametrize(("name", "limit"), APPROACHES.items())
def test_torque_norm_approaching_a_half_turn(name, limit):
    found = norm(law(name).torque(at_angle(np.pi - 1e-6)))
    np.testing.assert_allclose(found, limit, atol=3e-6)  # 2 sin θ is 2e-6 there


@pytest.mark.parametrize("name", ["logarithmic", "quaternion"])
def test_torque_changes_its_sign_at_a_half_turn(name):
    before, after = (law(name).torque(at_angle(np.pi + d)) for d in (-1e-7, 1e-7))
    np.testing.assert_allclose(before, -after, atol=1e-6)
    assert norm(before) > 3


@pytest.mark.parametrize("name", ["logarithmic", "quaternion"])
def test_torque_is_finite_at_a_half_turn(name):
    Q = np.diag([1.0, -1.0, -1.0])
    torque = law(name).torque(dataclasses.replace(at_angle(1.0), Q=Q))
    np.testing.assert_allclose(np.abs(torque), [APPROACHES[name], 0, 0], atol=1e-12)


@pytest.mark.parametrize("name", [in_ci("compiles a longer law", "logarithmic"), "quaternion"])
def test_runs_through_a_half_turn_agree_and_keep_the_balance(name):
    """Fast enough to pass π: both engines see the jump, and L, which is continuous, still falls."""
    loop = closed_loop(group_named("SO3"), law(name), gains=EVEN)
    G, zero = loop.group, np.zeros((1, 3))
    Q = G.exp(np.array([[2.9, 0.3, -0.2]]))
    states = loop.initial_state(Q, np.array([[4.0, 0.5, 0.3]]), G.identity[None], zero)
    problem = Problem(loop, states, np.linspace(0.0, 2.0, 41))
    exact = Native(rtol=SMALLEST_RTOL, atol=SMALLEST_RTOL).solve(problem).states
    s = loop.tracking(problem.times, exact)
    passed = np.diff(np.sign(G.vee(s.relative.Q)[0, :, 0]))
    assert passed.any()
    L = loop.lyapunov(s) + loop.work(exact)
    np.testing.assert_allclose(L, L[:, :1].repeat(41, axis=1), rtol=1e-9)  # of the crossing's event
    other = SolveIvp(rtol=1e-8, atol=1e-10).solve(problem).states
    # The solver of SciPy finds the jump by small steps, and no better than by its tolerance.
    np.testing.assert_allclose(other, exact, atol=1e-4)


# Integral action ----------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("name", "options", "offset"),
    [
        ("lee2012", {}, True),
        ("goodarzi2013", {"ki": 1.0, "c2": 1.0}, False),
        ("goodarzi2013", {"ki": 1.0, "c2": 1.0, "bound": 2.0}, False),
    ],
)
def test_integral_removes_the_offset_of_a_constant_push(name, options, offset):
    free = dataclasses.replace(
        closed_loop(group_named("SO3"), law(name, **options), gains=EVEN),
        gains=Gains(np.eye(3), 2 * np.eye(3)),
        reference=ConstantReference(),
    )
    push = Vehicle(forces=(ConstantForce(force=[0.1, -0.05, 0.08]),))
    loop = dataclasses.replace(free, vehicle=push.of_run(free.group))
    G, zero = loop.group, np.zeros((1, 3))
    start = loop.initial_state(G.exp(np.array([[0.5, -0.3, 0.2]])), zero, G.identity[None], zero)
    problem = Problem(loop, start, np.array([0.0, 30.0]))
    found = SolveIvp(rtol=1e-6, atol=1e-8).solve(problem).states[:, -1]
    error = np.linalg.norm(G.identity - loop.tracking(30.0, found).Q_E)
    # A push of 0.14 N m against a stiffness of 2 N m/rad leaves 0.07 rad, 0.1 in this norm; the
    # integral removes it at about c₂ k_I / (k_R + k_I) = 0.33 1/s, in 30 s to 5e-6 of it.
    assert error > 0.05 if offset else error < 1e-4


def test_a_bound_on_the_integral_bounds_its_torque():
    loop = closed_loop(group_named("SO3"), law("goodarzi2013", ki=0.5, bound=0.2))
    s = loop.tracking(0.0, any_states(loop, 2))
    far = dataclasses.replace(s, memory={"integral": np.full((2, 3), 50.0)})
    change = loop.command(far) - loop.command(s)
    np.testing.assert_allclose(change, -0.5 * 0.2, atol=1e-12)
