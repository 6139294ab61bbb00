"""Laws that reject disturbances around a cascade, against a plain program and closed forms."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, refusal
from plain import hat
from said import mentions
from scipy.integrate import solve_ivp
from scipy.signal import butter

import eqt_cli
from eqt_cli.base.errors import ConfigError

T, LAG, MASS, G = 0.01, 0.02, 0.8, 9.81
J = np.diag([0.0047, 0.005, 0.0074])
KX, KV, KR, KW = np.array([6.0, 6.0, 12.0]), np.array([4.0, 4.0, 8.0]), 1.0, 0.1
FORCE, TORQUE = np.array([0.8, -0.5, 0.4]), np.array([0.01, -0.02, 0.005])
RATE, CUTOFF, A, LOW_PASS, SECOND = 8.0, 3.0, 2.0, 20.0, 50.0
E3 = np.array([0.0, 0.0, 1.0])

CASCADE = {
    "kind": "cascade",
    "attitude": "lee2010",
    "position": {"kx": KX.tolist(), "kv": KV.tolist()},
    "along": [0, 0, 1],
}
GAINS = {"k_R": KR, "k_Omega": KW}
LAWS = {
    "observer": {"kind": "observer", "rate": RATE},
    "push only": {"kind": "observer", "rate": RATE, "lateral": False},
    "indi": {"kind": "indi", "cutoff": CUTOFF},
    "accelerometer": {"kind": "indi", "cutoff": CUTOFF, "linear": "accelerometer"},
    "l1": {"kind": "l1", "cutoff": LOW_PASS, "a": A},
    "second": {"kind": "l1", "cutoff": LOW_PASS, "a": A, "second_cutoff": SECOND},
}
QUADROTOR = {
    "group": "SE3",
    "inertia": [*np.diag(J).tolist(), MASS, MASS, MASS],
    "model": {"forces": [{"kind": "restoring", "weight": MASS * G}]},
    "reference": {"kind": "flat", "position": ["cos(t)", "sin(t)", "0.2*t"]},
    "plant": {
        "forces": [
            {"kind": "restoring", "weight": MASS * G},
            {"kind": "constant", "frame": "spatial", "force": [0, 0, 0, *FORCE.tolist()]},
            {"kind": "constant", "force": [*TORQUE.tolist(), 0, 0, 0]},
        ]
    },
    "actuators": [{"kind": "lag", "time_constant": LAG}],
    "control": {"period": T},
    "time": {"duration": 0.4, "samples": 5},
    "solver": {"engine": "native", "rtol": 1e-12, "atol": 1e-13},
}


def configuration(*names, **changes):
    law = {"law": CASCADE, "gains": GAINS}
    laws = [{**LAWS[name], **law, "label": name} for name in names]
    return yaml.safe_dump({**QUADROTOR, "controllers": laws, **changes})


def desired(t):
    c, s = np.cos(t), np.sin(t)
    up = [0.2 * t, 0.2, 0.0, 0.0, 0.0]
    turning = [(c, s), (-s, c), (-c, -s), (s, -c), (c, s)]
    return [np.array([*xy, z]) for xy, z in zip(turning, up, strict=True)]


def unit(q, q1, q2):
    n = np.linalg.norm(q)
    u = q / n
    n1 = u @ q1
    u1 = (q1 - u * n1) / n
    n2 = u1 @ q1 + u @ q2
    return u, u1, (q2 - 2 * u1 * n1 - u * n2) / n


def lee(t, x, v, R, W, force):
    """Lee's f and M of arXiv 1003.2005 with a known constant force, z up."""
    p, p1, p2, p3, p4 = desired(t)
    kx, kv, b = MASS * KX, MASS * KV, R @ E3
    F = -kx * (x - p) - kv * (v - p1) + MASS * G * E3 + MASS * p2 - force
    f = F @ b
    a = -G * E3 + f / MASS * b + force / MASS
    F1 = -kx * (v - p1) - kv * (a - p2) + MASS * p3
    b1 = R @ hat(W) @ E3
    jerk = ((F1 @ b + F @ b1) * b + f * b1) / MASS
    F2 = -kx * (a - p2) - kv * (jerk - p3) + MASS * p4
    c3, ahead = unit(F, F1, F2), np.array([1.0, 0.0, 0.0])
    c2 = unit(*(np.cross(c, ahead) for c in c3))
    rates = [
        np.cross(c2[0], c3[0]),
        np.cross(c2[1], c3[0]) + np.cross(c2[0], c3[1]),
        np.cross(c2[2], c3[0]) + 2 * np.cross(c2[1], c3[1]) + np.cross(c2[0], c3[2]),
    ]
    Rc, R1, R2 = (np.column_stack([rates[k], c2[k], c3[k]]) for k in range(3))
    spin = Rc.T @ R1
    Wc, turning = vee(spin), vee(Rc.T @ R2 - spin @ spin)
    E = Rc.T @ R
    M = -KR * vee(E) - KW * (W - E.T @ Wc) + np.cross(W, J @ W)
    return f, M - J @ (hat(W) @ E.T @ Wc - E.T @ turning)


