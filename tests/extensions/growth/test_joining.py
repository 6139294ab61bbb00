"""Results of two machines: joined to what one run from nothing gives."""

import pytest
from case_tables import from_yaml
from faults_harness import assert_equal, contents
from said import error_of, says
from small_experiment import mapping

from eqt_cli.api import pack, run

pytestmark = pytest.mark.ci("compiles laws")

GRID = [{"grid": {"gains.kp": [1, 2, 4]}}]
FEW = {"time": {"duration": 0.5, "samples": 6}, "solver": {"rtol": 1e-6}, "name": "x"}


@from_yaml
def test_a_joined_result_is_that_of_a_run_from_nothing(tmp_path, one, other, whole):
    for name, changes in (("one", one), ("other", other)):
        run(mapping(**{**FEW, "sweep": GRID, **changes}), tmp_path / name)
    done = pack(tmp_path / "one", tmp_path / "other", out=tmp_path / "both")
    expected = run(mapping(**{**FEW, "sweep": GRID, **whole}), tmp_path / "whole")
    assert_equal(done.path, contents(expected.path))
    assert {each.name for each in done.path.iterdir()} <= {
        *("results.h5", "config.yaml", "manifest.json", "shapes")
    }


@from_yaml
def test_what_cannot_be_joined_is_said(tmp_path, changes, said):
    run(mapping(**FEW, sweep=GRID), tmp_path / "one")
    run(mapping(**{**FEW, "sweep": GRID, **changes}), tmp_path / "other")
    message = error_of(pack, tmp_path / "one", tmp_path / "other", out=tmp_path / "both")
    assert says(" ".join(message.split()), said)
    assert not (tmp_path / "both" / "results.h5").exists()


def test_a_folder_is_named_for_several(tmp_path):
    run(mapping(**FEW), tmp_path / "one")
    assert says(
        error_of(pack, tmp_path / "one", tmp_path / "one"), "pack: several results need a folder…"
    )
    assert says(error_of(pack, tmp_path / "one", out=tmp_path / "b"), "pack: several results need…")
    message = error_of(pack, tmp_path / "one", tmp_path / "one", out=tmp_path / "one")
    assert says(message, "…one: holds a result already; choose another folder with out=…")
