"""Super-twisting and the geometric adaptive law against plain programs, and their equations."""

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, refusal
from plain import hat
from said import mentions
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.mechanics import lie_poisson
from eqt_cli.config.remarks import remarks
from eqt_cli.loop.closed_loop import MEMORY

J, T, KR, KW, V_D = np.diag([0.04, 0.05, 0.08]), 0.01, 4.0, 0.8, np.array([0.3, -0.5, 0.9])
DELTA, SLOPE, K1, K2 = np.array([0.1, -0.2, 0.15]), 0.6, [3.0, 2.0, 4.0], 12.0
GAMMA, C2, BOUND = 0.9, 1.5, 0.12
TWISTING = {"kind": "super_twisting", "slope": SLOPE, "k1": K1, "k2": K2, "layer": None}
ADAPTIVE = {"kind": "geometric_adaptive", "gamma": GAMMA, "c2": C2}
ALL = [*("constant", "damping", "quadratic", "weight")]
ATTITUDE = {
    "group": "SO3",
    "inertia": np.diag(J).tolist(),
    "gains": {"k_R": KR, "k_Omega": KW},
    "reference": {"kind": "constant", "velocity": V_D.tolist()},
    "plant": {"forces": [{"kind": "constant", "force": DELTA.tolist()}]},
    "initial": {
        "pose": {"kind": "exp_normal", "std": 0.0, "centre": [0.4, -0.3, 0.5]},
        "velocity": {"kind": "fixed", "coordinates": [0.5, 0.2, -0.4]},
    },
    "time": {"duration": 0.6, "samples": 4},
    "solver": {"engine": "native", "rtol": 1e-12, "atol": 1e-13},
}
HELD = {"control": {"period": T}}


def changed(law, **changes):
    return yaml.safe_dump({**ATTITUDE, "controllers": [{**law, "label": "law"}], **changes})


def vee(S):
    return np.array([S[2, 1] - S[1, 2], S[0, 2] - S[2, 0], S[1, 0] - S[0, 1]]) / 2


class Twisting:
    """Moreno and Osorio's algorithm on s = ω − ξ + Λ k_R e_R, of which J ṡ is to be ν."""

    def __init__(self):
        self.z = np.zeros(3)

    def __call__(self, R, W, E, xi, xi_dot):
        e_R = KR * vee(E)
        e = W - xi
        # E' = E ê, so that ∨(E' − E'ᵀ)/2 = ½(tr(E) I − Eᵀ) e.
        rate = KR * 0.5 * (np.trace(E) * e - E.T @ e)
        s = e + SLOPE * e_R
        u = J @ (xi_dot - SLOPE * rate) + np.cross(W, J @ W)
        u = u - J @ (np.array(K1) * np.sqrt(abs(s)) * np.sign(s) - self.z)
        self.z = self.z - T * K2 * np.sign(s)
        return u


class Adaptive:
    """The attitude law of Goodarzi, Lee and Lee (2015) with its projection."""

    def __init__(self):
        self.theta = np.zeros(12)

    def __call__(self, R, W, E, xi, xi_dot):
        W_R = np.hstack([np.eye(3), np.diag(W), np.diag(abs(W) * W), hat(R[2])])
        e_R, e = vee(E), W - xi
        y = W_R.T @ (e + C2 * e_R)
        u = -KR * e_R - KW * e - W_R @ self.theta + np.cross(xi, J @ xi)
        u = u + J @ (xi_dot + np.cross(W, xi))  # JRᵀR_dΩ̇_d
        size = self.theta @ self.theta
        if size > BOUND**2 and self.theta @ y > 0:
            y = y - self.theta * (self.theta @ y) / size
        self.theta = self.theta + T * GAMMA * y
        return u


def flown(law, R, W):
    rows = []
    for k in range(60):
        R_d = expm(k * T * hat(V_D))
        E = R_d.T @ R
        xi = E.T @ V_D
        u = law(R, W, E, xi, -np.cross(W, xi))

        def rates(_, y, u=u):
            R, W = y[:9].reshape(3, 3), y[9:]
            turning = np.linalg.solve(J, u + DELTA - np.cross(W, J @ W))
            return np.concatenate([(R @ hat(W)).ravel(), turning])

        y = solve_ivp(rates, (0, T), [*R.ravel(), *W], method="DOP853", rtol=1e-13, atol=1e-14)
        R, W = y.y[:9, -1].reshape(3, 3), y.y[9:, -1]
        rows.append(y.y[:, -1])
    return np.array(rows)[19::20]


