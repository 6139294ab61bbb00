"""Sweeps whose points differ in shape: a result for each shape, and an index of all points."""

import json
import shutil
from functools import partial

import h5py
import numpy as np
import pytest
from case_tables import from_yaml
from faults_harness import Losing, assert_equal, contents
from said import error_of, says
from small_experiment import configuration, study_of
from stored import of_variable_length

from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import ResultError
from eqt_cli.base.store_reader import open_results
from eqt_cli.config.document import read_config
from eqt_cli.config.study import MOST_GROUPS, study
from eqt_cli.extend import Status
from eqt_cli.runs.law_names import law_names
from eqt_cli.runs.run_study import execute

CONFIG = configuration(
    inertia="2",
    ensemble="{runs: 5, seed: 1}",
    time="{duration: 0.5, samples: 6}",
    solver="{rtol: 1.0e-6, block: 5, cross_check: 1}",
)
GROUPS = """\
sweep:
  - grid: {gains.kp: [1, 2]}
  - zip:
      group: [SO3, SE3]
      reference.torque: [["cos(t)", "sin(t)", "0"], ["cos(t)", "0", "0", "1", "0", "0"]]
      initial.pose: [haar, {kind: exp_normal, std: 0.5}]
"""
# Shared references and initial states, shapes that take turns.
TIMES = "sweep: [{grid: {gains.kp: [1, 2], time.samples: [6, 4]}}]\n"


