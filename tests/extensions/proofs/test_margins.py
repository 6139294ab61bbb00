"""Margins against closed forms, against runs, and against the loop's own period."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from math import comb, factorial
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import yaml

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import ConfigError, EqtWarning
from eqt_cli.config.experiment import Experiment
from eqt_cli.extend import Array, Lee2010, Problem, SolveIvp, Tracking, stack
from eqt_cli.extensions.proofs import margins as searched
from eqt_cli.extensions.proofs import scaled
from eqt_cli.extensions.proofs.margins import CutLoop, LawMargins, delay_margin, delayed
from eqt_cli.extensions.proofs.scaled import LARGEST_FACTOR
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.linearised import Linearised, _settled, linearised

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

CROSSOVER = np.sqrt(np.roots([J**2, -(DAMPING**2), -(STIFFNESS**2)]).max())
MARGIN = np.arctan2(DAMPING * CROSSOVER, STIFFNESS) / CROSSOVER
"""|2 + 0.8iω| = 0.4ω²; the phase of (2 + 0.8iω) / (0.4ω²), over ω."""

LATE = yaml.safe_load("""
group: SO3
inertia: [2.0, 1.0, 3.0]
gains: {kp: 0.05, kd: 0.5}
reference: {kind: constant, pose: {rotvec: [0.4, -0.2, 0.7]}}
controllers: [eqt]
actuators: [{kind: limit, limit: 5.0}, {kind: lag, time_constant: 0.2}]
control: {period: 0.5, delay: 1}
initial: {pose: {kind: exp_normal, std: 1.0e-5}, velocity: {kind: normal, std: 1.0e-5}}
ensemble: {runs: 6, seed: 3}
time: {duration: 8.0, samples: 17}
solver: {rtol: 1.0e-9, atol: 1.0e-14, cross_check: 0}
""")


def of(config: Mapping[str, Any], **changes: Any) -> LawMargins:
    [law] = eqt_cli.margins({**config, **changes}).laws
    return law


def test_the_delay_margin_of_a_wheel_is_the_phase_margin_over_the_crossover() -> None:
    law = of(WHEEL)
    assert law.growth.eigenvalue.real == pytest.approx(-1.0, rel=1e-9)
    assert abs(law.growth.eigenvalue.imag) == pytest.approx(2.0, rel=1e-9)
    assert law.delay == pytest.approx(MARGIN, rel=1e-9)
    assert (law.delay_periods, law.is_indicative, law.is_unstable) == (None, False, False)
    sampled = of(WHEEL, control={"period": MARGIN / 100})
    # The hold is a delay of half a period: 99.5 periods are left, of which 99 are whole.
    assert sampled.delay_periods == 99
    assert sampled.delay == pytest.approx(MARGIN, rel=0.01 + 1e-9)


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


@pytest.mark.parametrize(
    "factor", [1.6, pytest.param(100.0, marks=pytest.mark.ci("within the range, too")), 133.0]
)
def test_the_gain_margin_of_a_wheel_with_lag_is_that_of_routh_and_hurwitz(factor: float) -> None:
    """Up to a factor of 128, beyond which there is none."""
    T = DAMPING / (factor * STIFFNESS)  # TJs³ + Js² + ds + k is stable for d > Tk
    law = of(WHEEL, actuators=[{"kind": "lag", "time_constant": T}])
    is_shown = factor < LARGEST_FACTOR == 128
    assert law.gains["kp"].upper == (pytest.approx(factor, rel=1e-4) if is_shown else None)
    assert law.gains["kp"].lower is None
    assert law.gains["kd"].lower == (pytest.approx(1 / factor, rel=1e-4) if is_shown else None)
    both = law.gains["both"]
    assert (law.gains["kd"].upper, both.lower, both.upper) == (None, None, None)


@pytest.mark.parametrize(("power", "most"), [(1.0, 3), (2.0, 4), (3.0, 5), (0.5, 100)])
def test_margins_are_those_of_any_function_of_a_gain(
    power: float, most: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A stiffness f^p k is stable to f^p = d/(Tk); as many linearisations as a polynomial needs."""
    about = loop_of(WHEEL, actuators=[{"kind": "lag", "time_constant": DAMPING / 9 / STIFFNESS}])[1]
    law = about.about.loop.controller

    class Power(type(law)):  # type: ignore[misc]
        """The law with a stiffness that is a power of its gain."""

        def torque(self, s: Tracking) -> Array:
            """τ, body frame."""
            more = s.gains.K[..., 0, :1] ** (power - 1.0) - 1.0
            return super().torque(s) - more * s.relative.gradient

    loop = replace(about.about.loop, controller=Power())
    linear = linearised(loop, about.about.times, about.about.poses, np.zeros((1, 1)))
    factors = []
    whole = scaled.multiplied
    monkeypatch.setattr(
        scaled, "multiplied", lambda loop, names, f: factors.append(f) or whole(loop, names, f)
    )
    loop_at = scaled.ScaledLoop(linear, ["kp"])
    found = searched._first_unstable(loop_at, 2.0)
    assert found == pytest.approx(9.0 ** (1 / power), rel=1e-7)
    assert searched._first_unstable(loop_at, 0.5) is None
    assert len(factors) <= most


