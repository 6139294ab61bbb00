"""A folder that a colleague sent, in which everything is hostile, and the commands that meet it."""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from eqt_cli.cli import main
from eqt_cli.core import registry

CONFIG = """\
group: SO3
inertia: 1.0
gains: {kp: 1.0, kd: 0.5}
reference: {torque: [0, 0, 0]}
controllers: [eqt]
initial: {pose: haar}
ensemble: {runs: 2, seed: 1}
time: {duration: 0.1, samples: 2}
solver: {rtol: 1.0e-3, cross_check: 0}
"""


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    code: int
    out: str
    err: str


@pytest.fixture(autouse=True)
def _no_plugins(monkeypatch):
    """A plugin that one test loads is unknown to the next."""
    monkeypatch.setattr(registry, "_loaded_plugins", {})
    for one in registry._registries:
        monkeypatch.setattr(one, "_plugins", {})


@pytest.fixture
def sent(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The colleague's folder, which is the current one; beside it lies what is the user's."""
    folder = tmp_path / "sent"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (folder / "c.yaml").write_text(CONFIG, encoding="utf-8")
    return folder


@pytest.fixture
def eqt(capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch) -> Callable[..., Done]:
    """Calls the command within this process."""

    def call(*arguments: object) -> Done:
        monkeypatch.setattr(sys, "argv", ["eqt", *map(str, arguments)])
        with pytest.raises(SystemExit) as exit_:
            main()
        out, err = capsys.readouterr()
        assert "Traceback" not in err
        return Done(int(exit_.value.code or 0), out, err)

    return call
