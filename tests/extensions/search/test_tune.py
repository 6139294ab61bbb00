"""Searches over real runs: what they find, what they keep, how they go on."""

import json
import math
from copy import deepcopy
from shutil import copytree
from types import SimpleNamespace

import numpy as np
import pytest
import yaml
from faults_harness import assert_equal, contents
from stored import of_variable_length

from eqt_cli import api
from eqt_cli.analysis.maps import RULE
from eqt_cli.api.comparing import compare
from eqt_cli.base.files import write_record
from eqt_cli.base.reporting import Block, Reporter, TextTable, reporting
from eqt_cli.config import shipped
from eqt_cli.config.document import document_of
from eqt_cli.extend import EqtError
from eqt_cli.extensions.report.document import report
from eqt_cli.extensions.search import ratios
from eqt_cli.extensions.search.fronts import Constraint, scores
from eqt_cli.extensions.search.record import fits_tuning
from eqt_cli.extensions.search.tables import _notes, _ranking, tuning_answer, tuning_tables
from eqt_cli.results.conclusion import conclusion_of
from eqt_cli.results.metrics import QUANTITIES
from eqt_cli.results.result import open_result


def read(folder):
    return dict(json.loads((folder / "tuning.json").read_text()))


@pytest.mark.ci("searches to the end")
def test_the_shipped_problem_is_solved_to_a_hundredth(tmp_path):
    """As derived in its file: the first overshoot touches the threshold, at the stiffest spring."""
    config = yaml.safe_load(shipped.text("tune_so2"))
    config["time"] = {"duration": 8.0, "samples": 801}
    config["solver"] = {"rtol": 1e-8, "method": "DOP853"}
    (winner,) = api.tune(config, tmp_path / "so2").record["laws"][0]["winners"]
    zeta = math.log(20) / math.hypot(math.pi, math.log(20))
    assert winner["values"]["gains.kp"] == pytest.approx(0.5, rel=0.01)
    assert winner["values"]["gains.kd"] == pytest.approx(2 * zeta, rel=0.01)
    root = math.sqrt(1 - zeta**2)
    grid = np.linspace(0, 4, 400_001)  # where the way down first meets the threshold
    x = np.exp(-zeta * grid) * (np.cos(root * grid) + zeta / root * np.sin(root * grid))
    assert winner["objectives"][0] == pytest.approx(grid[np.argmax(x < 0.05)], rel=0.01)


def test_a_search_leaves_winners_ready_to_run_and_held_out_runs(searched):
    done, folder = searched
    for law in done.record["laws"]:
        (winner,) = law["winners"]
        loaded = api.load_experiment(folder / winner["config"])
        assert loaded.controllers == [law["label"]]
        given = loaded.resolved["gains"]["kp"]
        assert given == winner["values"]["gains.kp"]
    with open_result(folder) as result:
        assert result.labels == ["eqt", "family", "eqt, start", "family, start"]
        assert result.runs == 6
        assert document_of(result).data["ensemble"]["seed"] == 9
    law = done.search.laws[0]
    assert law.values(law.start or ())["gains.kp"] == pytest.approx(1.0)


def test_a_comparison_has_no_seeds_and_blames_no_gains(searched, tmp_path):
    """A winner of one seed is a law only where somebody asks for it."""
    _, folder = searched
    record = read(folder)
    record["laws"][0]["searches"][0]["label"] = "family, start"  # as if a seed's winner
    copy = tmp_path / "copy"
    copy.mkdir()
    (copy / "results.h5").write_bytes((folder / "results.h5").read_bytes())
    alone = compare(copy)
    assert alone.labels == ["eqt", "family", "eqt, start", "family, start"]
    assert alone.gains and alone.not_matched
    del record["checksum"]
    write_record(copy / "tuning.json", record)
    tuned = compare(copy)
    assert tuned.labels == ["eqt", "family", "eqt, start"]
    assert not tuned.gains and not tuned.not_matched
    assert not any(line.startswith("gains are not") for line in tuned.answer())
    some = compare(copy, controllers=["eqt", "family, start"])
    assert some.labels == ["eqt", "family, start"]


