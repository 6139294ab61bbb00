"""The page of a sweep: its points with means over runs, the best of them, its figures."""

from dataclasses import replace

import numpy as np
import pytest

import eqt_cli
from eqt_cli.analysis.maps import NOBODY, extreme_points, winners
from eqt_cli.api.loading import open_at
from eqt_cli.base.reporting import significant
from eqt_cli.extend import EqtError
from eqt_cli.extensions.report.document import report
from eqt_cli.extensions.report.opening import extremes, points_won
from eqt_cli.extensions.report.summary import point_table


@pytest.fixture(scope="module")
def results(swept_result):
    with open_at(swept_result) as opened:
        yield opened


@pytest.fixture(scope="module")
def text(page_of, swept_result):
    return page_of(swept_result).read_text(encoding="utf-8")


@pytest.mark.ci("draws the page of a sweep")
def test_the_line_of_facts_says_what_was_swept(text):
    assert "4 laws · 6 points over gains.kp and gains.kd · 5 runs of 4 s each · " in text


def test_every_point_of_every_controller_is_in_the_table(results):
    table = point_table(results)
    heads = [(column["name"], column["unit"]) for column in table["columns"][:2]]
    assert heads == [("gains.kp", "N m"), ("gains.kd", "N m s")]
    assert extreme_points(results, ["effort"]).header[3:5] == ["gains.kp, N m", "gains.kd, N m s"]
    assert len(table["rows"]) == table["total"] == 24
    place = [column["name"] for column in table["columns"]].index("effort ∫‖τ‖² dt")
    for _, point, status, kp, kd, *_ in table["rows"]:
        assert status == "ok"
        assert (kp, kd) == (results["gains.kp"][point], results["gains.kd"][point])
    row = table["rows"][7]
    assert row[:2] == [1, 1]
    assert row[3 + place] == float(f"{results['effort'][1, 1].mean():.6g}")


def test_a_sweep_opens_with_the_points_that_laws_win(results):
    wins = winners(results)[0]
    won = [replace(wins.cells[0], winner=law, alike=False) for law in (1, 1, NOBODY, 3)]
    said = points_won(replace(wins, cells=won, without_winner="undecided"))
    assert said == "GT wins 2 of 4 points by its mean attitude error, asym 1, 1 undecided."
    assert points_won(replace(wins, cells=won[2:3])).startswith("With 5 runs at each point, no law")


def test_a_sweep_of_one_law_opens_with_its_least_and_its_greatest_error(results):
    means = results["mean_attitude_error"].mean(axis=-1)[:, 0]
    ends = [f"{significant(means[k])} deg at {results.point_name(k)}" for k in means.argsort()]
    said = extremes(results)
    assert ends[0] in said.partition("; ")[0] and ends[-1] in said.partition("; ")[2]


def test_a_point_at_which_runs_failed_counts_them_and_has_no_means(results, monkeypatch):
    status = results["status"]
    status[2, 0, :2] = 1
    monkeypatch.setattr(results, "status", status)
    (row,) = (row for row in point_table(results)["rows"] if row[:2] == [0, 2])
    place = [column["name"] for column in point_table(results)["columns"]].index("largest ‖τ‖")
    assert row[2] == "2 of 5 failed"
    assert row[3 + place] is None


def test_the_best_point_is_one_at_which_no_run_failed(results, monkeypatch):
    status, best = results["status"], int(np.argmin(results["effort"].mean(axis=-1)[:, 0]))
    status[best, 0, 0] = 1
    monkeypatch.setattr(results, "status", status)
    (block,) = (
        b for b in extreme_points(results, ["effort"]).blocks if b.title.startswith("effort")
    )
    assert block.rows[0][2] != str(best)


def test_the_best_point_has_the_least_mean_and_the_worst_the_largest(results):
    (block,) = (
        b for b in extreme_points(results, ["effort"]).blocks if b.title.startswith("effort")
    )
    means = results["effort"].mean(axis=-1)
    expected = []
    for controller, title in enumerate(results.titles):
        for end, found in (("best", np.argmin), ("worst", np.argmax)):
            point = int(found(means[:, controller]))
            values = [f"{results[key][point]:.4g}" for key in ("gains.kp", "gains.kd")]
            expected.append(
                [title, end, str(point), *values, significant(means[point, controller])]
            )
    assert block.rows == expected


@pytest.mark.ci("draws the page of a sweep")
def test_its_figures_are_those_of_sweeps(text):
    assert text.count("<figure id=") == 4  # the loop first; no law wins: no map of winners
    assert 'id="picker"' not in text and 'id="claims"' not in text and "All points" in text
    assert "could not be verified" not in text


@pytest.mark.ci("computes a sweep of eight points, and draws its page")
@pytest.mark.usefixtures("unarranged")
def test_three_keys_leave_out_the_maps(invoke, tmp_path):
    grids = [
        word
        for key in ("gains.kp", "gains.kd", "ensemble.seed")
        for word in ("--grid", f"{key}=1,2")
    ]
    settings = ["ensemble.runs=2", "time.duration=1", "time.samples=5", "solver.cross_check=0"]
    invoke("config", "new", "--from", "paper", tmp_path / "paper.yaml")
    invoke(
        "sweep",
        tmp_path / "paper.yaml",
        "--out",
        tmp_path / "out",
        "--quiet",
        *(f"--set={setting}" for setting in settings),
        *grids,
    )
    with open_at(tmp_path / "out") as results:
        text = report(results)
    assert text.count("<figure id=") == 1 and "Pareto front" in text
    assert "8 points over gains.kp, gains.kd and ensemble.seed · 2 runs" in text


def test_a_page_of_a_sweep_is_against_no_law(swept_result):
    with pytest.raises(EqtError, match="--against: applies to one experiment; choose a point"):
        eqt_cli.report(swept_result, against="gt", quick=True)
