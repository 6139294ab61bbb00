"""The cascade against programs written from the formulas, closed forms and differences."""

import dataclasses
import re

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, in_ci, refusal
from said import mentions
from scipy.integrate import solve_ivp
from scipy.linalg import expm
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.components.motions import unit_vector
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.remarks import remarks
from eqt_cli.extend import (
    Problem,
    Status,
    cos,
    cross,
    dot,
    group_named,
    sin,
    sqrt,
    stack,
    transpose,
)
from eqt_cli.extensions.underactuated import cascade
from eqt_cli.loop.law_program import law_program
from eqt_cli.loop.linearised import linearised
from eqt_cli.numbers.program import traced

J, MASS, G = np.array([0.0820, 0.0845, 0.1377]), 4.34, 9.81
KX, KV, KR, KW = 16.0, 5.6, 8.81, 2.54
UPSIDE_DOWN = [[1, 0, 0], [0, -0.9995, -0.0314], [0, 0.0314, -0.9995]]
HOVER = {"kind": "flat", "position": [0.0, 0.0, 0.0], "heading": 0.0}
HELIX = {"kind": "flat", "position": ["0.4*t", "0.4*sin(pi*t)", "0.6*cos(pi*t)"], "heading": "pi*t"}
KNOTS = [{"t": t, "position": p} for t, p in ((0, [0, 0, 0]), (0.4, [1, 0, 2]), (1, [0, 3, 0]))]
LAW = {
    "kind": "cascade",
    "attitude": "lee2010",
    "position": {"kx": KX, "kv": KV},
    "gains": {"kp": KR / 2, "kd": KW},
    "along": [0, 0, -1],
}
QUADROTOR = {
    "group": "SE3",
    "inertia": [*J, MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * G, "up": [0, 0, -1]}]},
    "reference": HOVER,
    "controllers": [LAW],
    "initial": {"pose": "fixed", "velocity": "fixed"},
    "time": {"duration": 10.0, "samples": 101},
    "solver": {"engine": "native", "rtol": 1e-12, "atol": 1e-14},
}


def experiment(**changes):
    law = {**LAW, **changes.pop("law", {})}
    config = {**QUADROTOR, "controllers": [law], **changes}
    return eqt_cli.load_experiment(config).experiment(0)


DRAG = np.array([2.2, 1.3, 0.4])  # N s/m, on 4.34 kg


def with_drag(linear, **options):
    drag = {"kind": "drag", "linear": [0, 0, 0, *linear], **options}
    return {"model": {"forces": [*QUADROTOR["model"]["forces"], drag]}}


def loop_of(**changes):
    return next(iter(experiment(**changes).loops.values()))


# A program written from the formulas of arXiv 1003.2005: eq. (15) to (20), and their derivatives.


def unit(q, q1, q2):
    """The direction of q and its first two derivatives."""
    size = sqrt(dot(q, q))[..., None]
    n = q / size
    rate = dot(n, q1)[..., None]
    n1 = (q1 - n * rate) / size
    bend = (dot(n1, q1) + dot(n, q2))[..., None]
    return n, n1, (q2 - n * bend - 2.0 * n1 * rate) / size


def crossed(a, b):
    """a × b and its first two derivatives."""
    return (
        cross(a[0], b[0]),
        cross(a[1], b[0]) + cross(a[0], b[1]),
        cross(a[2], b[0]) + 2.0 * cross(a[1], b[1]) + cross(a[0], b[2]),
    )


def dragged(v, a, R, W, d):
    """The acceleration −R diag(d) Rᵀ v / m by drag, and its rate at the acceleration a."""
    u, u_rate = ((transpose(R) @ each[..., None])[..., 0] for each in (v, a))
    rate = cross(W, d * u) + d * (u_rate - cross(W, u))
    return (-(R @ each[..., None])[..., 0] / MASS for each in (d * u, rate))