def test_a_winner_is_no_worse_than_the_start_on_the_runs_of_the_search(searched):
    """The starting gains are one of the points, and count as an ordinary run has them."""
    done, folder = searched
    tried = json.loads((folder / "generations/000.json").read_text())["tried"]
    for law in done.search.laws:
        first = tried[f"{law.slug}, sample 1"]
        assert first["shares"][0] == list(law.start)
        (winner,) = next(x for x in done.record["laws"] if x["label"] == law.label)["winners"]
        assert winner["objectives"][0] <= first["costs"][0]


def test_a_second_session_computes_nothing_and_finds_the_same(small, searched, monkeypatch):
    done, folder = searched
    monkeypatch.setattr("eqt_cli.runs.run_study.Session.run", None)
    assert api.tune(small, folder).record == done.record


@pytest.mark.ci("searches three times")
def test_more_held_out_runs_keep_the_earlier_ones(small, tmp_path):
    small["solver"] = {"engine": "native", "rtol": 1e-6}
    before = api.tune(small, tmp_path / "t").judged.runs
    small["tune"]["confirm"] = small["tune"].get("confirm", {}) | {"runs": 7}
    grown, whole = api.tune(small, tmp_path / "t"), api.tune(small, tmp_path / "other")
    assert grown.judged.taken == before < grown.judged.runs == whole.judged.runs
    assert_equal(tmp_path / "t", contents(tmp_path / "other"))


@pytest.mark.ci("searches three times")
def test_more_generations_go_on_where_fewer_ended(small, tmp_path):
    api.tune(small, tmp_path / "t")
    small["tune"]["budget"] = 12
    done = api.tune(small, tmp_path / "t")
    assert done.record == api.tune(small, tmp_path / "other").record
    with open_result(tmp_path / "t") as one, open_result(tmp_path / "other") as other:
        assert np.array_equal(one["mean_pose_error"], other["mean_pose_error"])


@pytest.mark.ci("searches twice")
def test_another_search_takes_the_place_of_one_only_where_it_is_told_to(small, tmp_path):
    small["tune"]["budget"] = 5
    api.tune(small, tmp_path / "t")
    small["tune"]["objective"] = "effort"
    with pytest.raises(EqtError, match="holds another tuning"):
        api.tune(small, tmp_path / "t")
    assert api.tune(small, tmp_path / "t", force=True).record["objectives"] == ["effort"]


@pytest.mark.ci("searches for many candidates")
def test_the_winners_of_a_front_are_numbered_and_none_betters_another(small, tmp_path):
    for key in ("objective", "samples"):
        del small["tune"][key]
    front = {"objectives": ["effort", "mean_pose_error"], "budget": 10, "population": 5, "seeds": 1}
    small["tune"] |= front
    done = api.tune(small, tmp_path / "t")
    for law in done.record["laws"]:
        found = np.array([winner["objectives"] for winner in law["winners"]])
        assert len(found) > 1
        assert (np.diff(found[:, 0]) > 0).all()
        assert (np.diff(found[:, 1]) < 0).all()
        files = {path.name for path in (tmp_path / "t/tuned" / law["label"]).iterdir()}
        assert files - {"stored_plugins"} == {f"{k + 1}.yaml" for k in range(len(found))}


GOOD = np.zeros((2, 4), dtype=int)


def test_failed_runs_violate_and_unsettled_ones_count(stored):
    nan, errors = math.nan, [[1, 1, 1, 1], [2, 2, 2, 6]]
    times = [[nan, 1, 1, 1], [1, 2, nan, nan]]
    result = stored([[1, 0, 0, 0], [0] * 4], mean_pose_error=errors, settling_time=times)
    found = scores(result, ["mean_pose_error"], [])
    assert found.violation.tolist() == [0.25, 0]
    assert found.failed.tolist() == [1, 0]
    assert found.unsettled.tolist() == [0, 2]
    assert found.objectives[:, 0].tolist() == [1, 3]


