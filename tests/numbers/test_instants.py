"""The times at which expressions change their piece: closed forms, and their number."""

import numpy as np
import pytest
from scipy.optimize import brentq

from eqt_cli.base.errors import InputError
from eqt_cli.engines.engine import together
from eqt_cli.extend import parse
from eqt_cli.numbers.instants import MOST_INSTANTS, Interval, instants
from eqt_cli.numbers.jets import series


def changes(text, until):
    """The changes of an expression, one for the two times around each."""
    return together(np.array(instants(parse(text), until)), np.array([0.0, until]))[0]


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("sin(t)", ()),
        ("step(t, 2)", (2.0,)),
        ("where(t <= 1, 0, t)", (1.0,)),
        ("smoothstep(t, 1, 3)", (1.0, 3.0)),
        ("max(t, 2, 4 - 2*t)", (1.0, 4 / 3, 2.0)),
        ("step(1, 2)*t", ()),
        ("step(sin(1), 0)", ()),
    ],
)
def test_times_in_numbers_are_read_off(text, expected):
    assert instants(parse(text), 5.0)[-1:] == expected[-1:]  # not moved by rounding
    assert changes(text, 5.0) == pytest.approx(expected, rel=1e-14)


def after(first, period, until=50.0):
    """The times from the first one on, a period apart, within a horizon."""
    return [t for t in np.arange(first, until, period) if t > 1e-9]


ARC = np.arcsin(0.9)
FOLD = np.arcsin(0.3) / 3


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (
            "where(sin(2*pi*t/7) > 0.9, 1, 0)",
            [*after(3.5 * ARC / np.pi, 7), *after(3.5 - 3.5 * ARC / np.pi, 7)],
        ),
        ("sign(cos(t/2))", after(np.pi, 2 * np.pi)),
        ("sign(sin(2*pi*t/2.5))", after(1.25, 1.25)),  # also at eighths of the horizon
        ("step(2*t - 1, 3)", [2.0]),
        ("mod(t, 7)", after(7.0, 7.0)),
        ("where(mod(t - 1, 7) < 2.5, 1, 0)", [*after(1.0, 7.0), *after(3.5, 7.0)]),
        ("pulse(t, 10, 2, 3)", [*after(2.0, 10.0), *after(3.0, 10.0)]),
        ("floor(sin(t))", after(np.pi, np.pi)),  # and it touches 1
        (
            "where(3*sin(t) - 4*sin(t)**3 > 0.3, 1, 0)",
            [*after(FOLD, 2 * np.pi / 3), *after(np.pi / 3 - FOLD, 2 * np.pi / 3)],
        ),
        ("where(t**2 < 600.25, 1, 0)", [24.5]),
        (
            "where(sin(t**2/50) < 0.5, 1, 0)",
            [np.sqrt(50 * (k * np.pi + (-1) ** k * np.pi / 6)) for k in range(16)],
        ),
        ("max(abs(t - 30), 5)", [25.0, 30.0, 35.0]),
        ("atan(tan(t/4))", after(2 * np.pi, 4 * np.pi)),
        ("tanh(1/sin(t/4))", after(4 * np.pi, 4 * np.pi)),
        ("where(where(t < 30, t, t - 25) > 10, 1, 0)", [10.0, 30.0, 35.0]),
        ("where(step(sin(t/3), 0)*t > 20, 1, 0)", [20.0, *after(3 * np.pi, 3 * np.pi)]),
        (
            "min(exp(t/10), 30 - cosh(t/20))",
            [brentq(lambda t: np.exp(t / 10) - 30 + np.cosh(t / 20), 30, 40)],
        ),
    ],
)
def test_all_changes_are_found(text, expected):
    found, expected = changes(text, 50.0), np.array(sorted(expected))
    if "floor(sin" in text:
        found = [t for t in found if min(abs(t - expected)) < 1e-3]
    inside = np.array([t for t in found if 0 < t < 50])
    assert inside == pytest.approx(expected[expected < 50], rel=1e-9)


@pytest.mark.parametrize("seed", range(2))
def test_no_change_of_a_random_wave_is_lost(seed):
    rng = np.random.default_rng(seed)
    a, w, p = rng.uniform(0.3, 1, 3), rng.uniform(0.5, 6, 3), rng.uniform(0, 6, 3)
    wave = " + ".join(f"{a[k]}*sin({w[k]}*t + {p[k]})" for k in range(3))
    found = changes(f"where({wave} > {0.4 * a.sum()}, 1, 0)", 40.0)
    t = np.linspace(0, 40, 200_001)
    above = (a * np.sin(np.multiply.outer(t, w) + p)).sum(axis=1) > 0.4 * a.sum()
    expected = t[1:][np.diff(above)]
    assert found == pytest.approx(expected, abs=2.1e-4)  # the spacing of t


