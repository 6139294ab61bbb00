"""The search for the worst run: what it finds, what it keeps, what is said of its section."""

import json
import math
from copy import deepcopy
from types import SimpleNamespace

import numpy as np
import pytest
import small_experiment
import yaml
from case_tables import from_yaml
from said import error_of, mentions

from eqt_cli import api
from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import ConfigError, EqtError, EqtWarning
from eqt_cli.extensions.report.document import report
from eqt_cli.extensions.search.figures import ShownWorst
from eqt_cli.extensions.search.record import WORST, agree, fits_worst
from eqt_cli.extensions.search.tables import worst_tables
from eqt_cli.extensions.search.worst import WorstSearch, _worst_run, badness
from eqt_cli.results.result import open_result

WHEEL = small_experiment.WHEEL | {
    "controllers": ["stabilising", {"kind": "stabilising", "label": "soft", "gains": {"kp": 0.2}}],
    "ensemble": {"runs": 3, "seed": 1},
    "time": {"duration": 1.0, "samples": 5},
    "solver": {"rtol": 1.0e-6, "cross_check": 0, "error_estimate": False},
    "worst": {
        "over": {"plant.inertia.relative": [-0.2, 0.2], "control.period": {"log": [0.25, 0.5]}},
        "objective": "mean_pose_error",
        "budget": 2,
        "population": 5,
        "seeds": 1,
    },
}


def read(**changed):
    return WorstSearch.read(document_from(WHEEL | {"worst": WHEEL["worst"] | changed}, {}))


@pytest.fixture(scope="module")
def searched(tmp_path_factory):
    """A search to its end, and its folder; to be read only."""
    folder = tmp_path_factory.mktemp("searched") / "w"
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eqt_cli.extensions.search.worst.MOST_ON_A_LINE", 4)
        return api.worst(deepcopy(WHEEL), folder), folder


@pytest.mark.parametrize(
    ("profile", "points", "runs"),
    [({}, 5, 3), ({"points": 2}, 2, 3), ({"points": 30, "runs": 1}, 30, 1)],
)
def test_the_picture_takes_no_more_runs_than_asked_for(profile, points, runs):
    """By default no more than the search of two laws takes, if 5 points along a key allow it."""
    search = read(profile=profile)
    assert search.judging_runs == 2 * 3 + 4 * (points + 1) * 2 * runs
    lines = search.lines({law.label: law.values((0.3, 0.6)) for law in search.laws})
    assert [len(line.points) for line in lines] == [points + 1] * 4
    assert search.along(lines).data["ensemble"]["runs"] == runs


@pytest.mark.ci("searches, and runs what was found")
def test_the_worst_run_is_given_again_bit_for_bit_by_its_own_configuration(searched, tmp_path):
    done, folder = searched
    law = done.record["laws"][0]
    config = folder / law["config"]
    assert config.read_text(encoding="utf-8").splitlines()[:2] == [
        "# found by eqt worst",
        f"# run {law['run']} of stabilising: mean_pose_error {law['value']!r}",
    ]
    alone = api.run(api.load_experiment(config), tmp_path / "alone").path
    with open_result(alone) as result:
        values = result.metric("mean_pose_error")[0]
    assert values[law["run"]] == law["value"]
    assert values.argmax() == law["run"]
    with open_result(config.with_suffix("")) as kept:  # its trajectories are there already
        assert kept["mean_pose_error"][0].tolist() == values.tolist()
        assert kept.is_over_time("pose")


def test_what_was_found_is_the_worst_of_all_runs_of_all_generations(searched):
    done, folder = searched
    for law in done.record["laws"]:
        files = sorted((folder / "generations" / law["label"]).glob("*/*.json"))
        seen = [-min(json.loads(file.read_text())["objectives"])[0] for file in files]
        assert len(seen) == 2
        assert law["searches"] == [{"seed": 0, "value": max(seen), "failed": False}]
        assert law["value"] == pytest.approx(max(seen), rel=1e-9)  # beside other runs


def test_a_run_of_the_profile_that_is_worse_is_the_worst(tmp_path):
    """A search of one generation, and lines that reach the ends of the ranges."""
    section = WHEEL["worst"] | {"budget": 1, "population": 5, "profile": {"points": 3}}
    done = api.worst(deepcopy(WHEEL) | {"worst": section}, tmp_path / "w")
    with open_result(tmp_path / "w") as result:
        along = result.metric("mean_pose_error")  # point, law, run
        text = " ".join(worst_tables(result, done.record)[0].notes)
    for position, law in enumerate(done.record["laws"]):
        [searched] = law["searches"]
        most = max(searched["value"], along[:, position].max())
        assert law["value"] == pytest.approx(most, rel=1e-9)  # beside other runs
        assert law["in_profile"] == (along[:, position].max() > searched["value"])
    assert any(law["in_profile"] for law in done.record["laws"])
    assert "lies on the lines through the worst that the searches found" in text