def vee(S):
    return np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2


class Estimator:
    """δ̂ in (body, space) at an instant, of what acted, and the momentum there."""

    def __init__(self, name):
        self.name, self.predicted, self.before, self.estimate = name, None, None, np.zeros(6)
        self.first, self.b_a, self.past = np.zeros(6), butter(2, CUTOFF, fs=1 / T), np.zeros((4, 6))

    def __call__(self, P, given, free, felt):
        if self.name in ("indi", "accelerometer"):
            rate = 0 if self.before is None else (P - self.before) / T
            x = 0 * P if self.before is None else given + free - rate
            if self.name == "accelerometer" and self.before is not None:
                x[3:] = (given + free)[3:] - felt
            (b0, b1, b2), (_, a1, a2) = self.b_a
            x1, x2, y1, y2 = self.past
            y = b0 * x + b1 * x1 + b2 * x2 - a1 * y1 - a2 * y2
            self.past, self.before, self.estimate = np.array([x, x1, y, y1]), P, -y
            return -y
        start = P if self.predicted is None else self.predicted + T * given
        if self.name in ("observer", "push only"):
            if self.predicted is not None:
                start = start + T * self.estimate
            self.estimate = RATE * (P - start)
            self.predicted = start + T * free
            return self.estimate
        error, decay = start - P, np.exp(-A * T)
        sigma = -A / (1 - decay) * decay * error
        self.predicted = start + T * (free + sigma - A * error)
        if self.name == "second":
            c = np.exp(-LOW_PASS * T)
            self.first = c * self.first + (1 - c) * sigma
            c = np.exp(-SECOND * T)
            self.estimate = c * self.estimate + (1 - c) * self.first
        else:
            c = np.exp(-LOW_PASS * T)
            self.estimate = c * self.estimate + (1 - c) * sigma
        return self.estimate


def flown(name, x, v, R, W):
    """Position and momentum by DOP853 between the instants: 40 of them."""
    estimator, u_hat, actual, rows = Estimator(name), np.zeros(6), np.zeros(6), []

    def space(R, w):
        return np.concatenate([w[:3], R @ w[3:]])

    for k in range(40):
        P = np.concatenate([J @ W, MASS * v])
        free = np.concatenate([np.cross(J @ W, W), -MASS * G * E3])
        felt = R @ actual[3:] + FORCE - MASS * G * E3  # with its weight: m v̇
        d = estimator(P, space(R, u_hat), free, felt)
        if name == "push only":
            f, M = lee(k * T, x, v, R, W, np.zeros(3))
            f = f - d[3:] @ R[:, 2]
        else:
            f, M = lee(k * T, x, v, R, W, d[3:])
        u = np.concatenate([M - d[:3], [0, 0, f]])
        u_hat = u + np.exp(-T / LAG) * (u_hat - u)

        def rates(_, y, u=u):
            v, R, W, w = y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:]
            a = (R @ w[3:] + FORCE) / MASS - G * E3
            turning = np.linalg.solve(J, w[:3] + TORQUE - np.cross(W, J @ W))
            return np.concatenate([v, a, (R @ hat(W)).ravel(), turning, (u - w) / LAG])

        y = np.concatenate([x, v, R.ravel(), W, actual])
        y = solve_ivp(rates, (0, T), y, method="DOP853", rtol=1e-13, atol=1e-14).y[:, -1]
        x, v, R, W, actual = y[:3], y[3:6], y[6:15].reshape(3, 3), y[15:18], y[18:]
        rows.append(np.concatenate([x, R.ravel(), W]))
    return np.array(rows)[9::10]


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("name", LAWS)
@pytest.mark.ci("runs of a cascade by two engines")
def test_a_run_is_that_of_a_plain_program(solved, engine, name):
    """Within 1e-11 m: the engines' tolerance."""
    solver = QUADROTOR["solver"] | {"engine": engine}
    problem, solution = solved(configuration(name, solver=solver), label=name)
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V = s.Q[0], s.V[0]
    rows = flown(name, Q[0, :3, 3], Q[0, :3, :3] @ V[0, 3:], Q[0, :3, :3], V[0, :3])
    np.testing.assert_allclose(Q[1:, :3, 3], rows[:, :3], rtol=0, atol=1e-11)
    np.testing.assert_allclose(Q[1:, :3, :3].reshape(4, 9), rows[:, 3:12], rtol=0, atol=1e-10)
    np.testing.assert_allclose(V[1:, :3], rows[:, 12:], rtol=0, atol=1e-9)


