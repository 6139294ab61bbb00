"""Ctrl-C, as a terminal sends it, and the signals of clusters and of terminals that are closed."""

import json
import os
import random
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from faults_harness import (
    RUN,
    START,
    SWEEP,
    TIMEOUT,
    Session,
    assert_equal,
    check_left_over,
    contents,
    parts,
)

from eqt_cli.extend import Native

pytestmark = [
    pytest.mark.skipif(os.name != "posix", reason="has no process groups"),
    pytest.mark.ci("starts eqt, and its workers"),
]

LONG = RUN.replace("runs: 200", "runs: 4000")
EXECUTORS = {
    "serial": ["--executor", "serial"],
    "threads": ["--executor", "threads", "--workers", "2"],
    "local": ["--executor", "local", "--workers", "2"],
}


def started(tmp_path, command, text, options, least=2):
    """A session that has kept some parts."""
    config = tmp_path / "config.yaml"
    config.write_text(text, encoding="utf-8")
    session = Session(command, config, tmp_path / "out", options)
    while session.running and len(parts(tmp_path / "out")) < least:
        time.sleep(0.01)
    return session


def kept(session, total):
    """How many runs it says it has kept, in the one message that it leaves."""
    stdout, stderr = session.process.communicate(timeout=TIMEOUT)
    if stderr == "eqt: interrupted; run the same command again\n":
        return 0  # a busy machine had not begun
    done = stderr.split("interrupted; ")[1].split(" of ")[0]
    whole = " (whole parts of 200 are)" if done == "0" else ""
    assert stderr == (
        f"eqt: interrupted; {done} of {total} runs are kept in {session.out}{whole}: "
        "run the same command again to continue\n"
    )
    document = json.loads(stdout)
    assert document["exit_code"] == session.process.returncode
    assert document["error"].startswith("interrupted; ")
    return int(done)


@pytest.mark.parametrize(
    ("command", "text", "executor", "total"),
    [("run", RUN, "serial", 400), ("sweep", SWEEP, "local", 360)],
)
def test_ctrl_c_says_how_to_continue_and_loses_nothing(tmp_path, command, text, executor, total):
    options = EXECUTORS[executor]
    session = started(tmp_path, command, text, options)
    before = parts(session.out)
    os.killpg(session.process.pid, signal.SIGINT)
    done = kept(session, total)
    assert session.process.returncode == 130
    assert done >= 30 * len(before)
    check_left_over(session.out, before)
    assert Session(command, session.config, session.out, options).finish()["resumed"] == done
    Session(command, session.config, tmp_path / "whole", EXECUTORS["serial"]).finish()
    assert_equal(session.out, contents(tmp_path / "whole"))


@pytest.mark.parametrize("executor", EXECUTORS)
def test_ctrl_c_ends_a_long_call_of_c_and_keeps_its_finished_runs(tmp_path, executor):
    """A call of C takes 3 s of a core, for eight runs at a time; it need not be the first."""
    text = RUN.replace("rtol: 1.0e-6, block: 10", "engine: native")
    text = text.replace("duration: 1.0", "duration: 20000")
    for seconds in (4, 7, 12, 20):  # a busy machine needs longer for the first eight
        (folder := tmp_path / str(seconds)).mkdir()
        session = started(folder, "run", text, EXECUTORS[executor], least=0)
        time.sleep(seconds)
        begun = time.monotonic()
        os.killpg(session.process.pid, signal.SIGINT)
        runs = kept(session, 400)
        assert time.monotonic() < begun + 2
        assert not parts(session.out)
        if runs:
            return
    pytest.fail(f"no run ended in {seconds} s")


def test_a_second_ctrl_c_changes_nothing(tmp_path):
    session = started(tmp_path, "run", LONG, EXECUTORS["threads"])
    os.killpg(session.process.pid, signal.SIGINT)
    time.sleep(0.2)
    if session.running:
        os.killpg(session.process.pid, signal.SIGINT)
    assert kept(session, 8000) > 0
    assert session.process.returncode == 130


@pytest.mark.parametrize(
    ("executor", "name", "code"), [("serial", "SIGTERM", 143), ("local", "SIGHUP", 129)]
)
def test_what_clusters_and_closed_terminals_send(tmp_path, executor, name, code):
    session = started(tmp_path, "run", LONG, EXECUTORS[executor])
    os.killpg(session.process.pid, getattr(signal, name))
    assert kept(session, 8000) > 0
    assert session.process.returncode == code


def test_a_signal_that_is_ignored_stays_ignored(tmp_path):
    config = tmp_path / "config.yaml"
    config.write_text(RUN.replace("runs: 200", "runs: 50"), encoding="utf-8")
    code = f"import signal; signal.signal(signal.SIGHUP, signal.SIG_IGN); {START}"
    words = ["run", str(config), "--out", str(tmp_path / "out"), "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words], stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    while process.poll() is None and not (tmp_path / "out/manifest.json").exists():
        time.sleep(0.01)
    process.send_signal(signal.SIGHUP)
    _, stderr = process.communicate(timeout=TIMEOUT)
    assert (process.returncode, stderr) == (0, b"")


def test_ctrl_c_while_typer_reads_the_command_line_is_one_line():
    code = f"""
import signal
from eqt_cli.cli.app import _Commands
_Commands.make_context = lambda *_, **__: signal.raise_signal(signal.SIGINT)
{START}
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert (done.returncode, done.stdout) == (130, "")
    assert done.stderr == "eqt: interrupted; run the same command again\n"


@pytest.mark.parametrize("seed", range(2))
def test_ctrl_c_while_libraries_load_is_one_line(tmp_path, seed):
    text = LONG
    if not Native.unavailable():
        text = text.replace("{rtol", "{engine: native, rtol").replace(" block: 2,", "")
    (tmp_path / "config.yaml").write_text(text, encoding="utf-8")
    code = "from eqt_cli.cli import main; print('ready', flush=True); main()"
    words = ["run", "config.yaml", "--out", "out", "--quiet"]
    process = subprocess.Popen(
        [sys.executable, "-c", code, *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
    )
    assert process.stdout.readline() == "ready\n"
    time.sleep(0.05 + random.Random(seed).uniform(0, 0.4))
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=TIMEOUT)
    assert process.returncode == 130
    assert stdout == ""
    assert stderr.startswith("eqt: interrupted; ")
    assert stderr.count("\n") == 1


def _lives(pid):
    try:
        state = Path(f"/proc/{pid}/stat").read_text().rpartition(") ")[2][0]
    except OSError:
        return False
    return state not in "ZX"


@pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="finds processes as Linux does")
def test_workers_end_with_their_parent(tmp_path):
    session = started(tmp_path, "run", LONG, EXECUTORS["local"])
    workers = session.workers()
    assert len(workers) == 2
    session.process.kill()
    deadline = time.monotonic() + TIMEOUT  # they wait for ever, or end soon
    while any(map(_lives, workers)) and time.monotonic() < deadline:
        time.sleep(0.01)
    living = list(filter(_lives, workers))
    session.process.communicate(timeout=TIMEOUT)
    assert not living