def test_a_gain_that_a_law_does_not_use_has_no_margin() -> None:
    assert set(of(WHEEL, controllers=["sliding"]).gains) == {"kp", "both", "effectiveness"}


def test_a_gain_whose_effect_cancels_but_for_rounding_is_not_used() -> None:
    class Spring(Lee2010):
        """Lee's law with a stiffness of its own."""

        def torque(self, s: Tracking) -> Array:
            """τ, body frame."""
            R = s.relative.Q
            e = [R[..., i, j] - R[..., j, i] for i, j in ((2, 1), (0, 2), (1, 0))]
            return super().torque(s) + s.relative.gradient - 0.04 * stack(e)

    about = loop_of(LATE, controllers=["lee2010"])[1].about
    loop = replace(about.loop, controller=Spring())
    linear = linearised(loop, about.times, about.poses, np.zeros((1, 3)))
    assert [*searched._gain_margins(linear)] == ["kd", "both", "effectiveness"]


def loop_of(config: Mapping[str, Any], **changes: Any) -> tuple[Experiment, Linearised]:
    experiment = eqt_cli.load_experiment({**config, **changes}).base
    [loop] = experiment.loops.values()
    Qd, Vd = experiment.desired.pose[None], experiment.desired.velocity[None]
    return experiment, linearised(loop, np.zeros(1), Qd, Vd, with_estimator=True)


def by_size(eigenvalues: Array) -> Array:
    """Those that are not 0, the largest first; of two that are conjugate, the upper one first."""
    kept = eigenvalues[np.abs(eigenvalues) > 1e-6]
    return kept[np.lexsort((-kept.imag, -np.abs(kept).round(6)))]


def test_eigenvalues_are_those_of_the_period_that_stored_runs_show(tmp_path: Any) -> None:
    """A map x ↦ M x from instant to instant, by least squares over runs of small errors."""
    brief = {**LATE, "time": {"duration": 5.0, "samples": 11}}
    experiment, loop = loop_of(brief)
    run = eqt_cli.run(eqt_cli.load_experiment(brief), tmp_path / "runs")
    with open_at(run) as data:
        G, Q = experiment.group, data["pose"][0]
        errors = G.log(G.inverse(data["desired_pose"]) @ Q)
        asked, given, V = (data[name][0] for name in ("command", "torque", "velocity"))
    held = np.concatenate([0 * asked[:, :1], asked[:, :-1]], axis=1)  # one period late
    x = np.concatenate([errors, V, given, held], axis=-1)
    before, after = x[:, :-1].reshape(-1, 12), x[:, 1:].reshape(-1, 12)
    scale = np.abs(before).max(axis=0)
    M = np.linalg.lstsq(before / scale, after / scale)[0].T
    expected = by_size(np.linalg.eigvals(M))
    found = by_size(np.linalg.eigvals(loop.closed[0]))
    # Second-order terms are 1e-5 of the first, relative to it.
    np.testing.assert_allclose(found, expected[: len(found)], atol=2e-5)


def errors_of(experiment: Experiment, factors: list[tuple[float, float]]) -> Array:
    """‖I − Q_E‖ of runs from one small error, with gains multiplied by factors."""
    [loop], G = experiment.loops.values(), experiment.group
    Qd, Vd = experiment.desired.pose, experiment.desired.velocity
    start = loop.initial_state(Qd @ G.exp(np.array([0.02, 0.03, -0.01])), Vd, Qd, Vd)
    kp, kd = np.array(factors).T[..., None, None]
    gains = {"gains.K": kp * loop.gains.K, "gains.K_d": kd * loop.gains.K_d}
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


@pytest.mark.ci("integrates runs on both sides of a margin")
def test_runs_decay_with_the_largest_delay_that_is_stable_and_grow_with_one_period_more() -> None:
    periods = of(LATE).delay_periods
    assert periods is not None
    for more, expected in ((periods, assert_decays), (periods + 1, assert_grows)):
        late = {**LATE, "control": {"period": 0.5, "delay": 1 + more}}
        [errors] = errors_of(eqt_cli.load_experiment(late).base, [(1.0, 1.0)])
        expected(errors)


