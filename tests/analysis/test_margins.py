"""Margins against closed forms, against runs, and against the loop's own period."""

from __future__ import annotations

from collections.abc import Mapping
from math import comb, factorial
from typing import Any

import numpy as np
import pytest

import eqt_cli
from eqt_cli.analysis.delay_margin import CutLoop, delay_margin
from eqt_cli.analysis.margins import LawMargins
from eqt_cli.closed_loop.linearised import Linearised, linearised
from eqt_cli.core.arrays import Array
from eqt_cli.engines import Problem
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.experiment.build import Experiment

WHEEL = {
    "group": "SO2",
    "inertia": 0.4,
    "gains": {"kp": 1.0, "kd": 0.8},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "time": {"duration": 5.0},
}
J, STIFFNESS, DAMPING = 0.4, 2.0, 0.8
"""Of the wheel: Υ = 2(1 − cos θ)."""

LATE = {
    "group": "SO3",
    "inertia": [2.0, 1.0, 3.0],
    "gains": {"kp": 0.05, "kd": 0.5},
    "reference": {"kind": "constant", "pose": {"rotvec": [0.4, -0.2, 0.7]}},
    "controllers": ["eqt"],
    "actuators": [{"kind": "limit", "limit": 5.0}, {"kind": "lag", "time_constant": 0.2}],
    "control": {"period": 0.5, "delay": 1},
    "initial": {
        "pose": {"kind": "exp_normal", "std": 1e-5},
        "velocity": {"kind": "normal", "std": 1e-5},
    },
    "ensemble": {"runs": 6, "seed": 3},
    "time": {"duration": 8.0, "samples": 17},
    "solver": {"rtol": 1e-9, "atol": 1e-14, "cross_check": 0},
}


def of(config: Mapping[str, Any], **changes: Any) -> LawMargins:
    [law] = eqt_cli.margins({**config, **changes}).laws
    return law


def test_the_delay_margin_of_a_wheel_is_the_phase_margin_over_the_crossover() -> None:
    # |2 + 0.8iω| = 0.4ω²; the phase of (2 + 0.8iω) / (0.4ω²) is the margin.
    square = np.roots([J**2, -(DAMPING**2), -(STIFFNESS**2)]).max()
    crossover = np.sqrt(square)
    margin = np.arctan2(DAMPING * crossover, STIFFNESS) / crossover
    law = of(WHEEL)
    assert law.growth.eigenvalue.real == pytest.approx(-1.0, rel=1e-9)
    assert abs(law.growth.eigenvalue.imag) == pytest.approx(2.0, rel=1e-9)
    assert law.delay == pytest.approx(margin, rel=1e-9)
    assert (law.delay_periods, law.is_indicative) == (None, False)
    sampled = of(WHEEL, control={"period": margin / 100})
    # The hold is a delay of half a period: 99.5 periods are left, of which 99 are whole.
    assert sampled.delay_periods == 99
    assert sampled.delay == pytest.approx(margin, rel=0.01 + 1e-9)


def test_the_delay_margin_of_a_body_that_turns_is_that_of_its_sampled_loop() -> None:
    """Three commands at once, along a circle; the hold is a delay of half a period."""
    start = {"position": [0.0, -2.0]}
    circle = {"kind": "constant", "pose": start, "velocity": [0.5, 1.0, 0.0]}
    body = {**WHEEL, "group": "SE2", "inertia": [1.0, 2.0, 3.0], "reference": circle}
    margin = of(body).delay
    assert margin is not None
    period = margin / 20
    sampled = of(body, control={"period": period})
    assert sampled.delay_periods == 19
    assert not sampled.is_indicative


def test_the_gain_margin_of_a_wheel_with_lag_is_that_of_routh_and_hurwitz() -> None:
    T = 0.25  # TJs³ + Js² + ds + k is stable for d > Tk
    law = of(WHEEL, actuators=[{"kind": "lag", "time_constant": T}])
    assert law.gains["kp"].upper == pytest.approx(DAMPING / (T * STIFFNESS), rel=1e-4)
    assert law.gains["kp"].lower is None
    assert law.gains["kd"].lower == pytest.approx(T * STIFFNESS / DAMPING, rel=1e-4)
    both = law.gains["both"]
    assert (law.gains["kd"].upper, both.lower, both.upper) == (None, None, None)


def test_the_memory_of_a_law_is_part_of_the_loop() -> None:
    ki, c2 = 0.3, 0.5  # Js² + ds + k + kᵢ(s + c₂)/s
    law = {"kind": "goodarzi2013", "ki": ki, "c2": c2}
    roots = np.roots([J, DAMPING, STIFFNESS + ki, ki * c2])
    assert of(WHEEL, controllers=[law]).growth.rate == pytest.approx(roots.real.max(), rel=1e-9)


