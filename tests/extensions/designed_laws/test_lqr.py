"""LQR against closed forms, dense Riccati equations written here, and the cost of runs.

With x = (ε, e), Q = Q_d exp(ε) and V = V_d + ad_{V_d}ε + e to first order, ε̇ = e and
ė = ∂V̇/∂V (ad_{V_d}ε + e) − ad_{V̇_d}ε − ad_{V_d}e + 𝕀⁻¹u, where 𝕀V̇ = ad*_V 𝕀V.
"""

import functools

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, in_ci, refusal
from plain import hat
from said import says
from scipy.integrate import solve_ivp
from scipy.linalg import expm, logm, solve_continuous_are, solve_discrete_are

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import Gains, Inertia, LinearPlant, Problem, SolveIvp, Tracking, group_named
from eqt_cli.extensions.designed_laws.lqr import Eqr, _Design
from eqt_cli.runs.law_names import law_names

J = np.array([1.0, 2.0, 3.0])
BODY = {
    "group": "SO3",
    "inertia": J.tolist(),
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"kind": "constant"},
    "controllers": ["lqr"],
    "initial": {"pose": {"kind": "angle", "angle": 0.1}, "velocity": {"kind": "normal", "std": 0}},
    "time": {"duration": 20.0},
}
PERIOD, LAG = 0.1, 0.2
LATE = {
    "control": {"period": PERIOD, "delay": 2},
    "actuators": [{"kind": "lag", "time_constant": LAG}],
}
WEIGHTS = {"pose": [4.0, 1.0, 2.0], "velocity": 0.5, "torque": [1.0, 2.0, 3.0]}
RATES = ["0.5*cos(2*pi*t/5)", "0.3", "0.4*sin(2*pi*t/5)"]

# Differences of the loop give A and B to 1e-12; measured 7e-15 where they are exact.
GAINS = 1e-10


def law_of(**changes):
    return eqt_cli.load_experiment({**BODY, **changes}).experiment(0).loops["lqr"].controller


def test_gains_at_rest_are_the_closed_form():
    """S solves 1 = k_ε² and J k_e² = J + 2J k_ε J⁻¹ … for each axis: k_ε = 1, k_e² = 1 + 2J."""
    gain = law_of().regulator.gain
    np.testing.assert_allclose(gain[:, :3], np.eye(3), rtol=0, atol=GAINS)
    np.testing.assert_allclose(gain[:, 3:], np.diag(np.sqrt(1 + 2 * J)), rtol=0, atol=GAINS)


def test_weights_are_numbers_diagonals_or_matrices():
    weights = {**WEIGHTS, "velocity": (0.5 * np.eye(3)).tolist()}
    one, other = (
        law_of(controllers=[{"kind": "lqr", "weights": each}]).regulator.gain
        for each in (WEIGHTS, weights)
    )
    np.testing.assert_array_equal(one, other)
    stiffness = np.sqrt(np.array([4.0, 1.0, 2.0]) / np.array([1.0, 2.0, 3.0]))
    np.testing.assert_allclose(one[:, :3], np.diag(stiffness), rtol=0, atol=GAINS)


@pytest.mark.parametrize("axis", range(3))
def test_a_sampled_late_loop_has_the_gains_of_the_dense_equation(axis):
    """States ε, e, the lag's, and the commands of two periods on their way."""
    A = np.array([[0, 1, 0], [0, 0, 1 / J[axis]], [0, 0, -1 / LAG]])
    B = np.array([[0], [0], [1 / LAG]])
    both = expm(PERIOD * np.block([[A, B], [np.zeros((1, 4))]]))
    late, add = np.zeros((5, 5)), np.eye(5)[:, 4:]
    late[:3, :4], late[3, 4] = both[:3], 1.0
    Q, R = PERIOD * np.diag([1.0, 1, 0, 0, 0]), PERIOD * np.eye(1)
    S = solve_discrete_are(late, add, Q, R)
    expected = np.linalg.solve(R + add.T @ S @ add, add.T @ S @ late)[0]
    row = law_of(**LATE).regulator.gain[axis]
    # Its own order: errors, the queue of commands, whose oldest is spent, then lags.
    found = [row[axis], row[3 + axis], row[15 + axis], row[9 + axis], row[12 + axis]]
    np.testing.assert_allclose(found, expected, rtol=0, atol=GAINS)
    assert np.abs(row[6:9]).max() < GAINS