@pytest.mark.ci("integrates runs on both sides of a margin")
def test_runs_decay_inside_of_the_gain_margins_and_grow_outside() -> None:
    law, inside, outside = of(LATE), [], []
    for which, (with_kp, with_kd) in {"kp": (1, 0), "kd": (0, 1), "both": (1, 1)}.items():
        margin = law.gains[which]
        for limit, inwards in ((margin.lower, 1.15), (margin.upper, 1 / 1.15)):
            if limit is not None:
                for found, factor in ((inside, limit * inwards), (outside, limit / inwards)):
                    found.append((factor**with_kp, factor**with_kd))
    assert len(inside) == 4  # both ends for kd, the upper one for kp and both
    errors = errors_of(eqt_cli.load_experiment(LATE).base, inside + outside)
    for one in errors[: len(inside)]:
        assert_decays(one)
    for one in errors[len(inside) :]:
        assert_grows(one)


def test_further_delay_is_what_the_queue_of_the_loop_makes_of_it() -> None:
    _, once = loop_of(LATE)
    _, thrice = loop_of(LATE, control={"period": 0.5, "delay": 3})
    A, B, C = (each[0] for each in once.phases[0])
    later = delayed([(A, B, C)], 2)
    expected = by_size(np.linalg.eigvals(thrice.closed[0]))
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
    found, expected = (by_size(np.linalg.eigvals(each.closed[0])) for each in (sensed, asked))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_where_the_clock_of_an_actuator_begins_changes_no_eigenvalue() -> None:
    """The law acts at every tick, so that both loops are one, begun at another tick."""
    slow = {"kind": "limit", "limit": 9.0, "period": 0.2}
    loops = [
        of(WHEEL, control={"period": 0.1}, actuators=[{**slow, "offset": begun}])
        for begun in (0.0, 0.1)
    ]
    at_once, later = (abs(law.growth.eigenvalue) for law in loops)
    assert 0 < later < 1 and later == pytest.approx(at_once, rel=1e-9)


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


@pytest.mark.parametrize(("b", "k"), [(1e-2, 1e3), (1e3, 1e-3)])
def test_the_delay_margin_of_an_integrator_is_a_quarter_turn(b: float, k: float) -> None:
    """−bk/(iω) is e^(iπ/2) at ω = bk, however far the other poles of the loop are away."""
    A, B, C = np.diag([0.0, -1e6]), np.array([[b], [0.0]]), np.array([[-k, 0.0]])
    margin = np.pi / 2 / (b * k)
    assert delay_margin(CutLoop(A, B, C, None)) == pytest.approx(margin, rel=1e-9)
    assert delay_margin(CutLoop(A[:1, :1], B[:1], C[:, :1], None)) == pytest.approx(margin)


def test_the_delay_margin_of_several_commands_is_the_least_of_theirs() -> None:
    """Of −1/s and −(0.1 + 0.2s)/s², in coordinates that mix their states and commands.

    The second has less phase where the first one crosses, but does not cross there.
    """
    square = np.roots([1.0, -(0.2**2), -(0.1**2)]).max()
    crossover = np.sqrt(square)
    margins = [np.pi / 2, np.arctan2(0.2 * crossover, 0.1) / crossover]
    A = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 0.0, 0.0]])
    B = np.array([[1.0, 0.0], [0.0, 0.0], [0.0, 1.0]])
    C = -np.array([[1.0, 0.0, 0.0], [0.0, 0.1, 0.2]])
    S = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, -1.0], [1.0, 0.0, 1.0]])
    U = np.array([[2.0, 1.0], [1.0, 1.0]])
    inverse, back = np.linalg.inv(S), np.linalg.inv(U)
    mixed = CutLoop(S @ A @ inverse, S @ B @ back, U @ C @ inverse, None)
    assert delay_margin(mixed) == pytest.approx(min(margins), rel=1e-9)


@pytest.mark.parametrize("share", [0.97, 1.02])
def test_a_mode_that_hardly_reaches_the_gain_1_is_found(share: float) -> None:
    """Its gain is share / √(1 + x²), with x in units of its decay rate from its frequency."""
    d, w = 0.01, 50.0
    A, B = np.array([[-d, w], [-w, -d]]), np.array([[1.0], [0.0]])
    margin = delay_margin(CutLoop(A, B, np.array([[-2 * d * share, 0.0]]), None))
    x = np.sqrt(max(share**2 - 1, 0.0))
    if share < 1:
        assert margin == np.inf
    else:  # the phase of −1/(1 + ix), to the order of d/w
        assert margin == pytest.approx((np.pi - np.arctan(x)) / w, rel=1e-3)