def test_a_gain_that_a_law_does_not_use_has_no_margin() -> None:
    assert set(of(WHEEL, controllers=["sliding"]).gains) == {"kp", "both"}


def loop_of(config: Mapping[str, Any], **changes: Any) -> tuple[Experiment, Linearised]:
    experiment = eqt_cli.load_experiment({**config, **changes}).experiment
    [loop] = experiment.loops.values()
    Qd, Vd = experiment.initial_pose[None], experiment.initial_velocity[None]
    return experiment, linearised(loop, np.zeros(1), Qd, Vd)


def by_size(eigenvalues: Array) -> Array:
    """Those that are not 0, the largest first; of two that are conjugate, the upper one first."""
    kept = eigenvalues[np.abs(eigenvalues) > 1e-6]
    return kept[np.lexsort((-kept.imag, -np.abs(kept).round(6)))]


def test_eigenvalues_are_those_of_the_period_that_stored_runs_show(tmp_path: Any) -> None:
    """A map x ↦ M x from instant to instant, by least squares over runs of small errors."""
    experiment, loop = loop_of(LATE)
    data = eqt_cli.open_results(eqt_cli.run(eqt_cli.load_experiment(LATE), tmp_path / "runs"))
    G, Q = experiment.group, data.pose.values[0]
    errors = G.log(G.inverse(data.desired_pose.values) @ Q)
    asked, given = data.command.values[0], data.torque.values[0]
    held = np.concatenate([0 * asked[:, :1], asked[:, :-1]], axis=1)  # one period late
    x = np.concatenate([errors, data.velocity.values[0], given, held], axis=-1)
    before, after = x[:, :-1].reshape(-1, 12), x[:, 1:].reshape(-1, 12)
    scale = np.abs(before).max(axis=0)
    M = np.linalg.lstsq(before / scale, after / scale)[0].T
    expected = by_size(np.linalg.eigvals(M))
    found = by_size(loop.eigenvalues[0])
    # Second-order terms are 1e-5 of the first, relative to it.
    np.testing.assert_allclose(found, expected[: len(found)], atol=2e-5)


def errors_of(experiment: Experiment, factors: list[tuple[float, float]]) -> Array:
    """‖I − Q_E‖ of runs from one small error, with gains multiplied by factors."""
    [loop], G = experiment.loops.values(), experiment.group
    Qd, Vd = experiment.initial_pose, experiment.initial_velocity
    start = loop.initial_state(Qd @ G.exp(np.array([0.02, 0.03, -0.01])), Vd, Qd, Vd)
    kp, kd = np.array(factors).T[..., None, None]
    gains = {"kp": kp * loop.gains.K, "kd": kd * loop.gains.K_d}
    times = np.linspace(0.0, 50.0, 101)
    problem = Problem(loop, np.tile(start, (len(factors), 1)), times, gains)
    states = SolveIvp(method="RK23", rtol=1e-3, atol=1e-5).solve(problem).states
    Q = G.unpack(loop.layout.split(states)["pose"])
    error: Array = np.linalg.norm(G.identity - G.inverse(Qd) @ Q, axis=(-2, -1))
    return error


def assert_decays(errors: Array) -> None:
    assert errors[-20:].max() < 0.9 * errors[:20].max()


def assert_grows(errors: Array) -> None:
    assert errors[-20:].max() > 1.1 * errors[:20].max()


@pytest.mark.slow("integrates runs on both sides of a margin")
def test_runs_decay_with_the_largest_delay_that_is_stable_and_grow_with_one_period_more() -> None:
    periods = of(LATE).delay_periods
    assert periods is not None
    for more, expected in ((periods, assert_decays), (periods + 1, assert_grows)):
        late = {**LATE, "control": {"period": 0.5, "delay": 1 + more}}
        [errors] = errors_of(eqt_cli.load_experiment(late).experiment, [(1.0, 1.0)])
        expected(errors)


@pytest.mark.slow("integrates runs on both sides of a margin")
def test_runs_decay_inside_of_the_gain_margins_and_grow_outside() -> None:
    law, inside, outside = of(LATE), [], []
    for which, (with_kp, with_kd) in {"kp": (1, 0), "kd": (0, 1), "both": (1, 1)}.items():
        margin = law.gains[which]
        for limit, inwards in ((margin.lower, 1.15), (margin.upper, 1 / 1.15)):
            if limit is not None:
                for found, factor in ((inside, limit * inwards), (outside, limit / inwards)):
                    found.append((factor**with_kp, factor**with_kd))
    assert len(inside) == 4  # both ends for kd, the upper one for kp and both
    errors = errors_of(eqt_cli.load_experiment(LATE).experiment, inside + outside)
    for one in errors[: len(inside)]:
        assert_decays(one)
    for one in errors[len(inside) :]:
        assert_grows(one)


