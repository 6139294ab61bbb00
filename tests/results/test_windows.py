"""Stretches of time: how they are written, and what lies in them."""

import math

import numpy as np
import pytest
from said import error_of

from eqt_cli.extend import EqtError, Window

TIMES = np.linspace(0.0, 10.0, 11)


@pytest.mark.parametrize(
    ("text", "window"),
    [("0:5", Window(0, 5)), (":5", Window(0, 5)), ("2.5:", Window(2.5, math.inf)), (":", Window())],
)
def test_parse(text, window):
    assert Window.parse(text) == window


@pytest.mark.parametrize("text", ["5", "a:b", "", "1:2:3", "nan:1", "0:nan"])
def test_parse_says_what_it_expects(text):
    assert error_of(Window.parse, text) == (
        f"window '{text}': expected START:STOP in seconds, as 0:5, 5: or : for all of it"
    )


@pytest.mark.parametrize("text", ["5:5", "5:1", "-1:5", "inf:"])
def test_parse_refuses_what_is_empty(text):
    with pytest.raises(EqtError, match=f"^window '{text}': expected 0 <= START < STOP$"):
        Window.parse(text)


@pytest.mark.parametrize("begin", [0.0, 3.0])
def test_window_ends_with_the_runs(begin):
    assert Window(5, 50).within(begin + TIMES) == Window(5, 10)
    assert Window(5, 9.5).within(begin + TIMES) == Window(5, 9.5)


@pytest.mark.parametrize("start", [10, 12])
def test_window_after_the_end(start):
    assert error_of(Window(start, 15).within, 3.0 + TIMES) == (
        f"window '{start}:15' begins after the end of the runs; they last 10 s"
    )


@pytest.mark.parametrize(
    "window", [Window(0, 10), Window(2, 5), Window(1.25, 3.5), Window(4.2, 4.6), Window(0.25, 9.75)]
)
def test_cut_interpolates_its_ends(window):
    times, values = window.cut(TIMES, np.stack([3 * TIMES, 1 - TIMES]))
    assert (times[0], times[-1]) == (window.start, window.stop)
    # Linear signals are interpolated up to rounding.
    assert values == pytest.approx(np.stack([3 * times, 1 - times]), abs=1e-14)


def test_cut_keeps_samples_as_they_are():
    """Nothing of what lies outside comes in, nor of one sample into the next."""
    values = np.random.default_rng(1).normal(size=(2, 11, 3))
    values[:, [0, 1, 4, 6]] = np.nan
    times, cut = Window(2, 5).cut(TIMES, values)
    assert np.array_equal(times, [2, 3, 4, 5])
    assert np.array_equal(cut, values[:, 2:6], equal_nan=True)


@pytest.mark.parametrize("start", [2 - 1e-9, 2 + 1e-9])
@pytest.mark.parametrize("stop", [5 - 1e-9, 5 + 1e-9])
def test_ends_that_are_samples_up_to_rounding_are_these_samples(start, stop):
    times, cut = Window(start, stop).cut(TIMES, TIMES[None])
    assert times.tolist() == cut[0].tolist() == [2, 3, 4, 5]
    # What rounding is depends on how long the runs are, and not on when they begin.
    times, _ = Window(2 + 1e-7, 5).cut(1e4 + TIMES, TIMES[None])
    assert times[0] == 10002.0000001


def test_ends_are_relative_to_the_first_sample_and_between_two_samples():
    """x = t² at whole seconds: at 1½ s it is 2½, not what the next samples would say."""
    times, cut = Window(1.5, 4.5).cut(3.0 + TIMES, TIMES[None] ** 2)
    assert times.tolist() == [4.5, 5.0, 6.0, 7.0, 7.5]
    assert cut.tolist() == [[2.5, 4.0, 9.0, 16.0, 20.5]]


def test_a_window_between_two_samples_has_the_line_between_them():
    """x = t² from 0 to 1, from 4 to 9 and from 81 to 100 s."""
    for start, first, last in ((0.25, 0.25, 0.75), (2.25, 5.25, 7.75), (9.25, 85.75, 95.25)):
        times, cut = Window(start, start + 0.5).cut(TIMES, TIMES[None] ** 2)
        assert times.tolist() == [start, start + 0.5]
        assert cut.tolist() == [[first, last]]


@pytest.mark.parametrize("window", [Window(3.0), Window(3.0, 50.0)])
def test_cut_ends_with_the_samples(window):
    times, values = window.cut(TIMES, np.stack([TIMES, -TIMES]))
    assert np.array_equal(times, TIMES[3:])
    assert np.array_equal(values, [TIMES[3:], -TIMES[3:]])