@pytest.mark.parametrize(
    ("text", "number"), [("pulse(t, 1e-5, 0, 2e-6)", "1e+06"), ("sign(sin(pi*1e6*t))", "1e+07")]
)
def test_too_many_changes_are_an_error_with_their_number(text, number):
    with pytest.raises(
        InputError, match=rf"^'[^']*' changes its piece about {number.replace('+', '.')}"
    ) as caught:
        instants(parse(text), 10.0)
    assert f"{MOST_INSTANTS:,}" in str(caught.value)


@pytest.mark.ci("divides the horizon to the end")
def test_what_rounding_decides_is_an_error():
    with pytest.raises(InputError, match="may be equal"):
        instants(parse("where(sin(t)**2 + cos(t)**2 > 1, 1, 0)"), 10.0)


TEXTS = [
    *("sin(t) - cos(2*t)", "tan(t/3)", "asin(t/9) + acos(t/9)", "exp(-t)*sinh(t)", "cosh(t - 2)"),
    *("atanh(t/9)/(1 + t**2)", "acosh(1 + t)", "log(1 + t)*tanh(t - 1)", "sqrt(t)*asinh(t - 2)"),
    *("(t - 2)**3", "(1 + t)**-2", "(1 + t)**0.3", "(1 + t)**t", "2**(t - 1)", "abs(t - 2)*t"),
    *("where(t < 2, t, 4 - t)", "min(t, 3 - t, sin(t))", "smoothstep(t, 1, 3)", "atan2(t - 2, -1)"),
    *("floor(t)", "mod(t, 1.5)", "atan(t - 2)**2", "1/(t - 2.05)", "(t - 2)**4"),
]


@pytest.mark.parametrize("text", TEXTS)
def test_an_interval_encloses_values_and_rates(text):
    low = np.linspace(0.0, 3.9, 14)
    high = low + np.linspace(0.01, 0.6, 14)
    expression = parse(text)
    with np.errstate(all="ignore"):
        wide = series(expression, {"t": Interval(low, high)}, 1)
        points = low + np.linspace(0.0, 1.0, 50)[:, None] * (high - low)
        narrow = series(expression, {"t": points}, 1)
    for found, exact in ((wide.value, narrow.value), (wide.derivative(1), narrow.derivative(1))):
        bounds = Interval.of(found, low.shape)
        slack = 1e-14 * (1 + np.abs(exact))
        assert (bounds.low - slack <= exact).all()
        assert (exact <= bounds.high + slack).all()


def test_an_interval_without_numbers_has_none():
    with np.errstate(all="ignore"):
        found = parse("sqrt(t)").evaluate(
            {"t": Interval(np.array([-2.0, -1.0]), np.array([-1.0, 4.0]))}
        )
    assert np.isnan([found.low[0], found.high[0]]).all()
    assert (found.low[1], found.high[1]) == (0.0, 2.0)


@pytest.mark.parametrize(
    "text",
    [
        *("3.5e5*exp(-((t - 3)/1e-5)**2/2)", "tanh((t - 3)/1e-5)", "1/(1 + (1e5*(t - 3))**2)"),
        *("exp(-1e7*(t**2 - 9)**2)", "exp(1e10*(cos(t - 3) - 1))", "cos(t - 3)**1e10"),
        "sin(5*t) + exp(-((t - 3)/1e-5)**2)",
    ],
)
def test_the_sides_of_a_short_pulse_are_instants(text):
    before, within, after = instants(parse(text), 5.0)
    assert 3 - 1e-3 < before < 3 - 1e-5 < within == pytest.approx(3, abs=3e-5)
    assert 3 + 1e-5 < after < 3 + 1e-3


def test_several_pulses_are_found():
    many = instants(parse("exp(-1e9*cos(pi*t/2)**2)"), 8.0)
    assert many[1::3] == pytest.approx([1, 3, 5, 7], abs=3e-5)
    two = instants(parse("exp(-((t - 3)/1e-5)**2) - exp(-((t - 5)/1e-5)**2)"), 10.0)
    assert two[1::3] == pytest.approx([3, 5], abs=1e-4)
    hidden = instants(parse("exp(-1e12*sin(1e4*t)**2)"), 0.01)
    assert hidden[3::3] == pytest.approx(np.arange(1, 32) * np.pi * 1e-4, abs=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        *("cos(t - 3)", "sin(1e5*(t - 3))", "exp(-(t - 3)**2)", "(t - 3)**2", "exp(t)/9"),
        *("5 + cos(t)*sin(3*t)", "sqrt(t + 1)", "atan(t - 3) + log(1 + t)"),
    ],
)
def test_a_slow_or_lasting_change_has_no_instants(text):
    assert instants(parse(text), 10.0) == ()