@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize("name", ["twisting", "adaptive"])
@pytest.mark.ci("runs by two engines")
def test_a_run_is_that_of_a_plain_program(solved, engine, name):
    """Within 1e-11: the engines' tolerance. The adaptive law reaches its bound."""
    entry = TWISTING if name == "twisting" else {**ADAPTIVE, "estimates": ALL, "bound": BOUND}
    solver = ATTITUDE["solver"] | {"engine": engine}
    problem, solution = solved(changed(entry, solver=solver, **HELD), label="law")
    s = problem.loop.tracking(problem.times, solution.states)
    law = Twisting() if name == "twisting" else Adaptive()
    rows = flown(law, s.Q[0, 0], s.V[0, 0])
    np.testing.assert_allclose(s.Q[0, 1:].reshape(3, 9), rows[:, :9], rtol=0, atol=1e-11)
    np.testing.assert_allclose(s.V[0, 1:], rows[:, 9:], rtol=0, atol=1e-10)
    if name == "adaptive":
        assert np.linalg.norm(law.theta) > BOUND


@pytest.mark.ci("runs of some seconds")
def test_super_twisting_finds_the_force_and_stays_on_its_surface(solved):
    """z → −𝕀⁻¹δ and |s| = O(T²), O(T): a tenth of the period makes s a hundredth."""
    sizes = []
    for period in (0.01, 0.001):
        time = {"duration": 3.0, "samples": 301}
        text = changed(TWISTING, control={"period": period}, time=time)
        problem, solution = solved(text, label="law")
        s = problem.loop.tracking(problem.times[-100:], solution.states[:, -100:])
        sizes.append(np.abs(problem.loop.controller._sliding(s).V_tilde).max())
        expected = -DELTA / np.diag(J)
        np.testing.assert_allclose(s.memory["z"][0].mean(axis=0), expected, atol=10 * K2 * period)
    assert sizes[0] < 10 * K2 * 0.01**2 and 50 < sizes[0] / sizes[1] < 200


@pytest.mark.parametrize("group", ["SO3", "SE3", "R3"])
def test_the_variable_of_super_twisting_obeys_the_algorithm(experiment_of, group):
    """ṡ = −k₁|s|^½ sgn s + z along the motion of the model, by differences."""
    m = {"SO3": 3, "SE3": 6, "R3": 3}[group]
    random, inertia = np.random.default_rng(1), [0.4, 0.5, 0.8, 1.3, 1.3, 1.3][:m]
    law = {**TWISTING, "k1": 3.0}
    gains = {"gains": {"kp": 2.0, "kd": 1.0}, "plant": None, "initial": {}}
    reference = {"kind": "constant", "velocity": random.normal(size=m).tolist()}
    text = changed(law, group=group, inertia=inertia, reference=reference, **gains, **HELD)
    loop = experiment_of(text).loop
    G, law = loop.group, loop.controller
    Q, V = G.exp(0.5 * random.normal(size=m)), random.normal(size=m)
    z, Vd = {"z": random.normal(size=m)}, np.array(reference["velocity"])

    def at(t, Q, P):
        state = loop.initial_state(Q, loop.inertia.velocity(P), G.exp(t * Vd), Vd)
        s = loop.tracking(t, state)
        return s, law._sliding(s).V_tilde

    P, h = loop.inertia.momentum(V), 1e-6
    s = at(0.0, Q, P)[0].__class__(**{**vars_of(at(0.0, Q, P)[0]), "memory": z})
    torque = law.torque(s)
    _, P_dot = lie_poisson(G, Q, P, V, torque)
    ahead, behind = (at(k * h, Q @ G.exp(k * h * V), P + k * h * P_dot)[1] for k in (1, -1))
    sliding = law._sliding(s).V_tilde
    expected = -3.0 * np.sqrt(abs(sliding)) * np.sign(sliding) + z["z"]
    np.testing.assert_allclose((ahead - behind) / (2 * h), expected, rtol=0, atol=1e-7)


def vars_of(s):
    return {name: getattr(s, name) for name in s.__dataclass_fields__}


def test_the_lyapunov_function_of_super_twisting_falls():
    """Of Moreno and Osorio (2008): V̇ = −ζᵀQζ/√|s| with ζ = (√|s| sgn s, z), by differences."""
    random = np.random.default_rng(2)
    s, z = random.normal(size=(2, 50))
    k1, k2, h = 2.0, 3.0, 1e-7

    def V(s, z):
        return 2 * k2 * abs(s) + z**2 / 2 + (k1 * np.sqrt(abs(s)) * np.sign(s) - z) ** 2 / 2

    s_dot, z_dot = -k1 * np.sqrt(abs(s)) * np.sign(s) + z, -k2 * np.sign(s)
    rate = (V(s + h * s_dot, z + h * z_dot) - V(s - h * s_dot, z - h * z_dot)) / (2 * h)
    a, Q = np.sqrt(abs(s)) * np.sign(s), k1 / 2 * np.array([[2 * k2 + k1**2, -k1], [-k1, 1.0]])
    form = Q[0, 0] * a * a + 2 * Q[0, 1] * a * z + Q[1, 1] * z * z
    np.testing.assert_allclose(rate, -form / np.sqrt(abs(s)), rtol=1e-5, atol=1e-5)
    assert np.linalg.eigvalsh(Q).min() > 0


