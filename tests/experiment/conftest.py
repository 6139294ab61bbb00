"""Small configurations as text, so that places in them are known."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from eqt_cli.config.source import read_config
from eqt_cli.core import registry
from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.build import Experiment, build
from eqt_cli.experiment.sweeping import study
from eqt_cli.run.execute import Outcome, execute

LINES = {
    "group": "SO3",
    "inertia": "[2, 1, 3]",
    "gains": "{kp: 1.0, kd: 0.5}",
    "reference": '{torque: ["cos(t)", "sin(t)", "0"]}',
    "controllers": "[eqt, gt]",
    "initial": "{pose: haar, velocity: normal}",
    "ensemble": "{runs: 3, seed: 1}",
    "time": "{duration: 1.0, samples: 11}",
    "solver": "{rtol: 1.0e-6, cross_check: 0}",
}
"""A configuration that is fine: one section a line, from line 1 on."""


def configuration(**changes: str | None) -> str:
    """`LINES` with sections replaced, left out (None) or, where new, added at the end."""
    lines = {**LINES, **changes}
    return "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None)


@pytest.fixture(autouse=True)
def _no_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin that one test loads is unknown to the next."""
    monkeypatch.setattr(registry, "_loaded_plugins", {})
    for one in registry._registries:
        monkeypatch.setattr(one, "_plugins", {})


@pytest.fixture
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty current folder."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def experiment(folder: Path) -> Callable[..., Experiment]:
    """Builds `c.yaml`: `LINES` with changes, and overrides as of ``--set``."""

    def built(*overrides: str, **changes: str | None) -> Experiment:
        Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
        return build(read_config(Path("c.yaml"), overrides))

    return built


@pytest.fixture
def run(folder: Path) -> Callable[..., Outcome]:
    """Runs `c.yaml`, with changes and overrides, in the folder `out`."""

    def done(
        *overrides: str, out: str = "out", force: bool = False, **changes: str | None
    ) -> Outcome:
        Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
        source = read_config(Path("c.yaml"), overrides)
        return execute(study(source), Path(out), force=force)

    return done


@pytest.fixture
def message(experiment: Callable[..., Experiment]) -> Callable[..., str]:
    """What is said of `c.yaml` with changes and overrides."""

    def said(*overrides: str, **changes: str | None) -> str:
        with pytest.raises(EqtError) as caught:
            experiment(*overrides, **changes)
        return str(caught.value)

    return said