def test_further_delay_is_what_the_queue_of_the_loop_makes_of_it() -> None:
    _, once = loop_of(LATE)
    _, thrice = loop_of(LATE, control={"period": 0.5, "delay": 3})
    later = CutLoop(once.A[0], once.B[0], once.C[0], once.period).delayed(2)
    expected = by_size(thrice.eigenvalues[0])
    np.testing.assert_allclose(by_size(np.linalg.eigvals(later)), expected, atol=1e-6)


def test_multipliers_below_0_and_next_to_1_are_rates() -> None:
    law = of(LATE, gains={"kp": 1e-3, "kd": 0.5}, control={"period": 0.5})
    # 2 kp / kd, the rate at which a nearly overdamped error creeps
    assert law.growth.rate == pytest.approx(-2 * 1e-3 / 0.5, rel=0.02)
    assert law.gains["kp"].lower is None


def test_late_measurements_are_as_late_commands() -> None:
    noise = {"kind": "noise", "std": 0.0, "delay": 2}
    _, sensed = loop_of(
        LATE, control={"period": 0.5}, sensors={"pose": [noise], "velocity": [noise]}
    )
    _, asked = loop_of(LATE, control={"period": 0.5, "delay": 2})
    found, expected = by_size(sensed.eigenvalues[0]), by_size(asked.eigenvalues[0])
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_loop_that_a_force_keeps_beside_its_reference_is_linearised_there() -> None:
    push = {"forces": [{"kind": "constant", "force": [1.2]}]}
    law = of(WHEEL, plant=push)
    angle = np.arcsin(1.2 / STIFFNESS)
    assert law.offset == pytest.approx([angle], rel=1e-6)
    roots = np.roots([J, DAMPING, STIFFNESS * np.cos(angle)])
    assert abs(law.growth.eigenvalue.imag) == pytest.approx(roots.imag.max(), rel=1e-6)
    lost = {"forces": [{"kind": "constant", "force": [2.5]}]}  # more than any spring of the law
    assert of(WHEEL, plant=lost).is_indicative


def test_eigenvalues_are_indicative_where_the_loop_changes_in_time() -> None:
    turning = {"kind": "rates", "rates": ["cos(t)", "sin(t)", "0"]}
    law = of({**LATE, "reference": turning, "actuators": [], "time": {"duration": 5.0}})
    assert law.is_indicative and not law.is_unstable
    swinging = of(WHEEL, reference={"torque": ["cos(t)"]})  # all errors of a wheel are alike
    assert not swinging.is_indicative


def test_crossings_beyond_the_first_decide_nothing() -> None:
    """A lightly damped mode that crosses far above the main crossover has the smaller margin."""
    A = np.array([[-1.0, 0.0, 0.0], [0.0, -0.01, 50.0], [0.0, -50.0, -0.01]])
    B, C = np.array([[1.0], [0.0], [1.0]]), np.array([[-3.0, -0.05, 0.0]])
    margin = delay_margin(CutLoop(A, B, C, None))
    assert 0.0 < margin < 2 * np.pi / 50
    for delay, stable in ((0.99 * margin, True), (1.01 * margin, False)):
        # Bernoulli's delay by a product of many lags of first order would be another system;
        # Padé's of order 8 at ω τ < 2π is right to 1e-4.
        assert is_stable_by_pade(A, B, C, delay) == stable


def is_stable_by_pade(A: Array, B: Array, C: Array, delay: float) -> bool:
    n = 8
    k = np.arange(n + 1)
    factors = [comb(n, j) * factorial(2 * n - j) / factorial(2 * n) for j in range(n + 1)]
    denominator = (np.array(factors) * delay**k)[::-1]  # of e^(-sτ), in falling powers
    numerator = ((-1.0) ** k[::-1]) * denominator
    feed = numerator[0] / denominator[0]
    rest = (numerator - feed * denominator)[1:] / denominator[0]
    a = np.diag(np.ones(n - 1), -1)  # in the form of a controller
    a[0] = -denominator[1:] / denominator[0]
    b = np.eye(n)[:, :1]
    whole = np.block([[A + feed * B @ C, B @ rest[None]], [b @ C, a]])
    return bool(np.linalg.eigvals(whole).real.max() < 0)


def test_a_loop_that_no_delay_makes_unstable_has_an_infinite_margin() -> None:
    A, B = np.array([[-1.0]]), np.array([[1.0]])
    assert delay_margin(CutLoop(A, B, np.array([[-0.9]]), None)) == np.inf
    assert delay_margin(CutLoop(0.5 * B, B, np.array([[-0.4]]), 1.0)) == np.inf
