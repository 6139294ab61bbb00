"""Results that grow: bit for bit what a run from nothing gives."""

from pathlib import Path

import pytest
from case_tables import from_yaml, table_of
from faults_harness import assert_equal, contents
from said import error_of, says
from small_experiment import mapping

from eqt_cli.api import run
from eqt_cli.runs.folder import ResultFolder


def grown(folder, before, after, engine):
    changes = {"solver": {"rtol": 1e-6, "engine": engine}, "time": {"duration": 0.5, "samples": 6}}
    before, after = (
        mapping(**{**changes, **each, "solver": changes["solver"] | each.get("solver", {})})
        for each in (before, after)
    )
    run(before | {"name": "x"}, folder / "grown")
    done = run(after | {"name": "x"}, folder / "grown", grow=True)
    return done, contents(run(after | {"name": "x"}, folder / "whole").path)


@pytest.mark.filterwarnings("ignore:.*solves runs in blocks")
@from_yaml
def test_a_grown_result_is_that_of_a_run_from_nothing(tmp_path, before, after, engine, taken):
    done, whole = grown(tmp_path, before, after, engine)
    assert done.outcome.taken == taken
    assert_equal(done.path, whole)
    assert {each.name for each in done.path.iterdir()} <= {
        *("results.h5", "config.yaml", "manifest.json", "shapes")
    }


def test_the_table_has_both_engines_and_points_of_several_shapes():
    cases = table_of(test_a_grown_result_is_that_of_a_run_from_nothing)
    assert {case["engine"] for case in cases} == {"native", "solve_ivp"}


@pytest.mark.ci("compiles laws")
@pytest.mark.parametrize("moved", [0, 1, 2])
def test_a_growth_that_ended_while_files_moved_is_no_complete_result(tmp_path, moved):
    few = {"time": {"duration": 0.1, "samples": 2}, "name": "x", "solver": {"engine": "native"}}
    before, after = (
        mapping(**few, sweep=[{"grid": {"time.samples": [2, 3], "gains.kp": list(gains)}}])
        for gains in ((1,), (1, 2))
    )
    run(before, tmp_path / "r")
    replace, moves = Path.replace, []

    def ended(path, place):
        if "grown" in path.parts and "grown" not in Path(place).parts:
            moves.append(path)
            if len(moves) > moved:
                raise KeyboardInterrupt
        return replace(path, place)

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(Path, "replace", ended)
        with pytest.raises(KeyboardInterrupt):
            run(after, tmp_path / "r", grow=True)
    assert not run(after, tmp_path / "r").outcome.was_complete  # without being asked to grow
    assert_equal(tmp_path / "r", contents(run(after, tmp_path / "whole").path))


@pytest.mark.ci("compiles laws")
def test_a_growth_that_ended_when_it_was_complete_leaves_no_folder_behind(tmp_path, monkeypatch):
    few = {"time": {"duration": 0.1, "samples": 2}, "name": "x", "solver": {"engine": "native"}}
    run(mapping(**few, ensemble={"runs": 1, "seed": 1}), tmp_path / "r")
    finish = ResultFolder.finish

    def ended(folder, manifest):
        finish(folder, manifest)
        raise KeyboardInterrupt

    after = mapping(**few, ensemble={"runs": 2, "seed": 1})
    monkeypatch.setattr(ResultFolder, "finish", ended)
    with pytest.raises(KeyboardInterrupt):
        run(after, tmp_path / "r", grow=True)
    assert run(after, tmp_path / "r").outcome.was_complete
    assert not {each.name for each in (tmp_path / "r").iterdir()} & {"grown", "reruns"}


def test_nothing_of_a_result_is_lost(tmp_path):
    grid = {"sweep": [{"grid": {"gains.kp": [1, 2]}}], "solver": {"cross_check": 0}}
    small = {"time": {"duration": 0.1, "samples": 2}, "name": "x"}
    run(mapping(**grid, **small), tmp_path / "r")
    before = (tmp_path / "r" / "results.h5").read_bytes()
    for changes, said in (
        ({"controllers": ["eqt"]}, "gt at point 0, gt at point 1; keep them…"),
        ({"sweep": [{"grid": {"gains.kp": [2]}}]}, "eqt at point 0, gt at point 0; keep…"),
        ({"ensemble": {"runs": 2, "seed": 1}}, "runs 2 to 2; keep…"),
        ({"inertia": [1, 1, 1]}, None),
    ):
        other = mapping(**{**grid, **small, **changes})
        message = error_of(run, other, tmp_path / "r", grow=True)
        if said:
            assert says(message, f"{tmp_path}/r: holds what the configuration leaves out: {said}")
        else:
            assert "holds another experiment, which differs in\n  inertia[0]: 2" in message
        assert (tmp_path / "r" / "results.h5").read_bytes() == before
    message = error_of(run, other, tmp_path / "r", grow=True, force=True)
    assert says(message, "…a result grows in one session…")


@pytest.mark.ci("compiles two laws")
def test_laws_of_different_memory_share_a_label(tmp_path):
    sliding = [{"kind": "slotine_li", "label": "law", "slope": x} for x in (0.5, 1.0)]
    integral = [{"kind": "goodarzi2013", "label": "law", "ki": x} for x in (0.1, 0.3)]
    few = {"time": {"duration": 0.5, "samples": 6}, "controllers": sliding[:1], "name": "x"}
    parts = [{"grid": {"controllers[0]": laws}} for laws in (sliding, integral)]
    whole = contents(run(mapping(**few, sweep=[{"concat": parts}]), tmp_path / "whole").path)
    for index, part in enumerate(parts):
        alone = contents(run(mapping(**few, sweep=[part]), tmp_path / str(index)).path)
        for name in ("effort", "pose", "steps"):
            assert whole[f"{index}.h5: {name}"].tobytes() == alone[name].tobytes()