def by_hand(x, v, R, W, xd, heading, d=None):
    """Lee's wrench, body frame, with z down; and Ω_c, Ω̇_c; d is the drag along the body's axes."""
    kx, kv, m, e3 = KX * MASS, KV * MASS, MASS, np.array([0.0, 0.0, 1.0])
    ev, b3, dz = v - xd[1], R[..., 2], 0.0 if d is None else d[2]
    b3_rate = R[..., 0] * W[..., 1, None] - R[..., 1] * W[..., 0, None]
    A = -kx * (x - xd[0]) - kv * ev - m * G * e3 + m * xd[2]
    A = A if d is None else A + dz * v
    f = -dot(A, b3)[..., None]
    a = G * e3 - f / m * b3
    a = a if d is None else a + next(dragged(v, a, R, W, d))
    ea = a - xd[2]
    A1 = -kx * ev - kv * ea + m * xd[3]
    A1 = A1 if d is None else A1 + dz * a
    f1 = -(dot(A1, b3) + dot(A, b3_rate))[..., None]
    j = -f1 / m * b3 - f / m * b3_rate
    j = j if d is None else j + list(dragged(v, a, R, W, d))[1]
    ej = j - xd[3]
    A2 = -kx * ea - kv * ej + m * xd[4]
    if d is None:
        c3 = unit(-A, -A1, -A2)
        c2 = unit(*crossed(c3, heading))
        c1 = crossed(c2, c3)
    else:  # across b₁ and b₂ there is no push: Faessler, Franchi and Scaramuzza (2018)
        A2 = A2 + dz * j
        one, two = ([-(A + (dk - dz) * xd[1]), -(A1 + (dk - dz) * xd[2])] for dk in d[:2])
        for each, dk in zip((one, two), d[:2], strict=True):
            each.append(-(A2 + (dk - dz) * xd[3]))
        c2 = unit(*crossed(two, heading))
        c1 = unit(*crossed(c2, one))
        c3 = crossed(c1, c2)
    Rc = stack([c1[0], c2[0], c3[0]])
    Wc = stack([dot(c3[0], c2[1]), dot(c1[0], c3[1]), dot(c2[0], c1[1])])
    Wc_rate = stack(
        [
            dot(c3[1], c2[1]) + dot(c3[0], c2[2]),
            dot(c1[1], c3[1]) + dot(c1[0], c3[2]),
            dot(c2[1], c1[1]) + dot(c2[0], c1[2]),
        ]
    )
    E = transpose(Rc) @ R
    eR = stack(
        [E[..., 2, 1] - E[..., 1, 2], E[..., 0, 2] - E[..., 2, 0], E[..., 1, 0] - E[..., 0, 1]]
    )
    carried, carried_rate = ((transpose(E) @ w[..., None])[..., 0] for w in (Wc, Wc_rate))
    M = -KR / 2.0 * eR - KW * (W - carried) + cross(W, J * W)
    M = M - J * (cross(W, carried) - carried_rate)
    return np.concatenate([M, 0.0 * f, 0.0 * f, -f], axis=-1), Wc, Wc_rate, Rc


def helix(t):
    """Lee's elliptic helix and heading with their derivatives."""
    p = np.pi
    s, c, one = np.sin(p * t), np.cos(p * t), 1.0 + 0 * t
    x = [
        [0.4 * t, 0.4 * s, 0.6 * c],
        [0.4 * one, 0.4 * p * c, -0.6 * p * s],
        [0 * t, -0.4 * p**2 * s, -0.6 * p**2 * c],
        [0 * t, -0.4 * p**3 * c, 0.6 * p**3 * s],
        [0 * t, 0.4 * p**4 * s, 0.6 * p**4 * c],
    ]
    b = [[c, s, 0 * t], [-p * s, p * c, 0 * t], [-p * p * c, -p * p * s, 0 * t]]
    return [np.stack(row, -1) for row in x], [np.stack(row, -1) for row in b]


def hover(t):
    still = np.zeros(3)
    return [still] * 5, [np.array([1.0, 0, 0]), still, still]


def states_near(times, count=1000, seed=1):
    """Positions and attitudes near the helix, and any velocities."""
    random, SO3 = np.random.default_rng(seed), group_named("SO3")
    x, v, W = random.normal(size=(3, count, 3)) * [[[0.05]], [[0.5]], [[2.0]]]
    return x + helix(times)[0][0], v, SO3.exp(random.normal(size=(count, 3))), W


def flat_states(loop, x, v, R, W, t=0.0):
    Q = np.broadcast_to(np.eye(4), (len(x), 4, 4)).copy()
    Q[:, :3, :3], Q[:, :3, 3] = R, x
    V = np.concatenate([W, (np.swapaxes(R, 1, 2) @ v[..., None])[..., 0]], axis=1)
    return loop.initial_state(Q, V, Q, 0 * V, t)


@pytest.mark.parametrize("drag", [None, DRAG], ids=["no drag", "drag"])
def test_the_law_and_its_rates_are_those_written_by_hand(drag):
    known = {} if drag is None else with_drag(drag.tolist())
    loop, times = loop_of(reference=HELIX, **known), np.linspace(0.0, 3.0, 1000)
    x, v, R, W = states_near(times)
    s = loop.tracking(times, flat_states(loop, x, v, R, W, times))
    wrench, Wc, Wc_rate, _ = by_hand(x, v, R, W, *helix(times), drag)
    inner = loop.controller.commanded(s).tracking
    np.testing.assert_allclose(inner.Vd, Wc, rtol=1e-10, atol=1e-10)
    np.testing.assert_allclose(inner.Vd_dot, Wc_rate, rtol=1e-10, atol=1e-9)  # up to 300 rad/s²
    np.testing.assert_allclose(loop.torque(s), wrench, rtol=1e-10, atol=1e-10)


def test_derived_rates_cost_little_more_than_those_by_hand():
    groups = {"x": 3, "v": 3, "R": 9, "W": 3, "xd": 15, "psi": 3}

    def function(given):
        x, v, R, W, xd, psi = (given[name][None] for name in groups)
        cosine, sine = cos(psi[..., 0]), sin(psi[..., 0])
        rate, bend = psi[..., 1], psi[..., 2]
        ahead, left = stack([cosine, sine, 0.0]), stack([-sine, cosine, 0.0])
        heading = [
            ahead,
            rate[..., None] * left,
            bend[..., None] * left - (rate * rate)[..., None] * ahead,
        ]
        xd = [xd.reshape(1, 5, 3)[:, k] for k in range(5)]
        return {"wrench": by_hand(x, v, R.reshape(1, 3, 3), W, xd, heading)[0]}

    hand = traced(function, groups).operations
    derived = law_program(loop_of(reference=HELIX)).step.operations
    assert derived <= 1.4 * hand