# Along references that move: R_d = exp(a e_z) exp(b e_x), with ω = (ḃ, ȧ sin b, ȧ cos b).

REPEATS = 5.0
MOTIONS = {
    "path": {
        "kind": "path",
        "factors": [
            {"axis": "wz", "by": f"0.6*sin(2*pi*t/{REPEATS})"},
            {"axis": "wx", "by": f"0.4*sin(4*pi*t/{REPEATS})"},
        ],
    },
    "slew": {"kind": "slew", "to": {"rotvec": [2, 0, 0]}, "start": 1.0, "duration": REPEATS - 2},
}


def turning(kind, **changes):
    """A configuration that turns and returns, or slews from rest to rest."""
    return {"reference": MOTIONS[kind], "time": {"duration": REPEATS}, **changes}


def angles(kind, t):
    """(a, b) and their two derivatives."""
    if kind == "path":
        rates = np.array([2, 4]) * np.pi / REPEATS
        phase, size = rates * t, np.array([0.6, 0.4])
        return size * [np.sin(phase), rates * np.cos(phase), -(rates**2) * np.sin(phase)]
    length = REPEATS - 2
    s = np.clip((t - 1) / length, 0, 1)
    rows = (
        10 * s**3 - 15 * s**4 + 6 * s**5,
        30 * s**2 * (1 - s) ** 2,
        60 * s * (1 - s) * (1 - 2 * s),
    )
    return np.array([[0, 2 * row / length**k] for k, row in enumerate(rows)])


INVERSE = np.diag(1 / J)
B = np.vstack([np.zeros((3, 3)), INVERSE])


def plant(kind, t):
    """A at time t, by hand."""
    (_, b), (da, db), (dda, ddb) = angles(kind, t)
    w = np.array([db, da * np.sin(b), da * np.cos(b)])
    w_dot = [ddb, dda * np.sin(b) + da * db * np.cos(b), dda * np.cos(b) - da * db * np.sin(b)]
    slope = INVERSE @ (hat(J * w) - hat(w) * J)
    lower = [slope @ hat(w) - hat(np.array(w_dot)), slope - hat(w)]
    return np.block([[np.zeros((3, 3)), np.eye(3)], lower])


@functools.cache
def values(kind, periods=1):
    """S as a function over the last horizon, from its stationary value at the end."""

    def riccati(before, flat):
        S, A = flat.reshape(6, 6), plant(kind, -before % REPEATS)
        return (A.T @ S + S @ A - S @ B @ B.T @ S + np.eye(6)).ravel()

    last = plant(kind, REPEATS)
    end = solve_continuous_are(last, B, np.eye(6), np.eye(3)).ravel()
    span, bounds = (0, periods * REPEATS), {"rtol": 1e-10, "atol": 1e-12}
    found = solve_ivp(riccati, span, end, "DOP853", dense_output=True, **bounds)
    return lambda t: found.sol(periods * REPEATS - t).reshape(6, 6)


def errors(kind, pieces, **law):
    """The largest errors of K and S, relative, at times between all knots, and at the end."""
    options = {"kind": "lqr", "pieces": pieces, **law}
    table = law_of(**turning(kind, controllers=[options])).table
    times = np.append(np.linspace(0.0, REPEATS, 307, endpoint=False), REPEATS)
    S = np.array([values(kind, 3 if law else 1)(t) for t in times])
    now = table.at(times)
    pairs = (now.gain_at(times), B.T @ S), (now.value_at(times), S)
    return np.array([np.abs(found - true).max() / np.abs(true).max() for found, true in pairs])


@pytest.mark.parametrize(
    ("kind", "law"),
    [
        ("path", {"periodic": True}),
        in_ci("as the first", "path", {}),
        in_ci("as the first", "slew", {}),
    ],
)
def test_gains_and_values_at_all_times_are_wrong_by_the_square_of_a_piece(kind, law):
    """Against −Ṡ = AᵀS + SA − SBBᵀS + I: twice the pieces, a quarter of the error."""
    few, many = (errors(kind, pieces, **law) for pieces in (50, 100))
    assert (few < 1e-2).all()  # of pieces of 0.1 s; measured 8.3e-3
    np.testing.assert_allclose(few / many, 4.0, rtol=0.05)


