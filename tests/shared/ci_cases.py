"""Cases of a test of which a few are enough outside CI."""

import pytest


def mostly_ci(argument, cases, fast, why, **options):
    """Try a test on cases, which only CI tries for this reason, but a few."""
    mark = pytest.mark.ci(why)
    marked = [pytest.param(case, marks=[mark] * (case not in fast)) for case in cases]
    return pytest.mark.parametrize(argument, marked, **options)