def sampled(period: float, stiffness: float, damping: float) -> CutLoop:
    """A mass under a spring and a damper, whose force is held for a period."""
    A, B = np.array([[1.0, period], [0.0, 1.0]]), np.array([[period**2 / 2], [period]])
    return CutLoop(A, B, -np.array([[stiffness, damping]]), period)


def periods_by_roots(loop: CutLoop) -> int:
    """The most periods for which all roots of zⁿ det(z − A) = C adj(z − A) B are within 1.

    The right-hand side is what det(z − A − BC) lacks of det(z − A).
    """
    opened = np.poly(loop.A)
    gain = opened - np.poly(loop.A + loop.B @ loop.C)
    for periods in range(500):
        whole = np.append(opened, np.zeros(periods))
        whole[-len(gain) :] -= gain
        if np.abs(np.roots(whole)).max() > 1:
            return periods - 1
    raise AssertionError("a loop is always stable")


def resonant(angle: float, coupling: float) -> CutLoop:
    """An integrator, and a mode that turns by an angle and loses a thousandth in every period."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    A = np.block([[np.eye(1), np.zeros((1, 2))], [np.zeros((2, 1)), 0.999 * turn]])
    return CutLoop(A, np.array([[1.0], [0.0], [1.0]]), -np.array([[0.02, coupling, 0.0]]), 0.01)


def mode_alone(angle: float, share: float) -> CutLoop:
    """The mode alone, with a gain of about this share of 1 at its frequency."""
    turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    return CutLoop(0.999 * turn, np.array([[1.0], [0.0]]), -np.array([[0.002 * share, 0.0]]), 0.01)


@pytest.mark.parametrize(
    ("loop", "periods"),
    [
        (mode_alone(2.6, 1.02), 4),
        (sampled(1.0, 0.5, 1.0), 0),
        (sampled(1e-3, 1e4, 150.0), 6),
        (sampled(40.0, 2e-6, 3e-3), 10),
        (resonant(0.3, 0.0025), 2),
        (resonant(0.6, -0.0025), 5),
        (resonant(0.6, 0.0), 78),
    ],
)
def test_the_delay_margin_of_a_sampled_loop_is_that_of_its_polynomial(
    loop: CutLoop, periods: int
) -> None:
    assert periods_by_roots(loop) == periods
    assert delay_margin(loop) == pytest.approx(periods * loop.period)


def test_a_crossing_that_the_search_misses_is_seen_by_the_eigenvalues(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of frequencies around the crossing of the integrator, at 2 rad/s, without the mode's."""
    monkeypatch.setattr(searched, "_frequencies", lambda _: np.array([0.5, 4.0]))
    monkeypatch.setattr(searched, "TRIED", 1)
    loop = resonant(0.335, 0.0025)
    assert periods_by_roots(loop) == 1
    assert delay_margin(loop) == pytest.approx(0.01)


def test_a_delay_of_whole_periods_to_the_edge_of_stability_is_not_within_the_margin() -> None:
    """x' = x − x ends at once; x'' = x' − x neither grows nor decays, however it is rounded."""
    one = np.array([[1.0]])
    assert delay_margin(CutLoop(one, one, -one, 0.5)) == 0.0


STIFF = pytest.mark.filterwarnings("ignore:.*is stiff")


@STIFF
def test_the_delay_margin_is_that_of_the_slow_loop_beside_a_fast_lag() -> None:
    """A lag of T takes T from it, but for T³."""
    T = 3e-5
    law = of(WHEEL, actuators=[{"kind": "lag", "time_constant": T}])
    assert law.delay == pytest.approx(MARGIN - T, rel=1e-3 * T)


def test_a_sampled_gain_is_that_of_its_difference_equation() -> None:
    """Y/U of x⁺ = x/2 + u, y = 3x at z = e^(iωT), and 3/(s − ½) of ẋ = x/2 + u at s = iω."""
    A, one, T = np.array([[0.5]]), np.array([[1.0]]), 0.1
    w = np.array([0.3, 2.0, 7.0])
    gain = CutLoop(A, one, 3 * one, T).gain(w)
    np.testing.assert_allclose(gain[:, 0, 0], 3 / (np.exp(1j * w * T) - 0.5), rtol=1e-13)
    gain = CutLoop(A, one, 3 * one, None).gain(w)
    np.testing.assert_allclose(gain[:, 0, 0], 3 / (1j * w - 0.5), rtol=1e-13)