def test_a_slew_from_rest_to_rest_ends_with_the_gains_at_rest():
    """Nothing repeats: its loop goes on at rest, without end, as in the closed form above."""
    table = law_of(**turning("slew")).table
    gain = table.at(REPEATS).gain_at(REPEATS)
    expected = np.hstack([np.eye(3), np.diag(np.sqrt(1 + 2 * J))])
    np.testing.assert_allclose(gain, expected, rtol=0, atol=GAINS)
    first = table.at(0.0).gain_at(0.0)
    assert np.abs(first - B.T @ values("slew")(0.0)).max() < 1e-3
    assert np.abs(first - expected).max() > 1e-2


@pytest.mark.parametrize("kind", ["path", "slew"])
@pytest.mark.parametrize("velocity", [1.0, in_ci("as the first", 0.0)])
def test_the_cost_to_come_falls_along_a_reference_that_moves(kind, velocity):
    """ẋ = (A − BK)x by an integration here; L falls by the cost, to the square of a piece."""
    weights = {"velocity": velocity}
    law = {"kind": "lqr", "weights": weights}
    table = law_of(**turning(kind, controllers=[law])).table
    times = np.linspace(0.0, REPEATS, 501)
    Q = np.diag([1.0] * 3 + [velocity] * 3)

    def rates(t, flat):
        x = flat[:36].reshape(6, 6)
        K = table.at(t).gain_at(t)
        running = (x * (Q @ x)).sum(axis=0) + ((K @ x) ** 2).sum(axis=0)
        return np.concatenate([((plant(kind, t) - B @ K) @ x).ravel(), running])

    start = np.concatenate([np.eye(6).ravel(), np.zeros(6)])
    found = solve_ivp(rates, (0, REPEATS), start, t_eval=times, rtol=1e-9, atol=1e-12).y
    x = np.moveaxis(found[:36].reshape(6, 6, -1), -1, 0)
    S = table.at(times).value_at(times)
    L = np.einsum("tik,tij,tjk->tk", x, S, x)
    assert (np.diff(L, axis=0) < 0).all()
    np.testing.assert_allclose(L + found[36:].T, np.broadcast_to(L[0], L.shape), rtol=3e-3)


def test_gains_of_a_sampled_loop_that_moves_are_those_of_its_recursion():
    """One knot in each of ten instants, or in each: the same to the square of a piece."""
    found = []
    for pieces in (10, 20, 100):
        law = {"kind": "lqr", "pieces": pieces}
        made = turning("path", controllers=[law], control={"period": 0.05})
        found.append(law_of(**made).table)
    times = 0.05 * np.arange(100)
    few, many, all_of_them = (each.at(times).gain_at(times) for each in found)
    late = np.abs(few - all_of_them).max(), np.abs(many - all_of_them).max()
    assert late[0] < 0.2 * np.abs(all_of_them).max() and 3.5 < late[0] / late[1] < 5.0


@pytest.mark.parametrize("last", [0.99, 0.8], ids=["from above", "from below"])
def test_a_regulator_that_decays_slowly_over_a_period_is_periodic(last):
    """Against one recursion over 300 periods of nine instants, of which four are knots.

    S begins with the constant gain of the last knot, and the first period reaches neither bound.
    """
    knots = np.array([0, 3, 6, 8])
    A = np.array([0.95, 1.01, last, 0.9])[:, None, None]
    Q, R, found = np.array([[1.0]]), np.array([[400.0]]), []
    plant = LinearPlant(0.1 * knots, A, np.ones((4, 1, 1)), 0.1)
    table = _Design(plant, Q, R, periodic=True).over_time()
    each, S = np.interp(np.arange(9), knots, A[:, 0, 0]), 1.0
    for instant in reversed(range(9 * 300)):
        a = each[instant % 9]
        gain = S * a / (0.1 * R[0, 0] + S)
        S = 0.1 * Q[0, 0] + a * S * a * (1 - S / (0.1 * R[0, 0] + S))
        if instant in knots:
            found.append((gain, S))
    gains, values = np.array(found[::-1]).T
    at, times = table.at(0.1 * knots), 0.1 * knots
    np.testing.assert_allclose(at.value_at(times)[:, 0, 0], values, rtol=1e-8)
    np.testing.assert_allclose(at.gain_at(times)[:, 0, 0], gains, rtol=1e-8)


