"""What is said of small configurations."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.experiment import Experiment


@pytest.fixture
def message(experiment: Callable[..., Experiment]) -> Callable[..., str]:
    """What is said of `c.yaml` with changes and overrides."""

    def said(*overrides: str, **changes: str | None) -> str:
        with pytest.raises(EqtError) as caught:
            experiment(*overrides, **changes)
        return str(caught.value)

    return said
