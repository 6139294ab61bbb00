"""What is said of small configurations."""

import pytest
from said import error_of


@pytest.fixture
def message(experiment):
    """What is said of `c.yaml` with changes and overrides."""

    def said(*overrides, **changes):
        return error_of(experiment, *overrides, **changes)

    return said
