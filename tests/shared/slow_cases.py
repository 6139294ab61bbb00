"""Cases of a test of which a few are enough every time."""

import pytest


def mostly_slow(argument, cases, fast, why, **options):
    """Try a test on cases, which all are slow for this reason but a few."""
    mark = pytest.mark.slow(why)
    marked = [pytest.param(case, marks=[mark] * (case not in fast)) for case in cases]
    return pytest.mark.parametrize(argument, marked, **options)
