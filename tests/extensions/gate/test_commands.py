"""`eqt compare OLD NEW --fail-on`, the gate of continuous integration, as a user types it."""

import json
import os
import shlex
import shutil
import subprocess
import sys
from pathlib import Path

import docs_runner
import h5py
import numpy as np
import pytest
import yaml
from case_tables import from_yaml
from said import mentions
from scipy import stats
from small_experiment import configuration
from stored import fixed

from eqt_cli.results.result import open_result

ROOT = Path(__file__).parents[3]
RULE = "mean_attitude_error worse by 5 %"


def copied(file):
    """A result with equal numbers in another file."""


def still(file):
    file["effort"][:] = 0


def shorter(file):
    file["time"][:] /= 2


def looser(file):
    file["settling_time"].attrs["threshold"] = 0.2


def turned(file):
    file["effort"].attrs["units"] = fixed("N^2 s")


def lighter(file):
    file.move("steps", "strides")


def slower(file):
    file["desired_pose"][-1] = np.eye(3)


def failing(file):
    file["status"][1, 7] = 1


def late(file):
    file["settling_time"][1, 2] = np.nan


def rounded(file):
    file["error_estimate"][:] = 100.0


@pytest.fixture
def gate(changed, tmp_path, monkeypatch, invoke):
    """Compares two results with rules; of those that do not exist, soft is copied and changed."""
    monkeypatch.setenv("COLUMNS", "300")
    monkeypatch.chdir(changed)

    def call(*words, code):
        places = []
        for word in words:
            if word in globals() and callable(change := globals()[word]):
                path = shutil.copytree("soft", tmp_path / word, dirs_exist_ok=True) / "results.h5"
                with h5py.File(path, "r+") as file:
                    change(file)
                word = tmp_path / word
            places.append(word)
        return invoke("compare", *places, "--resamples", 99, code=code)

    return call


@from_yaml
def test_a_slip_gets_a_sentence_that_helps(gate, tmp_path, words, message):
    said = gate(*words, code=2).stderr.replace(f"{tmp_path}/", "")
    assert mentions(said, f"eqt: error: {message}")


def test_the_bounds_are_those_of_the_paired_t_test(gate, changed):
    """Fieller inverts the test of now − (1 + margin) before; the numbers are those of the files."""
    absolute = ["--fail-on", "effort worse by 2 (N m)^2 s"]
    done = gate("soft", "stiff", "--fail-on", RULE, *absolute, "--json", code=4)
    document = json.loads(done.stdout)["gate"]
    assert document["passes"] is False
    with open_result(changed / "soft") as soft, open_result(changed / "stiff") as stiff:
        for finding in document["findings"]:
            law = soft.labels.index(finding["controller"].removeprefix("stiff/"))
            before, now = (x.metric(finding["metric"], law) for x in (soft, stiff))
            if finding["unit"] == "%":
                for end, side in ((finding["high"], "less"), (finding["low"], "greater")):
                    at_end = stats.ttest_rel(now, (1 + end / 100) * before, alternative=side)
                    assert at_end.pvalue == pytest.approx(0.05)
                assert finding["value"] == pytest.approx(100 * (now.mean() / before.mean() - 1))
            else:
                test = stats.ttest_rel(now, before, alternative="greater")
                assert finding["low"] == pytest.approx(test.confidence_interval(0.95).low)
            worse, holds = finding["low"] > finding["margin"], finding["high"] <= finding["margin"]
            outcome = "worse" if worse else "holds" if holds else "not shown"
            assert finding["outcome"] == outcome
    assert {x["outcome"] for x in document["findings"]} >= {"worse", "holds"}


def test_the_answer_stands_first(gate):
    done = gate("soft", "stiff", "--fail-on", RULE, "--fail-on", "effort worse by 5 %", code=4)
    first, second, *others = done.stdout.splitlines()
    assert first == "gate fails: 4 worse, 4 hold"
    assert second.startswith("worse: EqT: effort worse by more than 5 %: +")
    assert second.endswith(" % (95 %)") and " %, at least +" in second
    assert others[3].startswith("holds: EqT: mean attitude error not worse by 5 %: −")
    assert others[7:9] == ["", "what differs: gains.kp 1.0 → 2.0"]
    as_csv = gate("soft", "stiff", "--fail-on", "effort worse by 5 %", "--format", "csv", code=4)
    assert as_csv.stderr.startswith("gate fails: 4 worse\n")
    assert as_csv.stdout.startswith("metric,")