@pytest.mark.parametrize("vehicle", [{}, LATE], ids=["continuous", "sampled"])
def test_the_cost_of_a_small_error_is_x_s_x(vehicle):
    """To 1e-3, because errors of 1e-3 leave the linear loop by their square only."""
    loop = eqt_cli.load_experiment({**BODY, **vehicle}).experiment(0).loops["lqr"]
    Q, V = loop.group.exp(np.array([1e-3, -2e-3, 1.5e-3])), np.array([1e-3, 1e-3, -2e-3])
    start = loop.initial_state(Q, V, loop.group.identity, np.zeros(3))
    times = np.linspace(0.0, 14.0, 1_401 if not vehicle else 141)
    states = SolveIvp().solve(Problem(loop, start[None], times)).states[0]
    s = loop.tracking(times, states)
    torque = loop.command(s)
    rates = sum((x**2).sum(axis=-1) for x in (loop.group.log(s.Q), s.V, torque))
    cost = np.trapezoid(rates, times) if not vehicle else PERIOD * rates.sum()
    x = np.concatenate([loop.group.log(Q), V])
    value = loop.controller.regulator.value[:6, :6]
    assert cost == pytest.approx(x @ value @ x, rel=1e-3)


# A heavy body that is coupled, along a constant velocity.
COUPLED = yaml.safe_load("""
group: SE3
inertia: [[0.28, 0, 0, 0, -0.23, 0], [0, 0.28, 0, 0.23, 0, 0], [0, 0, 0.28, 0, 0, 0],
  [0, 0.23, 0, 17.0, 0, 0], [-0.23, 0, 0, 0, 24.2, 0], [0, 0, 0, 0, 0, 26.07]]
reference: {kind: constant, velocity: [0, 0, 0.3, 0.15, 0, 0]}
controllers: [{kind: lqr, weights: {pose: [8, 8, 8, 4, 4, 4], torque: 0.1}}]
""")


def coupled():
    """A, B, Q and R of that loop, by hand: ė = (∂V̇ − ad_{V_d})e + (∂V̇ ad_{V_d})ε."""
    inertia, V = np.array(COUPLED["inertia"]), np.array([0, 0, 0.3, 0.15, 0, 0])
    P, none = inertia @ V, np.zeros((3, 3))
    ad = np.block([[hat(V[:3]), none], [hat(V[3:]), hat(V[:3])]])
    free = np.block([[hat(P[:3]), hat(P[3:])], [hat(P[3:]), none]]) + ad.T @ inertia
    slope = np.linalg.solve(inertia, free)
    A = np.block([[np.zeros((6, 6)), np.eye(6)], [slope @ ad, slope - ad]])
    B = np.vstack([np.zeros((6, 6)), np.linalg.inv(inertia)])
    return A, B, np.diag([8.0] * 3 + [4.0] * 3 + [1.0] * 6), 0.1 * np.eye(6)


def test_gains_of_a_coupled_body_follow_from_the_stable_subspace():
    """S = Y X⁻¹ of the eigenvectors (X, Y) of the Hamiltonian with negative real parts."""
    A, B, Q, R = coupled()
    values, vectors = np.linalg.eig(np.block([[A, -B @ np.linalg.solve(R, B.T)], [-Q, -A.T]]))
    X, Y = np.split(vectors[:, values.real < 0], 2)
    expected = np.linalg.solve(R, B.T @ (Y @ np.linalg.inv(X)).real)
    gain = law_of(**COUPLED).regulator.gain
    np.testing.assert_allclose(gain, expected, rtol=0, atol=GAINS * np.abs(expected).max())


