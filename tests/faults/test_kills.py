"""SIGKILLs at random moments: nothing that was finished is lost, and the end is always the same.

`make faults` runs all 500, `make faults SHARE=tenth` a tenth, and `make test` one of each kind.
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

SHARE = {"full": 1.0, "tenth": 0.1}.get(os.environ.get("EQT_FAULTS", ""), 0.02)
"""Of all kills, of which each scenario has one at least."""

MOST_SESSIONS = 200
MOST_WORKER_KILLS = 2
"""In one session: a part whose worker is lost three times is given up, which is another test."""

CONFIGURATIONS = {
    "run": RUN,
    "sweep": SWEEP,
    "flight": FLYING,
    "compiled flight": FLYING_COMPILED,
}

# configuration, options, who is killed, how often
LOCAL = ["--executor", "local", "--workers", "2"]
DASK = ["--executor", "dask", "--workers", "2"]
SERIAL = ["--executor", "serial"]
THREADS = ["--executor", "threads", "--workers", "2"]
SCENARIOS = [
    ("flight", SERIAL, "coordinator", 40),
    ("flight", LOCAL, "worker", 40),
    ("compiled flight", LOCAL, "coordinator", 40),
    ("compiled flight", THREADS, "coordinator", 40),
    ("run", SERIAL, "coordinator", 50),
    ("sweep", SERIAL, "coordinator", 50),
    ("run", LOCAL, "coordinator", 40),
    ("run", LOCAL, "worker", 40),
    ("sweep", LOCAL, "coordinator", 40),
    ("sweep", LOCAL, "worker", 40),
    ("run", DASK, "coordinator", 20),
    ("run", DASK, "worker", 20),
    ("sweep", DASK, "coordinator", 20),
    ("sweep", DASK, "worker", 20),
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
    wanted = max(1, round(kills * SHARE))
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
