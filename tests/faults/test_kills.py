"""SIGKILLs at random moments: nothing that was finished is lost, and the end is always the same.

`make faults` runs all 500, `make faults SHARE=tenth` a tenth, and `make test-all` some scenarios
once.
"""

import os
import random
import shutil
import time
from pathlib import Path

import pytest
from faults_harness import (
    FLYING,
    FLYING_NATIVE,
    RAGGED,
    RUN,
    SWEEP,
    SWEEP_NATIVE,
    Session,
    assert_equal,
    check_left_over,
    contents,
    kill_one,
    parts,
)

from eqt_cli.extend import Native

SHARE = {"full": 1.0, "tenth": 0.1}.get(os.environ.get("EQT_FAULTS", ""))
"""Of all kills, of which each scenario has one at least; None elsewhere, where it has one."""

MOST_SESSIONS = 200
MOST_WORKER_KILLS = 2
"""In one session: a part whose worker is lost three times is given up, which is another test."""

CONFIGURATIONS = {
    "run": RUN,
    "sweep": SWEEP,
    "flight": FLYING,
    "native flight": FLYING_NATIVE,
    "native sweep": SWEEP_NATIVE,
    "ragged sweep": RAGGED,
}

LOCAL = ["--executor", "local", "--workers", "2"]
SERIAL = ["--executor", "serial"]
THREADS = ["--executor", "threads", "--workers", "2"]
# configuration, options, who is killed, how often; with the shards and `pack` below 500 in all
SCENARIOS = [
    ("flight", SERIAL, "coordinator", 30),
    ("flight", LOCAL, "worker", 30),
    ("native flight", THREADS, "coordinator", 25),
    ("native flight", LOCAL, "coordinator", 45),
    ("run", SERIAL, "coordinator", 50),
    ("run", LOCAL, "coordinator", 50),
    ("run", LOCAL, "worker", 60),
    ("sweep", SERIAL, "coordinator", 25),
    ("sweep", LOCAL, "coordinator", 25),
    ("sweep", LOCAL, "worker", 45),
    ("native sweep", THREADS, "coordinator", 10),
    ("ragged sweep", SERIAL, "coordinator", 25),
    ("ragged sweep", LOCAL, "worker", 25),
]
KILLS_OF_SHARDS, KILLS_OF_PACK = 25, 25

ALWAYS = {
    ("run", "local", "worker"),
    ("sweep", "serial", "coordinator"),
    ("native flight", "threads", "coordinator"),
    ("ragged sweep", "local", "worker"),
}
"""Otherwise these, each of another study by another executor; `make faults` has them all."""

pytestmark = [
    pytest.mark.skipif(
        not Path("/proc/self/task").is_dir(), reason="finds processes as Linux lists them"
    ),
    pytest.mark.ci("starts eqt several times, and its workers"),
]


@pytest.fixture(scope="module")
def reference(made_once):
    """Results and durations of uninterrupted runs, each computed once."""

    def find(which):
        def compute(folder):
            config = folder / "config.yaml"
            config.write_text(CONFIGURATIONS[which], encoding="utf-8")
            session = Session(_command(which), config, folder / "out", ["--executor", "serial"])
            session.wait_for_start()
            started = time.monotonic()
            session.finish()
            (folder / "duration").write_text(str(time.monotonic() - started), encoding="utf-8")

        folder = made_once(f"uninterrupted {which}", compute)
        results = contents(folder / "out")
        return folder / "config.yaml", results, float((folder / "duration").read_text())

    return find


def _command(which):
    return "sweep" if "sweep" in which else "run"


def _wanted(kills):
    return 1 if SHARE is None else max(1, round(kills * SHARE))


@pytest.mark.parametrize(
    ("which", "options", "victim", "kills"),
    [entry for entry in SCENARIOS if SHARE or (entry[0], entry[1][1], entry[2]) in ALWAYS],
    ids=lambda value: value[1].replace(" ", "_") if isinstance(value, list) else str(value),
)
def test_kills_lose_nothing_and_change_nothing(reference, tmp_path, which, options, victim, kills):
    if "native" in which and (missing := Native.unavailable()):
        pytest.skip(missing)
    config, expected, duration = reference(which)
    command, rng = _command(which), random.Random(f"{which} {options} {victim}")
    wanted = _wanted(kills)
    strike = _strike_coordinator if victim == "coordinator" else _strike_workers
    done = finished = 0
    for _ in range(MOST_SESSIONS):
        out = tmp_path / f"out{finished}"
        session = Session(command, config, out, options)
        session.wait_for_start()
        done += strike(session, rng, duration, out, wanted - done)
        if session.process.returncode != -9:
            session.finish()
            assert_equal(out, expected)
            finished += 1
        if done >= wanted:
            break
    assert done >= wanted
    document = Session(command, config, tmp_path / f"out{finished}", options).finish()
    assert document["failed"] == 0
    assert_equal(tmp_path / f"out{finished}", expected)


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
        struck += session.running and kill_one(session.workers(), rng)
        check_left_over(out, before)
    return struck


SHARDS = [["--executor", "serial", "--shard", f"{number}/2"] for number in (1, 2)]


def test_kills_of_shards_beside_each_other(reference, tmp_path):
    """One of two shards is killed while the other goes on; then both are started again."""
    config, expected, duration = reference("ragged sweep")
    rng, wanted = random.Random("shards"), _wanted(KILLS_OF_SHARDS)
    done = finished = 0
    for _ in range(MOST_SESSIONS):
        out = tmp_path / f"out{finished}"
        sessions = [Session("sweep", config, out, shard) for shard in SHARDS]
        for session in sessions:
            session.wait_for_start()
        if done < wanted:
            time.sleep(rng.uniform(0, duration / 4))  # each has half of the runs, and does not pack
            before = parts(out)
            done += rng.choice(sessions).kill()
            check_left_over(out, before)
        whole = True
        for session in sessions:
            if session.process.returncode == -9:
                whole = False
            else:
                session.finish()
        if whole:
            Session("pack", config, out, []).finish()
            assert_equal(out, expected)
            finished += 1
            if done >= wanted:
                break
    assert done >= wanted


@pytest.mark.parametrize("which", ["ragged sweep", *["native sweep"] * bool(SHARE)])
def test_kills_of_pack(reference, tmp_path, which):
    """At any moment there are all parts, or the whole result, and packing again ends well."""
    config, expected, _ = reference(which)
    rng, wanted = random.Random("pack"), _wanted(KILLS_OF_PACK)
    parted = tmp_path / "parted"
    for shard in SHARDS:
        Session("sweep", config, parted, shard).finish()
    whole = shutil.copytree(parted, tmp_path / "whole")
    session = Session("pack", config, whole, [])
    session.wait_for_start()
    started = time.monotonic()
    session.finish()
    duration = time.monotonic() - started
    left = {path.name for path in whole.iterdir()}
    done = 0
    for number in range(MOST_SESSIONS):
        out = shutil.copytree(parted, tmp_path / f"out{number}")
        session = Session("pack", config, out, [])
        session.wait_for_start()
        done += _strike_coordinator(session, rng, duration, out, 1)
        if session.process.returncode == -9:
            session = Session("pack", config, out, [])
        session.finish()
        assert_equal(out, expected)
        assert {path.name for path in out.iterdir()} == left
        if done >= wanted:
            break
    assert done >= wanted


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
    assert_equal(out, expected)