def test_remarks_on_a_configuration_are_those_of_a_run(tmp_path):
    far = deepcopy(WHEEL) | {"initial": {"pose": {"kind": "exp_normal", "std": 45}}}
    far["worst"] = far["worst"] | {"budget": 1, "profile": {"points": 2}}
    said = "initial.pose.std: rotation of 45 rad is 7.2 turns"
    with pytest.warns(EqtWarning, match=said):
        laws = api.worst(far, tmp_path / "w").record["laws"]
    folders = [tmp_path / "w", *(tmp_path / "w/worst" / law["label"] for law in laws)]
    for folder in folders:
        with open_result(folder) as result:
            assert [text.startswith(said) for text in result.described.remarks] == [True]


def test_every_law_is_run_along_every_key_through_what_was_found(searched):
    done, folder = searched
    with open_result(folder) as result:
        assert WORST.beside(result) == done.record
        shown = ShownWorst(result, "worst")
        assert [key for key in shown.keys if shown.swept(key).logarithmic] == ["control.period"]
        for position, law in enumerate(done.record["laws"]):
            lines = {line["key"]: slice(*line["points"]) for line in law["lines"]}
            assert list(lines) == ["plant.inertia.relative", "control.period"]
            for key, points in lines.items():
                varied = result.coordinate(key)[points]
                assert (varied[0], varied[-1]) == pytest.approx(tuple(law["over"][key]))
                (other,) = set(lines) - {key}
                assert set(result.coordinate(other)[points]) == {law["values"][other]}
                at = list(varied).index(law["values"][key])
                value = result.metric("mean_pose_error")[points][at, position, law["run"]]
                assert value == pytest.approx(law["value"], rel=1e-9)


def test_the_table_says_found_and_how_many_do_not_settle(searched):
    done, folder = searched
    law = done.record["laws"][0]
    with open_result(folder) as result:
        (table,) = worst_tables(result, done.record)
    assert table.caption == "The worst run that was found: mean ‖I − Q_E‖"
    header = ["law", "worst found", "at", "run", "not settled", "in the box", "agree"]
    assert table.header == header
    assert table.blocks[0].rows[0] == [
        "stabilising",
        f"{law['value']:.4g}",
        f"relative {law['values']['plant.inertia.relative']:.4g}, "
        f"period {law['values']['control.period']:.4g}",
        str(law["run"]),
        f"{law['unsettled']} of 3",
        f"{law['first']['unsettled']} of 15",
        "1 of 1",
    ]
    assert table.notes == [
        "Searched: 2 generations of 5 points, each of 3 runs, for every law, with the seed 0. "
        "Worse runs may exist: a search is not a proof.",
        "Not settled: of the runs at the point that was found; in the box: of all runs of "
        "the first generations, whose points are spread over the ranges. A failed run has not "
        "settled. Agree: searches whose worst is within 1 % of the worst of all.",
    ]


def test_the_report_shows_the_table_and_the_figure(searched, unarranged):
    with open_result(searched[1]) as result:
        page = report(result)
    assert 'id="worst-1-table"' in page[page.index('id="summary"') : page.index("<figure")]
    assert "Worse runs may exist: a search is not a proof." in page
    assert 'aria-label="The worst run of each law along each key' in page


@pytest.mark.parametrize(("seen", "value"), [(9.0, "9"), (None, "a failed run")])
def test_a_run_that_amplifies_rounding_is_told(searched, seen, value):
    done, folder = searched
    law = done.record["laws"][0]
    search = {"seed": 0, "value": seen, "failed": seen is None}
    with open_result(folder) as result:
        (table,) = worst_tables(result, done.record | {"laws": [law | {"searches": [search]}]})
    assert table.notes[1] == (
        f"stabilising: together with other points, the searches found {value}; the run amplifies "
        "rounding, so its value is no more certain than that."
    )


def test_a_second_session_computes_nothing_and_finds_the_same(searched, monkeypatch):
    done, folder = searched
    monkeypatch.setattr("eqt_cli.runs.run_study.Session.run", None)
    monkeypatch.setattr("eqt_cli.extensions.search.worst.MOST_ON_A_LINE", 4)
    assert api.worst(deepcopy(WHEEL), folder).record == done.record


