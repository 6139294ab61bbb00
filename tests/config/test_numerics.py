"""Numerically ill experiments say so, with numbers that are near what is measured."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from ci_cases import mostly_ci
from drawn_starts import draw_initial_states
from said import says
from small_experiment import mapping

from eqt_cli.api import load_experiment
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import check_steps, ill_conditioned, remarks
from eqt_cli.engines.choice import unavailable
from eqt_cli.engines.engine import Problem, engines
from eqt_cli.extend import Problems
from eqt_cli.loop.linearised import flow

OF_MANY = pytest.mark.ci("one of many pairs")
METHODS_AND_GAINS = [
    ("solve_ivp, method: DOP853", "kd"),
    ("solve_ivp, method: RK45", "kp"),
    ("native", "kd"),
    pytest.param("solve_ivp, method: DOP853", "kp", marks=OF_MANY),
    pytest.param("solve_ivp, method: RK45", "kd", marks=OF_MANY),
    pytest.param("solve_ivp, method: RK23", "kd", marks=OF_MANY),
    pytest.param("solve_ivp, method: RK23", "kp", marks=OF_MANY),
    pytest.param("native", "kp", marks=OF_MANY),
]
STIFF = {"kd": "{kp: 1.0, kd: 1000.0}", "kp": "{kp: 20000.0, kd: 600.0}"}


@pytest.mark.parametrize(("method", "gains"), METHODS_AND_GAINS)
def test_the_work_that_is_told_is_within_a_factor_of_two(experiment, method, gains):
    if unavailable(engines.get(method.split(",")[0])):
        pytest.skip(f"{method} is not installed")
    made = experiment(gains=STIFF[gains], solver=f"{{engine: {method}, rtol: 1.0e-4}}")
    loop, duration = made.loops["gt"], made.config.time.duration
    Qd, Vd = made.desired.pose, made.desired.velocity
    rates = np.linalg.eigvals(flow(loop, np.zeros(1), Qd[None], Vd[None]))
    told = made.engine.work_for_stability(rates, duration).amount
    Q, V = draw_initial_states(
        made.group, made.start.poses, made.start.velocities, Qd=Qd, Vd=Vd, seed=1, runs=[0]
    )
    problem = Problem(loop, loop.initial_state(Q, V, Qd, Vd), np.array([0.0, duration]))
    alone = dataclasses.replace(made.engine, block=1) if hasattr(made.engine, "block") else None
    [measured] = (alone or made.engine).solve(problem).steps
    assert told / 2 < measured < told * 2


def test_a_stiff_loop_says_what_it_takes_and_what_others_would(experiment):
    made = experiment("gains.kd=10000", "time.duration=20", "controllers=[eqt]")
    [remark] = map(str, remarks(made))
    before, after = remark.split(" evaluations a run; ")
    assert says(before, "c.yaml:3:1: gains: the loop of 'eqt' is stiff: its…")
    assert after.startswith("`solver.method: Radau` about ")


@pytest.mark.parametrize(
    "settings",
    [
        ["gains.kd=10"],
        ["time.duration=100000"],  # long, and not stiff
        ["gains.kd=10000", "time.duration=20", "solver.method=Radau"],
    ],
)
def test_nothing_is_said_of_what_is_not_stiff(experiment, settings):
    assert remarks(experiment(*settings)) == []


def test_a_lag_that_is_short_makes_a_loop_stiff(experiment):
    lag = "[{kind: lag, time_constant: 0.0001}]"
    made = experiment("time.duration=20", "controllers=[eqt]", actuators=lag)
    assert "is stiff: its errors decay at up to 1e+04 1/s" in str(remarks(made)[0])


@pytest.mark.parametrize(
    ("settings", "rate", "work"),
    [
        (["gains.kp=1e17"], "4.5e+08", "900,000,000"),  # √(2 kp/J)
        (["time.duration=1e11"], "1.4", "260,000,000,000"),
        (["time.duration=1e11", "solver.method=RK45"], "1.4", "270,000,000,000"),
    ],
)
def test_a_run_that_cannot_end_is_not_begun(experiment, settings, rate, work):
    """With the largest rate λ, a step of DOP853 is at most 6/|λ| or so, of 12 evaluations."""
    made, problems = experiment(*settings, "controllers=[eqt]"), Problems()
    check_steps(made, problems)
    [told] = [str(each.message) for each in problems]
    assert told == (
        f"no run of 'eqt' would end: its errors decay at up to {rate} 1/s, for which "
        f"{made.config.time.duration:g} s take about {work} evaluations, and solver.max_steps is "
        "1,000,000; check gains, inertia and time constants, take a shorter duration, or "
        "`solver.method: Radau`"
    )


@pytest.mark.parametrize(
    "settings", [["gains.kp=1e17", "solver.method=Radau"], ["gains.kd=1e4"], ["control.period=1"]]
)
def test_a_run_that_may_end_is_begun(experiment, settings):
    check_steps(experiment(*settings), problems := Problems())
    assert not problems


SKEWED = 1e-8
NEARLY_DEPENDENT = [[1.0, 1 - SKEWED, 0.0], [1 - SKEWED, 1.0, 0.0], [0.0, 0.0, 1.0]]


def test_an_inertia_that_rounding_spoils(experiment):
    made = experiment("rigid=false", "solver.rtol=1e-9", inertia=str(NEARLY_DEPENDENT))
    remark = str(remarks(made)[0])
    assert says(remark, "c.yaml:2:1: inertia: its condition number is 2e+08, so that…")
    loose = experiment("rigid=false", "solver.rtol=1e-6", inertia=str(NEARLY_DEPENDENT))
    assert ill_conditioned(loose) == ""


def test_units_spoil_nothing(experiment):
    made = experiment("rigid=false", "solver.rtol=1e-9", inertia="[1e-9, 1, 1]")
    assert ill_conditioned(made) == ""


def test_an_inertia_that_is_ill_later_says_when(experiment):
    entry = "1 - 1e-10 - 0.5*(t - 1)**2"
    matrix = f"[[1, '{entry}', 0], ['{entry}', 1, 0], [0, 0, 1]]"
    made = experiment("rigid=false", "solver.rtol=1e-9", inertia=f"{{matrix: {matrix}}}")
    assert " at t = 1 s, so that rounding alone" in ill_conditioned(made)


@mostly_ci("name", shipped.names(), ["paper", "se3_bluerov2"], "integrates every reference")
def test_shipped_configurations_are_well_conditioned(name):
    made = build(read_config(Path(shipped.folder() / f"{name}.yaml"), []))
    found = [str(remark) for remark in remarks(made, made.reference_over_horizon())]
    expected = {
        "se3_bluerov2_flies": "the loop of 'gt' is unstable: small errors grow at 0.497 ",  # 1 Hz
        "se3_bluerov2_thrusters": "the loop of 'eqt' is unstable: small errors grow at 0.634 ",
        "cubesat_sun": "cones[0]: the reference is inside from 93.53 to 126.5 s",  # what it shows
    }
    if name in expected:
        assert len(found) == 1
        assert expected[name] in found[0]
    else:
        assert found == []


WRONG_SIGN = """
from eqt_cli.extend import Controller

