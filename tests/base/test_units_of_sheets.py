"""Units as data sheets write them, and units that have two readings or none."""

import math

import pytest

from eqt_cli.base.option_types import Written, number_of
from eqt_cli.base.units import split

DEGREE, G = math.pi / 180, 9.80665


@pytest.mark.parametrize(("text", "unit", "number"), [
    ("4 dps", "rad/s", 4 * DEGREE),
    ("4 mdps/√Hz", "rad/sqrt(s)", 4e-3 * DEGREE),
    ("0.01 deg/sec/rtHz", "rad/sqrt(s)", 0.01 * DEGREE),
    ("0.0135 deg/sec/sqrt(hz)", "rad/sqrt(s)", 0.0135 * DEGREE),
    ("0.4 mg/rtHz", "m/s/sqrt(s)", 0.4e-3 * G),
    ("1e-4 g/sqrt(h)", "m/s^2/sqrt(s)", 1e-4 * G / 60),
    ("0.2 g", "m/s^2", 0.2 * G),
    ("2 g", "kg", 2e-3),
    ("2 g cm^2", "kg m^2", 2e-7),
])  # fmt: skip
def test_a_unit_of_a_sheet_is_that_number(text, unit, number):
    assert number_of(Written(text, [unit])) == pytest.approx(number, rel=1e-14)  # rounding


@pytest.mark.parametrize(("text", "unit", "offered"), [
    ("3 G", "T", ["T, uT or nT", "100 uT", "g for an acceleration"]),  # 1 G = 1e-4 T
    ("0.4 mG/√Hz", "m/s/sqrt(s)", ["ug/sqrt(Hz)", "0.1 uT", "mg for an acceleration"]),
    ("2 furlong/sqrt(h)", "rad/s", ["rad/s, deg/s"]),
    ("2 knots/√Hz", "m/s", ["m/s, cm/s"]),
    ("0.2 g_0", "m/s^2", ["m/s^2, ug or mg"]),
    ("0.3 deg/h^0.5", "rad/sqrt(s)", ["deg/sqrt(h)"]),
    ("3e-3 deg/s/root(Hz)", "rad/sqrt(s)", ["deg/s/sqrt(Hz)"]),
    ("1/2 turn", "rad", ["rad, mrad, deg"]),
])  # fmt: skip
def test_an_unknown_unit_is_refused_with_those_that_do(text, unit, offered):
    with pytest.raises(ValueError, match=r"expected a number or an? ") as refused:
        number_of(Written(text, [unit]))
    assert text in str(refused.value) and "operator" not in str(refused.value)
    assert all(words in str(refused.value) for words in offered)


def test_a_unit_may_stand_behind_the_time():
    assert split("30*t deg") == ("30*t", "deg")
    assert split("2*th") is None  # a name, not t in hours
