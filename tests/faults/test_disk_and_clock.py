"""What else happens to a run: a disk that fails, a clock that jumps, another process, a kill."""

import errno
import io
import os
import random
import subprocess
import sys
import time
from pathlib import Path

import pytest
from faults_harness import CONFIG, FLIGHT, START, Session, assert_equal, contents

from eqt_cli import api
from eqt_cli.extend import EqtError, Native

# Limits that the reference does not reach, or eqt remarks on them.
SMALL = f"{CONFIG}ensemble: {{runs: 4, seed: 1}}\n{FLIGHT.replace('[0.8, 1.2]', '[1.2, 1.4]')}"
NATIVE = SMALL.replace("rtol:", "engine: native, rtol:")

pytestmark = pytest.mark.ci("runs experiments, some in processes of their own")


@pytest.fixture
def config(tmp_path, monkeypatch):
    if missing := Native.unavailable():
        pytest.skip(missing)
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr("eqt_cli.config.study.PART_RUNS", 2)
    monkeypatch.setattr("eqt_cli.runs.run_study.UNSAVED_SECONDS", 0.0)
    Path("c.yaml").write_text(NATIVE, encoding="utf-8")
    return Path("c.yaml")


@pytest.fixture
def expected(config):
    api.run(config, "expected")
    return contents(Path("expected"))


@pytest.mark.parametrize(
    ("name", "number"),
    [("manifest.json", errno.EIO), ("000001.npy", errno.ENOSPC), ("results.h5", errno.EIO)],
)
def test_what_cannot_be_written_is_written_later(config, expected, monkeypatch, name, number):
    opened = io.FileIO

    class Failing(opened):  # a name for the class it replaces
        def write(self, data):
            if name in str(self.name):
                raise OSError(number, os.strerror(number))
            return int(super().write(data))

    with monkeypatch.context() as patch:
        patch.setattr(io, "FileIO", Failing)
        with pytest.raises(EqtError, match=f"(?i){os.strerror(number)}"):
            api.run(config, "out")
    assert not list(Path("out").rglob("*.tmp"))
    api.run(config, "out")
    assert_equal(Path("out"), expected)


def test_a_clock_that_jumps_changes_nothing(config, expected, monkeypatch):
    rng = random.Random(1)
    monkeypatch.setattr(time, "time", lambda: rng.choice([0.0, 1e9, 4e9]))
    api.run(config, "out")
    assert_equal(Path("out"), expected)


def test_of_two_processes_on_one_folder_one_says_so(config, expected):
    sessions = [Session("run", config, Path("out"), ["--executor", "serial"]) for _ in range(2)]
    said = [session.process.communicate(timeout=100) for session in sessions]
    codes = [session.process.returncode for session in sessions]
    assert 0 in codes
    for code, (_, err) in zip(codes, said, strict=True):
        assert code == 0 or (code == 2 and "out: " in err), err
    assert_equal(Path("out"), expected)


@pytest.mark.parametrize(
    ("command", "given"), [("export", "c.yaml"), ("report", "expected")], ids=["export", "report"]
)
def test_a_kill_leaves_whole_files_or_none(config, expected, command, given):
    """The result of a report is that of native; the states of an export come from its runs."""
    del expected

    def begun(out):
        page = [f"{out}.html", "--date", "2026-01-01", "--figure", "paper"]
        words = page if command == "report" else [out]
        return subprocess.Popen(
            [sys.executable, "-c", START, command, given, "--out", *words],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )

    def files(out):
        found = Path().glob(f"{out}.html" if command == "report" else f"{out}/*")
        return {path.name.replace(out, ""): path.read_bytes() for path in found}

    started = time.monotonic()
    assert begun("whole").wait() == 0
    duration, rng = time.monotonic() - started, random.Random(command)
    whole = files("whole")
    process = begun("killed")
    time.sleep(rng.uniform(0.5, 1.0) * duration)
    process.kill()
    process.wait()
    for name, content in files("killed").items():
        assert ".tmp" in name or content == whole[name], name
    assert begun("killed").wait() == 0
    left = {name: text for name, text in files("killed").items() if ".tmp" not in name}
    assert left == whole