def test_a_loop_that_is_unstable_without_delay_has_no_margins() -> None:
    with pytest.warns(EqtWarning, match="unstable"):
        law = of(WHEEL, control={"period": 3.0})
    assert (law.is_unstable, law.delay, law.delay_periods, law.gains) == (True, None, None, {})
    assert law.size == abs(law.growth.eigenvalue) > 1


def cycle_of_an_axis(
    J: float, T: float, pose: tuple[int, int], rate: tuple[int, int], gains: tuple[float, float]
) -> Array:
    """The map of Jë = u over a cycle of its sensors (periods between and until), by hand."""
    k, d = gains
    P = np.array([[1, T, T**2 / (2 * J)], [0, 1, T / J]])

    def after(x: Array, tick: int) -> Array:
        motion, angles, rates = x[:2], x[2 : 3 + pose[1]], x[3 + pose[1] :]
        angles = np.append(angles[1:], motion[0] if tick % pose[0] == 0 else angles[-1])
        rates = np.append(rates[1:], motion[1] if tick % rate[0] == 0 else rates[-1])
        command = -k * angles[0] - d * rates[0]
        return np.concatenate([P @ np.append(motion, command), angles, rates])

    found = np.eye(4 + pose[1] + rate[1])
    for tick in range(int(np.lcm(pose[0], rate[0]))):
        found = np.stack([after(column, tick) for column in found.T], axis=1)
    return found


SLOW = {**LATE, "actuators": [], "control": {"period": 0.1}, "time": {"duration": 10.0}}


def slow(pose: tuple[int, int], rate: tuple[int, int], **changes: Any) -> dict[str, Any]:
    """The body of LATE with sensors that are slower than the law, in its periods."""
    pairs = (("pose", pose), ("velocity", rate))
    sensors = {
        name: [{"kind": "noise", "std": 0.0, "period": 0.1 * every, "delay": delay}]
        for name, (every, delay) in pairs
    }
    return {**SLOW, "sensors": sensors, **changes}


@pytest.mark.parametrize(
    ("pose", "rate", "kp", "kd"),
    [((10, 0), (1, 0), 1.0, 0.5), ((10, 0), (1, 0), 0.1, 0.8), ((4, 3), (6, 1), 0.1, 0.5)],
)
def test_slow_sensors_are_part_of_the_loop(
    pose: tuple[int, int], rate: tuple[int, int], kp: float, kd: float
) -> None:
    """Against a cycle by hand; the first grows by 1.15 a second."""
    _, loop = loop_of(slow(pose, rate, gains={"kp": kp, "kd": kd}))
    hand = [cycle_of_an_axis(J, 0.1, pose, rate, (2 * kp, kd)) for J in (1.0, 2.0, 3.0)]
    expected = max(np.abs(np.linalg.eigvals(each)).max() for each in hand)
    assert np.abs(np.linalg.eigvals(loop.closed)).max() == pytest.approx(expected, rel=1e-9)
    assert loop.cycle == pytest.approx(0.1 * np.lcm(pose[0], rate[0]))


@pytest.mark.ci("another delay margin is fast")
def test_the_delay_margin_with_slow_sensors() -> None:
    """The commands of one axis wait 15 periods of 0.1 s, and not 16."""
    law = of(slow((10, 0), (1, 0), gains={"kp": 0.1, "kd": 0.8}))
    assert (law.delay_periods, law.delay_is_least, law.is_indicative) == (15, False, False)
    [unstable] = eqt_cli.margins(slow((10, 0), (1, 0), gains={"kp": 1.0, "kd": 0.5})).laws
    assert unstable.is_unstable


KALMAN = {"pose_std": 0.1, "velocity_std": 1.0, "bias_walk": 1.0, "initial_bias_std": 1.0}


def settled_gains(h: float, ticks: int) -> tuple[float, float, float]:
    """Of angle, bias and rate, of a Kalman filter with KALMAN and a fix once in so many ticks."""
    fix, rate, walk, start = KALMAN.values()
    step, P = np.array([[1, -h, -h / 2], [0, 1, 0], [0, 0, 0]]), np.diag([fix, start, rate]) ** 2
    new = np.array([[-h / 2, 0, 1], [-h / 2, 1, 0]]) * [[rate], [np.sqrt(h) * walk]]
    for _ in range(100):
        for _ in range(ticks):
            P = step @ P @ step.T + new.T @ new
        K = P[:, 0] / (P[0, 0] + fix**2)
        P = P - np.outer(K, P[0])
    return K[0], -K[1], K[2]


