"""The clock of a law, and errors of what it is told."""

import json
import runpy
from pathlib import Path

import numpy as np
import pytest
from case_tables import in_ci

from eqt_cli.base import yaml_source
from eqt_cli.base.option_types import validated
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.config.document import Document, Place
from eqt_cli.config.schema import ControlSection
from eqt_cli.config.study import study
from eqt_cli.extend import Bias, Noise, Problems, SampledRuns, group_named
from eqt_cli.loop.signals import compute
from eqt_cli.results.metrics import energy_residual

EXAMPLES = Path(__file__).parents[2] / "examples"

SO3 = group_named("SO3")

LOOP = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {kp: 2, kd: 2}
reference: {torque: ["0.2*cos(t)", "0.1", 0]}
controllers: [eqt]
initial: {pose: {kind: exp_normal, std: 0.6}, velocity: {kind: normal, std: 0.4}}
ensemble: {runs: 12, seed: 4}
"""

NOISY = (
    LOOP
    + """time: {duration: 2, samples: 41}
plant: {inertia: {relative: {uniform: [-0.1, 0.1]}}}
actuators: [{kind: limit, limit: {uniform: [0.8, 1.2]}}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors:
  pose: [{kind: noise, std: 0.01}]
  velocity: [{kind: noise, density: 0.01}, {kind: bias, value: {normal: [0, 0.1]}, walk: 0.01}]
"""
)

ENGINES = ["solve_ivp", in_ci("the engines are compared below", "native")]


def with_engine(text, engine, options=""):
    return f"{text}solver: {{engine: {engine}{options}}}\n"


@pytest.mark.parametrize("engine", ENGINES)
def test_stored_values_at_instants_are_those_after_and_at_the_end_those_before(solved, engine):
    text = with_engine(LOOP + "time: {duration: 1, samples: 11}\n", engine)
    problem, solution = solved(f"{text}control: {{period: 0.1}}\n")
    s = problem.loop.tracking(problem.times, solution.states)
    command, law = problem.loop.command(s), problem.loop.controller.torque(s)
    np.testing.assert_allclose(command[:, :-1], law[:, :-1], rtol=0, atol=1e-12)  # rounding
    np.testing.assert_array_equal(command[:, -1], command[:, -2])


@pytest.mark.parametrize("engine", ENGINES)
def test_a_rate_limit_bounds_every_step(solved, engine):
    rate = "actuators: [{kind: rate_limit, rate: 1.5}]\n"
    text = with_engine(LOOP + "time: {duration: 1, samples: 11}\n" + rate, engine)
    problem, solution = solved(f"{text}control: {{period: 0.1}}\n")
    s = problem.loop.tracking(problem.times, solution.states)
    torque, command = problem.loop.torque(s)[:, :-1], problem.loop.command(s)[:, :-1]
    before = np.concatenate([np.zeros_like(torque[:, :1]), torque[:, :-1]], axis=1)
    expected = before + np.clip(command - before, -0.15, 0.15)
    np.testing.assert_allclose(torque, expected, rtol=0, atol=1e-14)  # rounding


@pytest.mark.parametrize("period", [0.02, 0.1, 0.5])
def test_noise_has_the_covariance_that_is_asked_for(period):
    # 200 000 samples: variances err by 0.3 %, correlations by 0.2 %; five of these are allowed.
    count = 200_000
    std = [0.1, 0.2, 0.3]
    found = Noise(std=std).errors(SO3, count, period, generator_at(0, Stream.VEHICLE, 0, "a"))
    np.testing.assert_allclose(np.cov(found.T), np.diag(np.square(std)), atol=0.016 * 0.09)
    found = Noise(density=0.1).errors(SO3, count, period, generator_at(0, Stream.VEHICLE, 0, "b"))
    np.testing.assert_allclose(found.var(axis=0), 0.01 / period, rtol=0.016)
    later = (found[1:] * found[:-1]).mean(axis=0) * period / 0.01
    np.testing.assert_allclose(later, 0.0, atol=0.011)


AGAIN = pytest.mark.ci("draws thousands of runs again")


@pytest.mark.parametrize(
    "period", [0.1, *(pytest.param(each, marks=AGAIN) for each in (0.02, 0.5))]
)
def test_a_bias_walks_by_the_root_of_time(period):
    # 2000 runs: a variance errs by 3 %; five of these are allowed.
    instants = round(2.0 / period) + 1
    bias = Bias(value=1.0, walk=0.3)
    found = np.array(
        [
            bias.errors(SO3, instants, period, generator_at(0, Stream.VEHICLE, run, "c"))
            for run in range(2000)
        ]
    )
    np.testing.assert_array_equal(found[:, 0], 1.0)
    np.testing.assert_allclose(found[:, -1].var(axis=0), 0.09 * 2.0, rtol=0.16)


def test_both_engines_meet_the_same_vehicles_and_noise(solved):
    states = [solved(with_engine(NOISY, engine))[1].states for engine in ("solve_ivp", "native")]
    # Noise is no solver's: what remains is 1e-9 per step, and kinks that solve_ivp steps over.
    np.testing.assert_allclose(*states, rtol=0, atol=1e-6)


def test_an_engine_of_a_plugin_meets_the_same_vehicles_and_noise(solved):
    """It knows nothing of instants: what an engine is gives them to all."""
    engine = runpy.run_path(str(EXAMPLES / "runge_kutta.py"))["RungeKutta"](rtol=1e-9)
    text = NOISY.replace("duration: 2, samples: 41", "duration: 0.3, samples: 7")
    text = with_engine(text, "solve_ivp", ", rtol: 1.0e-11")
    problem, solution = solved(text, runs=[0, 1, 2])
    found = engine.solve(problem).states
    # Steps of 3 ms, and a lag of 0.1 s: measured 2e-9.
    np.testing.assert_allclose(found, solution.states, rtol=0, atol=1e-8)


@pytest.mark.parametrize(
    ("kind", "offset"), [("velocity", [0.1, 0.0, 0.0]), ("pose", [0.0, 0.3, -0.2])]
)
def test_the_law_is_told_what_is_measured(solved, kind, offset):
    text = with_engine(LOOP + "time: {duration: 1, samples: 2}\n", "solve_ivp")
    sensors = f"sensors: {{{kind}: [{{kind: bias, value: {offset}}}]}}\n"
    problem, solution = solved(f"{text}control: {{period: 1}}\n{sensors}")
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V, Qd, Vd = (part[:, 0] for part in (s.Q, s.V, s.Qd, s.Vd))
    if kind == "pose":
        Q = Q @ SO3.exp(np.array(offset))
    else:
        V = V + np.array(offset)
    told = problem.loop.initial_state(Q, V, Qd, Vd)
    expected = problem.loop.controller.torque(problem.loop.tracking(0.0, told))
    np.testing.assert_allclose(problem.loop.command(s)[:, 0], expected, rtol=0, atol=1e-13)


HELD = """actuators:
  - {kind: quantisation, resolution: 0.05}
  - {kind: deadband, width: 0.07}
  - {kind: rate_limit, rate: 2.0}
"""


def test_engines_agree_on_what_acts_at_instants(solved):
    text = LOOP + "time: {duration: 2, samples: 21}\ncontrol: {period: 0.1}\n" + HELD
    found = [solved(with_engine(text, engine)) for engine in ("solve_ivp", "native")]
    torques = [p.loop.torque(p.loop.tracking(p.times, s.states)) for p, s in found]
    # A command within 1e-9 of a step or of the width would tell them apart; none is here.
    np.testing.assert_allclose(*torques, rtol=0, atol=1e-7)


@pytest.mark.parametrize("engine", ENGINES)
def test_energy_balance_of_a_sampled_law_with_memory(solved, engine):
    text = NOISY.replace("[eqt]", "[{kind: goodarzi2013, bound: 0.5}]")
    problem, solution = solved(with_engine(text, engine), label="goodarzi2013")
    found = compute(problem.batched_loop(extra_axes=1), problem.times, solution.states)
    L, balance = found["lyapunov"], found["energy_balance"]
    assert np.abs(L[:, -1] - L[:, 0]).min() > 1e-3
    # As the certificate allows: 100 rtol.
    assert energy_residual(SampledRuns(problem.times), L, balance).max() < 1e-7


# A delay as a time --------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("written", "periods"),
    [("20 ms", 2), ("0.03 s", 3), ("40000us", 4), ("2*10 ms", 2), (5, 5), ("0 s", 0)],
)
def test_a_delay_may_be_a_time(written, periods):
    found = ControlSection.model_validate({"period": 0.01, "delay": written})
    assert found.delay == periods


@pytest.mark.parametrize("written", ["-10 ms", "-1 s"])
def test_a_delay_is_not_negative(written):
    problems = Problems()
    assert validated(ControlSection, {"period": 0.01, "delay": written}, problems) is None
    said = f"expected a time of at least 0 s, got {written}"
    assert [problem.message for problem in problems] == [said]


def test_a_sweep_of_delays_as_times():
    values = {"control.delay": ["0 ms", "100 ms"]}
    source = yaml_source.load(NOISY + f"sweep: [{{grid: {json.dumps(values)}}}]\n", "c.yaml")
    found = study(Document(source, source.data, Place(Path())))
    assert [found.experiment(k).config.control.delay for k in range(2)] == [0, 1]