def test_with_constant_forces_the_adaptive_law_is_the_integral_law(experiment_of):
    """θ̂ = k_I e_I with γ = k_I, on SO3 and SE3."""
    for group, m in (("SO3", 3), ("SE3", 6)):
        pid = {"kind": "goodarzi2013", "ki": GAMMA, "c2": C2}
        laws = [{**ADAPTIVE, "label": "adaptive"}, {**pid, "label": "integral"}]
        random, inertia = np.random.default_rng(3), [0.4, 0.5, 0.8, 1.3, 1.3, 1.3][:m]
        gains = {"kp": 2.0, "kd": 1.0}
        moves = {"kind": "constant", "velocity": random.normal(size=m).tolist()}
        more = {"plant": None, "initial": {}, "gains": gains, "reference": moves}
        text = {**ATTITUDE, **more, "controllers": laws, "group": group, "inertia": inertia}
        loops = experiment_of(yaml.safe_dump(text)).loops
        e_I, states = random.normal(size=m), []
        for name, key, theta in (
            ("adaptive", "constant", GAMMA * e_I),
            ("integral", "integral", e_I),
        ):
            loop = loops[name]
            Q = loop.group.exp(0.4 * np.arange(1, m + 1) / m)
            state = loop.initial_state(Q, np.ones(m), loop.group.identity, np.ones(m))
            state[loop.layout.slices[f"{MEMORY}{key}"]] = theta
            s = loop.tracking(0.0, state)
            law = loop.controller
            rate = law.memory_rate(s)[key] / (GAMMA if key == "constant" else 1.0)
            states.append([*law.torque(s), *rate, law.lyapunov(s), law.dissipation(s)])
        np.testing.assert_allclose(*states, rtol=1e-13)


@pytest.mark.ci("a run with its energy")
@pytest.mark.parametrize("estimates", [["constant"], ALL])
def test_the_energy_of_the_adaptive_law_is_balanced(solved, estimates):
    """L + W is constant without a force, beyond the bound too: the solver's tolerance."""
    law = {**ADAPTIVE, "estimates": estimates, "bound": BOUND}
    problem, solution = solved(changed(law, plant=None), label="law")
    loop = problem.loop
    s = loop.tracking(problem.times, solution.states)
    energy = loop.lyapunov(s)[0] + loop.work(solution.states)[0]
    np.testing.assert_allclose(energy, energy[0], rtol=1e-9)


@from_yaml
def test_what_is_wrong_is_said_at_its_place(experiment_of, changes, said):
    text = changed(ADAPTIVE, **yaml.safe_load(changes))
    assert mentions(refusal(ConfigError, experiment_of, text), said)


OWN = """
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking


@dataclass(frozen=True)
class Own(Controller):
    name: ClassVar[str] = "own_NUMBER"

    def torque(self, s: Tracking) -> Array:
        r = s.relative
        return FEEDFORWARD - r.body_damping - r.gradient
"""


@pytest.mark.ci("loads four plugins")
def test_check_says_where_an_own_law_leaves_its_reference(experiment_of, tmp_path):
    """PD alone does not drive a body that turns; each exact feedforward does."""
    forward = "0.0", "r.tau_d", "r.cancelling_feedforward", "r.feedforward(0.0, 0.0, 1.0)"
    for k, formula in enumerate(forward):
        source = OWN.replace("NUMBER", str(k)).replace("FEEDFORWARD", formula)
        (tmp_path / f"own_{k}.py").write_text(source, encoding="utf-8")
    laws = [f"own_{k}" for k in range(len(forward))]
    text = yaml.safe_dump({**ATTITUDE, "controllers": laws, "plugins": [f"{x}.py" for x in laws]})
    told = [str(x) for x in remarks(experiment_of(text)) if "on the reference" in str(x)]
    assert len(told) == 1 and "controllers[0]: " in told[0]
    size = np.linalg.norm(np.cross(V_D, J @ V_D))
    assert f"up to {size:.3g} from τ_d" in told[0]
