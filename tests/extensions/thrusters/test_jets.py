"""Jets, on or off: against plain programs, the formulas of the modulator, and bad input."""

import numpy as np
import pytest
from case_tables import from_yaml
from plain import hat
from plain_satellite import exp
from said import mentions
from scipy.integrate import solve_ivp

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.components.blocks import signals
from eqt_cli.extend import group_named
from eqt_cli.extensions.thrusters.parts import Jets, Priority
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from eqt_cli.numbers.leaves import leaves, with_leaves

SO3, INERTIA, ARM = group_named("SO3"), np.array([1.2, 1.4, 1.0]), np.array([0.4, 0.3, 0.2])
STEP, PERIOD, THRUST, ISP = 0.01, 0.2, np.array([1.0, 1.0, 0.8, 0.8, 1.0, 1.2]), 220.0
MATRIX = np.kron(np.diag(ARM), [[1.0, -1.0]])
WIDTH, TRIGGER = "{minimum: 30 ms, every: 0.2}", "{minimum: 30 ms, gain: 4, off: 0.2}"
TEXT = f"""
group: SO3
inertia: {INERTIA.tolist()}
gains: {{kp: 0.1, kd: 0.4}}
reference: {{kind: torque, torque: [0, 0, 0]}}
controllers: [lee2010]
actuators:
  - kind: thrusters
    matrix: {MATRIX.tolist()}
    period: {STEP}
    low: 0
    high: {THRUST.tolist()}
    allocation: {{kind: priority, order: [torque x, torque y, torque z]}}
    jets: JETS
    isp: {ISP}
control: {{period: {PERIOD}}}
initial:
  pose: {{kind: exp_normal, std: 0.0, centre: [0.9, -0.5, 0.7]}}
  velocity: {{kind: fixed, coordinates: [0.2, -0.1, 0.3]}}
time: {{duration: 2.0, samples: 201}}
solver: {{engine: ENGINE, rtol: 1.0e-12, atol: 1.0e-15}}
"""


class Valves:
    """One jet after the other, at its instants, by numbers of instants."""

    def __init__(self, name):
        self.name, self.level = name, np.zeros(6)
        self.on, self.held, self.left = np.zeros(6, bool), np.zeros(6, int), np.zeros(6, int)

    def next(self, tick, share):
        for k in range(6):
            if self.name == "width":
                if tick % 20 == 0:
                    seconds = share[k] * 0.2
                    self.left[k] = 0 if seconds < 0.03 else round(seconds / STEP)
                self.on[k] = self.left[k] > 0
                self.left[k] -= 1
            else:
                must = self.on[k] and self.held[k] < 3
                before, self.on[k] = (
                    self.on[k],
                    must or (self.level[k] > 0.45 or (self.on[k] and not self.level[k] < 0.2)),
                )
                self.held[k] = self.held[k] + 1 if before and self.on[k] else int(self.on[k])
                end = 4 * (share[k] - self.on[k])
                self.level[k] = end + (self.level[k] - end) * np.exp(-STEP / 0.15)
        return self.on.copy()


def plain(name, fails=None):
    """Q, V, thrusts from each instant on, and propellant, at the instants; a jet fails at 1 s."""
    valves, mass = Valves(name), 0.0
    y = np.concatenate([exp([0.9, -0.5, 0.7]).ravel(), [0.2, -0.1, 0.3]])
    states, thrusts, burnt = [y], [], [mass]
    for tick in range(200):
        Q, w = y[:9].reshape(3, 3), y[9:]
        if tick % 20 == 0:
            error = 0.1 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
            torque = -error - 0.4 * w + np.cross(w, INERTIA * w)
            pairs = [(max(u, 0), max(-u, 0)) for u in torque / ARM]
            share = np.clip(np.ravel(pairs), 0, THRUST) / THRUST
        f = THRUST * valves.next(tick, share)
        if fails is not None and tick >= 100:
            f[fails] = 0.0

        def rate(t, y, f=f):
            Q, w = y[:9].reshape(3, 3), y[9:]
            turn = (np.cross(INERTIA * w, w) + MATRIX @ f) / INERTIA
            return np.concatenate([(Q @ hat(w)).ravel(), turn])

        y = solve_ivp(rate, (0, STEP), y, method="DOP853", rtol=1e-12, atol=1e-15).y[:, -1]
        mass += STEP * f.sum() / (9.80665 * ISP)
        states.append(y)
        thrusts.append(f)
        burnt.append(mass)
    return np.array(states), np.array(thrusts), np.array(burnt)


SLOW = pytest.mark.ci("the same by the other engine")