def test_a_run_that_does_not_settle_counts_with_the_horizon(stored):
    result = stored(GOOD, settling_time=[[1, 2, 3, 4], [2, 2, math.nan, 6]])
    found = scores(result, ["settling_time"], [])
    assert found.objectives[:, 0].tolist() == [2.5, 5]


def test_a_number_of_a_part_is_an_objective(stored):
    """As its whole is: less is better."""
    values = [[1, 2, 3, 4], [2, 2, 2, 6]]
    result = stored(GOOD, effort_rotation=values, settling_time=values)
    result.attributes = {"group": "SE3"}
    found = scores(result, ["effort_rotation"], [])
    assert found.objectives[:, 0].tolist() == [2.5, 3]


@pytest.mark.parametrize(
    ("bound", "violation"),
    [
        (Constraint("mean_pose_error", 2.0, above=True, every_run=False), [0, 0.5]),
        (Constraint("mean_pose_error", 2.0, above=True, every_run=True), [0, 2.0]),
        (Constraint("settled", 0.8, above=False, every_run=False), [0, 0.375]),
    ],
)
def test_how_much_a_bound_is_violated(stored, bound, violation):
    times = [[1] * 4, [1, 2, math.nan, math.nan]]
    result = stored(GOOD, mean_pose_error=[[1] * 4, [2, 2, 2, 6]], settling_time=times)
    found = scores(result, ["mean_pose_error"], [bound])
    assert found.violation == pytest.approx(violation)


@pytest.mark.parametrize(("every", "violation"), [(False, 0.25), (True, 1.25)])
def test_a_run_without_a_value_violates_a_bound_on_every_run(stored, every, violation):
    errors = [[1, 1, 1, math.nan]]
    result = stored([[0, 0, 0, 1]], mean_pose_error=errors, settling_time=[[1] * 4])
    bound = Constraint("mean_pose_error", 2.0, above=True, every_run=every)
    assert scores(result, ["mean_pose_error"], [bound]).violation.tolist() == [violation]


@pytest.mark.ci("searches several times")
def test_what_was_found_is_kept_when_the_search_is_interrupted(small, tmp_path, searched):
    class Stopping(Reporter):
        def note(self, about, words):
            if about == "family":
                raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), reporting(Stopping()):
        api.tune(small, tmp_path / "t")
    assert (tmp_path / "t/generations/000.json").exists()
    assert api.tune(small, tmp_path / "t").record == searched[0].record


@pytest.mark.ci("searches for many candidates")
def test_the_winners_of_all_samples_stand_side_by_side_on_held_out_runs(searched_twice):
    folder, record = searched_twice
    eqt, family = record["laws"]
    assert [search["seed"] for search in eqt["searches"]] == [1, 2]
    assert family["searches"] == [
        search | {"label": search["label"].replace("eqt", "family")} for search in eqt["searches"]
    ]  # with g = 1, n = 0 and c = 0 this member of the family is EqT, and starts where EqT starts
    costs = {search["label"]: search["objectives"][0][0] for search in eqt["searches"]}
    assert min(costs, key=lambda label: costs[label]) == "eqt"  # the lower middle one of two
    assert eqt["winners"][0]["objectives"] == [costs["eqt"]]
    with open_result(folder) as result:
        assert set(costs) < set(result.labels)
        assert len(result.labels) == 6


