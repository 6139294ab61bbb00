"""Forces that jump again and again: both engines end steps there, and lose no impulse."""

import numpy as np
import pytest
from small_loops import closed_loop

from eqt_cli.engines import horizon
from eqt_cli.engines.choice import unavailable
from eqt_cli.engines.horizon import check_reference, missed, reference_over_horizon
from eqt_cli.extend import Native, Problem, SolveIvp, Status, TorqueReference, group_named, parse
from eqt_cli.loop.closed_loop import ReferenceSystem
from eqt_cli.numbers.instants import bounds_of_integral, instants

STOP = 105.0  # fifteen periods of 7 s


def arc(level):
    """The share of a period in which a sine is above a level."""
    return 0.5 - np.arcsin(level) / np.pi


SHARES = {
    "where(sin(2*pi*t/7) > 0.9, 1, 0)": arc(0.9),
    "where(sin(2*pi*t/7) > 0.9, 1, 0) - where(sin(2*pi*t/7) < -0.5, 1, 0)": arc(0.9) - arc(0.5),
    "where(cos(2*pi*(t - 3)/7) > 0.999, 1, 0)": arc(0.999),
    "pulse(t, 7, 6.5, 7.25)": 0.75 / 7,
    "where(mod(t, 7) < 0.1, 1, where(mod(t, 7) < 0.3, -1, 0))": -0.1 / 7,
    "step(sin(2*pi*t/7)*sin(4*pi*t/7), 0.5)": None,
    "max(sin(2*pi*t/7), 0.9) - 0.9": (2 * np.sqrt(1 - 0.81) - 0.9 * 2 * np.pi * arc(0.9))
    / (2 * np.pi),
    "sign(sin(2*pi*t/7) + 0.2)": 2 * arc(-0.2) - 1,
    "0.25*floor(0.9*sin(2*pi*t/7))": -0.125,
    "mod(t, 3.5)/7": 0.25,
    "abs(atan(tan(pi*t/7)))": np.pi / 4,
    "where(abs(sin(2*pi*t/7)) > 0.99, 1, 0)": 2 * arc(0.99),
}
"""Expressions with their means over a period."""


def share(text):
    """The mean, or where x = cos(2πt/7) has (1 − x²)·2x > 0.5 if there is no closed form."""
    if SHARES[text] is not None:
        return SHARES[text]
    x = np.roots([-2.0, 0.0, 2.0, -0.5])
    low, high = np.sort(x[np.abs(x) < 1].real)[-2:]
    return (np.arccos(low) - np.arccos(high)) / np.pi


@pytest.mark.ci("compiles twelve expressions, and ends some 500 steps of twelve states")
@pytest.mark.parametrize("engine", [Native(), SolveIvp()], ids=lambda engine: engine.name)
def test_no_impulse_of_a_periodic_force_is_lost(engine):
    if unavailable(type(engine)):
        pytest.skip("no compiler")
    G = group_named("*".join(["R3"] * 4))
    loop = closed_loop(G, reference=TorqueReference([*SHARES]))
    system = ReferenceSystem.of(loop)
    state = system.initial_state(*[G.identity, np.zeros(G.dimension)] * 2)
    for samples in (2, 106):  # at many changes of mod, and at none
        times = np.linspace(0.0, STOP, samples)
        solved = engine.solve(Problem(system, state[None], times))
        assert solved.status.tolist() == [Status.OK]
        momentum = system.layout.split(solved.states[0, -1])["desired_momentum"]
        for text, found in zip(SHARES, momentum, strict=True):
            # Times of some 1e-13 s are cut off at each change.
            assert found == pytest.approx(share(text) * STOP, rel=1e-9, abs=1e-9), text


def test_a_pulse_is_as_long_in_every_period():
    loop = closed_loop(group_named("R1"), reference=TorqueReference(["pulse(t, 7, 6.5, 7.25)"]))
    start = loop.group.identity, np.zeros(1)
    shown = reference_over_horizon(loop, start, np.array([0.0, STOP]))
    momentum = loop.inertia.momentum(shown.velocity)
    assert momentum[-1] == pytest.approx([0.25 + 14 * 0.75 + 0.5], rel=1e-12)


def test_a_change_that_equals_a_sample_but_for_rounding_is_on_its_side():
    """0.1 + 0.2 is above 0.3: evaluated next to the sample, the force would not have changed."""
    system = ReferenceSystem.of(
        closed_loop(group_named("R1"), reference=TorqueReference(["where(t < 0.3, 1, 0)"]))
    )
    times = np.array([0.0, 0.1 + 0.2, 1.0])
    first, second = Problem(system, np.zeros((1, system.state_length)), times).spans
    assert first.within[1] < 0.3 < times[1] < second.within[0]


def test_many_jumps_are_counted():
    loop = closed_loop(group_named("R1"), reference=TorqueReference(["pulse(t, 2, 0.5, 1)"]))
    start = loop.group.identity, np.zeros(1)
    shown = reference_over_horizon(loop, start, np.linspace(0.0, 100.0, 5))
    [remark] = check_reference(shown, None, None)
    assert remark.endswith("t = 0.5, 1, 2.5, 3, …, 99 (100 times) s")


PLAIN = ("exp(-((t - 3)/1e-5)**2)", "sin(t) + step(t, 5)", "floor(2*t)")  # the last jumps at 105


@pytest.mark.parametrize("text", [*SHARES, *PLAIN])
def test_what_steps_add_is_the_integral(text):
    assert [missed(parse(text), STOP, rtol) for rtol in (1e-9, 1e-4)] == ["", ""]
    if SHARES.get(text):
        low, high, size = bounds_of_integral(parse(text), STOP)
        assert low - 1e-9 <= SHARES[text] * STOP <= high + 1e-9
        assert high - low < 3e-3 * size


def test_a_lost_pulse_is_an_error_with_both_integrals(monkeypatch):
    """If the search did not see them: pulses of 1 ms, and steps of 1.6 s."""
    text = "pulse(t, 7, 3, 3.001) + step(t, 50)"
    known = instants(parse(text), STOP)
    monkeypatch.setattr(horizon, "instants_of", lambda *_: np.array([50.0]))
    missed.cache_clear()
    said = missed(parse(text), STOP, 1e-9)
    missed.cache_clear()
    assert len(known) > 30
    assert "would add 55 until t = 105 s, and its integral is 55.015" in said