class Wrong(Controller):
    name = "wrong"
    title = "Wrong"

    def torque(self, s):
        r = s.relative
        return r.cancelling_feedforward + r.gradient - r.body_damping
"""


FAST = pytest.param({"period": 0.001}, marks=pytest.mark.ci("flies 5,000 periods"))


@pytest.mark.parametrize("control", [None, FAST, {"period": 0.04}])
@pytest.mark.parametrize("shows", [True, False])
def test_a_wrong_sign_is_told_at_any_clock(monkeypatch, tmp_path, control, shows):
    """With J = 2, a spring of 2 kp = 3 of the wrong sign and kd = 1: λ² + λ/2 − 3/2 = 0."""
    monkeypatch.chdir(tmp_path)
    Path("wrong.py").write_text(WRONG_SIGN)
    moves = {"kind": "rates", "rates": ["0.5*cos(t)", "0.3*sin(2*t)", 0.2], "pose": "identity"}
    base = load_experiment(
        mapping(
            inertia=[2.0, 2.0, 2.0],
            gains={"kp": 1.5, "kd": 1.0},
            controllers=["lee2010", "wrong"],
            plugins=["wrong.py"],
            reference=moves,
            control=control,
            time={"duration": 5, "samples": 11},
            solver={"engine": "solve_ivp"},
        )
    ).base
    shown = base.reference_over_horizon() if shows else None  # `eqt run` looks at the start first
    (said,) = [str(one) for one in remarks(base, shown) if "unstable" in str(one)]
    assert "'wrong' is unstable wherever the reference is held: small errors grow at" in said
    rate = float(said.split("grow at ")[1].split()[0])
    assert rate == pytest.approx(1.0, rel=0.03)  # a command that is held acts 0.02 s late


@pytest.mark.ci("flies 200 periods by NumPy")
def test_growth_is_told_of_flights_that_leave_the_reference(monkeypatch, tmp_path):
    """e″ = k e/J, whose torque is held for h: a spring of the wrong sign without damping.

    Flights are far from the reference, and near to each other, long before the horizon ends.
    """
    monkeypatch.chdir(tmp_path)
    undamped = WRONG_SIGN.replace("+ r.gradient - r.body_damping", "+ 0.5 * r.gradient")
    Path("wrong.py").write_text(undamped)
    J, k, h = 3.0, 2.0, 0.1
    base = load_experiment(
        mapping(
            inertia=[J, J, J],
            gains={"kp": k, "kd": 0.5},
            controllers=["wrong"],
            plugins=["wrong.py"],
            reference={"kind": "rates", "rates": ["0.5*cos(t)", "0.3*sin(2*t)", 0.2]},
            control={"period": h},
            time={"duration": 20, "samples": 201},
            solver={"engine": "solve_ivp"},
        )
    ).base
    held = np.array([[1.0, h], [0.0, 1.0]]) + np.array([[h**2 / 2], [h]]) @ [[k / J, 0.0]]
    rate = np.log(np.abs(np.linalg.eigvals(held)).max()) / h
    (said,) = [str(one) for one in remarks(base) if "unstable" in str(one)]
    assert f"small errors grow at {rate:.3g} 1/s or more" in said


EARLY = """
import numpy as np
from eqt_cli.extend import Controller, less, where

