"""A drift against the Allan deviation of a first-order Gauss-Markov process, in closed form."""

import numpy as np
import pytest

from eqt_cli.components.groups import groups
from eqt_cli.extensions.budget.drift import Drift

SO3 = groups.get("SO3")()


def allan_variance(b, length):
    """Half the mean square of differences of neighbouring means over `length` measurements."""
    means = b[: len(b) // length * length].reshape(-1, length, b.shape[1]).mean(axis=1)
    return (np.diff(means, axis=0) ** 2).mean() / 2


def gauss_markov(x):
    """The Allan variance at averages over x T, with std 1 (IEEE Std 952, annex C)."""
    return 2 / x * (1 - (3 - 4 * np.exp(-x) + np.exp(-2 * x)) / (2 * x))


def test_the_floor_of_the_allan_deviation_is_the_instability():
    drift, period = Drift(time=5.0, instability=0.3), 0.05
    b = drift.errors(SO3, 40_000, period, np.random.default_rng(1))
    x = np.array([0.2, 1.893, 10.0])  # averages over x T
    variance = gauss_markov(x) / gauss_markov(1.893) * 0.3**2
    # 3 x 2,000 s are some 1,200 / x independent differences with squares of chi-squared; four
    # standard deviations. Sampling changes the closed form by (period / T)^2.
    lengths = np.rint(5 * x / period).astype(int)
    deviations = 4 * np.sqrt(2 * x / 1_200)
    assert np.all(
        np.abs([allan_variance(b, length) for length in lengths] / variance - 1) < deviations
    )


def test_the_first_errors_do_not_depend_on_how_many_there_are():
    drift = Drift(time=5.0, std=0.3)
    some, more = (drift.errors(SO3, k, 0.1, np.random.default_rng(1)) for k in (5, 50))
    np.testing.assert_array_equal(some, more[:5])


def test_a_drift_starts_from_its_stationary_distribution():
    drift, random = Drift(time=5.0, std=[0.1, 0.2, 0.3]), np.random.default_rng(2)
    starts = np.array([drift.errors(SO3, 2, 0.1, random)[0] for _ in range(400)])
    assert starts.std(axis=0) == pytest.approx([0.1, 0.2, 0.3], rel=4 / np.sqrt(2 * 400))
