"""`eqt sweep`, and what it has in common with `eqt run`."""

from __future__ import annotations

import csv
import io
import json
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from eqt_cli.store.reader import open_results

Eqt = Callable[..., Any]

GRID = ("--grid", "gains.kp=1,2", "--grid", "gains.kd=0.5,1,2")


def test_the_summary(eqt: Eqt) -> None:
    done = eqt("sweep", "c.yaml", *GRID, "--out", "out")
    assert (done.code, done.err) == (0, "")
    assert "6 points, 36 runs, simulation " in done.out
    assert done.out.endswith(f"results  {Path('out/results.h5')}\nnext     eqt compare out\n")
    assert "settled runs" not in done.out  # nothing over all points
    won = "Points won by mean ‖I − Q_E‖: EqT 0, GT 0, undecided 6.\n"  # of 3 runs
    assert re.search(r"^  EqT +best +\d +", done.out, re.M) and won in done.out
    with open_results("out") as results:
        assert results["effort"].shape == (6, 2, 3)
        np.testing.assert_array_equal(results["gains.kd"], [0.5, 1, 2] * 2)


def test_scenarios_are_listed_and_none_is_best(eqt: Eqt) -> None:
    lag = "{actuators: [{kind: lag, time_constant: 0.5}]}"
    done = eqt("sweep", "c.yaml", "--set", f"sweep=[cases: {{ideal: {{}}, slow: {lag}}}]")
    assert done.code == 0
    table = done.out.partition("\n\n")[2].splitlines()
    assert done.out.startswith("mean ‖I − Q_E‖, each point\n\n")
    assert table[0].split()[:5] == ["point", "at", "EqT", "GT", "winner"]
    assert [row.split()[1] for row in table[2:4]] == ["ideal", "slow"]
    assert table[2].split()[4] == "undecided"
    assert "best" not in done.out


def test_dry_run_stores_nothing(eqt: Eqt) -> None:
    done = eqt("sweep", "c.yaml", *GRID, "--dry-run")
    lines = done.out.splitlines()
    assert lines[:3] == [
        "6 points × 2 controllers × 3 runs = 36",
        "  0  gains.kp = 1, gains.kd = 0.5",
        "  1  gains.kp = 1, gains.kd = 1",
    ]
    assert lines[6].strip() == "…"
    assert lines[7].startswith("time     about ")
    assert lines[8].startswith("size     ")
    assert not Path("results").exists()


