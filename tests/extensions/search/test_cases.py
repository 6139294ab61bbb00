"""Tuning over named cases: how they are joined, what is run, what is said of the winners."""

import json
import re
from copy import deepcopy

import numpy as np
import pytest
import small_experiment
from case_tables import from_yaml
from said import error_of, mentions

from eqt_cli import api
from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import Forest
from eqt_cli.extensions.report.document import report
from eqt_cli.extensions.search.fronts import Population, Scores, held_out
from eqt_cli.extensions.search.record import TUNE
from eqt_cli.extensions.search.tables import tuning_answer, tuning_tables
from eqt_cli.extensions.search.tune import Search
from eqt_cli.results.result import open_result

WHEEL = small_experiment.WHEEL | {
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 2.0, "samples": 5},
    "solver": {"rtol": 1.0e-6, "cross_check": 0},
    "tune": {
        "over": {"gains.kp": [0.1, 1]},
        "objective": "mean_pose_error",
        "subject_to": {"final_pose_error": 1.0},
        "budget": 5,
        "samples": 1,
        "cases": {"ideal": {}, "late": {"control.delay": 1}},
        "over_cases": "worst",
        "confirm": {"runs": 6},
    },
}
"""The cases differ in their states: a delay keeps a command."""


def read(**changed):
    return Search.read(document_from(WHEEL | {"tune": WHEEL["tune"] | changed}, {}))


@pytest.fixture(scope="module")
def tuned(tmp_path_factory):
    """A search to its end, and its folder; to be read only."""
    folder = tmp_path_factory.mktemp("tuned") / "w"
    return api.tune(deepcopy(WHEEL), folder), folder


def tried_in(folder):
    """All points that a search has tried, by law and sample."""
    tried = {}
    for batch in sorted(folder.glob("generations/*.json")):
        for name, of_batch in json.loads(batch.read_text())["tried"].items():
            for key, values in of_batch.items():
                tried.setdefault(name, {}).setdefault(key, []).extend(values)
    return tried


def test_the_mean_and_the_worst_of_cases_choose_different_points():
    def of(*objectives, violation=0.0):
        none = np.zeros(2, dtype=int)
        return Scores(np.array(objectives)[:, None], np.array([0, violation]), none + 1, none)

    cases = [of(1, 3), of(6, 5)]
    mean, worst = (Scores.over_cases(cases, worst=how) for how in (False, True))
    assert [Population(np.eye(2), scores).best for scores in (mean, worst)] == [0, 1]
    assert worst.objectives[:, 0].tolist() == [6, 5]
    assert worst.failed.tolist() == [2, 2]
    kept = Scores.over_cases([cases[0], of(6, 5, violation=0.5)], worst=True)
    assert Population(np.eye(2), kept).best == 0  # a bound is to hold in each case


def test_a_point_is_scored_by_its_worst_case(tuned, tmp_path):
    done, folder = tuned
    [law], [search] = done.search.laws, tried_in(folder).values()
    (winner,) = done.record["laws"][0]["winners"]
    best = int(np.argmin(search["costs"]))
    assert winner["objectives"] == [search["costs"][best]]
    assert winner["values"] == law.values(search["shares"][best])
    means = []
    for case in ("ideal", "late"):  # as an ordinary sweep runs them
        settings = WHEEL["tune"]["cases"][case]
        values = [law.values(row)["gains.kp"] for row in search["shares"]]
        sweep = [{"cases": {case: settings}}, {"grid": {"gains.kp": values}}]
        config = {key: each for key, each in WHEEL.items() if key != "tune"} | {"sweep": sweep}
        swept = api.sweep(config, out=tmp_path / case)
        means.append(swept["mean_pose_error"].reshape(len(values), -1).mean(axis=1))
    np.testing.assert_allclose(search["costs"], np.max(means, axis=0), rtol=1e-5)


def test_the_runs_are_as_many_as_a_dry_run_says(tuned):
    done, folder = tuned
    [search] = tried_in(folder).values()
    counted, search = len(search["costs"]) * 2 * 2, read()
    assert (counted, done.judged.runs) == (search.searched_runs, search.judging_runs) == (20, 24)


def test_held_out_runs_are_those_of_the_worst_case_of_each_law(tuned):
    done, folder = tuned
    with open_result(folder) as result:
        assert TUNE.beside(result) == done.record
        cases = result.counted("mean_pose_error")
        whole = held_out(result, done.record)
        late = cases[1]
        assert (late.mean(axis=-1) > cases[0].mean(axis=-1)).all()
        assert whole.counted("mean_pose_error").tolist() == late.tolist()
        mean = held_out(result, done.record | {"over_cases": "mean"})
        assert np.allclose(mean.counted("mean_pose_error"), cases.mean(axis=0), rtol=1e-15)
        tables = {table.name: table for table in tuning_tables(result, done.record)}
        [bound] = done.record["constraints"]
        strict = done.record | {"constraints": [bound | {"bound": 1e-7}]}
        [answer] = tuning_answer(result, strict)
        page = Forest().subject([result], ())
    assert page.titles == ["stabilising", "stabilising, start"]
    assert (
        tables["tuned"]
        .notes[0]
        .startswith("Searched: 5 points for every law on 1 training sample of 2 runs in each")
    )
    assert tables["tuned"].notes[1] == (
        "Over the cases ideal and late: each number is from the case in which the mean over all "
        "runs is worst."
    )
    blocks = ["mean ‖I − Q_E‖", "mean attitude error in deg", "mean ‖τ‖ in N m"]
    assert [block.title for block in tables["tuned"].blocks] == blocks
    assert [row[0] for row in tables["tuned"].rows] == ["stabilising"] * 3
    assert answer.rows == tables["tuned"].blocks[0].rows
    broken = re.findall(
        r"([\w, ]+) \(final_pose_error ≤ 1e-07 in the mean: [\d.e-]+\)", answer.notes[0]
    )
    assert answer.notes[0].startswith("Bounds violated on the held-out runs: stabilising, ideal (")
    assert answer.notes[1] == tables["tuned"].notes[1]
    assert len(broken) == 4
    assert [row[0] for row in tables["cases"].blocks[0].rows] == ["ideal", "late"]
    bounds = [row[0] for row in tables["bounds"].blocks[0].rows]
    laws = ("stabilising", "stabilising, start")
    assert bounds == [f"{law}, {case}" for case in ("ideal", "late") for law in laws]


@pytest.mark.ci("draws the page")
def test_the_report_has_the_tables(tuned, unarranged):
    with open_result(tuned[1]) as result:
        page = report(result)
    assert "Tuned laws on held-out runs" in page
    assert "of the tuned laws in each case" in page


def test_cases_in_another_order_are_another_search():
    cases = WHEEL["tune"]["cases"]
    assert read(cases=dict(reversed(cases.items()))).digest != read().digest


@from_yaml
def test_what_is_wrong_with_cases_is_said_at_its_place(changed, message):
    assert mentions(error_of(read, **changed, kind=ConfigError), message)
