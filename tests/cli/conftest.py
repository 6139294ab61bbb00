"""The command line as users call it, within this process and in one of its own."""

import os
import shutil
import subprocess
import sys
from collections import namedtuple

import pytest
from small_experiment import configuration

Done = namedtuple("Done", "code out err")
"""How a command ended."""


@pytest.fixture(autouse=True)
def folder(folder, monkeypatch):
    """The current folder, with a small configuration in it."""
    monkeypatch.setenv("NO_COLOR", "1")
    (folder / "c.yaml").write_text(configuration(), encoding="utf-8")
    return folder


@pytest.fixture
def untimed(monkeypatch):
    """Dry runs that time nothing: every run takes 0.1 s."""
    monkeypatch.setattr("eqt_cli.runs.preflight._time_per_run", lambda *_: 0.1)


@pytest.fixture(scope="session")
def _kept():
    """How a command ended and a copy of its folder."""
    return {}


@pytest.fixture
def eqt(eqt, folder, tmp_path_factory, _kept):
    """Calls the command within this process.

    What `run` or `sweep` makes with ``--quiet`` in the untouched folder is computed once.
    """

    def call(*arguments):
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
def result(eqt):
    """A result of the small configuration, in this folder."""
    eqt("run", "c.yaml", "--out", "out", "--quiet")
    return "out"


@pytest.fixture
def process():
    """Calls the command in a process of its own."""

    def call(*arguments, **environment):
        done = subprocess.run(
            [sys.executable, "-m", "eqt_cli", *map(str, arguments)],
            capture_output=True,
            encoding="utf-8",
            env={**os.environ, "PYTHONIOENCODING": "utf-8", **environment},
            check=False,
        )
        return Done(done.returncode, done.stdout, done.stderr)

    return call