def test_equal_runs_hold_every_rule(gate):
    """Also shares, of which 20 runs alone cannot show 2 points."""
    rules = [RULE, "settled worse by 2 points", "effort worse by 1e-6 (N m)^2 s", "worse", "failed"]
    done = gate("soft", "copied", *(word for rule in rules for word in ("--fail-on", rule)), code=0)
    assert done.stdout.startswith("gate passes: 12 hold\nholds: EqT: mean attitude error not worse")
    assert "settled not worse by 2 points: 0.0 points, at least 0.0 points (95 %)" in done.stdout
    assert gate("soft", "copied", "--fail-on", "worse", code=0).stdout.startswith(
        "gate passes: nothing failed\n"
    )


def test_too_few_runs_do_not_pass(gate):
    """Or a gate would be passed by deleting runs."""
    words = ["soft", "few", "--controller", "mine", "--law", "mine=gt", "--fail-on", RULE]
    done = gate(*words, code=4).stdout.splitlines()
    assert done[:2] == [
        "gate fails: 1 not shown",
        "not shown: mine: mean attitude error not worse by 5 %: 0.0 %, no bound from 4 runs; 5 "
        "runs would show it if nothing changed",
    ]
    allowed = gate(*words, "--undecided", "pass", code=0).stdout
    assert allowed.startswith("gate passes although not shown: 1 not shown\n")


def test_shares_need_many_runs(gate):
    """None of 20 in both: 1 − 0.05^(1/20) is 13.9 points, and 2 points for 149 runs."""
    done = gate("soft", "stiff", "--fail-on", "settled worse by 2 points", code=4).stdout
    assert (
        "nog: settled not worse by 2 points: 0.0 points, at least −13.9 points (95 %); 149" in done
    )


def test_a_run_that_fails_anew_is_no_better_mean(gate):
    done = gate("soft", "failing", "--fail-on", RULE, code=4).stdout.splitlines()
    assert done[:2] == [
        "gate fails: 1 worse, 4 hold",
        "worse: GT: 1 run failed that did not before: 7",
    ]
    assert gate("failing", "soft", "--fail-on", "failed", code=0)
    assert gate("soft", "failing", "--fail-on", "failed", "--undecided", "pass", code=4)


def test_worse_alone_is_the_word_of_the_comparison(gate):
    done = gate("soft", "stiff", "--fail-on", "worse", "--json", code=4)
    document = json.loads(done.stdout)
    decided = [x for x in document["pairs"] if x["word"] == "worse"]
    assert decided and len(document["gate"]["findings"]) == len(decided)
    assert "worse: EqT (stiff): effort: +" in str(document["gate"]["findings"])


def test_what_says_nothing_is_not_shown(gate):
    unsettled = gate("soft", "late", "--fail-on", "settling_time worse by 5 %", code=4).stdout
    assert "not shown: GT: settling time: " in unsettled
    assert "did not settle; use 'settled worse by 2 points'" in unsettled
    error = gate("rounded", "stiff", "--fail-on", RULE, code=4).stdout
    zero = gate("still", "soft", "--fail-on", "effort worse by 5 %", code=4).stdout
    why = "the means are 0, or within the error estimate of the runs; give a margin in a unit"
    assert why in error and why in zero


@pytest.mark.ci("starts a process")
@pytest.mark.skipif(os.name != "posix", reason="pipes as a POSIX shell has them")
def test_a_gate_fails_although_its_reader_has_left(changed):
    """`eqt compare … | head -1` under `pipefail`, as GitHub runs a step."""
    two = [changed / name for name in ("soft", "stiff")]
    words = [sys.executable, "-m", "eqt_cli", "compare", *two, "--fail-on", "effort worse by 5 %"]
    reads, writes = os.pipe()
    os.close(reads)
    done = subprocess.run(words, stdout=writes, stderr=subprocess.PIPE, check=False)
    os.close(writes)
    assert done.returncode == 4


@pytest.mark.ci("compiles a law twice")
def test_a_plugin_that_changed_is_what_differs(invoke, tmp_path, monkeypatch):
    """The configuration is the same, and the law has the other sign of its spring."""
    law = (ROOT / "examples" / "laws" / "damped.py").read_text(encoding="utf-8")
    for name, text in {"old": law, "new": law.replace("- spring", "+ spring")}.items():
        (tmp_path / name).mkdir()
        monkeypatch.chdir(tmp_path / name)
        Path("damped.py").write_text(text, encoding="utf-8")
        changes = {"controllers": "[damped]", "plugins": "[damped.py]"}
        Path("c.yaml").write_text(configuration(**changes), encoding="utf-8")
        with docs_runner.without_plugins():
            invoke("run", "c.yaml", "--out", "result", "--quiet")
    two = [tmp_path / name / "result" for name in ("old", "new")]
    done = invoke("compare", *two, "--fail-on", RULE, code=4)
    assert "what differs: file damped.py\n" in done.stdout