@pytest.mark.parametrize(
    ("estimator", "gains"),
    [
        pytest.param(
            {"kind": "complementary", "kp": 0.7, "ki": 0.2},
            (0.3 * 0.7, 0.3 * 0.2, 0.0),
            marks=pytest.mark.ci("a second filter"),
        ),
        ({"kind": "invariant", **KALMAN}, settled_gains(0.1, 3)),
    ],
    ids=["complementary", "invariant"],
)
def test_an_estimator_is_part_of_the_loop(
    estimator: dict[str, Any], gains: tuple[float, float, float]
) -> None:
    """A filter with a fix at every third tick, against a cycle of one axis by hand."""
    h, k, d, (kp, ki, kn) = 0.1, 0.2, 0.8, gains

    def cycle(J: float) -> Array:
        motion = np.array([[1, h, h**2 / (2 * J)], [0, 1, h / J]])

        def after(x: Array, tick: int) -> Array:
            angle, rate, guess, bias, before = x
            guess = guess + h * ((before + rate) / 2 - bias)
            sigma = (angle - guess) * (1.0 if tick == 0 else 0.0)
            guess, bias = guess + kp * sigma, bias - ki * sigma
            command = -k * guess - d * (rate - bias)
            before = rate - kn * sigma  # without its noise, as far as that is known
            return np.array([*motion @ [angle, rate, command], guess, bias, before])

        found = np.eye(5)
        for tick in range(3):
            found = np.stack([after(column, tick) for column in found.T], axis=1)
        return found

    body = slow((3, 0), (1, 0), gains={"kp": 0.1, "kd": 0.8}, estimator=estimator)
    expected = np.concatenate([np.linalg.eigvals(cycle(J)) for J in (1.0, 2.0, 3.0)])
    found = by_size(np.linalg.eigvals(loop_of(body)[1].closed[0]))
    np.testing.assert_allclose(found, by_size(expected), rtol=1e-6)


@pytest.mark.ci("settles several filters; one is compared with a program by hand above")
def test_laws_share_a_filter_that_settles_and_filters_of_other_numbers_do_not() -> None:
    """Laws of other gains and memories have the covariance that they have alone."""
    filters = {"kind": "invariant", **KALMAN}
    laws = ["lee2010", {"kind": "goodarzi2013", "ki": 0.01, "c2": 0.1}]
    body = slow((3, 0), (1, 0), gains={"kp": 0.1, "kd": 0.8}, estimator=filters, controllers=laws)
    experiment = eqt_cli.load_experiment(body).base
    first, second = experiment.loops.values()
    gains = replace(first, gains=replace(first.gains, K=2.0 * first.gains.K))
    estimator: Any = first.vehicle.estimator
    doubtful = replace(estimator, pose_std=2.0 * estimator.pose_std)
    other = replace(first, vehicle=replace(first.vehicle, estimator=doubtful))
    at = np.zeros(1), experiment.desired.pose[None], experiment.desired.velocity[None]

    def bases(loop: ClosedLoop) -> Array:
        return np.array(linearised(loop, *at, with_estimator=True).about.bases)

    _settled.cache_clear()
    together = [bases(loop) for loop in (first, second, gains, other)]
    assert (_settled.cache_info().hits, _settled.cache_info().misses) == (2, 2)
    for loop, shared in zip((second, gains, other), together[1:], strict=True):
        _settled.cache_clear()
        np.testing.assert_array_equal(shared, bases(loop))
    assert together[1].shape[-1] > together[0].shape[-1]  # the second law has a memory
    assert (together[2] != together[3]).any()


def test_of_a_reference_that_moves_an_estimator_is_judged_at_rest_where_it_begins() -> None:
    noise = [{"kind": "noise", "std": 0.1}]
    body = {
        **WHEEL,
        "control": {"period": 0.1},
        "sensors": {"pose": noise, "velocity": noise},
        "estimator": {"kind": "complementary", "kp": 0.7, "ki": 0.2},
    }
    moves = of(body, reference={"torque": ["0.3*cos(t)"], "pose": {"rotvec": [0.3]}})
    rests = of(body, reference={"kind": "constant", "pose": {"rotvec": [0.3]}})
    raw = of({k: v for k, v in body.items() if k != "estimator"})
    assert moves.gains == rests.gains != raw.gains
    assert (moves.starts, rests.starts) == (True, False)
    assert (moves.verdict, rests.verdict, raw.filters) == ("indicative", "stable", "")
    assert moves.filters == rests.filters == "with the estimator, settled at rest"


