"""`eqt tune` and `eqt worst` as users see them."""

import json
import re
import signal
from pathlib import Path
from unittest.mock import Mock

import pytest
from small_experiment import configuration

from eqt_cli.base.process import Interrupted
from eqt_cli.extensions.search.tables import _means_over

TUNE = """\
tune:
  over: {gains.kp: {log: [0.1, 10]}, gains.kd: {log: [0.1, 10]}}
  objective: mean_pose_error
  subject_to: {effort: {max: %s}}
  budget: 8
  samples: 3
  confirm: {runs: 6}
"""
WORST = """\
worst:
  over: {plant.inertia.relative: [-0.1, 0.1]}
  objective: mean_pose_error
  budget: 1
  population: 5
  seeds: 1
"""


@pytest.fixture(autouse=True)
def folder(folder, monkeypatch):
    """The current folder, with a small configuration in it."""
    monkeypatch.setenv("NO_COLOR", "1")
    (folder / "c.yaml").write_text(configuration(), encoding="utf-8")
    return folder


@pytest.fixture
def untimed(monkeypatch):
    """Dry runs that time nothing: every run takes 0.1 s."""
    monkeypatch.setattr("eqt_cli.runs.preflight._time_per_run", lambda *_: 0.1)


@pytest.fixture
def config(folder):
    path = folder / "t.yaml"
    path.write_text((folder / "c.yaml").read_text() + TUNE % "1000", encoding="utf-8")
    return path


@pytest.mark.ci("searches, confirms and compares")
@pytest.mark.usefixtures("unarranged")
def test_it_prints_winners_bounds_and_pairs_on_held_out_runs(eqt, config):
    done = eqt("tune", config)
    assert done.code == 0
    assert re.fullmatch(r"runs     \d+ \(3 runs at each .*to judge the outcome\n", done.err)
    for line in (
        "Tuned laws against their starting gains: means over 6 held-out runs ± half the 95 %",
        "By mean ‖I − Q_E‖: ",
        "Bounds violated on the held-out runs: none.",
        "results  results/t-tuned",
        "next     eqt run results/t-tuned/tuned/eqt.yaml",
    ):
        assert line in done.out
    assert len(done.out.splitlines()) <= 20
    for line in (
        "for every law on 3 training samples of 3 runs; at most 8 and 3 × 5 after",
        "exchanges between the samples.",
        "Constraints on the held-out runs",
        "Tuned laws against each other, over 3 training samples and 6 runs",
        "GT against EqT",
    ):
        assert line not in done.out
        assert line in eqt("show", "results/t-tuned").out
    assert eqt("run", "results/t-tuned/tuned/eqt.yaml").code == 0
    assert eqt("compare", "results/t-tuned").code == 0
    assert "Tuned laws on held-out runs" in _report(eqt)


def test_means_over_few_runs_promise_no_interval():
    said = [_means_over(Mock(runs=runs)) for runs in (1, 4, 5)]
    assert said[:2] == ["means over 1 held-out run", "means over 4 held-out runs"]
    assert said[2] == "means over 5 held-out runs ± half the 95 % interval"


def _report(eqt):
    assert eqt("report", "results/t-tuned").code == 0
    return Path("results/t-tuned/report.html").read_text(encoding="utf-8")


@pytest.mark.ci("searches, confirms and compares")
def test_as_json(eqt, config):
    laws = "controllers=[eqt, {kind: gt, label: none}]"
    done = eqt("tune", config, "--json", "--out", "out", "--set", laws)
    found = json.loads(done.out)
    assert [law["label"] for law in found["laws"]] == ["eqt", "none"]
    assert found["causes"] == []
    remarked = [text for text in found["remarks"] if "reads as a word of a sentence" in text]
    assert len(remarked) == 1 and remarked[0] in done.err
    assert remarked == json.loads(eqt("show", "out", "--json").out)["remarks"]


def test_a_bound_that_no_point_keeps_ends_with_4_and_the_least_violation(eqt, config):
    never = config.read_text().replace("1000", "1.0e-9").replace("budget: 8", "budget: 2")
    config.write_text(never, encoding="utf-8")
    done = eqt("tune", config)
    assert done.code == 4
    for law in ("eqt", "gt"):
        asked = r"effort is at best [\d.]+, and effort ≤ 1e-09 in every run was asked for"
        assert re.search(f"no feasible point of {law}: {asked}", done.out)
    assert not Path("results/t-tuned/tuned").exists()


