"""One motion under another clock, rate, noise or name, and different flights of one law."""

from itertools import combinations

import numpy as np
import pytest
from scipy.interpolate import CubicSpline
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

from eqt_cli.extensions.logs.logs import Series
from eqt_cli.extensions.logs.same_motion import Motion, motion_from, motion_of, twins

STEP = 0.01
T = np.arange(0.0, 30.0, STEP)


def wanted(t):
    return np.c_[2 * np.cos(0.8 * t), np.sin(1.6 * t), 1 + 0.2 * np.sin(0.4 * t)]


def flight(seed, wind=0.01):
    """Late by 0.1 s, pushed by wind, from another start; as a plain program simulates it."""
    noise = np.random.default_rng(seed)
    error = noise.normal(size=(len(T), 3))
    for time in (0.8, 0.3):
        a = np.exp(-STEP / time)
        error = lfilter([1 - a], [1, -a], error, axis=0)
    error *= wind / np.sqrt(np.mean(np.sum(error**2, axis=1)))
    start = 0.02 * np.exp(-T / 1.5)[:, None] * noise.normal(size=3)
    return Motion(T, wanted(T - 0.1) + error + start)


FLOWN = flight(0)


def resampled(rate, how=FLOWN.at):
    t = np.arange(0.003, 29.9, 1 / rate)
    return Motion(t + 12.3, how(t))


COPIES = {
    "clock": (Motion(T + 1.7e9, FLOWN.places), 1.7e9),
    "fast clock": (Motion(T * (1 + 5e-5), FLOWN.places), 5e-5 * 15),
    "a part": (Motion(T[900:2700] - 3.0, FLOWN.places[900:2700]), -3.0),
    "37 Hz": (resampled(37), 12.3),
    "250 Hz": (resampled(250), 12.3),
    "spline": (resampled(50, CubicSpline(T, FLOWN.places)), 12.3),
    "text": (motion_from(FLOWN.as_text()), 0.0),
}


@pytest.mark.parametrize(("copy", "later"), COPIES.values(), ids=COPIES)
@pytest.mark.parametrize("noise", [0.0, 1e-6])
def test_one_motion_is_recognised(copy, later, noise):
    noisy = copy.places + noise * np.random.default_rng(1).normal(size=copy.places.shape)
    (twin,) = twins({"a": FLOWN, "b": copy._replace(places=noisy)})
    assert (twin.name, twin.first) == ("b", "a")
    # Of the last digits of a clock of 1.7e9 s, and of noise of 1e-6 m at 1 m/s
    assert twin.later == pytest.approx(later, abs=1e-5)


@pytest.mark.ci("105 pairs of flights of 30 s")
@pytest.mark.parametrize("wind", [0.03, 0.003])
def test_different_flights_of_one_law_are_not_one(wind):
    flights = {f"{seed}": flight(seed, wind) for seed in range(15)}
    assert len([*combinations(flights, 2)]) > 100
    assert not [*twins(flights)]


def test_turns_without_positions_are_compared_too():
    turn = Rotation.from_euler("ZYX", np.c_[0.4 * T, 0.2 * np.sin(T), 0.1 * np.cos(T)])
    q = turn.as_quat(scalar_first=True)
    here = motion_of({"attitude": Series("a", T, q)})
    there = motion_of({"attitude": Series("b", T + 4.0, -q)})  # the same rotations
    (twin,) = twins({"a": here, "b": there})
    assert twin.later == pytest.approx(4.0, abs=1e-6)


def test_what_stands_still_is_not_compared():
    still = Motion(T, np.zeros((len(T), 3)))
    assert not [*twins({"a": still, "b": still})]