def plain(times, R0, desired, d=None, torque=None):
    """Lee's closed loop from rest at 0, by SciPy: x and Ω at the times."""

    def field(t, y):
        x, v, R, W = y[None, :3], y[None, 3:6], y[None, 6:15].reshape(1, 3, 3), y[None, 15:]
        wrench, Wc, _, Rc = by_hand(x, v, R, W, *desired(t), d)
        if torque is not None:
            wrench[0, :3] = torque(R[0], W[0], Rc[0], Wc[0])
        W_rate = (wrench[0, :3] - np.cross(W[0], J * W[0])) / J
        W_hat = np.array([[0, -W[0, 2], W[0, 1]], [W[0, 2], 0, -W[0, 0]], [-W[0, 1], W[0, 0], 0]])
        v_rate = np.array([0, 0, G]) + wrench[0, 5] * R[0, :, 2] / MASS
        if d is not None:
            v_rate = v_rate - R[0] @ (d * (R[0].T @ v[0])) / MASS
        return np.concatenate([v[0], v_rate, (R[0] @ W_hat).ravel(), W_rate])

    y0 = np.concatenate([np.zeros(6), np.ravel(R0), np.zeros(3)])
    options = {"t_eval": times, "method": "DOP853", "rtol": 1e-13, "atol": 1e-14}
    y = solve_ivp(field, (0.0, times[-1]), y0, **options).y.T
    return y[:, :3], y[:, 15:]


def flown(times, R0, **changes):
    """The states of a run of eqt from rest at 0, with what they stand for."""
    one = experiment(**changes)
    loop = next(iter(one.loops.values()))
    start = flat_states(loop, np.zeros((1, 3)), np.zeros((1, 3)), R0[None], np.zeros((1, 3)))
    found = one.engine.solve(Problem(loop, start, times))
    assert found.status[0] == 0
    return loop, found.states[0], loop.tracking(times, found.states[0])


def nearest(R):
    U, _, Vt = np.linalg.svd(R)
    return U @ Vt


@pytest.mark.parametrize(
    ("reference", "desired", "R0", "engine", "duration", "drag"),
    [
        (HELIX, helix, np.eye(3), "native", 0.05, None),
        (HELIX, helix, np.eye(3), "native", 0.05, DRAG),
        (HELIX, helix, np.eye(3), "solve_ivp", 0.05, DRAG),
        in_ci("the plain program takes a minute", *(HELIX, helix, np.eye(3), "native", 10.0, None)),
        in_ci(
            "the plain program takes half a minute",
            *(HOVER, hover, nearest(UPSIDE_DOWN), "native", 10.0, None),
        ),
        in_ci(
            "the plain program takes ten seconds",
            *(HELIX, helix, np.eye(3), "solve_ivp", 1.0, None),
        ),
    ],
)
def test_lees_examples_are_those_of_a_plain_program(reference, desired, R0, engine, duration, drag):
    times = np.linspace(0.0, duration, 21)
    solver = {"engine": engine, "rtol": 1e-12, "atol": 1e-14}
    known = {} if drag is None else with_drag(drag.tolist())
    loop, states, s = flown(times, R0, reference=reference, solver=solver, **known)
    x, W = plain(times, R0, desired, drag)
    np.testing.assert_allclose(s.Q[:, :3, 3], x, atol=1e-11)
    np.testing.assert_allclose(s.V[:, :3], W, atol=1e-8)
    # The balance of the attitude law's energy, measured 3e-14: it holds for right rates only.
    L = loop.lyapunov(s)
    assert np.abs(L + loop.work(states) - L[0]).max() <= 1e-12 * L[0]


# Small errors -------------------------------------------------------------------------------------


def eigenvalues(loop):
    zero, V = np.zeros(1), np.zeros((1, loop.group.dimension))
    found = np.linalg.eigvals(linearised(loop, zero, loop.group.identity[None], V).closed[0])
    return found[np.lexsort((found.imag.round(6), found.real.round(6)))]


def roots(*polynomials):
    found = np.concatenate([np.roots(each) for each in polynomials]).astype(complex)
    return found[np.lexsort((found.imag.round(6), found.real.round(6)))]


def test_gains_of_the_attitude_law_are_numbers_of_one_structure():
    """So that a tuning of them traces it once."""
    inside = ({"kind": "goodarzi2013", "ki": ki, "c2": 1.0} for ki in (0.1, 0.2))
    one, two = (loop_of(law={"attitude": law}).controller for law in inside)
    assert one.structure == two.structure
    assert (one.inner.ki, two.inner.ki) == (0.1, 0.2)


def test_hover_has_the_poles_of_position_and_attitude():
    expected = roots(*[[1, KV, KX]] * 3, *([j, KW, KR] for j in J))
    np.testing.assert_allclose(eigenvalues(loop_of()), expected, atol=1e-6)