def test_an_interruption_says_the_best_so_far(eqt, config, monkeypatch):
    def stopped(*_):
        raise Interrupted(signal.SIGINT)

    monkeypatch.setattr("eqt_cli.extensions.search.tune.Search.confirmation", stopped)
    done = eqt("tune", config, "--set", "tune.budget=1")
    assert done.code == 130
    assert "interrupted; the search is kept in results/t-tuned: run the same" in done.err
    assert re.search(
        r"^  eqt, 3 points on 3 training samples, best so far: mean_pose_error [\d.]+ at kp ",
        done.err,
        re.M,
    )
    assert Path("results/t-tuned/tuned/gt.yaml").exists()


def test_a_folder_with_another_result_is_left_alone(eqt, config):
    assert eqt("run", "c.yaml", "--out", "out", "--quiet").code == 0
    done = eqt("tune", config, "--out", "out")
    assert done.code == 2
    assert "out: holds a result that eqt tune did not write" in done.err


@pytest.mark.usefixtures("untimed")
def test_a_dry_run_says_points_runs_and_time_and_searches_nothing(eqt, config):
    done = eqt("tune", config, "--dry-run", "--workers", "1")
    assert (done.code, done.err) == (0, "")
    points, runs, time, small, _ = done.out.splitlines()
    assert small.startswith("tune.budget 8 is small for 2 numbers of eqt")
    searched = "(8 points + 3 × 5 after exchanges between the samples)"
    assert points == f"2 laws × 3 training samples × at most {searched} = 138"
    assert runs == "runs     414 (3 runs at each point), and at most 48 to judge the outcome"
    assert re.fullmatch(r"time     about \S+ (s|min) with 1 worker", time)
    assert not Path("results").exists()
    found = json.loads(eqt("tune", config, "--dry-run", "--json").out)
    assert (found["points"], found["runs"]) == (138, 462)


@pytest.fixture
def worst(folder, monkeypatch):
    monkeypatch.setattr("eqt_cli.extensions.search.worst.MOST_ON_A_LINE", 2)
    path = folder / "t.yaml"
    path.write_text((folder / "c.yaml").read_text() + WORST, encoding="utf-8")
    return path


@pytest.mark.ci("searches, and draws what it finds")
def test_an_angle_to_prove_is_refused_before_the_search(refused, worst):
    pytest.importorskip("clarabel", reason="the extra certify is not installed")
    said = refused("worst", worst, "--certified", "200")
    assert said == "the angle of a start: expected 0 to below 180 deg, got 200\n"


def test_worst_prints_what_was_found_and_draws_it(eqt, worst):
    done = eqt("worst", worst, "--fail-above", "100")
    told = "at most 42 for the picture along all keys (worst.profile)"
    runs = f"runs     30 (3 runs at each point), and {told}\n"
    assert (done.code, done.err) == (0, runs)
    for line in (
        "The worst run that was found: mean ‖I − Q_E‖",
        "Searched: 1 generation of 5 points, each of 3 runs, for every law, with the seed 0. Worse",
        "results  results/t-worst",
        "next     eqt run results/t-worst/worst/eqt.yaml",
    ):
        assert line in done.out
    shown = eqt("show", "results/t-worst").out  # the same table
    assert done.out.partition("results  ")[0].strip() in shown
    assert eqt("plot", "results/t-worst", "--format", "json").code == 0
    assert Path("results/t-worst/figures/worst.json").exists()


@pytest.mark.ci("searches again")
def test_a_law_that_is_worse_than_it_may_be_ends_with_4(eqt, worst):
    done = eqt("worst", worst, "--json", "--fail-above", "0")
    assert done.code == 4
    found = json.loads(done.out)
    assert found["causes"] == [
        f"{law['label']}: mean_pose_error {law['value']:.4g} is above 0" for law in found["laws"]
    ]
    assert [law["label"] for law in found["laws"]] == ["eqt", "gt"]


@pytest.mark.parametrize("section", ["tune", "worst"])
def test_config_check_looks_at_the_section(eqt, refused, request, section):
    config = request.getfixturevalue("config" if section == "tune" else section)
    assert eqt("config", "check", config).code == 0
    config.write_text(config.read_text().replace("mean_pose_error", "mean_pose"), encoding="utf-8")
    said = "objective: no metric 'mean_pose' is stored of every run; did you mean"
    assert f"{section}.{said}" in refused("config", "check", config)


def test_a_name_that_is_too_long(refused):
    assert "file name too long" in refused("tune", 300 * "n").lower()
