"""The command line as users call it, within this process and in one of its own."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import pytest
from small_experiment import configuration


class Done(NamedTuple):
    """How a command ended."""

    code: int
    out: str
    err: str


Eqt = Callable[..., Done]


@pytest.fixture(autouse=True)
def folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The current folder, with a small configuration in it."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setenv("NO_COLOR", "1")
    (tmp_path / "c.yaml").write_text(configuration(), encoding="utf-8")
    return tmp_path


@pytest.fixture
def untimed(monkeypatch: pytest.MonkeyPatch) -> None:
    """Dry runs that time nothing: every run takes 0.1 s."""
    monkeypatch.setattr("eqt_cli.execution.cost._time_per_run", lambda *_: 0.1)


@pytest.fixture(scope="session")
def _kept() -> dict[tuple[str, ...], tuple[Done, Path]]:
    """How a command ended and a copy of its folder."""
    return {}


@pytest.fixture
def eqt(
    eqt: Eqt,
    folder: Path,
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
        alone = makes and list(folder.iterdir()) == [config]
        alone = alone and config.read_text() == configuration()
        if alone and words in _kept:
            done, copy = _kept[words]
            shutil.copytree(copy, folder, dirs_exist_ok=True)
            return done
        done = eqt(*words)
        if alone:
            _kept[words] = done, tmp_path_factory.mktemp("kept") / "folder"
            shutil.copytree(folder, _kept[words][1])
        return done

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