def test_without_rates_hover_is_unstable_as_its_characteristic_polynomial_says():
    found = eigenvalues(loop_of(law={"rates": "none"}))
    tilts = [[j / KR, KW / KR, 1, KV, KX] for j in J[:2]]
    np.testing.assert_allclose(found, roots(*tilts, [1, KV, KX], [J[2], KW, KR]), atol=1e-6)
    worst = found[found.real.argmax()]
    assert (worst.real, abs(worst.imag)) == pytest.approx((0.0139, 4.414), abs=5e-4)
    one = experiment(law={"rates": "none"})
    said = [str(each) for each in remarks(one, one.reference_over_horizon())]
    assert any("the loop of 'cascade' is unstable: small errors grow at 0.0139" in e for e in said)


PLANAR = {
    "group": "SE2",
    "inertia": [0.02, 0.5, 0.5],
    "model": {"forces": [{"kind": "restoring", "weight": 0.5 * G}]},
    "reference": {"kind": "flat", "position": [0.0, 0.0]},
}


@pytest.mark.parametrize("along", [[0, 1], [1, 0]])
def test_the_plane_has_the_poles_of_position_and_attitude(along):
    loop = loop_of(law={"along": along, "gains": {"kp": 1.5, "kd": 0.3}}, **PLANAR)
    at = loop.group.exp(np.array([np.pi / 2 * along[0], 0, 0]))  # [1, 0] hovers on its side
    zero = np.zeros(1)
    found = np.linalg.eigvals(linearised(loop, zero, at[None], np.zeros((1, 3))).closed[0])
    found = found[np.lexsort((found.imag.round(6), found.real.round(6)))]
    expected = roots(*[[1, KV, KX]] * 2, [0.02, 0.3, 2 * 1.5])
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_free_heading_leaves_the_yaw_to_damping():
    loop = loop_of(reference={**HOVER, "heading": "free"})
    yaw = [0.0, -KW / J[2]]
    expected = roots(*[[1, KV, KX]] * 3, *([j, KW, KR] for j in J[:2]), np.poly(yaw))
    np.testing.assert_allclose(eigenvalues(loop), expected, atol=1e-6)


def test_a_wrong_mass_leaves_an_offset():
    """At rest, m̂ (g + k_x e) = m g for the model's m̂, upwards: e = Δm g / (k_x m̂)."""
    true = 1.1 * MASS
    acting = {"forces": [{"kind": "restoring", "weight": true * G, "up": [0, 0, -1]}]}
    plant = {**acting, "inertia": [*J, true, true, true]}
    loop, _, s = flown(np.linspace(0, 12, 2), np.eye(3), plant=plant)
    assert s.Q[-1, 2, 3] == pytest.approx(0.1 * MASS * G / (KX * MASS), abs=1e-6)
    assert loop.controller.known_forces[0].weight == MASS * G


@pytest.mark.parametrize("rates", ["model", in_ci("compiles another loop", "filter")])
def test_derived_rates_enlarge_the_offset_in_a_steady_wind(rates):
    """e = a_w (1 + (k_Ω k_v + J k_x)/k_R)/k_x with rates by the model, else a_w/k_x.

    The model takes the tilt in a wind for an acceleration −a_w: Ω_c = k_v a_w/g, and
    Ω̇_c = k_x a_w/g. At rest, 0 = −k_R (θ − θ_c) + k_Ω Ω_c + J Ω̇_c with gθ = −a_w and gθ_c = −k_x e.
    A filter at rest has no rates.
    """
    wind = 1e-3
    acting = [{"kind": "restoring", "weight": MASS * wind, "up": [-1, 0, 0]}]
    plant = {"forces": [*QUADROTOR["model"]["forces"], *acting]}
    law = {"rates": rates, **({"bandwidth": 60} if rates == "filter" else {})}
    _, _, s = flown(np.linspace(0, 12, 2), np.eye(3), plant=plant, law=law)
    more = (KW * KV + J[1] * KX) / KR if rates == "model" else 0.0
    assert s.Q[-1, 0, 3] == pytest.approx(wind / KX * (1.0 + more), rel=1e-6)


# Attitude laws, rates, clocks ---------------------------------------------------------------------

INSIDE = ["eqt", "gt", "nog", "asym", "lee2010", "lee2012", "bullo_murray", "maithripala2006"]
INSIDE += ["logarithmic", "quaternion", "sliding", "slotine_li", "goodarzi2013"]


def off(runs=2):
    random, SO3 = np.random.default_rng(3), group_named("SO3")
    x, v, W = random.normal(size=(3, runs, 3)) * 0.1
    return x, v, SO3.exp(0.3 * random.normal(size=(runs, 3))), W


def run_of(one, times):
    """The loop of an experiment, and runs that start nearby."""
    (loop,) = one.loops.values()
    found = one.engine.solve(Problem(loop, flat_states(loop, *off()), times))
    assert (found.status == 0).all()
    return loop, found


def imbalance(one, times):
    """The largest |L + ∫ dissipation − L(0)| relative to L(0)."""
    loop, found = run_of(one, times)
    L = loop.lyapunov(loop.tracking(times, found.states)) + loop.work(found.states)
    return np.abs(L / L[:, :1] - 1.0).max()