@pytest.mark.parametrize(
    ("engine", "name"),
    [
        ("native", "width"),
        ("native", "trigger"),
        pytest.param("solve_ivp", "width", marks=SLOW),
        ("solve_ivp", "trigger"),
    ],
)
def test_pulses_are_those_of_a_plain_program(solved, engine, name):
    """Each valve by itself; thrusts are 0 or full, and equal at every instant."""
    jets = {"width": WIDTH, "trigger": TRIGGER}[name]
    problem, solution = solved(TEXT.replace("JETS", jets).replace("ENGINE", engine), "lee2010")
    assert not any(solution.messages)
    s, (states, thrusts, burnt) = problem.loop.tracking(problem.times, solution.states), plain(name)
    found = signals(problem.loop.now(s))["thrust"][0]
    assert found[:-1].tolist() == thrusts.tolist()
    starts = (np.diff(np.vstack([0 * thrusts[:1], thrusts]), axis=0) > 0).sum(axis=0)
    assert (starts > 1).sum() > 2 and 0 < (thrusts > 0).mean() < 0.9
    np.testing.assert_allclose(s.Q[0].reshape(-1, 9), states[:, :9], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.V[0], states[:, 9:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.vehicle["propellant"][0, :, 0], burnt, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("engine", ["native", pytest.param("solve_ivp", marks=SLOW)])
def test_a_jet_that_fails_pushes_no_more(solved, engine):
    """Its valve goes on, and burns nothing; the second jet is on before and after 1 s."""
    text = TEXT.replace("JETS", f"{TRIGGER}\n    fails: {{rotor: 2, at: 1 s}}")
    problem, solution = solved(text.replace("ENGINE", engine), "lee2010")
    s, (states, _, burnt) = (
        problem.loop.tracking(problem.times, solution.states),
        plain("trigger", 1),
    )
    whole = plain("trigger")[1][:, 1]
    assert whole[:100].any() and whole[100:].any()
    np.testing.assert_allclose(s.V[0], states[:, 9:], rtol=0, atol=1e-9)
    np.testing.assert_allclose(s.vehicle["propellant"][0, :, 0], burnt, rtol=1e-12, atol=1e-18)


@pytest.mark.parametrize("share", [0.3, 0.5, 0.8])
def test_the_modulator_has_its_published_times(share):
    """T_on = −T ln((U_off − K(r−1))/(U_on − K(r−1))), T_off = −T ln((U_on − Kr)/(U_off − Kr))."""
    jets, step = Jets(1e-4, None, 4.5, 0.15, 0.45, 0.15), 2e-5
    x, states = np.zeros(3), []
    for _ in range(10_000):
        x = jets.after(np.array([share]), x, step)
        states.append(x[0])
    changes = np.flatnonzero(np.diff(states)) * step
    ends = 4.5 * (share - 1), 4.5 * share
    on = -0.15 * np.log((0.15 - ends[0]) / (0.45 - ends[0]))
    off = -0.15 * np.log((0.45 - ends[1]) / (0.15 - ends[1]))
    expected = np.resize([on, off], len(changes) - 1)  # it opens first
    assert len(changes) > 4
    # Each end is late by up to a step, in which the level passes the next one's start.
    np.testing.assert_allclose(np.diff(changes), expected, rtol=0, atol=5 * step)


def test_times_and_levels_are_numbers_that_runs_may_differ_in():
    options = {"matrix": MATRIX.tolist(), "low": 0.0, "high": 1.0, "period": STEP, "isp": 200.0}
    order = Priority("priority", ["torque"])
    command = np.array([[0.1, -0.05, 0.04]])
    for jets, name in ((Jets(0.02, 0.2), "minimum"), (Jets(0.02), "on")):
        part = Thrusters(**options, allocation=order, jets=jets).of_run(SO3, None)
        assert {"isp", f"jets.{name}"} <= leaves(part).keys()
        x = np.zeros((1, part.states(SO3)))
        x[:, 18:] = np.random.default_rng(0).random(6)  # levels, after no pulse
        both = with_leaves(part, {f"jets.{name}": np.array([[0.03], [0.7]])})
        found = both.step(SO3, command.repeat(2, axis=0), x.repeat(2, axis=0), STEP)
        for row, value in zip(found, (0.03, 0.7), strict=True):
            alone = with_leaves(part, {f"jets.{name}": np.array([value])})
            np.testing.assert_allclose(row, alone.step(SO3, command, x, STEP)[0], atol=1e-14)
        assert (found[0, 6:] != found[1, 6:]).any()


def test_a_jet_that_rests_is_at_no_limit():
    part = Thrusters(
        matrix=MATRIX.tolist(),
        low=0.0,
        high=1.0,
        period=STEP,
        allocation=Priority("priority", ["torque"]),
        jets=Jets(0.02, 0.2),
    ).of_run(SO3, None)
    for command, beyond in (([0.1, 0, 0], 0), ([0.5, 0, 0], 1)):
        x = part.step(SO3, np.array(command), np.zeros(part.states(SO3)), STEP)
        assert part.at_limit(SO3, np.array(command), x) == beyond
        expected = np.clip(command, -ARM, ARM)
        np.testing.assert_allclose(part.within(SO3, np.array(command), x), expected, atol=1e-12)


def test_valves_of_jets_that_lag_act_as_those_without_a_lag():
    options = {"matrix": MATRIX.tolist(), "low": 0.0, "high": 1.0, "period": STEP}
    options |= {"allocation": Priority("priority", ["torque"]), "jets": Jets(0.02, 0.2)}
    ideal, lagging = (
        Thrusters(**options, **lag).of_run(SO3, None) for lag in ({}, {"time_constant": 0.1})
    )
    x, command = np.random.default_rng(1).uniform(0, 1, lagging.states(SO3)), np.array([0.3, 0, 0])
    valves, thrusts = np.split(x, [ideal.states(SO3)])
    expected = [*ideal.step(SO3, command, valves, STEP), *thrusts]
    assert lagging.step(SO3, command, x, STEP).tolist() == expected


def test_thrusters_that_lag_burn_what_they_push(solved):
    """∫Σ|f| dt/(g₀ isp) of a lag T ḟ = B⁺u − f under a law that acts at all times."""
    text = TEXT.replace("ENGINE", "native")
    start, end = text.index("    period: 0.01"), text.index("    isp")
    text = (
        text[:start] + "    time_constant: 0.1\n" + text[end:].replace("period: 0.2", "period: 9")
    )
    text = text.replace("isp: 220.0", "isp: [200, 210, 220, 230, 240, 250]")
    problem, solution = solved(text.replace("control: {period: 9}\n", ""), "lee2010")
    inverse, specific = np.linalg.pinv(MATRIX), 9.80665 * np.arange(200, 251, 10)

    def rate(t, y):
        Q, w, f = y[:9].reshape(3, 3), y[9:12], y[12:18]
        error = 0.1 * np.array([(Q - Q.T)[2, 1], (Q - Q.T)[0, 2], (Q - Q.T)[1, 0]])
        wanted = inverse @ (-error - 0.4 * w + np.cross(w, INERTIA * w))
        turn = (np.cross(INERTIA * w, w) + MATRIX @ f) / INERTIA
        slopes = [(Q @ hat(w)).ravel(), turn, (wanted - f) / 0.1, [(np.abs(f) / specific).sum()]]
        return np.concatenate(slopes)

    y = np.concatenate([exp([0.9, -0.5, 0.7]).ravel(), [0.2, -0.1, 0.3], np.zeros(7)])
    found = solve_ivp(rate, (0, 2), y, method="DOP853", rtol=1e-11, atol=1e-15).y[-1, -1]
    s = problem.loop.tracking(problem.times, solution.states)
    assert s.vehicle["propellant"][0, -1, 0] == pytest.approx(found, rel=1e-8)


def test_results_have_the_propellant(tmp_path):
    text = TEXT.replace("JETS", WIDTH).replace("ENGINE", "solve_ivp, cross_check: 0")
    text = text.replace("duration: 2.0, samples: 201", "duration: 0.4, samples: 41")
    (tmp_path / "jets.yaml").write_text(text, encoding="utf-8")
    eqt_cli.run(tmp_path / "jets.yaml", out=tmp_path / "out")
    with eqt_cli.open_result(tmp_path / "out") as data:
        assert data["propellant"][0, 0] == pytest.approx(plain("width")[2][40], rel=1e-12)
        assert data["propellant"][0, 0] == data["burnt"][0, 0, -1]
        assert data.units("propellant") == "kg"


def test_margins_do_not_depend_on_the_propellant(experiment_of):
    """They are those of thrusts without limits and pulses, also of thrusts against a push."""
    from eqt_cli.config.remarks import along_reference
    from eqt_cli.loop.linearised import linearised

    text, found = TEXT.replace("JETS", TRIGGER).replace("ENGINE", "solve_ivp"), []
    pushed = text + "plant: {forces: [{kind: constant, force: [0.02, 0, 0]}]}\n"
    for each in (text, pushed, pushed.replace("    isp: 220.0\n", "")):
        experiment = experiment_of(each)
        [loop] = experiment.loops.values()
        about = along_reference(experiment, experiment.reference_over_horizon())
        found.append(linearised(loop, *about).closed[0])
    np.testing.assert_array_equal(found[1], found[2])
    eigenvalues = np.linalg.eigvals(found[0])
    for J in INERTIA:  # zero-order hold of −0.2 ε − 0.4 ω on J ω̇ = τ
        move = np.array([[1, PERIOD], [0, 1]]) - np.outer([PERIOD**2 / 2, PERIOD], [0.2, 0.4]) / J
        for value in np.linalg.eigvals(move):
            assert np.abs(eigenvalues - value).min() < 1e-7


@from_yaml
def test_what_does_not_fit_is_said(experiment_of, old, new, message):
    text = TEXT.replace("JETS", WIDTH).replace("ENGINE", "solve_ivp")
    assert text.count(old) == 1
    with pytest.raises(ConfigError) as caught:
        experiment_of(text.replace(old, new))
    [said] = [f"{each.path}: {each.message}" for each in caught.value.problems]
    assert mentions(said, message)
