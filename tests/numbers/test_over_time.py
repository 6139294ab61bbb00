"""Numbers that follow from the samples of a run."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import simpson

from eqt_cli.numbers.running import SampledRuns, held_weights, simpson_weights, trapezoidal_weights
from eqt_cli.results.quantity import Window

STEPS = st.lists(st.floats(0.01, 10.0), min_size=1, max_size=12)


@given(STEPS)
def test_weights_are_those_of_numpy_and_scipy(steps):
    times = np.cumsum([0.3, *steps])
    unit = np.eye(len(times))
    # Sums and quotients of steps that differ by 1000 times.
    np.testing.assert_allclose(trapezoidal_weights(times), np.trapezoid(unit, times), rtol=1e-12)
    np.testing.assert_allclose(
        simpson_weights(times), simpson(unit, x=times), rtol=1e-9, atol=1e-12 * times[-1]
    )


@pytest.mark.parametrize("samples", [51, 101, 501, 1001])
def test_the_integral_of_a_held_value_is_the_sum_over_its_ticks(samples):
    """With a tick of 0.1 s in 5 s, and samples at all ticks; values of size 1."""
    held = np.random.default_rng(4).normal(size=51)
    times = np.linspace(0, 5, samples)
    values = held[np.floor(times / 0.1 + 1e-9).astype(int)]
    assert held_weights(times, 0.1) @ values == pytest.approx(0.1 * held[:50].sum(), abs=1e-12)


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


def test_a_sum_goes_from_sample_to_sample():
    values, weights = np.array([[1e16, 1.0, -1e16, 1.0]]), np.ones(4)
    assert SampledRuns(np.arange(4.0)).weighted(weights, values) == 1.0  # pairs would give 0 or 2


def test_samples_without_weight_are_not_looked_at():
    values = np.array([[1.0, 2.0, np.nan]])
    assert SampledRuns(np.arange(3.0)).weighted(np.array([1.0, 1.0, 0.0]), values) == 3.0


def test_what_follows_from_all_samples():
    over, values = SampledRuns(np.arange(4.0)), np.array([[3.0, -1.0, 5.0, 2.0], [np.nan] * 4])
    assert over.duration == 3.0
    np.testing.assert_array_equal(over.largest(values), [5.0, np.nan])
    np.testing.assert_array_equal(over.smallest(values), [-1.0, np.nan])
    np.testing.assert_array_equal(over.final(values), [2.0, np.nan])
    np.testing.assert_array_equal(over.before(values)[0], [3.0, 3.0, -1.0, 5.0])
    np.testing.assert_array_equal(over.latest(values, values > 2.5), [5.0, 0.0])


@pytest.mark.parametrize(("share", "expected"), [(1.0, 2.0), (0.5, 3.0)])
def test_the_mean_over_the_last_part(share, expected):
    times = np.linspace(0, 4, 9)
    assert SampledRuns(times).closing_mean(times[None], share) == pytest.approx(expected)
