"""`eqt run`, within this process: what it prints where, and how it ends."""

import errno
import json
import os
import re
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from plugin_sources import ESCAPE, SHIFTED
from said import says

import eqt_cli.api
from eqt_cli.base.process import Interrupted
from eqt_cli.base.store_reader import open_results

FAILING = (
    *("--set", "plugins=[escape.py]", "--set", "controllers=[escape, eqt]"),
    *("--set", "solver.rtol=1e-3", "--set", "ensemble.runs=2"),  # how it fails is soon known
)
BRIEF = (
    *("--set", "controllers=[eqt]", "--set", "ensemble.runs=1"),
    *("--set", "time.duration=0.1"),
)
SOON = ("--set", "solver.max_steps=20")
WRONG = ("--set", "plugins=[shifted.py]", "--set", "solver.engine=shifted")
CHECKED = ("--set", "solver.cross_check=1")


@pytest.fixture
def plugins(folder):
    (folder / "escape.py").write_text(ESCAPE, encoding="utf-8")
    (folder / "shifted.py").write_text(SHIFTED, encoding="utf-8")


def assert_equal_datasets(one, other):
    with open_results(one) as a, open_results(other) as b:
        names = [*a.names, *a.coordinates]
        assert names == [*b.names, *b.coordinates]
        for name in names:
            np.testing.assert_array_equal(a[name], b[name], err_msg=name)


# What it prints ---------------------------------------------------------------------------------


def test_the_summary(eqt):
    done = eqt("run", "c.yaml")
    about, space, header, rule, *laws, gap, checked, results, following = done.out.splitlines()
    assert (done.code, done.err, space, gap) == (0, "", "", "")
    stages = r"(( \(|, )(compiling|cross-check|writing) \d+\.\d s)*\)?"
    assert re.fullmatch(rf"c: 6 runs of 1 s in \d+\.\d s{stages}", about)
    assert re.split(" {2,}", header) == [
        "law",
        "settled",
        "mean attitude error, deg",
        "final attitude error, deg",
        "mean torque, first 5 s, N m",
    ]
    assert set(rule) == {"─", " "}
    assert [law.split()[:2] for law in laws] == [["EqT", "0/3"], ["GT", "0/3"]]
    with open_results("results/c") as stored:
        names = "mean_attitude_error", "final_attitude_error", "early_torque"
        means = [stored[name].mean(axis=1) for name in names]
    shown = [re.findall(r"[\d.]+", law)[2:] for law in laws]
    for column, of_laws in zip(zip(*shown, strict=True), means, strict=True):
        assert [float(cell) for cell in column] == pytest.approx(of_laws, rel=1e-3)
    assert re.fullmatch(r"checked  energy balance to \de-\d\d", checked)
    assert results == f"results  {Path('results/c/results.h5')}"
    assert following.startswith("next     eqt compare results/c ")


def test_the_summary_tells_how_accurate_it_is_and_warns_of_large_estimates(eqt, monkeypatch):
    done = eqt("run", "c.yaml", *CHECKED, "--set", "solver.error_estimate=true")
    assert done.err == ""
    numbers = r"energy balance to \de-\d\d, errors to \de-\d\d, LSODA to \de-\d\d"
    assert re.search(rf"^checked  {numbers}$", done.out, re.M)
    monkeypatch.setattr("eqt_cli.cli.result_tables.FAR_ABOVE", 1e-6)
    done = eqt("show", "results/c")
    with open_results("results/c") as results:
        largest = results["error_estimate"].max()
    said = (
        f"eqt: warning: …6 runs exceed 1e-06 times solver.rtol = 1e-06…{largest:.2g}…max_error…\n"
    )
    assert says(done.err, said)


def test_the_summary_tells_who_settled_and_how_long_actuators_are_at_a_limit(eqt):
    limit = "actuators=[{kind: limit, limit: 0.5}]"
    run = "run", "c.yaml", "--set", limit, "--set", "settling_threshold=2.5"
    done = eqt(*run)
    with open_results("results/c") as results:
        settled = (results["final_pose_error"] < 2.5).sum(axis=1).tolist()
        shares = results["saturated_share"].mean(axis=1)
    assert 0 < min(shares) and 0 < sum(settled) < 6
    lines = done.out.splitlines()
    assert [line.split()[1] for line in lines[4:6]] == [f"{count}/3" for count in settled]
    said = f"time at a limit: EqT {100 * shares[0]:.2f} %, GT {100 * shares[1]:.2f} %"
    assert said in lines
    rows = json.loads(eqt(*run, "--json").out)["controllers"]
    assert [row["settled"] for row in rows] == settled
    assert [row["saturated_share"] for row in rows] == shares.tolist()


