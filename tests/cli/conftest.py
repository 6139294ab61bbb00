"""The command line as users call it, within this process and in one of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import pytest

from eqt_cli.cli import main
from eqt_cli.core import registry

CONFIG = """\
group: SO3
inertia: [2, 1, 3]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "0"]}
controllers: [eqt, gt]
initial: {pose: haar, velocity: normal}
ensemble: {runs: 3, seed: 1}
time: {duration: 1.0, samples: 11}
solver: {rtol: 1.0e-6, cross_check: 0}
"""


@dataclass(frozen=True)
class Done:
    """How a command ended."""

    code: int
    out: str
    err: str


Eqt = Callable[..., Done]


@pytest.fixture(autouse=True)
def _no_plugins(monkeypatch: pytest.MonkeyPatch) -> None:
    """A plugin that one test loads is unknown to the next."""
    monkeypatch.setattr(registry, "_loaded_plugins", {})
    for one in registry._registries:
        monkeypatch.setattr(one, "_plugins", {})


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a small configuration in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setenv("NO_COLOR", "1")
    (tmp_path / "c.yaml").write_text(CONFIG, encoding="utf-8")
    return tmp_path


@pytest.fixture(scope="session")
def _kept() -> dict[tuple[str, ...], tuple[Done, Path]]:
    """How a command ended and a copy of its folder."""
    return {}


@pytest.fixture
def eqt(
    folder: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
    tmp_path_factory: pytest.TempPathFactory,
    _kept: dict[tuple[str, ...], tuple[Done, Path]],
) -> Eqt:
    """Calls the command within this process.

    What `run` or `sweep` makes with ``--quiet`` in the untouched folder is computed once.
    """

    def call(*arguments: object) -> Done:
        words = tuple(map(str, arguments))
        makes = words[:1] in (("run",), ("sweep",)) and words[1:2] == ("c.yaml",)
        makes = makes and bool({"-q", "--quiet"} & set(words))
        config = folder / "c.yaml"
        alone = makes and list(folder.iterdir()) == [config] and config.read_text() == CONFIG
        if alone and words in _kept:
            done, copy = _kept[words]
            shutil.copytree(copy, folder, dirs_exist_ok=True)
            return done
        done = called(words)
        if alone:
            _kept[words] = done, tmp_path_factory.mktemp("kept") / "folder"
            shutil.copytree(folder, _kept[words][1])
        return done

    def called(words: tuple[str, ...]) -> Done:
        monkeypatch.setattr(sys, "argv", ["eqt", *words])
        # Click would call the program after the module that Python was started with.
        monkeypatch.setattr(sys.modules["__main__"], "__package__", None)
        with pytest.raises(SystemExit) as exit_:
            main()
        out, err = capsys.readouterr()
        return Done(int(exit_.value.code or 0), out, err)

    return call


@pytest.fixture
def process() -> Eqt:
    """Calls the command in a process of its own."""

    def call(*arguments: object, **environment: str) -> Done:
        done = subprocess.run(
            [sys.executable, "-m", "eqt_cli", *map(str, arguments)],
            capture_output=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment},
            check=False,
        )
        return Done(done.returncode, done.stdout, done.stderr)

    return call