@pytest.mark.ci("runs of half a minute")
@pytest.mark.parametrize("name", ["observer", "indi", "accelerometer", "second"])
def test_a_constant_wrench_leaves_no_offset(solved, name):
    """0 within rounding; of L1, the share 1 − e^{−aT} of what the law without it has, to 5 %."""
    time, reference = {"duration": 40.0, "samples": 2}, {"kind": "flat", "position": [0, 0, 0]}
    text = configuration(name, time=time, reference=reference)
    problem, solution = solved(text, label=name)
    s = problem.loop.tracking(problem.times, solution.states)
    offset, share = s.Q[0, -1, :3, 3], 1.0 - problem.loop.controller.share_found(T)
    found = s.memory["disturbance"][0, -1]
    np.testing.assert_allclose(found, (1 - share) * np.array([*TORQUE, *FORCE]), rtol=1e-11)
    if not share:
        np.testing.assert_allclose(offset, 0, rtol=0, atol=1e-12)
        return
    bare = yaml.safe_load(text)
    bare["controllers"] = [{**CASCADE, "gains": GAINS, "label": name}]
    problem, solution = solved(yaml.safe_dump(bare), label=name)
    without = problem.loop.tracking(problem.times, solution.states).Q[0, -1, :3, 3]
    np.testing.assert_allclose(offset, share * without, rtol=0.05)


@pytest.mark.ci("margins of a cascade, and six runs")
@pytest.mark.parametrize("name", ["observer", "indi", "second"])
def test_the_delay_margin_is_that_of_runs(tmp_path, solved, name):
    """With as many periods of delay, a small error decays, and with one more it grows."""
    still, path = {"kind": "flat", "position": [0, 0, 0]}, tmp_path / "rest.yaml"
    plant = {"forces": QUADROTOR["plant"]["forces"][:1]}
    path.write_text(configuration(name, reference=still, plant=plant), encoding="utf-8")
    [law] = eqt_cli.margins(path).laws
    start = {"pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.0, 1e-6, 0.0, 0, 0, 0]}}
    for delay, is_stable in ((law.delay_periods, True), (law.delay_periods + 1, False)):
        flying = {"period": T, "delay": delay}
        time = {"duration": 12.0, "samples": 121}
        changes = {"reference": still, "plant": plant, "initial": start, "time": time}
        problem, solution = solved(configuration(name, control=flying, **changes), label=name)
        s = problem.loop.tracking(problem.times, solution.states)
        sizes = np.abs(s.V[0]).max(axis=-1)
        assert (sizes[-20:].max() < sizes[40:60].max()) == is_stable


def test_the_estimate_of_l1_is_that_in_closed_form(experiment_of):
    """σ̂ = e^{−aT} d at once, but for a factor of −aT/2 in each period; no filter."""
    text = {**QUADROTOR, "group": "SO3", "inertia": np.diag(J).tolist(), "model": None}
    text |= {"reference": {"kind": "constant"}, "gains": GAINS, "plant": None, "actuators": []}
    law = {"kind": "l1", "law": "lee2010", "cutoff": 1e6, "a": A}
    loop = experiment_of(yaml.safe_dump({**text, "controllers": [law]})).loop
    W, states = np.zeros(3), loop.initial_state(np.eye(3), np.zeros(3), np.eye(3), np.zeros(3))
    memory, pushed = loop.memory(states), TORQUE
    for _ in range(12):
        x = loop.law_input(0.0, states)._replace(pose=np.eye(3), velocity=W)
        u, memory = loop.answer(x, memory, T)
        W = W + T * np.linalg.solve(J, u + pushed - np.cross(W, J @ W))
    np.testing.assert_allclose(memory["disturbance"], np.exp(-A * T) * pushed, rtol=1e-12)


@from_yaml
def test_what_is_wrong_is_said_at_its_place(experiment_of, changes, said):
    text = configuration("observer", **yaml.safe_load(changes))
    assert mentions(refusal(ConfigError, experiment_of, text), said)
