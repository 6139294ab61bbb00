"""`eqt sweep`, and what it has in common with `eqt run`."""

import csv
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from plugin_sources import component
from said import says

from eqt_cli.base.store_reader import open_results
from eqt_cli.config.preflight import build
from eqt_cli.engines import compiler

GRID = ("--grid", "gains.kp=1,2", "--grid", "gains.kd=0.5,1,2")


def test_the_summary(eqt):
    done = eqt("sweep", "c.yaml", *GRID, "--out", "out")
    assert (done.code, done.err) == (0, "")
    assert done.out.startswith("c: 6 points, 36 runs of 1 s in ")
    assert f"results  {Path('out/results.h5')}\nnext     eqt compare out  " in done.out
    assert "settled" not in done.out  # nothing over all points
    won = (
        "Points won by mean attitude error: EqT 0, GT 0, too few runs 6 (ensemble.runs: 8 or more)."
    )
    assert re.search(r"^  EqT +best +\d +", done.out, re.M) and won in " ".join(done.out.split())
    with open_results("out") as results:
        assert results["effort"].shape == (6, 2, 3)
        np.testing.assert_array_equal(results["gains.kd"], [0.5, 1, 2] * 2)


def test_scenarios_are_listed_and_none_is_best(eqt):
    lag = "{actuators: [{kind: lag, time_constant: 0.5}]}"
    done = eqt("sweep", "c.yaml", "--set", f"sweep=[cases: {{ideal: {{}}, slow: {lag}}}]")
    assert done.code == 0
    _, title, table = done.out.split("\n\n", 2)
    table = table.splitlines()
    assert title == "mean attitude error, each point, deg"
    assert table[0].split()[:5] == ["point", "at", "EqT", "GT", "winner"]
    assert [row.split()[1] for row in table[2:4]] == ["ideal", "slow"]
    assert table[2].split()[4:7] == ["too", "few", "runs"]
    assert "best" not in done.out


def test_dry_run_stores_nothing(eqt):
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


@pytest.mark.usefixtures("untimed")
def test_a_grid_may_be_a_range(eqt, untimed):
    done = eqt(
        "sweep",
        "c.yaml",
        "--grid",
        "gains.kp=1:2:3",
        "--grid",
        "gains.kd=0.1:10:3:log",
        "--dry-run",
    )
    points = [line.split(", gains.kd = ") for line in done.out.splitlines() if "gains.kd" in line]
    numbers = [(float(kp.split()[-1]), float(kd)) for kp, kd in points]
    assert numbers == [(1, 0.1), (1, 1), (1, 10), (1.5, 0.1), (1.5, 1)]  # the first five


def test_dry_run_of_very_many_points_checks_some(eqt, monkeypatch):
    monkeypatch.setattr("eqt_cli.cli.run.MOST_CHECKED", 3)
    done = eqt("sweep", "c.yaml", *GRID, "--dry-run")
    assert done.err == "c.yaml: 3 of its 6 points were checked; a run checks all\n"
    # The first, one between, and the last.
    wrong = ("--grid", "gains.kp=1,2,3,4,5,-1")
    assert eqt("sweep", "c.yaml", *wrong, "--dry-run").code == 2


@pytest.mark.parametrize("key", ["gains.kd", "actuators[0].time_constant"])
def test_dry_run_of_millions_of_points_builds_few(eqt, monkeypatch, key):
    for place in ("cli.run.MOST_CHECKED", "runs.preflight.MOST_TIMED"):
        monkeypatch.setattr(f"eqt_cli.{place}", 3)
    built = []

    def counted(*given, **more):
        built.append(None)
        return build(*given, **more)

    monkeypatch.setattr("eqt_cli.config.study.build", counted)
    axis = "{low: 0.1, high: 1.0, points: 3000}"
    with Path("c.yaml").open("a", encoding="utf-8") as config:
        config.write("actuators: [{kind: lag, time_constant: 1}]\n")
        config.write(f"sweep: [{{grid: {{gains.kp: {axis}, {key!r}: {axis}}}}}]\n")
    out = eqt("sweep", "c.yaml", "--dry-run").out
    assert out.startswith("9000000 points × 2 controllers × 3 runs = 54000000\n")
    assert len(built) < 30


@pytest.mark.usefixtures("untimed")
def test_dry_run_counts_the_workers_that_will_work(eqt):
    done = eqt("sweep", "c.yaml", *GRID, "--dry-run", "--workers", 2, "--executor", "auto")
    assert done.out.splitlines()[7].endswith(" with 1 worker")


@pytest.mark.usefixtures("untimed")
def test_dry_run_tells_the_size_of_the_data(eqt):
    eqt("sweep", "c.yaml", *GRID, "--out", "out", "--quiet")
    words = ("--dry-run", "--json", "--workers", 2, "--executor", "serial")
    expected = json.loads(eqt("sweep", "c.yaml", *GRID, *words).out)
    assert (expected["points"], expected["runs"], len(expected["first"])) == (6, 36, 5)
    assert expected["workers"] == 1
    size = Path("out/results.h5").stat().st_size
    # The rest of the file is structure, attributes and coordinates.
    assert expected["bytes"] < size < expected["bytes"] + 60_000


def test_run_and_sweep_name_each_other(refused):
    assert says(refused("sweep", "c.yaml"), "c.yaml: defines no sweep…\n")
    with Path("c.yaml").open("a", encoding="utf-8") as file:
        file.write("sweep: [{grid: {gains.kp: [1, 2]}}]\n")
    assert refused("run", "c.yaml") == ("c.yaml:10:1: defines a sweep; use `eqt sweep c.yaml`\n")