@pytest.fixture(autouse=True, scope="module")
def _small_parts():
    """Parts of one block, so that every piece has several."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eqt_cli.config.study.PART_RUNS", 5)
        yield


def study_in(folder, text, *overrides, **more):
    return study_of(folder, CONFIG + text, *overrides, **more)


@pytest.fixture
def make(tmp_path):
    return partial(study_in, tmp_path)


SWEEPS = {"groups": GROUPS, "times": TIMES}


@pytest.fixture(
    scope="module",
    params=["groups", pytest.param("times", marks=pytest.mark.ci("computes another sweep"))],
)
def finished(request, made_once):
    """The folder of a sweep that was not disturbed, to be read only; and the sweep."""
    text = SWEEPS[request.param]

    def make(folder):
        execute(study_in(folder, text), folder / "out")

    return made_once(f"ragged {request.param}", make) / "out", text


@pytest.fixture
def text(finished):
    return finished[1]


@pytest.fixture
def whole(finished):
    return contents(finished[0])


only = partial(pytest.mark.parametrize, "finished", indirect=True)


def test_each_shape_is_cross_checked_at_its_own_samples(tmp_path):
    """Points of 6 and of 4 samples in one horizon."""
    execute(study_in(tmp_path, TIMES), tmp_path / "out")
    with open_results(tmp_path / "out" / "results.h5") as results:
        check = results.attributes
        assert 0 < check["cross_check_difference"] < check["cross_check_bound"] / 100
        assert check["cross_check_method"] == "LSODA"


@only(["groups"])
def test_the_index_is_that_of_any_sweep_without_what_differs(finished):
    with open_results(finished[0]) as results:
        assert dict(results.dimensions) == {"point": 4, "controller": 2, "run": 5}
        dims = {results.dims(name) for name in results.names if name != "shape"}
        assert dims == {("point", "controller", "run")}
        assert results["shape"].tolist() == [0, 1, 0, 1]
        assert results["group"].tolist() == ["SO3", "SE3"] * 2
        assert results["gains.kp"].tolist() == [1, 1, 2, 2]
        assert results.attributes["group"] == "SO3, SE3"
        assert results.units("effort") == "mixed"
        assert results.units("settling_time") == "s"
        assert results.attributes["cross_check_runs"] == 2


@pytest.mark.ci("computes an experiment several times")
def test_points_are_the_results_of_single_experiments(make, finished, tmp_path):
    """Blocks of five hold the runs of one point only, so that even the last bits agree."""
    found = make(finished[1])
    for point in (0, 3):
        values = found.sweep.point(point)
        settings = [f"{key}={value}" for key, value in values.items()]
        execute(make("", *settings), tmp_path / str(point))
        with (
            open_at(finished[0], point) as there,
            open_results(finished[0]) as index,
            open_results(tmp_path / str(point)) as alone,
        ):
            assert dict(there.dimensions) == dict(alone.dimensions)
            assert (there.names, there.coordinates) == (alone.names, alone.coordinates)
            assert study_digest(there, tmp_path) == study_digest(alone, tmp_path)
            assert (
                json.loads(there.attributes["experiment"])["parts"]
                == (json.loads(alone.attributes["experiment"])["parts"])
            )
            for name in (*alone.names, *alone.coordinates):
                np.testing.assert_array_equal(there[name], alone[name], err_msg=name)
                assert there.dims(name) == alone.dims(name)
                assert there.units(name) == alone.units(name)
            for name in index.names:
                if name != "shape":
                    np.testing.assert_array_equal(index[name][point], alone[name])


@only(["groups"])
def test_a_shape_is_a_result_of_its_own(finished):
    """With the numbers of its points in the whole sweep."""
    with open_at(finished[0] / "shapes/1.h5", 1) as alone, open_at(finished[0], 3) as there:
        assert alone.attributes["title"] == "config, kp 2"
        assert there.attributes["title"].startswith("config, kp 2, group SE3")
        assert alone.attributes["config"] == there.attributes["config"]
        np.testing.assert_array_equal(alone["pose"], there["pose"])
    with open_results(finished[0] / "shapes/1.h5") as alone:
        assert alone["point"].tolist() == [1, 3]
        assert (alone.attributes["group"], alone.units("effort")) == ("SE3", "mixed")


def _without_a_shape(folder):
    (folder / "shapes/1.h5").unlink()


def _with_a_shape_of_another_session(folder):
    (folder / "shapes/1.h5").write_bytes((folder / "shapes/0.h5").read_bytes())


def _with_a_shape_that_is_not_there(folder):
    with h5py.File(folder / "results.h5", "r+") as file:
        file["shape"][1] = 7


SHAPE_FAULTS = {
    _without_a_shape: "{}/shapes/1.h5: not found; copy the whole folder {}",
    _with_a_shape_of_another_session: (
        "{}/shapes/1.h5: was written with another results.h5; copy it again or run the experiment "
        "again"
    ),
    _with_a_shape_that_is_not_there: (
        "{}/results.h5: refused: it has no shape 7; eqt writes no such file: copy it again or run "
        "the experiment again"
    ),
}


@only(["groups"])
@pytest.mark.parametrize("damage", SHAPE_FAULTS, ids=lambda damage: damage.__name__.strip("_"))
def test_shapes_that_do_not_fit_are_refused(finished, tmp_path, damage):
    folder = tmp_path / "copy"
    shutil.copytree(finished[0], folder)
    damage(folder)
    with open_results(folder) as results:
        assert results["effort"].shape == (4, 2, 5)
        assert results.at(0)["pose"].shape[-1] == 3
        with pytest.raises(ResultError) as caught:
            results.at(1)
    assert str(caught.value) == SHAPE_FAULTS[damage].format(folder, folder)


@only(["groups"])
def test_closing_the_index_closes_the_shapes(finished):
    with open_results(finished[0]) as results:
        point = results.at(1)
        with results.at(0) as other:
            assert other["pose"].size
        with pytest.raises(ResultError, match="is closed"):
            point.read("pose")


@pytest.mark.ci("computes a sweep anew")
@pytest.mark.needs("growth")
def test_rerun_failed_mends_lost_parts_bit_for_bit(make, text, whole, tmp_path):
    out = tmp_path / "out"
    first = execute(make(text), out, executor=Losing(lost={1, 6}))
    assert first.failed == 10
    with open_results(out) as results:
        assert np.count_nonzero(results["status"] == Status.WORKER_LOST) == 10
        assert sum(np.count_nonzero(results.at(k)["status"]) for k in range(4)) == 10
    outcome = execute(make(text), out, rerun_failed=True)
    assert (outcome.failed, outcome.resumed) == (0, 30)
    assert_equal(out, whole)


def test_a_result_runs_again_from_its_own_config(make, finished):
    folder, text = finished
    assert study(read_config(folder / "results.h5")).digest == make(text).digest


@pytest.mark.ci("as test_execute.py has it of one experiment")
@only(["times"])
def test_metrics_only(make, text, tmp_path):
    execute(make(text, "store.trajectories=none"), tmp_path / "out")
    with open_results(tmp_path / "out") as results:
        point = results.at(1)
        assert not point.has("pose")
        assert point["initial_pose"].shape[0] == 5
        np.testing.assert_array_equal(point["effort"], results["effort"][1])


@pytest.mark.ci("computes a sweep anew")
def test_xarray_opens_index_and_shapes(finished):
    xarray = pytest.importorskip("xarray")
    with xarray.open_dataset(finished[0] / "results.h5", engine="h5netcdf") as index:
        assert index.effort.dims == ("point", "controller", "run")
        assert "gains.kp" in index.effort.coords
        effort = index.effort
        for shape in range(2):
            file = finished[0] / f"shapes/{shape}.h5"
            with xarray.open_dataset(file, engine="h5netcdf") as points:
                assert points.pose.dims == ("point", "controller", "run", "time", "row", "col")
                late = points.pose_error.sel(controller="gt").isel(time=-1)
                np.testing.assert_array_equal(late, points.final_pose_error.sel(controller="gt"))
                np.testing.assert_array_equal(points.effort, effort[points.point])
                assert points.message_text.values.tolist() == [""]


def test_no_string_has_a_variable_length(finished):
    for file in finished[0].rglob("*.h5"):
        assert of_variable_length(file) == []


def test_points_of_one_shape_have_one_file(make, tmp_path):
    """And no names of laws, which stay the same."""
    execute(make("sweep: [{grid: {group: [SO3], gains.kp: [1, 2]}}]\n"), tmp_path / "out")
    assert not (tmp_path / "out/shapes").exists()
    with h5py.File(tmp_path / "out/results.h5") as file:
        assert "pose" in file
        assert {"law", "shape"}.isdisjoint(file)
        assert not any(isinstance(entry, h5py.Group) for entry in file.values())


@pytest.mark.ci("computes an experiment several times")
def test_one_point_of_a_sweep_of_one_shape(make, tmp_path):
    execute(make("", grids=["gains.kp=1,2"]), tmp_path / "out")
    execute(make("", "gains.kp=2"), tmp_path / "alone")
    with (
        open_at(tmp_path / "out", 1) as point,
        open_results(tmp_path / "out") as whole,
        open_results(tmp_path / "alone") as alone,
    ):
        assert dict(point.dimensions) == dict(alone.dimensions)
        assert (point.names, point.coordinates) == (alone.names, alone.coordinates)
        assert point.attributes["title"] == "config, kp 2"
        assert study(read_config_text(point, tmp_path)).digest == study_digest(alone, tmp_path)
        for name in point.names:
            np.testing.assert_array_equal(point[name], alone[name], err_msg=name)
        chosen = point.read("effort", controller=1, run=slice(1, 3))
        np.testing.assert_array_equal(chosen, whole["effort"][1, 1, 1:3])


def read_config_text(results, folder):
    path = folder / "again.yaml"
    path.write_text(str(results.attributes["config"]), encoding="utf-8")
    return read_config(path)


def study_digest(results, folder):
    return study(read_config_text(results, folder)).digest


@from_yaml
def test_what_cannot_be_swept(make, grid, message):
    assert says(error_of(make, "", grids=[grid]), message)


def test_an_ensemble_of_another_size_at_some_point(make):
    assert "sweep: point 1: ensemble.runs is 6, but 5 at point 0; ensemble.runs" in error_of(
        make, "sweep: [{grid: {ensemble: [{runs: 5}, {runs: 6}]}}]\n"
    )


def test_what_is_kept_is_decided_for_all_points_together(make, monkeypatch):
    monkeypatch.setattr("eqt_cli.config.study.MOST_TRAJECTORIES", 30)
    whole = make(TIMES)  # 40 runs in two pieces of 20
    assert (whole.trajectories, [whole.piece(index).trajectories for index in range(2)]) == (
        0,
        [0, 0],
    )


def test_more_shapes_than_a_folder_should_have(make, tmp_path):
    values = f"{{low: 1, high: 2, points: {MOST_GROUPS + 1}}}"
    assert says(
        error_of(make, f"sweep: [{{grid: {{time.duration: {values}}}}}]\n"),
        f"{tmp_path / 'config.yaml'}:10:1: 1,001 points that differ in group, times…",
    )


# The laws among the points.


@pytest.mark.ci("computes a sweep anew")
def test_points_that_are_registered_laws(make, tmp_path):
    text = """\