def test_json_is_one_document(eqt):
    done = eqt("run", "c.yaml", "--json", *CHECKED)
    document = json.loads(done.out)
    assert done.err == ""
    keys = "results was_complete runs failed resumed kept seconds causes window controllers "
    assert set(document) == {*keys.split(), "cross_check"}
    assert (document["runs"], document["failed"], document["causes"]) == (6, 0, [])
    assert document["results"] == str(Path("results/c/results.h5"))
    assert [row["controller"] for row in document["controllers"]] == ["eqt", "gt"]
    assert document["cross_check"]["holds"] is True
    with open_results("results/c") as results:
        torque = results["early_torque"].mean(axis=1)
    assert [row["early_torque"] for row in document["controllers"]] == torque.tolist()


def test_quiet_prints_nothing_but_errors(eqt):
    for again in (False, True):
        done = eqt("run", "c.yaml", "-q")
        assert (done.code, done.out, done.err) == (0, "", ""), again
    done = eqt("run", "c.yaml", *SOON, *BRIEF, "--quiet", "--out", "failing")
    assert (done.code, done.out) == (3, "")
    assert done.err.startswith("\n1 run failed: 1 step limit\n")


# Where it writes --------------------------------------------------------------------------------


@pytest.mark.parametrize(("name", "written"), [("other", "other"), ("", "c")])
def test_it_writes_to_results_by_the_name_which_is_that_of_the_file_where_it_is_empty(
    eqt, folder, name, written
):
    assert eqt("run", "c.yaml", *BRIEF, "--set", f"name={name}").code == 0
    assert [path.parent.name for path in folder.glob("results/*/results.h5")] == [written]


@pytest.mark.needs("report")
@pytest.mark.parametrize("command", ["run", "sweep", "plot", "animate"])
def test_an_empty_folder_name_is_no_folder(refused, folder, command):
    before = list(folder.iterdir())
    assert (
        refused(command, "c.yaml", "--out", "") == "--out: expected the name of a folder, got ''\n"
    )
    assert list(folder.iterdir()) == before


# Again ------------------------------------------------------------------------------------------


def test_a_complete_result_is_not_run_again(eqt, monkeypatch):
    eqt("run", "c.yaml", "--quiet")
    written = Path("results/c/results.h5").stat()
    monkeypatch.setattr("eqt_cli.runs.compute_part.compute_part", None)
    done = eqt("run", "c.yaml")
    assert done.code == 0
    assert done.err == (
        f"{Path('results/c')} already holds this experiment; --force runs it again\n"
    )
    assert done.out.startswith("c: 6 runs of 1 s\n")
    assert Path("results/c/results.h5").stat().st_mtime_ns == written.st_mtime_ns


def test_force_says_what_it_removes(eqt):
    eqt("run", "c.yaml", "--quiet")
    done = eqt("run", "c.yaml", "--force")
    assert done.code == 0
    assert done.err.splitlines() == [
        f"removed {Path('results/c', name)}"
        for name in ("results.h5", "config.yaml", "manifest.json")
    ]


def test_a_result_runs_again_with_a_change(eqt):
    eqt("run", "c.yaml", "--quiet")
    assert eqt("run", "results/c", "--out", "again", "--set", "ensemble.runs=2").code == 0
    with open_results("results/c") as one, open_results("again") as other:
        for name in ("initial_pose", "initial_velocity"):  # whatever the number of runs
            np.testing.assert_array_equal(one[name][:2], other[name])


# Errors -----------------------------------------------------------------------------------------


def test_a_wrong_configuration(refused, folder):
    text = (folder / "c.yaml").read_text(encoding="utf-8")
    wrong = text.replace("[2, 1, 3]", "[[1, 2, 3], [4, 5, 6]]").replace("kd: 0.5", "kd: 0")
    (folder / "c.yaml").write_text(wrong, encoding="utf-8")
    assert refused("run", "c.yaml") == (
        "2 errors in c.yaml\n"
        "c.yaml:2:1: inertia: expected 3×3 for SO3, got 2×3\n"
        "c.yaml:3:18: gains.kd: expected a positive definite matrix, got eigenvalues 0, 0, 0\n"
    )
    assert not (folder / "results").exists()


@from_yaml
def test_wrong_arguments(refused, arguments, said):
    assert says(refused("run", *arguments), f"{said}…\n")


@pytest.mark.ci("computes an experiment several times")
def test_a_result_with_plugins_must_be_trusted(eqt, refused, plugins, forget_plugins):
    eqt("run", "c.yaml", *FAILING)
    forget_plugins()
    assert refused("run", "results/c", "--out", "again").endswith(
        "read it with `eqt show --plugins`, then add --trust-plugins\n"
    )
    assert not Path("again").exists()
    assert eqt("run", "results/c", "--out", "again", "--trust-plugins").code == 3
    assert_equal_datasets("results/c", "again")