@pytest.mark.ci("searches twice")
def test_two_samples_call_no_law_better(searched_twice):
    folder, record = searched_twice
    with open_result(folder) as result:
        tables = {table.name: table for table in tuning_tables(result, record)}
        [answer] = tuning_answer(result, record)
        means = dict(zip(result.labels, result.means("mean_pose_error").tolist(), strict=True))
    tuned = tables["tuned"]
    both = [means[search["label"]] for search in record["laws"][0]["searches"]]
    assert tuned.header == ["law", "best values", "start", "tuned"]
    assert float(tuned.blocks[0].rows[0][3]) == pytest.approx(np.mean(both), abs=0.05)
    assert tuned.notes[0] == (
        "Searched: 5 points for every law on 2 training samples of 2 runs; at most 5."
    )
    assert (answer.header, answer.blocks) == (tuned.header, tuned.blocks[:1])
    assert answer.notes[0].startswith("No law is called better: 2 training samples do not show")
    assert [row[-1] for row in tables["pairs"].rows] == ["not judged"]
    stars = [row[:2] for row in tables["samples"].rows if "*" in row[1]]
    assert [law for law, _ in stars] == ["EqT", "family"]


@pytest.fixture
def unfinished(searched_twice, tmp_path, monkeypatch):
    """A tuning whose family gained 2.1 % in its last exchange; two samples are enough for it."""
    monkeypatch.setattr(ratios, "FEWEST_SAMPLES", 2)
    folder, record = copytree(searched_twice[0], tmp_path / "t"), deepcopy(searched_twice[1])
    for law, gained in zip(record["laws"], (0.001, 0.021), strict=True):
        law["searches"][1]["gained"], law["searches"][0]["gained"] = gained, 0.0
    record["budget"] = 100
    write_record(folder / "tuning.json", record)
    return folder


ENDED = (
    "Search not finished: family gained 2.1 % in its last exchange between samples; "
    "tune.budget: 140 would go on."
)


@pytest.mark.ci("searches twice")
def test_a_search_that_is_not_finished_is_said_first_and_to_programs(unfinished, invoke):
    document = json.loads(invoke("show", unfinished, "--json").stdout)["verdicts"]
    assert [pair["verdict"] for pair in document["pairs"]] == ["search not finished"]
    assert document["pairs"][0]["unfinished"] == ["family"]
    assert document["remarks"] == [ENDED]
    with open_result(unfinished) as result:
        concluded = conclusion_of(result)
        first = concluded.tables()[0]
        assert (first.name, first.notes[0]) == ("tuned", ENDED)
        assert concluded.finding(concluded.tables()).startswith(f"{ENDED} By ")
        assert ENDED in concluded.premise  # of words run by run, for chosen windows
        alone = read(unfinished)  # of one law, too, which has no pairs
        assert tuning_tables(result, alone | {"laws": alone["laws"][1:]})[0].notes[0] == ENDED


@pytest.mark.ci("searches twice")
@pytest.mark.needs("report")
def test_the_page_calls_no_law_better_whose_search_is_not_finished(unfinished):
    with open_result(unfinished) as result:
        page = report(result, [])
    assert '<p class="finding">Search not finished: family gained' in page
    assert '<span class="verdict undecided">search not finished</span>' in page


def test_the_answer_of_fronts_is_that_at_their_middle_cost(monkeypatch):
    rows = [
        [f"GT, {law}", f"{cost}", "1", "2", f"{cost} %", "GT", "3 %"]
        for law in ("EqT", "nog")
        for cost in (10, 20, 30)
    ]
    header = ["laws", "cost", "error", "error of the other", "less by", "better", "over searches"]
    table = TextTable("fronts", "", header, [Block("", rows)], ["a note"])
    monkeypatch.setattr("eqt_cli.extensions.search.tables.equal_cost_table", lambda *_: table)
    record = {"objectives": ["effort", "mean_pose_error"], "constraints": [], "cases": []}
    [answer] = tuning_answer(LAW, record | {"laws": []})
    assert answer.header == ["laws", "cost", "less by", "better", "over searches"]
    assert answer.rows == [[f"GT, {law}", "20", "20 %", "GT", "3 %"] for law in ("EqT", "nog")]
    assert answer.notes == [f"better: the law that is {RULE}"]


LAW = SimpleNamespace(
    censored=lambda name: np.zeros((1, 1)), runs=1, failed={"gt": 0}, labels=["gt"]
)