def test_the_result_of_a_sweep_is_swept_again(eqt):
    assert eqt("sweep", "c.yaml", "--grid", "gains.kd=1,2", "--out", "swept", "--quiet").code == 0
    done = eqt("run", "swept")
    result = Path("swept/results.h5")
    assert done.code == 2
    assert done.err.endswith(f": defines a sweep; use `eqt sweep {result}`\n")
    assert done.err.startswith(f"eqt: error: {result}[config]:")


@pytest.mark.parametrize("text", ["gains.kp", "=1", "gains.kp="])
def test_a_grid_that_is_none(refused, text):
    assert (
        refused("sweep", "c.yaml", "--grid", text)
        == f"--grid {text}: expected KEY=VALUE,VALUE,…, got '{text}'\n"
    )


@pytest.mark.parametrize("text", ["0/2", "3/2", "1", "a/b"])
def test_a_shard_that_is_none(refused, text):
    assert refused("sweep", "c.yaml", *GRID, "--shard", text) == (
        f"--shard: expected I/N with I from 1 to N, such as 2/8, got '{text}'\n"
    )


STORED = """\
group: SO3
inertia: [1, 2, 3]
gains: {kp: 1.0, kd: 0.5}
plugins: [own.py]
reference: {kind: waypoints, file: pass.csv}
controllers:
  - own
  - {kind: replay, file: pass.csv}
  - {kind: code, file: lee.c, as: lee2010, numbers: {kR: 2.0, kW: 0.5, J: [1, 2, 3]}}
control: {period: 0.02}
initial: {file: starts.csv}
time: {duration: 0.4, samples: 5}
solver: {rtol: 1.0e-6, cross_check: 0}
"""
OWN = component("own(eqt_cli.components.laws.GT):\n")
PASS = "t,qx,qy,qz,qw,tx,ty,tz\n0,0,0,0,1,1,0,0\n0.3,0.6,0,0,0.8,3,0,0\n0.5,0.8,0,0,0.6,2,0,0\n"


@pytest.mark.skipif(bool(compiler.missing()), reason="needs a C compiler")
@pytest.mark.ci("compiles a law, and computes an experiment twice")
def test_shards_with_every_kind_of_stored_file_are_packed(eqt, refused):
    """One is killed, so that its parts are missing; then it is computed again."""
    code = Path(__file__).parents[1] / "extensions" / "code"
    files = {
        "c.yaml": STORED,
        "own.py": OWN,
        "pass.csv": PASS,
        "starts.csv": "wx [rad],wy [rad],wz [rad]\n1,0,0\n",
    }
    for name, source in {"lee.c": "lee2010.c", "lee.h": "lee.h"}.items():
        files[name] = (code / source).read_text(encoding="utf-8")
    for name, text in files.items():
        Path(name).write_text(text, encoding="utf-8")
    run = ("run", "c.yaml", "-q", "--out")
    for shard in ("1/2", "2/2"):
        assert eqt(*run, "out", "--shard", shard).code == 0
    killed = Path("out/parts/000001.npy")
    killed.unlink()
    pack = ("pack", "out", "--trust-plugins")
    assert says(refused(*pack), "out: 1 of 3 parts are missing…\n")
    assert refused(*run, "out", "--set", "gains.kp=2") == (
        "out: holds another experiment, which differs in\n"
        "  gains.kp: 1.0 there, 2.0 here\n"
        "choose another folder with --out\n"
    )
    assert eqt(*run, "out", "--shard", "2/2").code == 0
    assert eqt(*pack).code == 0
    done = "already holds the complete result; there is nothing to pack"
    assert f"out {done}" in eqt(*pack).err
    assert eqt(*run, "whole").code == 0
    assert f"whole {done}" in eqt("pack", "whole", "--trust-plugins").err
    equal = eqt("diff", "out", "whole")
    assert (equal.code, equal.err) == (0, "")
    assert equal.out.endswith("equal: provenance differs, the 41 datasets do not\n")


def test_what_is_packed_is_what_was_begun(eqt, refused):
    assert eqt("run", "c.yaml", "-q", "--shard", "1/2", "--out", "out").code == 0
    config = Path("out/config.yaml")
    config.write_text(config.read_text(encoding="utf-8").replace("kp: 1.0", "kp: 3.0"))
    assert refused("pack", "out") == (
        "out: holds another experiment, which differs in\n"
        "  gains.kp: 1.0 there, 3.0 here\n"
        f"undo the changes of {config}\n"
    )


@pytest.mark.parametrize("sweeps", [False, True])
def test_the_table_holds_every_run_with_all_digits(eqt, sweeps):
    words = ("sweep", "c.yaml", *GRID) if sweeps else ("run", "c.yaml")
    eqt(*words, "--out", "out", "--quiet")
    rows = list(csv.DictReader(io.StringIO(eqt("show", "out", "--table", "metrics").out)))
    lines = eqt("show", "out", "--table", "metrics", "--format", "jsonl").out.splitlines()
    documents = [json.loads(line) for line in lines]
    with open_results("out") as results:
        effort = results["effort"].ravel()
        assert len(rows) == len(documents) == effort.size
        assert [float(row["effort"]) for row in rows] == effort.tolist()
        assert [document["effort"] for document in documents] == effort.tolist()
    assert rows[0]["controller"] == documents[0]["controller"] == "eqt"
    assert ("gains.kp" in rows[0]) == sweeps
    assert documents[-1]["settling_time"] is None or documents[-1]["settling_time"] >= 0


def test_a_value_that_is_given_twice(refused):
    assert says(
        refused("sweep", "c.yaml", "--grid", "gains.kp=0.5,1,0.50"),
        "--grid gains.kp=0.5,1,0.50…: 0.5 is listed twice…\n",
    )