sweep:
  - zip:
      controllers[0]:
        - {kind: family, gyroscopic: 1, transport: 1, connection: -0.0, label: a}
        - {kind: family, gyroscopic: 0, transport: 1, connection: 0, label: a}
        - {kind: family, gyroscopic: 0.5, transport: 0.5, connection: 0.5, label: a, damping: body}
        - {kind: family, gyroscopic: 0.5, transport: 0.5, connection: 0.5, label: a}
        - {kind: asym, label: a}
"""
    execute(make(text, "gains.kd=[1, 2, 3]"), tmp_path / "out")
    with open_results(tmp_path / "out") as results:
        assert results.dims("law") == ("point", "controller")
        assert results["law"][:, 0].tolist() == ["eqt", "nog", "gt", "", "asym"]
        assert results["law"][:, 1].tolist() == ["gt"] * 5


@pytest.mark.parametrize(
    ("kd", "swept", "name"),
    [("0.5", "", "gt"), ("[1, 2, 3]", "", ""), ("0.5", "gains.kp=1,2", "")],
    ids=["alike from every frame", "with axes of its own", "another key swept"],
)
def test_the_frame_of_damping_is_no_difference_where_it_changes_no_torque(make, kd, swept, name):
    """GT damps in the body frame, and this member of the family in the spatial one."""
    law = "{kind: family, gyroscopic: 0.5, transport: 0.5, connection: 0.5, label: a}"
    text = f"sweep: [{{zip: {{'controllers[0]': [{law}]}}}}]\n"
    found = make(text, f"gains.kd={kd}", grids=[swept] if swept else [])
    assert law_names(found, found.sweep)[0, 0] == name


LEAKY = """\
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import EqT


