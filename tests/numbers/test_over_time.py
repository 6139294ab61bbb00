"""Numbers that follow from the samples of a run."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import simpson

from eqt_cli.numbers.running import SampledRuns, simpson_weights, trapezoidal_weights

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