@pytest.mark.parametrize(
    "inside", [in_ci("compiles a law", name, unless=name == "goodarzi2013") for name in INSIDE]
)
def test_the_energy_of_every_attitude_law_balances(inside):
    one = experiment(law={"attitude": inside}, reference=HELIX)
    (loop,) = one.loops.values()
    known = loop.controller.inner.dissipation(loop.controller.commanded(start_of(loop)).tracking)
    if known is None:
        pytest.skip(f"{inside} does not state its dissipation")
    assert imbalance(one, np.linspace(0, 0.5, 6)) <= 1e-12  # measured: 1e-14


def start_of(loop):
    return loop.tracking(0.0, flat_states(loop, *off()))


@pytest.fixture
def wrong_rate(monkeypatch):
    """Ω̇_c = 0 from the call on, as in most public implementations."""
    of = cascade.attitude

    def without(*given):
        found = of(*given)
        return found._replace(acceleration=0.0 * found.acceleration)

    return lambda: monkeypatch.setattr(cascade, "attitude", without)


# Drag along the axes of the body, which a quadrotor can fly exactly ------------------------------

CIRCLE = {"kind": "flat", "position": ["3*cos(t)", "3*sin(t)", 1], "heading": "0.3*t"}


def errors_on(times, **changes):
    """‖p − p_d‖ and the angle of the attitude, of a run that starts on its reference."""
    one = experiment(**{"reference": CIRCLE} | changes)
    (loop,) = one.loops.values()
    Q, V, _ = (each[None] for each in loop.reference.motion(loop.group, 0.0))
    found = one.engine.solve(Problem(loop, loop.initial_state(Q, V, Q, V), times))
    s = loop.tracking(times, found.states[0])
    turned = (transpose(s.Qd) @ s.Q)[:, :3, :3]
    angle = np.linalg.norm(turned - np.eye(3), axis=(1, 2)) / np.sqrt(2)
    return np.linalg.norm(s.Q[:, :3, 3] - s.Qd[:, :3, 3], axis=1).max(), angle.max()


@pytest.mark.parametrize(
    "changes",
    [
        with_drag(DRAG.tolist()),
        with_drag(DRAG.tolist(), current=[1.0, -0.5, 0.2]),
        with_drag([2.0, 1.0, 1.0]) | {"law": {"along": [1, 0, 0]}},
        with_drag([2.0, 2.0, 0.0]) | {"law": {"rates": "reference"}},
        with_drag(DRAG.tolist()) | {"control": {"period": 1e-4}},
    ],
    ids=["still", "wind", "forward", "rates of the reference", "sampled"],
)
def test_a_body_with_the_known_drag_follows_its_reference(changes):
    most = 1e-4 if "control" in changes else 1e-9
    assert max(errors_on(np.linspace(0.0, 2.0, 9), **changes)) <= most


def test_a_free_heading_flies_drag_that_is_the_same_across():
    known = with_drag([2.2, 2.2, 0.4]) | {"reference": {**CIRCLE, "heading": "free"}}
    assert errors_on(np.linspace(0.0, 2.0, 9), **known)[0] <= 1e-9


@pytest.mark.parametrize("rates", ["reference", "heading"])
def test_other_rates_are_the_given_ones(rates):
    loop = loop_of(law={"rates": rates}, reference=HELIX)
    s = start_of(loop)
    read = loop.controller.commanded(s).tracking
    expected = s.Vd[:, :3] if rates == "reference" else [[0, 0, np.pi]] * 2
    np.testing.assert_allclose(read.Vd, expected)
    rate = s.Vd_dot[:, :3] if rates == "reference" else np.zeros((2, 3))
    np.testing.assert_allclose(read.Vd_dot, rate, atol=1e-15)


def test_the_rates_of_the_filter_are_those_of_the_model_where_it_is_fast():
    """Of second order with both poles at ω: it is late by 2/ω, so that rates differ by as much."""
    law, solver = {"rates": "filter", "bandwidth": 1000.0}, {"engine": "native", "rtol": 1e-7}
    times = np.linspace(0, 0.4, 3)
    loop, run = run_of(experiment(law=law, reference=HELIX, solver=solver), times)
    found = run.states
    read = loop.controller.commanded(loop.tracking(times, found)).tracking
    model = loop_of(reference=HELIX)
    states = model.initial_state(
        *(getattr(loop.tracking(times, found), n) for n in ("Q", "V")), np.eye(4), np.zeros(6)
    )
    exact = model.controller.commanded(model.tracking(times, states)).tracking
    np.testing.assert_allclose(read.Vd[:, 1:], exact.Vd[:, 1:], atol=0.1)
    assert np.abs(exact.Vd[:, 1:]).max() > 1.0