@pytest.mark.parametrize(
    ("ends", "value", "end"),
    [
        ([0.05, 0.5], 0.4973, "0.5"),  # that of tune_so2
        ([0.05, 0.5], 0.4949, ""),
        ([0.1, 10], 0.15, ""),  # near in the range, but half as large again as its end
        ([0.1, 10], 0.1009, "0.1"),
        ([0, 2], 0.019, "0"),  # of an end at 0, a share of the range
        ([-2, 0], -0.021, ""),
        ([100, 101], 100.5, ""),  # near 100, but in the middle of the range
    ],
)
def test_a_best_value_within_a_hundredth_of_the_end_of_its_range_is_named(ends, value, end):
    winner = {"label": "gt", "values": {"gains.kp": value}}
    law = {"label": "gt", "over": {"gains.kp": ends}, "winners": [winner, winner]}
    assert list(_notes(LAW, {"laws": [law], "cases": []}, ())) == [
        f"At the end of its range: gains.kp {end} of GT; widen the range in tune.over, or bound "
        "what the law may spend by tune.equal or tune.subject_to."
    ] * bool(end)


def test_failed_runs_of_starting_gains_are_counted_beside_their_mean():
    """The means of both leave failed runs out."""
    titles = {"gt": "GT", "start": "GT, start"}
    result = SimpleNamespace(
        censored=lambda name: np.array([[True, False], [True, True]]),
        runs=2,
        failed={"gt": 0, "start": 1},
        labels=["gt", "start"],
        title_of=titles,
    )
    notes = list(_notes(result, {"laws": [], "cases": []}, ["gt"], ["start"]))
    assert notes == ["Runs failed, of 2: GT, start: 1.", "Runs unsettled at the end, of 2: GT: 1."]


@pytest.mark.parametrize(
    ("runs", "said"),
    [
        (6, "too few runs: A – B, A – C and B – C."),
        (8, "A is better than B and C; undecided: B – C."),
    ],
)
def test_tuned_laws_are_ranked_by_the_rule_of_maps(runs, said):
    """A is better than B and C in all runs, B than C in half; three pairs take 7 runs.

    2^(1-7) ≤ 0.05/3. Of the starting gains S nothing is said.
    """
    swing = np.where(np.arange(runs) % 2, 0.1, -0.1)
    values = np.array([1 + 0 * swing, 2 + swing, 2 - swing, 9 + swing])
    result = SimpleNamespace(
        labels=["a", "b", "c", "s"],
        titles=["A", "B", "C", "S"],
        good=np.ones(values.shape, bool),
        counted=lambda name: values,
        quantity=lambda name: QUANTITIES[name],
    )
    note = _ranking(result, "mean_pose_error", {"a", "b", "c"})
    assert note == f"By mean ‖I − Q_E‖: {said}"


FOUND = {"sample": 1, "points": 8, "label": None, "objectives": [[1.0]]}


@pytest.mark.parametrize(
    "searches",
    [
        [],
        [FOUND | {"label": "nobody", "objectives": []}],
        [FOUND | {"objectives": [[1.0, 2.0]]}],
        [FOUND | {"objectives": [["x"]]}],
        [FOUND | {"points": "many"}],
        [FOUND | {"label": "eqt", "measured": [1.0], "values": {}, "failed": 0, "unsettled": 0}],
        [{"sample": 1, "label": None}],
    ],
)
def test_a_record_with_other_searches_is_none(searched, searches):
    done, folder = searched
    record = done.record
    laws = [law | {"searches": searches} for law in record["laws"]]
    with open_result(folder) as result:
        assert fits_tuning(record, result)
        assert not fits_tuning(record | {"laws": laws}, result)


def test_no_string_has_a_variable_length(searched):
    files = [*searched[1].rglob("*.h5")]
    assert files
    assert [of_variable_length(file) for file in files] == [[]] * len(files)