@pytest.mark.ci("searches with several seeds")
def test_a_corner_is_found_exactly_by_every_search(tmp_path):
    """The heavier the wheel and the later the torque, the worse: as a grid of runs shows."""
    config = WHEEL | {
        "controllers": ["stabilising"],
        "initial": {"pose": {"kind": "fixed", "coordinates": [0.5]}},
        "control": {"period": 0.1},
        "time": {"duration": 6.0, "samples": 61},
        "ensemble": {"runs": 1},
        "worst": {
            "over": {"control.delay": [0, 3], "plant.inertia.relative": [-0.2, 0.2]},
            "objective": "mean_pose_error",
            "budget": 5,
            "population": 8,
            "seeds": 2,
        },
    }
    grid = {"control.delay": [0, 1, 2, 3], "plant.inertia.relative": [-0.2, -0.1, 0, 0.1, 0.2]}
    without = {key: value for key, value in config.items() if key != "worst"}
    swept = api.run(api.load_experiment(without | {"sweep": [{"grid": grid}]}), tmp_path / "grid")
    with open_result(swept.path) as result:
        values = result.metric("mean_pose_error")[:, 0, 0].reshape(4, 5)
    assert (np.diff(values, axis=0) > 0).all()
    assert (np.diff(values, axis=1) > 0).all()
    (law,) = api.worst(config, tmp_path / "w").record["laws"]
    assert law["values"] == {"control.delay": 3, "plant.inertia.relative": 0.2}
    assert law["value"] == values[-1, -1]
    assert law["agreeing"] == 2


@pytest.mark.ci("searches for many generations")
def test_an_interior_maximum_is_found(tmp_path):
    """How far a swing has come after 5 s: |x(5)| of 𝕀x″ + k_d x′ + 2k_p x = 0 over 𝕀."""
    config = WHEEL | {
        "controllers": ["stabilising"],
        "gains": {"kp": 1.0, "kd": 0.4},
        "initial": {"pose": {"kind": "fixed", "coordinates": [0.01]}},
        "control": None,
        "time": {"duration": 5.0, "samples": 11},
        "ensemble": {"runs": 1},
        "solver": {"rtol": 1e-9, "atol": 1e-12, "cross_check": 0},
        "worst": {
            "over": {"plant.inertia.relative": [-0.3, 0.6]},
            "objective": "final_pose_error",
            "budget": 12,
            "population": 8,
            "seeds": 1,
        },
    }
    (law,) = api.worst(config, tmp_path / "w").record["laws"]
    relative = np.linspace(-0.3, 0.6, 90_001)
    decay = 0.2 / (1 + relative)
    root = np.sqrt(2 / (1 + relative) - decay**2)
    x = 0.01 * np.exp(-5 * decay) * (np.cos(5 * root) + decay / root * np.sin(5 * root))
    errors = 2 * math.sqrt(2) * np.abs(np.sin(x / 2))
    assert 0 < errors.argmax() < len(errors) - 1
    found = law["values"]["plant.inertia.relative"]
    assert found == pytest.approx(relative[errors.argmax()], abs=1e-3)
    assert law["value"] == pytest.approx(errors.max(), rel=1e-4)  # sin θ for θ: 2e-5


@pytest.mark.ci("searches to the end, with runs that fail")
def test_a_run_that_fails_is_found(tmp_path, monkeypatch):
    """A light wheel needs more evaluations than there are."""
    monkeypatch.setattr("eqt_cli.extensions.search.worst.MOST_ON_A_LINE", 2)
    section = WHEEL["worst"] | {"over": {"plant.inertia.relative": [-0.99, 0.2]}}
    config = WHEEL | {"controllers": ["stabilising"], "worst": section, "control": None}
    config |= {"solver": WHEEL["solver"] | {"max_steps": 150}, "ensemble": {"runs": 1}}
    done = api.worst(config, tmp_path / "w")
    (law,) = done.record["laws"]
    assert (law["failed"], law["value"]) == (True, None)
    text = (tmp_path / "w" / law["config"]).read_text(encoding="utf-8")
    assert f"# run {law['run']} of stabilising: failed\n" in text
    with open_result(tmp_path / "w" / law["config"].removesuffix(".yaml")) as alone:
        assert alone.status[0, law["run"]] != 0
    with open_result(tmp_path / "w") as result:
        assert worst_tables(result, done.record)[0].blocks[0].rows[0][1] == "a run failed"
        assert [note for note in ShownWorst(result, "worst").notes() if "failed" in note] == [
            "Crosses at the top: a run failed."
        ]


def test_a_search_that_misses_a_failure_does_not_agree_with_one_that_finds_it():
    assert [agree(cost, math.inf) for cost in (math.inf, 1.0)] == [True, False]
    assert [agree(cost, 1.0) for cost in (0.995, 0.98)] == [True, False]
    assert [agree(cost, -1.0) for cost in (-1.005, -1.02)] == [True, False]


# Scores -------------------------------------------------------------------------------------------


@pytest.fixture
def three(stored):
    """Three points of two runs, one of which failed."""
    numbers = [[1, 5], [2, 9], [3, math.nan]]
    times = [[1, math.nan], [1, 2], [1, 2]]
    of_runs = {"final_pose_error": numbers, "decay_rate": numbers, "settling_time": times}
    return stored([[0, 0], [0, 1], [0, 0]], **of_runs)


