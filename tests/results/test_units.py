"""Units of what is computed from signals."""

import pytest

from eqt_cli.results.quantity import Quantity


@pytest.mark.parametrize(
    ("pattern", "unit", "expected"),
    [
        ("({})^2 s", "N m", "(N m)^2 s"),
        ("({})^2 s", "rad/s", "(rad/s)^2 s"),
        ("({})^2 s", "N", "N^2 s"),
        ("({})^2 s", "1", "s"),
        ("({})^2 s", "mixed", "mixed"),
        ("{}", "1", "1"),
        ("s", "mixed", "s"),
    ],
)
def test_only_what_has_several_symbols_is_in_brackets(pattern, unit, expected):
    assert Quantity("effort", "control effort", units=pattern).unit(unit) == expected