class Early(Controller):
    name = "early"
    title = "Early"

    def torque(self, s):
        sign = where(less(np.asarray(s.t)[..., None] - LAST, 0.0), -1.0, 1.0)
        r = s.relative
        return r.cancelling_feedforward - r.body_damping - sign * r.gradient
"""


@pytest.mark.ci("flies by NumPy")
@pytest.mark.parametrize(("last", "said"), [(12.0, "where the reference begins"), (3.0, None)])
def test_growth_of_the_beginning_alone_is_told(monkeypatch, tmp_path, last, said):
    """The spring above has the wrong sign up to a time: of 100 s, 12 part flights by e¹²."""
    monkeypatch.chdir(tmp_path)
    Path("early.py").write_text(EARLY.replace("LAST", str(last)))
    base = load_experiment(
        mapping(
            inertia=[2.0, 2.0, 2.0],
            gains={"kp": 1.5, "kd": 1.0},
            controllers=["early"],
            plugins=["early.py"],
            reference={"kind": "rates", "rates": ["0.5*cos(t)", "0.3*sin(2*t)", 0.2]},
            time={"duration": 100, "samples": 101},
            solver={"engine": "solve_ivp"},
        )
    ).base
    told = [str(one) for one in remarks(base) if "unstable" in str(one)]
    assert len(told) == (said is not None)
    assert said is None or f"{said}: small errors grow at 1 1/s or more" in told[0]


WAKES = """
import numpy as np
from eqt_cli.extend import Controller

class Wakes(Controller):
    name = "wakes"
    title = "Wakes"

    def memory(self, G):
        return {"m": 1}

    def memory_rate(self, s):
        return {"m": (LAST - s.memory["m"]) / 0.05}

    def torque(self, s):
        return s.tau_d + (1 - 3 * s.memory["m"]) * (s.V - s.Vd)
"""


@pytest.mark.parametrize(("last", "grows"), [(1.0, False), (0.0, True)])
def test_growth_is_that_of_flights(monkeypatch, tmp_path, last, grows):
    """Errors with J = 1: e′ = (1 − 3 m) e, and m goes from 0 to its last value in 0.05 s."""
    monkeypatch.chdir(tmp_path)
    Path("wakes.py").write_text(WAKES.replace("LAST", str(last)))
    moves = {"kind": "rates", "rates": ["0.5*cos(t)", "0.3*sin(2*t)", 0.2], "pose": "identity"}
    base = load_experiment(
        mapping(
            inertia=[1.0, 1.0, 1.0],
            controllers=["wakes"],
            plugins=["wakes.py"],
            reference=moves,
            time={"duration": 5, "samples": 11},
            solver={"engine": "solve_ivp"},
        )
    ).base
    told = [str(one) for one in remarks(base) if "unstable" in str(one)]
    assert len(told) == grows
    assert ("grow at 1 1/s" in "".join(told)) == grows