def filtered_angle(periods: int, push: float, rate: float) -> Array:
    """θ of the wheel behind its own complementary filter, its command some periods late."""
    h, parts, start = 0.02, 20, 1e-4
    angles = []
    for theta, bias, at in ((start, 0.0, start), (0.0, 0.0, 0.0)):
        speed = last = 0.0
        queue, path = [0.0] * periods, list[float]()
        for k in range(4000):
            at += h * ((speed + last) / 2 - bias) * (k > 0)
            at, bias, last = at + 0.7 * h * (theta - at), bias - 0.2 * h * (theta - at), speed
            queue.append(-STIFFNESS * at - DAMPING * (speed - bias))
            held = queue.pop(0)
            for part in range(parts):
                rise = (held + push * np.sin(rate * h * (k + part / parts))) * h / parts / J
                theta, speed = theta + (speed + rise / 2) * h / parts, speed + rise
            path.append(theta)
        angles.append(path)
    return np.array(angles[0]) - np.array(angles[1])


@pytest.mark.ci("integrates a sampled loop twice, and computes margins with an estimator")
@pytest.mark.parametrize(("push", "rate", "has_filter"), [(0.05, 0.01, True), (1.8, 4.0, False)])
def test_the_filter_stays_in_the_loop_where_a_force_hardly_changes_it(
    push: float, rate: float, has_filter: bool
) -> None:
    noise = [{"kind": "noise", "std": 1e-3}]
    law = of(
        WHEEL,
        control={"period": 0.02},
        sensors={"pose": noise, "velocity": noise},
        estimator={"kind": "complementary", "kp": 0.7, "ki": 0.2},
        plant={"forces": [{"kind": "expression", "force": [f"{push}*sin({rate}*t)"]}]},
        time={"duration": 300},
    )
    assert (law.has_filter, law.freezes, law.verdict) == (has_filter, has_filter, "indicative")
    if has_filter:
        assert law.delay_periods is not None
        for later, grows in ((0, False), (1, True)):
            of_error = np.abs(filtered_angle(law.delay_periods + later, push, rate))
            assert (of_error[-1000:].max() > of_error[1000:2000].max()) is np.bool_(grows)


@pytest.mark.parametrize(
    ("kd", "lags", "stable"),
    [(0.8, [1e-4], True), (0.24, [0.3, 1e-4], False), (0.24, [0.3, 1e-5], False)],
)
@STIFF
def test_a_fast_lag_does_not_hide_a_slow_rate(kd: float, lags: list[float], stable: bool) -> None:
    law = of(
        WHEEL,
        gains={"kp": 0.04 if stable else 1.0, "kd": kd},
        actuators=[{"kind": "lag", "time_constant": each} for each in lags],
    )
    assert (law.growth.is_stable, law.is_indicative) == (stable, False)


@pytest.mark.parametrize(
    ("more", "indicative"),
    [
        ({"actuators": [{"kind": "limit", "limit": 5.0}]}, True),
        pytest.param({"sensors": {"pose": [{"kind": "noise", "std": 0.1, "dropout": 0.1}]}}, True,
            marks=pytest.mark.ci("another part")),
        ({"sensors": {"pose": [{"kind": "noise", "std": 0.1}]}}, False),
        ({"sensors": {name: [{"kind": "noise", "std": 0.1}] for name in ("pose", "velocity")},
         "estimator": {"kind": "complementary", "kp": 0.7, "ki": 0.2}}, False),
    ],
)  # fmt: skip
def test_what_is_left_out_makes_a_verdict_indicative(more: Any, indicative: bool) -> None:
    assert of({**WHEEL, "control": {"period": 0.1}, **more}).is_indicative is indicative


def test_every_law_counts(told: Any) -> None:
    eqt_cli.margins({**WHEEL, "controllers": ["eqt", "sliding"]})
    assert ("laws", 2) in told.steps
    assert told.total("laws") == 2


BODY: dict[str, Any] = {
    "group": "SO3",
    "inertia": [0.9, 1.3, 1.7],
    "gains": {"kp": 1.0, "kd": 0.8},
    "reference": {"torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"]},
    "time": {"duration": 20.0},
}
"""Along the reference of the paper, whose velocity changes."""


def slowest(*polynomials: Any) -> float:
    return max(np.roots(each).real.max() for each in polynomials)