@dataclass(frozen=True)
class Leaky(EqT):
    name: ClassVar[str] = "leaky"
    leak: float = 0.5

    def memory(self, G):
        return {"bias": G.dimension}

    def memory_rate(self, s):
        return {"bias": s.V_tilde - self.leak * s.memory["bias"]}

    def torque(self, s):
        return super().torque(s) - s.memory["bias"]
"""


def test_a_law_with_memory_is_no_other_law_though_it_begins_as_one(make, folder):
    (folder / "leaky.py").write_text(LEAKY, encoding="utf-8")
    found = make(
        "sweep: [{grid: {'controllers[0].leak': [0.1, 0.2]}}]\n",
        "plugins=[leaky.py]",
        "controllers=[{kind: leaky}]",
    )
    assert law_names(found, found.sweep).tolist() == [[""], [""]]


def test_a_delay_in_seconds_waits_for_its_time_at_each_period(folder):
    config = configuration(
        control="{period: 0.1}",
        sensors="{pose: [{kind: noise, std: 0.01, delay: 200 ms}]}",
        sweep="[{grid: {control.period: [0.1, 0.05]}}]",
        time="{duration: 0.5, samples: 6}",
    )
    (folder / "c.yaml").write_text(config, encoding="utf-8")
    swept = study(read_config(folder / "c.yaml"))
    loops = [experiment.loop for experiment in map(swept.experiment, range(2))]
    assert [loop.vehicle.holding(loop.group)[0].delay for loop in loops] == [2, 4]
    assert [list(points) for points in swept.shapes] == [[0], [1]]
