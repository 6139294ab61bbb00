"""Numbers of samples: weights of integrals, and that one by one is, to the bit, all at once."""

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.integrate import simpson

from eqt_cli.base.errors import TraceError
from eqt_cli.extend import Window, less
from eqt_cli.numbers.running import (
    Memory,
    Running,
    SampledRuns,
    held_weights,
    simpson_weights,
    trapezoidal_weights,
)
from eqt_cli.results.metrics import METRICS

VALUES = arrays(float, st.integers(2, 9), elements=st.floats(-1e6, 1e6))


def one_by_one(times, values, of):
    """A number of values, by a program that is run on floats."""

    def look(memory, columns, value):
        found = Memory(memory, columns)
        of(Running(times, found), np.array([value]))
        return found

    size = 64
    found = look(np.zeros(size), np.zeros(size), values[0])
    columns = np.array(found.columns).reshape(-1, len(times))
    memory = np.array(found.starts)
    for sample, value in enumerate(values):
        memory = np.array(look(memory, columns[:, sample], value).after, dtype=float)
    behind = Memory(memory, np.zeros(size), ended=True)
    return np.asarray(of(Running(times, behind), np.zeros(1)))[0]


def held(over):
    over.hold = 0.35
    return over


NUMBERS = {
    "integral": lambda over, x: over.integral(x),
    "simpson": lambda over, x: over.simpson(x * x),
    "held": lambda over, x: held(over).integral(x),
    "mean": lambda over, x: over.mean(x),
    "closing mean": lambda over, x: over.closing_mean(x, 0.4),
    "every other": lambda over, x: over.weighted(np.arange(len(over.times)) % 2.0, x),
    "largest": lambda over, x: over.largest(x),
    "smallest": lambda over, x: over.smallest(x),
    "final": lambda over, x: over.final(x),
    "from the first": lambda over, x: over.largest(x - over.initial(x)),
    "from the one before": lambda over, x: over.largest(x - over.before(x)),
    "latest": lambda over, x: over.latest(over.time + 0 * x, less(0.0, x)),
}


@pytest.mark.parametrize("name", NUMBERS)
@settings(max_examples=15)
@given(VALUES, st.integers(0, 9))
def test_one_by_one_is_all_at_once(name, values, known):
    times = 0.5 + np.cumsum(np.linspace(0.1, 0.4, len(values)))
    values[known:] = np.nan  # of a run that fails
    with np.errstate(invalid="ignore"):
        expected = NUMBERS[name](SampledRuns(times), values[None])[0]
        found = one_by_one(times, values, NUMBERS[name])
    np.testing.assert_array_equal(found, expected)


@pytest.mark.parametrize("name", ["settling_time", "early_torque", "peak_torque", "closing_torque"])
@settings(max_examples=10)
@given(arrays(float, 21, elements=st.floats(0, 1)))
def test_a_metric_is_the_same_both_ways(name, values):
    (metric,) = (each for each in METRICS if each.name == name)
    times, keys = np.linspace(0, 10, 21), dict.fromkeys(metric.settings, 0.3)

    def of(over: SampledRuns, x):
        signals = {metric.signals[0]: x}
        return metric.measure(over, signals, metric.window, **keys)

    expected = of(SampledRuns(times), values[None])[0]
    np.testing.assert_array_equal(one_by_one(times, values, of), expected)


def test_a_window_between_two_samples_cannot_be_found_one_by_one():
    over = Running(np.linspace(0, 10, 11), Memory(np.zeros(9), np.zeros(9)))
    with pytest.raises(TraceError, match="a window ends between two samples"):
        over.within(Window(0.0, 3.3).cut, [])


@pytest.mark.parametrize("name", NUMBERS)
def test_a_window_is_one_by_one_what_it_is_all_at_once(name):
    """Samples outside count nowhere: those before are larger, and the last ones are lost."""
    times, values = np.arange(9.0), np.array([9.0, 8.0, -1.0, 2.0, 1.5, 3.0, -2.0, np.nan, np.nan])

    def of(over, x):
        within, (x,) = over.within(Window(2.0, 6.0).cut, [x])
        return NUMBERS[name](within, x)

    expected = NUMBERS[name](SampledRuns(times[2:7]), values[None, 2:7])[0]
    assert np.isfinite(expected)
    np.testing.assert_array_equal(one_by_one(times, values, of), expected)


@given(st.lists(st.floats(0.01, 10.0), min_size=1, max_size=12))
@example([0.3, 2.0, 0.5])  # the last interval of an odd number
def test_weights_are_those_of_numpy_and_scipy(steps):
    times = np.cumsum([0.3, *steps])
    unit = np.eye(len(times))
    # Sums and quotients of steps that differ by 1000 times.
    np.testing.assert_allclose(trapezoidal_weights(times), np.trapezoid(unit, times), rtol=1e-12)
    tolerances = {"rtol": 1e-9, "atol": 1e-12 * times[-1]}
    np.testing.assert_allclose(simpson_weights(times), simpson(unit, x=times), **tolerances)


def test_the_integral_of_a_held_ramp_is_right_where_samples_skip_ticks():
    """The sum over ticks is 0.1 (0 + 0.1 + … + 4.9); trapezoids of a ramp are exact."""
    times = np.linspace(0, 5, 11)
    assert held_weights(times, 0.1) @ times == pytest.approx(0.01 * 49 * 50 / 2)


def test_a_window_of_held_values_is_not_interpolated():
    """1 until 0.1, then 3, then 0; from 0.05 s to 0.15 s it is 0.05 + 0.15."""
    times, values = np.array([0, 0.1, 0.2, 0.3]), np.array([[1.0, 3.0, 0.0, 0.0]])
    cut, inside = Window(0.05, 0.15).cut(times, values, held=True)
    assert inside[0].tolist() == [1.0, 3.0, 3.0]
    assert held_weights(cut, 0.1) @ inside[0] == pytest.approx(0.2)