def test_gains_of_a_coupled_body_are_those_of_python_control():
    control = pytest.importorskip("control", reason="make oracles installs it")
    A, B, Q, R = coupled()
    expected = control.lqr(A, B, Q, R)[0]
    gain = law_of(**COUPLED).regulator.gain
    np.testing.assert_allclose(gain, expected, rtol=0, atol=GAINS * np.abs(expected).max())


@pytest.mark.ci("compiles the loops")
@pytest.mark.parametrize("vehicle", [{}, LATE], ids=["continuous", "sampled"])
def test_gains_that_change_at_knots_are_the_same_by_both_engines(vehicle, tmp_path):
    rates = {"kind": "rates", "rates": RATES}
    config = {**BODY, **vehicle, "reference": rates, "time": {"duration": 5.0, "samples": 51}}
    config["controllers"] = [{"kind": "lqr", "pieces": 20}]
    found = [
        eqt_cli.run(
            config | {"solver": {"engine": engine, "cross_check": 0}}, tmp_path / engine
        ).to_xarray()
        for engine in ("native", "solve_ivp")
    ]
    for name in ("pose", "velocity", "torque"):
        # Both steps are accurate to 1e-9.
        np.testing.assert_allclose(*(each[name].values for each in found), rtol=0, atol=1e-7)


def test_swept_weights_have_no_name_of_a_law():
    """Also where a registered law, such as `quaternion`, is not for the group."""
    swept = {"sweep": [{"grid": {"controllers[0].weights.torque": [0.1, 0.2]}}]}
    study = eqt_cli.load_experiment({**BODY, **COUPLED, **swept})
    assert law_names(study, study.sweep).tolist() == [[""], [""]]


SEMI, DEFINITE = "expected a positive semidefinite matrix", "expected a positive definite matrix"


@from_yaml
def test_weights_that_give_no_regulator_are_refused(options, message):
    said = refusal(ConfigError, law_of, controllers=[{"kind": "lqr", **options}])
    assert says(said, f"controllers[0]{message}")


@pytest.mark.parametrize(
    ("reference", "duration", "differs", "difference"),
    [
        (MOTIONS["slew"], 5.0,
         "Q_d[1, 1] is 1 at the start of the horizon and -0.416147 at its end, 5 s", "1.42"),
        ({"kind": "path", "factors": [{"axis": "wz", "by": "sin(t)"}]}, np.pi,
         "V_d[2] is 1 at the start of the horizon and -1 at its end, 3.14159 s", "2"),
        ({"kind": "path", "factors": [{"axis": "wz", "by": "t*(t-1)**3"}]}, 1.0,
         "V_d[2] is -1 at the start of the horizon and 0 at its end, 1 s", "1"),
        ({"kind": "path", "factors": [{"axis": "wz", "by": "t**2*(t-1)**3"}]}, 1.0,
         "τ_d[2] is -6 at the start of the horizon and 0 at its end, 1 s", "6"),
    ],
)  # fmt: skip
def test_a_motion_that_does_not_repeat_is_not_periodic(reference, duration, differs, difference):
    law = [{"kind": "lqr", "periodic": True}]
    changes = {"reference": reference, "controllers": law, "time": {"duration": duration}}
    assert says(
        refusal(ConfigError, law_of, **changes),
        f"controllers[0]: periodic: {differs}, a difference of {difference}…",
    )


def test_laws_that_read_no_gains_need_none_and_compensate_known_forces():
    """At hover the command is the weight, and the plant stays where it is."""
    weight = {"kind": "restoring", "weight": 9.81}
    body = {"group": "SE3", "inertia": [0.1, 0.2, 0.3, 1, 1, 1], "model": {"forces": [weight]}}
    config = {**BODY, **body, "initial": {"pose": {"kind": "exp_normal", "std": 0}}}
    del config["gains"]
    loop = eqt_cli.load_experiment(config).experiment(0).loops["lqr"]
    at = np.eye(4)[None], np.zeros((1, 6))
    s = loop.tracking(0.0, loop.initial_state(*at, *at))
    np.testing.assert_array_equal(loop.command(s), [[0, 0, 0, 0, 0, 9.81]])
    np.testing.assert_array_equal(loop.acting_and_rates(s)[0], np.zeros((1, 6)))


