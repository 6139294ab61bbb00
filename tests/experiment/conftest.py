"""What is said of small configurations, and no plugin that outlives its test."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from eqt_cli.core import registry
from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.experiment import Experiment


@pytest.fixture(autouse=True)
def _no_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin that one test loads is unknown to the next."""
    monkeypatch.setattr(registry, "_loaded_plugins", {})
    for one in registry._registries:
        monkeypatch.setattr(one, "_plugins", {})


@pytest.fixture
def message(experiment: Callable[..., Experiment]) -> Callable[..., str]:
    """What is said of `c.yaml` with changes and overrides."""

    def said(*overrides: str, **changes: str | None) -> str:
        with pytest.raises(EqtError) as caught:
            experiment(*overrides, **changes)
        return str(caught.value)

    return said