@pytest.mark.ci("solves the paper's experiment three times")
def test_the_gate_on_results_of_the_paper(invoke, tmp_path):
    """5 % less stiffness costs 1.3 %, which today's word calls worse for GT; 0.3 of it is worse."""
    for name, gain in {"old": "1", "less": "0.95", "third": "0.3"}.items():
        few = ["--set", "ensemble.runs=20", "--set", f"gains.kp={gain}"]
        invoke("run", "paper", *few, "--out", tmp_path / name, "--quiet")
    old = ["compare", tmp_path / "old"]
    held = invoke(*old, tmp_path / "less", "--fail-on", RULE).stdout
    page = (ROOT / "docs" / "howto" / "gate.md").read_text(encoding="utf-8")
    shown = next(block.text for block in docs_runner.blocks(page) if block.language == "text")
    assert "EqT: mean attitude error not worse by 5 %: +1.4 %, at most +4.1 % (95 %)" in shown
    assert "GT: mean attitude error not worse by 5 %: +1.3 %, at most +1.8 % (95 %)" in shown
    assert held.startswith(shown)
    worse = invoke(*old, tmp_path / "third", "--fail-on", RULE, code=4).stdout
    assert worse.startswith("gate fails: 4 worse\n")


@pytest.fixture
def repository(tmp_path, monkeypatch):
    """A repository with the files of `examples/gate`, and a function that runs a shell in it."""
    shutil.copytree(ROOT / "examples" / "gate", tmp_path / "mine")
    eqt = tmp_path / "bin" / "eqt"
    eqt.parent.mkdir()
    eqt.write_text(f'#!/bin/sh\nexec {shlex.quote(sys.executable)} -m eqt_cli "$@"\n')
    eqt.chmod(0o755)
    names = {
        f"GIT_{who}_{what}": "a" for who in ("AUTHOR", "COMMITTER") for what in ("NAME", "EMAIL")
    }
    path = f"{eqt.parent}{os.pathsep}{os.environ['PATH']}"
    environment = {**os.environ, **names, "PATH": path, "PYTHONPATH": str(ROOT)}

    def shell(command, **more):
        words = ["bash", "-e", "-c", command]  # as GitHub runs a step
        done = subprocess.run(
            words, cwd=tmp_path / "mine", env=environment | more, capture_output=True, text=True
        )
        return done.returncode, done.stdout, done.stderr

    assert shell("git init -q && git add . && git commit -qm law")[0] == 0
    return shell


def changed_gain(shell, key, value):
    """Commit a change of the law; returns the commit before."""
    before = shell("git rev-parse HEAD")[1].strip()
    edit = f"sed -i 's/{key}: [0-9.]*/{key}: {value}/' law.yaml"
    assert shell(f"{edit} && git commit -qam '{key} {value}'")[0] == 0
    return before


@pytest.mark.ci("runs the steps of a job, each with 200 runs before and now")
@pytest.mark.skipif(not shutil.which("git"), reason="needs git")
def test_the_steps_of_the_examples_judge_a_change(repository):
    """The job of GitHub on a pull request, without what installs, and the hook on staged files."""
    [job] = yaml.safe_load((ROOT / "examples/gate/not-worse.yml").read_text())["jobs"].values()
    *install, step = [step for step in job["steps"] if "run" in step]
    assert [each["run"] for each in install] == ["pip install ./eqt"]
    assert step["env"] == {"BASE": "${{ github.event.pull_request.base.sha }}"}
    hooks = yaml.safe_load((ROOT / "examples/gate/pre-commit-config.yaml").read_text())
    [hook] = hooks["repos"][0]["hooks"]
    code, said, _ = repository(step["run"], BASE=changed_gain(repository, "kd", 2.1))
    assert (code, said.splitlines()[0]) == (0, "gate passes: 3 hold")
    code, said, _ = repository(hook["entry"])
    assert code == 0 and "what differs: nothing" in said
    repository("sed -i 's/kp: 1.0/kp: 0.7/' law.yaml && git add law.yaml")
    code, said, _ = repository(hook["entry"])
    assert code == 4 and "worse: GT: mean attitude error worse by more than 5 %" in said
    code, said, _ = repository(step["run"], BASE=changed_gain(repository, "kp", 0.7))
    assert (code, said.partition(":")[0]) == (4, "gate fails")
    repository("sed -i 's/seed: 1/seed: 2/' law.yaml")
    code, _, error = repository(hook["entry"])
    assert code == 2 and "'initial' differs from " in error
    assert repository("sh gate.sh v1.0")[0] != 0  # no such commit