def test_a_sampled_filter_follows_what_is_held_over_a_period():
    """ÿ = ω²(a − y) − 2ωẏ, by the exponential of its matrix."""
    w, h, random = 60.0, 0.01, np.random.default_rng(3)
    law = {"rates": "filter", "bandwidth": w}
    loop = loop_of(law=law, reference=HELIX, control={"period": h})
    s = loop.tracking(0.0, flat_states(loop, *off()))
    memory = {name: z + 0.1 * random.normal(size=z.shape) for name, z in s.memory.items()}
    s = dataclasses.replace(s, memory=memory)
    _, later = loop.controller.answer(s, h)
    asked = loop.controller.commanded(s).acceleration
    names = cascade.FILTERED, cascade.FILTERED_RATE
    y, rate = (memory[name] for name in names)
    moved = expm(h * np.array([[0.0, 1.0], [-(w**2), -2 * w]])) @ np.stack([y - asked, rate], -2)
    expected = asked + moved[..., 0, :], moved[..., 1, :]
    for name, value in zip(names, expected, strict=True):
        np.testing.assert_allclose(later[name], value, rtol=1e-11)


def test_c2_of_the_geometric_pid_follows_the_rotations_and_the_gains_of_the_cascade():
    """k_I c₂/(k_I + k_R) = ¼ min(k_R/k_Ω, k_Ω/J), with k_I = k_R/10."""
    law = loop_of(law={"attitude": "goodarzi2013"}).controller.inner
    assert law.c2 == pytest.approx(11 / 4 * min(KR / KW, KW / J.max()))
    told = loop_of(law={"attitude": {"kind": "goodarzi2013", "c2": 0.5}}).controller.inner
    assert told.c2 == 0.5


SAMPLED = {"control": {"period": 0.01, "delay": 1}, "time": {"duration": 0.1, "samples": 6}}


@pytest.mark.parametrize(
    "law",
    [
        in_ci("compiles a law, and calls it for a second",
            {"position": {"kx": KX, "kv": KV, "ki": 2, "limit": 6}}),
        {"rates": "filter", "bandwidth": 60, "attitude": {"kind": "goodarzi2013", "ki": 0.5},
         "position": {"kx": KX, "kv": KV, "ki": 2, "period": 0.03}},
    ],
)  # fmt: skip
def test_a_sampled_loop_is_the_same_by_both_engines(law):
    states = []
    for engine in ("native", "solve_ivp"):
        solver = {"engine": engine, "rtol": 1e-10, "atol": 1e-12}
        one = experiment(law=law, reference=HELIX, solver=solver, **SAMPLED)
        states.append(run_of(one, one.times)[1].states)
    assert np.isfinite(states[0]).all()
    np.testing.assert_allclose(*states, rtol=1e-7, atol=1e-7)


