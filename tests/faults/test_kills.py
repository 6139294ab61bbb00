"""SIGKILLs at random moments: nothing that was finished is lost, and the end is always the same.

`make faults` runs all of it; `make test` a fifth.
"""

import os
import random
import time
from importlib.util import find_spec
from pathlib import Path

import pytest
from faults_harness import (
    FLYING,
    FLYING_COMPILED,
    RUN,
    SWEEP,
    Session,
    assert_equal,
    check_left_over,
    contents,
    parts,
)

FULL = os.environ.get("EQT_FAULTS") == "full"
MOST_SESSIONS = 60
MOST_WORKER_KILLS = 2
"""In one session: a part whose worker is lost three times is given up, which is another test."""

CONFIGURATIONS = {
    "run": RUN,
    "sweep": SWEEP,
    "flight": FLYING,
    "compiled flight": FLYING_COMPILED,
}

# configuration, options, who is killed, how often
SCENARIOS = [
    ("flight", ["--executor", "serial"], "coordinator", 10),
    ("flight", ["--executor", "local", "--workers", "2"], "worker", 10),
    ("compiled flight", ["--executor", "local", "--workers", "2"], "coordinator", 10),
    ("run", ["--executor", "serial"], "coordinator", 8),
    ("sweep", ["--executor", "serial"], "coordinator", 8),
    ("run", ["--executor", "local", "--workers", "2"], "coordinator", 6),
    ("run", ["--executor", "local", "--workers", "2"], "worker", 6),
    ("sweep", ["--executor", "local", "--workers", "2"], "coordinator", 6),
    ("sweep", ["--executor", "local", "--workers", "2"], "worker", 6),
    ("run", ["--executor", "dask", "--workers", "2"], "coordinator", 4),
    ("run", ["--executor", "dask", "--workers", "2"], "worker", 4),
    ("sweep", ["--executor", "dask", "--workers", "2"], "coordinator", 4),
    ("sweep", ["--executor", "dask", "--workers", "2"], "worker", 4),
]

pytestmark = pytest.mark.skipif(
    not Path("/proc/self/task").is_dir(), reason="finds processes as Linux lists them"
)


@pytest.fixture(scope="module")
def reference(tmp_path_factory):
    """Results and durations of uninterrupted runs, each computed once."""
    known = {}

    def find(which):
        if which not in known:
            folder = tmp_path_factory.mktemp("reference")
            config = folder / "config.yaml"
            config.write_text(CONFIGURATIONS[which], encoding="utf-8")
            out = folder / "out"
            session = Session(_command(which), config, out, ["--executor", "serial"])
            session.wait_for_start()
            started = time.monotonic()
            session.finish()
            known[which] = config, contents(out / "results.h5"), time.monotonic() - started
        return known[which]

    return find


def _command(which):
    return "sweep" if which == "sweep" else "run"


@pytest.mark.parametrize(
    ("which", "options", "victim", "kills"),
    SCENARIOS,
    ids=[f"{which}-{options[1]}-{victim}" for which, options, victim, _ in SCENARIOS],
)
def test_kills_lose_nothing_and_change_nothing(reference, tmp_path, which, options, victim, kills):
    if "dask" in options and not find_spec("distributed"):
        pytest.skip("needs the extra dask")
    if "compiled" in which:
        pytest.importorskip("heyoka")
    config, expected, duration = reference(which)
    command, rng = _command(which), random.Random(f"{which} {options} {victim}")
    wanted = kills if FULL else max(1, kills // 5)
    strike = _strike_coordinator if victim == "coordinator" else _strike_workers
    done = finished = 0
    for _ in range(MOST_SESSIONS):
        out = tmp_path / f"out{finished}"
        session = Session(command, config, out, options)
        session.wait_for_start()
        done += strike(session, rng, duration, out, wanted - done)
        if session.process.returncode != -9:
            session.finish()
            assert_equal(out / "results.h5", expected)
            finished += 1
        if done >= wanted:
            break
    assert done >= wanted
    document = Session(command, config, tmp_path / f"out{finished}", options).finish()
    assert document["failed"] == 0
    assert_equal(tmp_path / f"out{finished}" / "results.h5", expected)


def _strike_coordinator(session, rng, duration, out, wanted):
    time.sleep(rng.uniform(0, duration))
    before = parts(out)
    if not session.kill():
        return 0
    check_left_over(out, before)
    return 1


def _strike_workers(session, rng, duration, out, wanted):
    struck = 0
    for _ in range(min(wanted, MOST_WORKER_KILLS)):
        deadline = time.monotonic() + 60
        while session.running and not session.workers() and time.monotonic() < deadline:
            time.sleep(0.01)
        time.sleep(rng.uniform(0, duration / 2))
        before = parts(out)
        struck += session.kill_worker(rng)
        check_left_over(out, before)
    return struck


def test_a_resumed_run_does_not_compute_again_what_was_there(reference, tmp_path):
    config, expected, _ = reference("run")
    out = tmp_path / "out"
    session = Session("run", config, out, ["--executor", "serial"])
    while session.running and len(parts(out)) < 3:
        time.sleep(0.01)
    assert session.kill()
    before = parts(out)
    document = Session("run", config, out, ["--executor", "serial"]).finish()
    assert document["resumed"] >= 50 * len(before) > 0
    assert_equal(out / "results.h5", expected)
