"""Which number tells bad runs from others: planted ones, and none where nothing matters."""

import json

import numpy as np
import pytest
from small_experiment import configuration

from eqt_cli import api
from eqt_cli.extensions.failures.causes import BadRuns, Candidate, causes
from eqt_cli.results.result import open_result

RUNS = 200


def numbers(random, count=8):
    return [Candidate(f"n{k}", "1", random.standard_normal(RUNS)) for k in range(count)]


def of_bad(bad):
    return [BadRuns(0, bad, ~bad, "failed")]


@pytest.mark.ci("imports scipy.stats")
@pytest.mark.parametrize(
    ("way", "bad"),
    [
        ("high", lambda x: x > 1),
        ("low", lambda x: x < -1),
        ("at both ends", lambda x: np.abs(x) > 1.3),
        ("in the middle", lambda x: np.abs(x) < 0.3),
    ],
)
def test_a_planted_number_is_found_with_its_side(way, bad):
    """All runs beyond the planted limit are bad, and no other one."""
    known = numbers(np.random.default_rng(5))
    known[3] = Candidate("planted", "N m", known[3].values)
    wrong = bad(known[3].values)
    first, *others = causes(known, of_bad(wrong))[0]
    assert (first.candidate.name, first.way, first.telling) == ("planted", way, True)
    if way in ("high", "low"):
        assert first.share == 1.0
        assert first.beyond == (wrong.sum(), wrong.sum())
        assert first.within == (0, RUNS - wrong.sum())
        side = known[3].values[wrong]
        assert first.cut == (side.min() if way == "high" else side.max())
    assert not any(row.telling for row in others)


@pytest.mark.ci("imports scipy.stats")
def test_false_findings_are_rare():
    """Bad runs by chance alone: 5 of 100 answers are expected at most, 11 with p < 0.012."""
    random = np.random.default_rng(1)
    false = 0
    for _ in range(100):
        bad = np.zeros(RUNS, dtype=bool)
        bad[random.choice(RUNS, 20, replace=False)] = True
        false += causes(numbers(random), of_bad(bad))[0][0].telling
    assert false <= 10


HEAVY = configuration(
    name="heavy",
    inertia="[1, 1.2, 1.5]",
    gains="{kp: 1, kd: 1.2}",
    reference="{kind: constant}",
    controllers="[gt]",
    plant="{inertia: {relative: {uniform: [-0.5, 3]}}, forces: [{kind: constant, "
    "force: [{normal: [0, 0.01]}, 0, 0]}]}",
    ensemble="{runs: 200, seed: 3}",
    time="{duration: 15, samples: 61}",
)


@pytest.fixture(scope="session")
def heavy(made_once):
    def make(folder):
        (folder / "heavy.yaml").write_text(HEAVY)
        api.run(folder / "heavy.yaml", out=folder / "result")

    return made_once("failures_heavy", make) / "result"


@pytest.mark.ci("200 runs")
class TestAResult:
    def test_says_that_heavy_bodies_do_not_settle(self, heavy, invoke):
        """With ζ = kd/(2√(kp J)) below 0.4, errors of 2 rad take longer than 15 s."""
        said = " ".join(invoke("show", heavy, "--failures").stdout.split())
        assert "did not settle, mostly where plant.inertia.relative is high" in said
        (of_law,) = json.loads(invoke("show", heavy, "--failures", "--json").stdout)
        telling = [f["name"] for f in of_law["findings"] if f["p_value"] <= 0.05]
        assert telling == ["plant.inertia.relative"]
        with open_result(heavy) as result:
            values = result["drawn.plant.inertia.relative"]
            late = np.isnan(result.metric("settling_time")[0])
        assert sorted(of_law["bad_runs"]) == np.flatnonzero(late).tolist()
        beyond = of_law["findings"][0]
        assert beyond["beyond"]["runs"] == np.count_nonzero(values >= beyond["cut"])
        assert beyond["beyond"]["bad"] == np.count_nonzero(late & (values >= beyond["cut"]))

    def test_shows_a_run_with_what_it_drew(self, heavy, invoke):
        said = json.loads(invoke("show", heavy, "--run", 7, "--json").stdout)
        with open_result(heavy) as result:
            values = result["drawn.plant.inertia.relative"]
        drawn = {each["name"]: each for each in said["drawn"]}
        assert drawn["plant.inertia.relative"]["value"] == values[7]
        assert drawn["plant.inertia.relative"]["below"] == np.mean(values < values[7])
        assert "initial pose error" in drawn
        assert said["controllers"][0]["controller"] == "gt"
        assert "plant.inertia.relative" in invoke("show", heavy, "--run", 7).stdout

    def test_what_is_not_there_is_said(self, heavy, invoke):
        assert "0 to 199" in invoke("show", heavy, "--run", 200, code=2).stderr
        assert (
            "did you mean"
            in invoke("show", heavy, "--failures", "--controller", "gtt", code=2).stderr
        )
        options = "--figure", "failures", "--option", "x=plant.mass"
        assert "plant.inertia.relative" in invoke("plot", heavy, *options, code=2).stderr

    def test_the_figure_has_every_run_once(self, heavy):
        from eqt_cli.extensions.failures.figures import Failures

        with open_result(heavy) as result:
            (panel,) = Failures().draw([result], arranged=False).axes
            values = result["drawn.plant.inertia.relative"]
        points = [line for line in panel.lines if "cut" not in line.get_label()]
        assert sorted(np.concatenate([line.get_xdata() for line in points])) == sorted(values)


@pytest.mark.ci("two results")
def test_runs_that_are_alike_or_few_tell_nothing(tmp_path, invoke):
    alike = {"initial": "{pose: {kind: fixed, coordinates: [1, 0, 0]}}", "ensemble": "{runs: 1}"}
    for name, changes in (("alike", alike), ("few", {})):
        (tmp_path / f"{name}.yaml").write_text(configuration(**changes))
        api.run(tmp_path / f"{name}.yaml", out=tmp_path / name)
    assert "alike" in invoke("show", tmp_path / "alike", "--failures", code=2).stderr
    said = " ".join(invoke("show", tmp_path / "few", "--failures").stdout.split())
    assert "too few runs" in said
    assert "ensemble.runs" in said