def test_errors_that_obey_one_equation_along_a_reference_have_its_rates() -> None:
    """Jε̈ + k_d ε̇ + 2k_p ε = 0: of lee2010 in the body; of asym in space, if J is a number."""
    law = of(BODY, controllers=["lee2010"])
    rate = slowest(*([J, 0.8, 2.0] for J in BODY["inertia"]))
    assert law.growth.rate == pytest.approx(rate, rel=1e-8)
    assert (law.growth.is_stable, law.changes, law.is_indicative) == (True, False, False)
    assert law.delay_is_frozen
    ball = of(BODY, inertia=1.3, controllers=["asym"])
    assert ball.growth.rate == pytest.approx(slowest([1.3, 0.8, 2.0]), rel=1e-8)
    assert not ball.is_indicative


@pytest.mark.ci("linearises seven states along a path; two laws alone are fast, above")
def test_a_cascade_along_a_path_has_the_rates_of_its_two_loops() -> None:
    J, kx, kv = [0.013, 0.014, 0.025], 6.25, 4.0
    law = of(
        {
            "group": "SE3",
            "inertia": [*J, 1.0, 1.0, 1.0],
            "model": {"forces": [{"kind": "restoring", "weight": 9.81}]},
            "reference": {
                "kind": "flat",
                "position": ["sin(t)", "1 - cos(2*t)", "0.3*sin(3*t)"],
                "heading": "t",
            },
            "controllers": [
                {
                    "kind": "cascade",
                    "attitude": "lee2010",
                    "along": [0, 0, 1],
                    "position": {"kx": kx, "kv": kv},
                    "gains": {"kp": 0.4, "kd": 0.12},
                }
            ],
            "time": {"duration": 5.0},
        }
    )
    rate = slowest([1.0, kv, kx], *([each, 0.12, 0.8] for each in J))
    assert law.growth.rate == pytest.approx(rate, rel=1e-6)
    assert (law.growth.is_stable, law.is_indicative) == (True, False)


def test_no_eigenvalue_of_a_loop_that_changes_is_a_rate() -> None:
    law = of(BODY, controllers=["eqt"])
    assert (law.changes, law.is_indicative, law.is_unstable) == (True, True, False)


def test_a_reference_that_is_not_finite_has_no_margins() -> None:
    with pytest.raises(ConfigError, match=r"reference: has no finite real value at about"):
        of(WHEEL, reference={"kind": "rates", "rates": ["sqrt(1 - t)"]})


def test_the_delay_margin_of_any_sampled_loop_is_the_first_period_that_makes_it_unstable() -> None:
    """Also where a root has left and entered again between two periods, and leaves for good later.

    Loops of up to four states and two commands, some of them at the edge of stability.
    """
    random, finite = np.random.default_rng(1), 0
    for _ in range(40):
        n, m = random.integers(1, 5), random.integers(1, 3)
        A = random.normal(size=(n, n))
        A *= random.choice([0.5, 0.9, 0.99, 1.0]) / np.abs(np.linalg.eigvals(A)).max()
        B = random.normal(size=(n, m))
        C = random.choice([0.02, 0.1, 0.3, 1.0]) * random.normal(size=(m, n))
        loop = CutLoop(A, B, C, 0.5)
        maps = (delayed([(A, B, C)], k) if k else A + B @ C for k in range(20))
        sizes = (np.abs(np.linalg.eigvals(each)).max() for each in maps)
        first = next((k for k, size in enumerate(sizes) if size > 1 + 1e-9), 20)
        if first > 0:  # else it is unstable without delay
            assert delay_margin(loop) == pytest.approx(0.5 * (first - 1)) or first == 20
            finite += first < 20
    assert finite > 5


@pytest.mark.parametrize(("most", "found"), [(0, 0), (1, 1), (37, 37), (140, 140)])
def test_the_delay_of_a_cycle_is_the_last_stable_number_of_periods(monkeypatch, most, found):
    monkeypatch.setattr(searched, "is_stable", lambda phases, delay: delay <= most)
    loop: Any = SimpleNamespace(period=0.5, phases=[SimpleNamespace(B=np.zeros((1, 4, 2)))])
    assert searched._delay_of_cycle(loop) == (0.5 * found, False)


def test_a_cycle_that_no_delay_makes_unstable_has_no_known_end(monkeypatch):
    monkeypatch.setattr(searched, "is_stable", lambda phases, delay: True)
    loop: Any = SimpleNamespace(period=0.5, phases=[SimpleNamespace(B=np.zeros((1, 4, 2)))])
    delay, is_least = searched._delay_of_cycle(loop)
    assert is_least
    assert delay >= 0.5 * (searched.MOST_STATES - 4) // 2