def test_dry_run_of_very_many_points_checks_some(eqt: Eqt, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("eqt_cli.cli.sweep.MOST_CHECKED", 3)
    done = eqt("sweep", "c.yaml", *GRID, "--dry-run")
    assert done.err == "c.yaml: 3 of its 6 points were checked; a run checks all\n"
    assert eqt("sweep", "c.yaml", *GRID, "--dry-run", "--quiet").err == ""
    # The first, one between, and the last.
    wrong = ("--grid", "gains.kp=1,2,3,4,5,-1")
    assert eqt("sweep", "c.yaml", *wrong, "--dry-run").code == 2


@pytest.mark.parametrize("executor", ["auto", "serial"])
def test_dry_run_counts_the_workers_that_will_work(eqt: Eqt, executor: str) -> None:
    chosen = ("--workers", 2, "--executor", executor)
    done = eqt("sweep", "c.yaml", *GRID, "--dry-run", *chosen)
    assert done.out.splitlines()[7].endswith(" s with 1 worker")  # two parts of less than a second
    document = json.loads(eqt("sweep", "c.yaml", *GRID, "--dry-run", "--json", *chosen).out)
    assert document["workers"] == 1


def test_dry_run_tells_the_size_of_the_data(eqt: Eqt) -> None:
    expected = json.loads(eqt("sweep", "c.yaml", *GRID, "--dry-run", "--json").out)
    assert (expected["points"], expected["runs"], len(expected["first"])) == (6, 36, 5)
    eqt("sweep", "c.yaml", *GRID, "--out", "out")
    size = Path("out/results.h5").stat().st_size
    # The rest of the file is structure, attributes and coordinates.
    assert expected["bytes"] < size < expected["bytes"] + 60_000


def test_run_and_sweep_name_each_other(eqt: Eqt) -> None:
    done = eqt("sweep", "c.yaml")
    assert done.code == 2
    assert done.err == (
        "eqt: c.yaml: defines no sweep; add a `sweep` section or --grid KEY=A,B, "
        "or use `eqt run c.yaml`\n"
    )
    with Path("c.yaml").open("a", encoding="utf-8") as file:
        file.write("sweep: [{grid: {gains.kp: [1, 2]}}]\n")
    done = eqt("run", "c.yaml")
    assert done.code == 2
    assert done.err == ("eqt: c.yaml:10:1: defines a sweep; use `eqt sweep c.yaml`\n")


def test_the_result_of_a_sweep_is_swept_again(eqt: Eqt) -> None:
    assert eqt("sweep", "c.yaml", "--grid", "gains.kd=1,2", "--out", "swept", "--quiet").code == 0
    done = eqt("run", "swept")
    result = Path("swept/results.h5")
    assert done.code == 2
    assert done.err.endswith(f": defines a sweep; use `eqt sweep {result}`\n")
    assert done.err.startswith(f"eqt: {result}[config]:")


@pytest.mark.parametrize("text", ["gains.kp", "=1", "gains.kp="])
def test_a_grid_that_is_none(eqt: Eqt, text: str) -> None:
    done = eqt("sweep", "c.yaml", "--grid", text)
    assert done.code == 2
    assert done.err == f"eqt: --grid {text}: expected KEY=VALUE,VALUE,…, got '{text}'\n"


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b"])
def test_a_shard_that_is_none(eqt: Eqt, text: str) -> None:
    done = eqt("sweep", "c.yaml", *GRID, "--shard", text)
    assert done.code == 2
    assert done.err == (
        f"eqt: --shard: expected I/N with I from 1 to N, such as 2/8, got '{text}'\n"
    )


@pytest.mark.slow("computes a sweep twice")
def test_shards_and_pack(eqt: Eqt) -> None:
    first = eqt("sweep", "c.yaml", *GRID, "--shard", "1/2", "--out", "out", "--executor", "serial")
    assert first.code == 0
    assert first.out == (
        "shard 1/2: 18 runs, 0 failed\nnext     eqt pack out  (when all shards are done)\n"
    )
    unfinished = eqt("show", "out")
    assert "done     18 of 36 runs (50.0 %)\nfailed   0\nrunning  no" in unfinished.out
    early = eqt("pack", "out")
    assert early.code == 2
    assert "1 of 2 parts are missing" in early.err
    eqt("sweep", "c.yaml", *GRID, "--shard", "2/2", "--out", "out", "--executor", "serial")
    assert eqt("pack", "out").code == 0
    eqt("sweep", "c.yaml", *GRID, "--out", "whole")
    with open_results("out") as one, open_results("whole") as other:
        for name in one.names:
            np.testing.assert_array_equal(one[name], other[name])


@pytest.mark.parametrize("sweeps", [False, True])
def test_the_table_holds_every_run_with_all_digits(eqt: Eqt, sweeps: bool) -> None:
    eqt(*(("sweep", "c.yaml", *GRID) if sweeps else ("run", "c.yaml")), "--out", "out")
    rows = list(csv.DictReader(io.StringIO(eqt("show", "out", "--table").out)))
    lines = eqt("show", "out", "--table", "--format", "jsonl").out.splitlines()
    documents = [json.loads(line) for line in lines]
    with open_results("out") as results:
        effort = results["effort"].ravel()
        assert len(rows) == len(documents) == effort.size
        assert [float(row["effort"]) for row in rows] == effort.tolist()
        assert [document["effort"] for document in documents] == effort.tolist()
    assert rows[0]["controller"] == documents[0]["controller"] == "eqt"
    assert ("gains.kp" in rows[0]) == sweeps
    assert documents[-1]["settling_time"] is None or documents[-1]["settling_time"] >= 0


def test_an_unknown_format_of_the_table(eqt: Eqt) -> None:
    eqt("run", "c.yaml", "--out", "out")
    done = eqt("show", "out", "--table", "--format", "cvs")
    assert (done.code, done.err) == (
        2,
        "eqt: --format: unknown format 'cvs'; did you mean 'csv'?\n",
    )


def test_a_value_that_is_given_twice(eqt: Eqt) -> None:
    done = eqt("sweep", "c.yaml", "--grid", "gains.kp=0.5,1,0.50")
    assert done.code == 2
    assert done.err == (
        "eqt: --grid gains.kp=0.5,1,0.50: sweep[0].grid.gains.kp[2]: 0.5 is listed twice; give "
        "each value once\n"
    )