def test_a_position_loop_with_a_period_holds_its_force():
    """F of every third instant, and the attitude law of Lee without rates at each of them."""
    law = {"rates": "none", "position": {"kx": KX, "kv": KV, "period": "30 ms"}}
    one = experiment(law=law, reference=HELIX, control={"period": "10 ms"})
    times = np.arange(11) / 100
    loop, found = run_of(one, times)
    s, (xd, heading) = loop.tracking(times, found.states), helix(times)
    R, W, v = s.Q[..., :3, :3], s.V[..., :3], (s.Q[..., :3, :3] @ s.V[..., 3:, None])[..., 0]
    e3, still = np.array([0, 0, 1]), np.zeros(3)
    F = xd[2] - KX * (s.Q[..., :3, 3] - xd[0]) - KV * (v - xd[1]) - G * e3
    F = F[:, np.arange(11) // 3 * 3]
    c3 = -F / np.linalg.norm(F, axis=-1, keepdims=True)
    c2 = np.cross(c3, heading[0])
    c2 /= np.linalg.norm(c2, axis=-1, keepdims=True)
    Rc = np.stack([np.cross(c2, c3), c2, c3], axis=-1)
    E = np.swapaxes(Rc, -1, -2) @ R
    eR = [E[..., 2, 1] - E[..., 1, 2], E[..., 0, 2] - E[..., 2, 0], E[..., 1, 0] - E[..., 0, 1]]
    torque = -KR / 2 * np.stack(eR, axis=-1) - KW * W + np.cross(W, J * W)
    push = MASS * (F * R[..., 2]).sum(axis=-1)
    wrench = np.concatenate([torque, still + push[..., None] * e3], axis=-1)
    # No instant is at the end.
    asked, expected = loop.torque(s)[:, :-1], wrench[:, :-1]
    np.testing.assert_allclose(asked, expected, rtol=1e-9, atol=1e-9)


def test_margins_know_the_period_of_the_position():
    """Upwards, a mass whose PD force is held for P: z² − (2 − a − b)z + 1 + a − b.

    Here a = k_x P²/2 and b = k_v P. A period of one control period is none.
    """
    position, period = {"kx": KX, "kv": KV}, 0.2
    slow, own, none = (
        loop_of(law={"position": position | each}, control={"period": 0.02})
        for each in ({"period": period}, {"period": 0.02}, {})
    )
    found = eigenvalues(slow)
    a, b = KX * period**2 / 2, KV * period
    for root in np.roots([1, a + b - 2, 1 + a - b]):
        assert np.abs(found - root).min() < 1e-6
    assert np.abs(found).max() < 1
    moving = [each[np.abs(each) > 1e-3] for each in (eigenvalues(own), eigenvalues(none))]
    np.testing.assert_allclose(*moving, atol=1e-6)


@pytest.mark.parametrize(
    ("engine", "control"), [("native", {}), ("solve_ivp", {"control": {"period": 0.01}})]
)
def test_a_run_in_which_the_force_is_0_ends_with_its_time_and_the_remedy(engine, control):
    """g/k_x above the target; a run beside it goes on."""
    one = experiment(solver={"engine": engine, "rtol": 1e-9}, **control)
    (loop,) = one.loops.values()
    x = np.array([[0, 0, -G / KX], [0, 0, -0.5]])
    start = flat_states(loop, x, 0 * x, np.broadcast_to(np.eye(3), (2, 3, 3)), 0 * x)
    found = one.engine.solve(Problem(loop, start, np.linspace(0.0, 0.1, 3)))
    assert found.status.tolist() == [Status.NON_FINITE, Status.OK]
    said, remedy = found.messages[0].split("; ", 1)
    assert said.startswith("t = 0 s: ") and said.endswith("finite")
    assert remedy == (
        "a cascade whose force passes 0 has no attitude to command; give position.limit, below the "
        "weight per mass"
    )


# What is refused ----------------------------------------------------------------------------------


@from_yaml
def test_what_no_cascade_can_fly_is_refused(changes, message):
    said = refusal(ConfigError, loop_of, **yaml.safe_load(changes))
    assert mentions(said, message)


def test_the_direction_of_the_thrusters_is_the_default():
    rotors = [
        {"at": [x, y, 0], "along": [0, 0, -2], "turns": turn}
        for x, y, turn in ((0.3, 0, 0.01), (0, 0.3, -0.01), (-0.3, 0, 0.01), (0, -0.3, -0.01))
    ]
    one = experiment(law={"along": None}, actuators=[{"kind": "thrusters", "thrusters": rotors}])
    assert next(iter(one.loops.values())).controller.direction == (0.0, 0.0, -1.0)
    assert not remarks(one)


def test_rotors_that_all_turn_one_way_are_remarked():
    rotors = [
        {"at": [x, y, 0], "along": [0, 0, -1], "turns": 0.01}
        for x, y in ((0.3, 0), (0, 0.3), (-0.3, 0), (0, -0.3))
    ]
    one = experiment(law={"along": None}, actuators=[{"kind": "thrusters", "thrusters": rotors}])
    [said] = map(str, remarks(one))
    assert said.endswith(
        "actuators[0]: thrusters with rank 3 of 4 cannot push along ωz − 0.01 vz; what a law asks "
        "for there is lost; of what it asks along one axis alone arrives ωz 0.01 %"
    )


def test_a_model_is_what_acts_and_the_laws_may_know_the_plant():
    forces = QUADROTOR["model"]["forces"]
    both = loop_of()
    told = loop_of(model={"forces": "plant"}, plant={"forces": forces})
    again = loop_of(**experiment().resolved)
    for loop in (both, told, again):
        assert (
            repr(loop.controller.known_forces)
            == repr(both.vehicle.forces)
            == repr(loop.vehicle.forces)
        )
    falling = {**HOVER, "position": [0.0, 0.0, "-10*t**2"]}  # needs a push without weight, too
    unknowing = loop_of(model=None, plant={"forces": forces}, reference=falling)
    assert unknowing.controller.known_forces == () and len(unknowing.vehicle.forces) == 1


@pytest.mark.needs("proofs")
@pytest.mark.ci("margins of another cascade are fast")
def test_margins_multiply_the_gains_of_position_and_attitude():
    """Without rates, Jλ⁴/k_R + k_Ωλ³/k_R + λ² + k_vλ + k_x: the attitude must be faster."""
    from eqt_cli.extensions.proofs.margins import margins_of

    law = {"rates": "none", "gains": {"kp": 4 * KR / 2, "kd": 2 * KW}}
    found = margins_of(experiment(law=law)).laws[0].gains["position"].upper

    def largest(factor):
        tilt = [J[1] / (4 * KR), 2 * KW / (4 * KR), 1, factor * KV, factor * KX]
        return np.roots(tilt).real.max()

    assert largest(0.999 * found) < 0 < largest(1.001 * found)


# Runs and their verification ----------------------------------------------------------------------


def rows_of(**changes):
    from eqt_cli.extensions.proofs.verification import verify_experiment

    one = experiment(
        **{
            "reference": HELIX,
            "ensemble": {"runs": 2},
            "initial": {"pose": {"kind": "angle", "angle": 0.5}},
            "time": {"duration": 1.0, "samples": 21},
            "solver": {"engine": "native", "rtol": 1e-9},
            **changes,
        }
    )
    return {row.name: row for row in verify_experiment(one, runs=2).rows}


@pytest.mark.needs("proofs")
def test_verify_judges_the_attitude_law_in_the_loop_that_it_runs_in():
    rows = rows_of()
    assert not [row for row in rows.values() if row.verdict == "FAILS"]
    assert rows["Υ is a navigation function"].measured == pytest.approx(KR)  # that on SO(3)
    assert rows["energy balance"].measured < 1e-8
    assert rows["rates of the commanded attitude"].verdict == "holds"
    assert rows["F is not 0"].verdict == "holds"


@pytest.mark.needs("proofs")
@pytest.mark.ci("verifies a loop")
def test_verify_tells_when_the_force_is_nearly_0():
    """A fall from beyond g/k_x turns F upside down, and then through 0."""
    pose = {"kind": "fixed", "coordinates": [0, 0, 0, 0, 0, -G / KX - 0.2]}
    row = rows_of(reference=HOVER, initial={"pose": pose, "velocity": "fixed"})["F is not 0"]
    assert row.verdict == "violated" and row.measured < 0.5
    said = r"F is nearly 0 at 0\.\d+ s: give position.limit below the weight per mass"
    assert re.search(said, row.remark)


@pytest.mark.needs("proofs")
@pytest.mark.parametrize(
    ("changes", "verdict"),
    [
        ({}, "holds"),
        ({"law": {"attitude": "goodarzi2013", "position": {"kx": KX, "kv": KV, "ki": 2}}}, "holds"),
        ({"reference": {"kind": "flat", "position": ["t", "t**2", "sin(t)"], "heading": "free"}},
         "holds"),
        ({"reference": {"kind": "flat", "minimum_snap": KNOTS}}, "holds"),
        ({"law": {"along": [0, 1]}, **PLANAR}, "holds"),
        ({"planted": True}, "FAILS"),
    ],
)  # fmt: skip
def test_verify_compares_the_rates_with_those_of_the_commanded_attitude(
    changes, verdict, wrong_rate
):
    """At random states, along the motion of the model, by numbers that carry their rates."""
    from eqt_cli.extensions.proofs.sample import sampled
    from eqt_cli.extensions.underactuated.certificates import CommandedRates

    if changes.pop("planted", False):
        wrong_rate()
    one = experiment(**{"reference": HELIX, **changes})
    ((label, loop),) = one.loops.items()
    of_model = dataclasses.replace(loop, vehicle=Vehicle(forces=loop.controller.known_forces))
    sample = sampled(label, of_model, 1.0, np.random.default_rng(1))
    (row,) = CommandedRates().check(sample)
    assert row.verdict == verdict
    assert (row.measured > 0.01) == (verdict == "FAILS")


@pytest.mark.needs("proofs")
@pytest.mark.ci("compiles and verifies a loop")
def test_verify_names_a_wrong_rate(wrong_rate):
    wrong_rate()
    balance = rows_of(reference={**HELIX, "heading": "2*t"})["energy balance"]
    assert balance.verdict == "FAILS" and balance.measured > 0.01


@pytest.mark.needs("export")
def test_a_cascade_is_exported_with_position_and_heading(tmp_path):
    start = {"pose": {"kind": "angle", "angle": 0.5}}
    laws = [{**LAW, "rates": "none"}]
    config = {**QUADROTOR, "name": "c", "initial": start, "controllers": laws}
    eqt_cli.export(config, tmp_path / "c")
    header = (tmp_path / "c" / "cascade.h").read_text()
    assert "double position[15];" in header and "double heading[3];" in header
    assert "double position_kx;" in header and "kx;      /* fixed" not in header


@pytest.mark.parametrize("size", [1e-200, 3.0, 1e200])
def test_a_direction_of_any_size_is_a_direction(size):
    assert unit_vector([0, 0, -size]) == (0.0, 0.0, -1.0)
    assert unit_vector([3 * size, 4 * size]) == pytest.approx((0.6, 0.8), rel=1e-15)


def test_a_direction_of_length_1_is_left_alone():
    """A fourth of them would change at the second time, if both times divided by the length."""
    drawn = np.random.default_rng(0).standard_normal((50, 3))
    for along in [*drawn, [0.8, 0.0, 0.6], [1.0, 2.0, -2.0]]:
        once = unit_vector(along)
        assert unit_vector(once) == once
        assert once == pytest.approx(along / np.sqrt(np.sum(np.square(along))), rel=1e-15)


@pytest.mark.needs("autopilots")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
def test_a_cascade_by_rates_is_that_of_a_plain_program(engine):
    """ω_c from the quaternion of R and R_c, and a rate loop 30 times as fast as Ω."""
    kp, b, times = np.array([7.0, 6.0, 3.0]), 30.0, np.linspace(0.0, 0.1, 6)

    def torque(R, W, Rc, Wc):
        q = Rotation.from_matrix(R.T @ Rc).as_quat()
        asked = R.T @ Rc @ Wc + 2 * kp * np.sign(q[3]) * q[:3]
        return J * b * (asked - W) + np.cross(W, J * W)

    given = {"reference": HELIX, "actuators": [{"kind": "rate_loop", "bandwidth": b}]}
    given["solver"] = {"engine": engine, "rtol": 1e-12, "atol": 1e-14}
    law = {"attitude": {"kind": "rate", "kp": kp.tolist()}, "gains": {}}
    loop, _, s = flown(times, np.eye(3), law=law, **given)
    x, W = plain(times, np.eye(3), helix, torque=torque)
    np.testing.assert_allclose(s.Q[:, :3, 3], x, rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[:, :3], W, rtol=0, atol=1e-9)
    assert loop.controller.commands == "rates"