# EqR, in other coordinates ------------------------------------------------------------------------


RIGID_BODY = {
    "group": "SE3",
    "inertia": [1.0, 2.0, 3.0, 4.0, 4.0, 4.0],
    "reference": {"kind": "constant", "velocity": [0.3, -0.2, 0.5, 1.0, 0.4, -0.7]},
    "controllers": ["lqr", {"kind": "eqr", "symmetry": "direct_product"}],
    "initial": {"pose": {"kind": "angle", "angle": 0.1}},
    "time": {"duration": 2.0},
}
LARGE = np.array([1.2, -0.8, 1.5, 2.0, -3.0, 1.0, 0.4, 1.0, -0.6, 2.0, -1.0, 0.5])


def shift(x):
    """A vector under addition, as a matrix."""
    return np.block([[np.eye(3), x[:, None]], [0, 0, 0, 1]])


def log(X):
    """The logarithm of a matrix; that of a shift is exact, since (X − I)² = 0."""
    N = X - np.eye(len(X))
    return (logm(X).real if (N @ N).any() else N).ravel()


def element(symmetry, Q, V):
    """The factors of X, with v in space and w in the body."""
    R, x, w = Q[:3, :3], Q[:3, 3], V[3:]
    if symmetry == "direct_product":
        return [R, shift(x), shift(R @ w)]
    if symmetry == "pose_velocity":
        return [Q, shift(w)]
    extended = np.eye(5)
    extended[:3] = np.column_stack([R, x, R @ w])
    return [extended]


@pytest.mark.parametrize(
    ("symmetry", "frame"),
    [
        ("direct_product", "body"),
        ("pose_velocity", "body"),
        ("extended_pose", "body"),
        ("extended_pose", "space"),
    ],
)
def test_errors_are_the_logarithm_in_the_coordinates_of_lqr_to_first_order(symmetry, frame):
    G, Vd = group_named("SE3"), np.array(RIGID_BODY["reference"]["velocity"])
    Qd = G.exp(np.array([0.5, 1.0, -0.7, 3.0, -1.0, 2.0]))

    def at(x):
        """A motion whose errors in the coordinates of lqr are x."""
        Q_L = G.exp(x[:6])
        return Qd @ Q_L, x[6:] + G.Ad(G.inverse(Q_L), Vd)

    def error(x):
        """The logarithm, and e_Ω, which belongs to no symmetry."""
        pairs = zip(element(symmetry, *at(x)), element(symmetry, Qd, Vd), strict=True)
        inverse = np.linalg.inv
        found = [X @ inverse(X_d) if frame == "space" else inverse(X_d) @ X for X, X_d in pairs]
        return np.concatenate([*map(log, found), x[6:9]])

    h = 1e-4  # whose square, 1e-8, is what differences leave of errors of 1
    tangent = np.array([error(h * e) - error(-h * e) for e in np.eye(12)]) / (2 * h)
    expected = np.linalg.lstsq(tangent.T, error(LARGE), rcond=None)[0]
    Q, V = at(LARGE)
    one = Inertia(np.eye(6), np.eye(6))
    s = Tracking(G, one, Gains(np.eye(4), np.eye(6)), 0.0, Q, V, Qd, Vd, np.zeros(6))
    found = np.concatenate(Eqr(symmetry=symmetry).errors(s))
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-6)
    assert np.abs(found - LARGE).max() > 0.1


def test_along_a_constant_velocity_the_gains_are_constant_and_those_of_lqr():
    loops = eqt_cli.load_experiment(RIGID_BODY).experiment(0).loops
    np.testing.assert_array_equal(*(each.controller.regulator.gain for each in loops.values()))


def test_a_group_without_a_position_is_refused():
    body = {**RIGID_BODY, "group": "SO3", "inertia": 1.0, "reference": {"kind": "constant"}}
    with pytest.raises(ConfigError) as caught:
        eqt_cli.load_experiment({**body, "controllers": ["eqr"]})
    assert str(caught.value) == (
        "controllers[0]: eqr needs a group of one rotation and one translation, SE2 or SE3, got SO3"
    )
