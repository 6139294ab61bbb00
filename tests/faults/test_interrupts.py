"""Ctrl-C, as a terminal sends it: to the command and all of its workers."""

import json
import os
import signal
import time

import pytest
from faults_harness import RUN, SWEEP, Session, assert_equal, check_left_over, contents, parts

pytestmark = pytest.mark.skipif(os.name != "posix", reason="has no process groups")


@pytest.mark.parametrize(
    ("command", "text", "options"),
    [
        ("run", RUN, ["--executor", "serial"]),
        ("sweep", SWEEP, ["--executor", "local", "--workers", "2"]),
    ],
)
def test_ctrl_c_says_how_to_continue_and_loses_nothing(tmp_path, command, text, options):
    config = tmp_path / "config.yaml"
    config.write_text(text, encoding="utf-8")
    out = tmp_path / "out"
    session = Session(command, config, out, options)
    while session.running and len(parts(out)) < 2:
        time.sleep(0.01)
    before = parts(out)
    os.killpg(session.process.pid, signal.SIGINT)
    stdout, stderr = session.process.communicate(timeout=60)
    assert session.process.returncode == 130
    document = json.loads(stdout)
    assert document["exit_code"] == 130
    assert document["error"].startswith("interrupted; ")
    done = stderr.split("interrupted; ")[1].split(" of ")[0]
    total = 400 if command == "run" else 360
    assert stderr == (
        f"eqt: interrupted; {done} of {total} runs are kept in {out}: "
        "run the same command again to continue, or with --force to start over\n"
    )
    assert int(done) >= 30 * len(before)
    check_left_over(out, before)
    assert Session(command, config, out, options).finish()["resumed"] == int(done)
    Session(command, config, tmp_path / "whole", ["--executor", "serial"]).finish()
    assert_equal(out / "results.h5", contents(tmp_path / "whole/results.h5"))