def test_a_failed_run_is_worse_than_any_and_runs_without_a_value_are_none(three):
    found = badness("final_pose_error", three)
    assert found.objectives[:, 0].tolist() == [-5, -math.inf, -3]
    assert found.failed.tolist() == [0, 1, 0]
    assert found.unsettled.tolist() == [1, 0, 0]
    assert found.feasible.all()


def test_an_objective_without_any_value_is_told(monkeypatch):
    monkeypatch.setattr(
        "eqt_cli.extensions.search.worst.costs_of_runs", lambda *_: np.full((1, 2), -np.inf)
    )
    result = SimpleNamespace(path="w/run/results.h5", labels=["gt"])
    assert error_of(_worst_run, read(objective="settling_time"), result) == (
        "w/run/results.h5: no run of 'gt' has a value of settling_time; choose another objective"
    )


def test_the_least_is_the_worst_of_what_is_better_where_larger(three):
    assert badness("decay_rate", three).objectives[:, 0].tolist() == [1, -math.inf, 3]


# The section --------------------------------------------------------------------------------------


def test_whole_numbers_stay_whole_and_keys_of_a_law_are_its_own():
    search = read(over={"control.delay": [0, 3], "controllers[1].gains.kp": [0.1, 0.3]})
    first, second = search.laws
    assert [first.values([share])["control.delay"] for share in (0, 0.3, 0.6, 1)] == [0, 1, 2, 3]
    assert list(first.axes) == ["control.delay"]
    assert second.written == ("control.delay", "controllers[1].gains.kp")
    assert list(second.axes) == ["control.delay", "gains.kp"]


def test_lines_of_one_number_for_several_entries():
    over = {"initial.pose.std": [0.1, 0.5], "gains.kp[0:2]": [0.1, 0.5]}
    config = WHEEL | {"gains": {"kp": [0.5, 0.5], "kd": 1.0}, "controllers": ["stabilising"]}
    section = WHEEL["worst"] | {"over": over}
    search = WorstSearch.read(document_from(config | {"worst": section}, {}))
    lines = search.lines({"stabilising": search.laws[0].values((0.25, 0.5))})
    assert [line.key for line in lines] == list(over)
    (block,) = search.along(lines).data["sweep"]
    columns = block["zip"]
    assert list(columns) == ["initial.pose.std", "gains.kp[0]", "gains.kp[1]"]
    assert columns["gains.kp[0]"] == columns["gains.kp[1]"]
    assert min(columns["gains.kp[0]"]) == pytest.approx(0.1)


def test_only_the_numbers_of_generations_and_searches_may_change_between_sessions():
    assert read(budget=9, seeds=4).digest == read().digest
    assert read(seed=4).digest != read().digest


@from_yaml
def test_what_is_wrong_is_said_at_its_place(changed, message):
    assert mentions(error_of(read, **changed, kind=ConfigError), message)


def test_a_configuration_without_the_section_is_told_what_to_add():
    without = {key: value for key, value in WHEEL.items() if key != "worst"}
    assert error_of(WorstSearch.read, document_from(without, {})).endswith(
        "has no section `worst`; add one, such as "
        "worst: {over: {gains.kp: [0.8, 1.2]}, objective: final_pose_error}"
    )


def test_a_sweep_is_no_place_to_search_around():
    with pytest.raises(EqtError, match="eqt worst searches around one point; leave `sweep`"):
        WorstSearch.read(document_from(WHEEL | {"sweep": [{"grid": {"gains.kp": [1]}}]}, {}))


# The folder ---------------------------------------------------------------------------------------


def test_another_search_is_not_mixed_into_the_folder(searched):
    with pytest.raises(EqtError, match="holds another search for the worst run"):
        api.worst(WHEEL | {"worst": WHEEL["worst"] | {"seed": 5}}, searched[1])


@pytest.mark.parametrize(
    "changed",
    [
        {"laws": []},
        {"objective": "nothing"},
        {"seeds": ["0"]},
        {"lines": [{"key": "control.period", "points": [0, 10_000]}]},
        {"lines": [{"key": "gains.kp", "points": [0, 1]}]},
        {"values": {"gains.kp": 1.0}},
        {"run": "0"},
        {"label": "nobody"},
    ],
    ids=str,
)
def test_a_record_with_something_else_is_none(searched, changed):
    done, folder = searched
    record = yaml.safe_load(yaml.safe_dump(done.record))
    (record if set(changed) <= set(record) else record["laws"][0]).update(changed)
    with open_result(folder) as result:
        assert fits_worst(done.record, result)
        assert not fits_worst(record, result)
