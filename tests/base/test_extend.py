"""What plugins import from one place."""

import pytest

from eqt_cli import extend
from eqt_cli.base.expressions import formula
from eqt_cli.figures.cells import scale_norm
from eqt_cli.numbers.jets import value_and_derivative


@pytest.mark.parametrize("offered", [formula, value_and_derivative, scale_norm])
def test_what_references_and_figures_of_eqt_use_is_offered_to_plugins(offered):
    assert getattr(extend, offered.__name__) is offered