# Failed runs and checks -------------------------------------------------------------------------


def test_failed_runs_end_with_3(eqt, plugins):
    done = eqt("run", "c.yaml", *FAILING)
    assert done.code == 3
    assert re.search(r"^Escape +0/2( +-){3}$", done.out, re.M)
    assert re.search(r"^EqT +0/2 ", done.out, re.M)
    title, *rows = done.err[done.err.index("2 runs failed") :].strip().splitlines()
    assert title == "2 runs failed: 2 solver failed"
    assert [row.split(":")[0] for row in rows] == [f"  escape run {run}" for run in range(2)]
    assert all(" t = 0.0" in row for row in rows)


def test_equal_messages_of_failed_runs_are_one_line(eqt, folder):
    law = ESCAPE.replace("20 * s.V_tilde**3", "s.V_tilde * float('nan')")
    (folder / "nowhere.py").write_text(law.replace("escape", "nowhere"), encoding="utf-8")
    nowhere = ("--set", "plugins=[nowhere.py]", "--set", "controllers=[nowhere]")
    done = eqt("run", "c.yaml", *nowhere, *CHECKED)
    assert done.code == 3
    assert done.err.strip().splitlines() == [
        "3 runs failed: 3 non finite",
        "  nowhere run 0 and 2 more: t = 0 s: the vector field is not finite",
        f"  `eqt show {Path('results/c')} --failed` lists all",
    ]
    assert "\nchecked  cross-check skipped: its runs failed\n" in done.out


@pytest.mark.ci("another run that fails is fast")
def test_where_nothing_succeeded_the_failures_are_what_is_next(eqt):
    for _ in ("computed", "remembered"):
        done = eqt("run", "c.yaml", *SOON, *BRIEF)
        assert (done.code, done.out.splitlines()[-1]) == (3, "next     eqt show results/c --failed")
    assert eqt("show", "results/c", "--failed").out.count("step limit") == 1


@pytest.mark.ci("another run that fails is fast")
def test_many_different_messages_are_cut(eqt):
    done = eqt("run", "c.yaml", *SOON, "--set", "ensemble.runs=12")
    rows = done.err.strip().splitlines()
    assert rows[0] == "24 runs failed: 24 step limit"
    assert len(rows) == 1 + 10 + 1
    # A run of one controller and of the other start alike, and fail alike.
    assert all(" and 1 more: t = " in row for row in rows[1:11])
    assert rows[-1] == f"  … `eqt show {Path('results/c')} --failed` lists all"


def test_a_check_that_fails_ends_with_4(eqt, plugins):
    done = eqt("run", "c.yaml", *WRONG, *CHECKED)
    assert done.code == 4
    assert says(done.err, "eqt: warning: the two integrators differ by more than…'gt'…\n")
    assert eqt("run", "c.yaml", *WRONG, *CHECKED).code == 4


def test_json_lists_every_cause_and_the_lower_code_wins(eqt, plugins):
    both = ("--set", "plugins=[escape.py, shifted.py]", *FAILING[2:4], *WRONG[2:], *CHECKED)
    done = eqt("run", "c.yaml", "--json", *both, "--set", "ensemble.runs=1")
    assert done.code == 3
    document = json.loads(done.out)
    assert document["causes"] == ["some runs failed", "the cross-check does not hold"]
    assert document["failed"] == 1
    assert document["controllers"][0]["peak_torque"] is None
    assert document["cross_check"]["holds"] is False


@pytest.mark.skipif(os.name != "posix", reason="Windows has no such locks")
def test_quiet_says_what_may_do_harm(eqt, monkeypatch):
    def refused(*_):
        raise OSError(errno.ENOLCK, "refused")

    monkeypatch.setattr("fcntl.flock", refused)
    done = eqt("run", "c.yaml", *BRIEF, "--quiet", "--out", "unlocked")
    assert done.err.startswith("eqt: warning: unlocked: its disk does not support file locks")


def test_an_interruption_behind_the_last_part_says_that_all_runs_are_there(eqt, monkeypatch):
    whole = eqt_cli.api.run

    def interrupted(*given, **options):
        whole(*given, **options)
        raise Interrupted(2)

    monkeypatch.setattr("eqt_cli.api.run", interrupted)
    done = eqt("run", "paper", *BRIEF, "--out", "late")
    assert (done.code, done.err.splitlines()[-1]) == (
        130,
        "eqt: interrupted; 1 of 1 runs are kept in late: run the same command again to continue",
    )
