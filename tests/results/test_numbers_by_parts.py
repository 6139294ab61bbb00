"""Numbers of runs where rotation and translation have units of their own."""

import numpy as np
import pytest

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.intervals import Resampling
from eqt_cli.api.loading import open_at
from eqt_cli.extend import SampledRuns
from eqt_cli.results.metrics import quantity_of
from eqt_cli.results.result import open_result
from eqt_cli.results.summary import headline


@pytest.fixture(scope="module")
def folder(invoke, made_once):
    def make(folder):
        (folder / "c.yaml").write_text(
            "group: SE3\ninertia: [2, 1, 3, 4, 4, 4]\ngains: {kp: 2, kd: 1.5}\n"
            'reference: {torque: ["cos(t)", "0", "0", "0", "sin(t)", "0"]}\n'
            "controllers: [eqt, gt]\ninitial: {pose: haar, velocity: normal}\n"
            "ensemble: {runs: 5, seed: 1}\ntime: {duration: 1.5, samples: 16}\nearly_window: 1\n"
            "solver: {rtol: 1.0e-4, cross_check: 0, error_estimate: false}\n"
        )
        invoke("run", folder / "c.yaml", "--out", folder / "out")
        bare = "--set", "store.trajectories=none"
        invoke("run", folder / "c.yaml", *bare, "--out", folder / "bare")

    return made_once("numbers by parts", make)


@pytest.fixture(params=["out", "bare"])
def result(request, folder):
    with open_result(folder / request.param) as opened:
        yield opened


PARTS = ("rotation", "translation")


def test_every_number_of_a_norm_is_stored_by_part_in_a_unit_of_its_own(result):
    stored = {name: result.units(name) for name in result.metrics if name.endswith(PARTS)}
    assert stored == {
        "mean_torque_rotation": "N m",
        "mean_torque_translation": "N",
        "effort_rotation": "(N m)^2 s",
        "effort_translation": "N^2 s",
        "peak_torque_rotation": "N m",
        "peak_torque_translation": "N",
        "early_torque_rotation": "N m",
        "early_torque_translation": "N",
        "mean_pose_error_rotation": "1",
        "mean_pose_error_translation": "m",
        "final_pose_error_rotation": "1",
        "final_pose_error_translation": "m",
        "final_velocity_error_rotation": "rad/s",
        "final_velocity_error_translation": "m/s",
    }
    # The parts of what is quadratic add up, which is why their sum has no unit.
    np.testing.assert_allclose(
        result["effort_rotation"] + result["effort_translation"], result["effort"], rtol=1e-12
    )


def test_numbers_of_parts_are_those_of_the_trajectories(folder):
    with open_result(folder / "out") as result:
        for name in (name for name in result.metrics if name.endswith(PARTS)):
            row = result.quantity(name)
            norm = {row.signals[0]: result[row.signals[0]]}
            for law in (0, 1):
                signals = {signal: values[law] for signal, values in norm.items()}
                found = row.measure(SampledRuns(result.times), signals, row.window)
                np.testing.assert_allclose(result[name][law], found, rtol=1e-12, err_msg=name)


def test_a_part_knows_the_window_of_its_file(result):
    row = result.quantity("early_torque_rotation")
    assert (row.plain, row.window.stop) == ("mean ‖τ‖, first 1 s", 1.0)
    assert row.long_name == "mean ||tau|| over the first 1 s, rotation part"
    assert quantity_of("closing_torque_rotation").plain == "closing rms of ‖τ‖ rotation"


def test_tables_show_parts_and_no_sum_of_two_units(result, invoke):
    first = headline(result)[0]
    assert {"early_torque_rotation", "early_torque_translation"} <= set(first)
    assert not {"early_torque", "mean_pose_error"} & set(first)
    levels = compare(result, how=Resampling(resamples=9)).levels
    compared = {each.measured.quantity.name for each in levels}
    assert {"mean_torque_rotation", "mean_torque_translation", "effort_translation"} <= compared
    assert not {"mean_torque", "effort"} & compared
    shown = invoke("show", result.path.parent).stdout
    [head] = [line for line in shown.splitlines() if line.startswith("law")]
    torques = "mean torque, first 1 s, N m", "mean force, first 1 s, N"
    assert all(words in head for words in torques)


def test_points_on_groups_with_other_parts_share_what_all_have(invoke, folder, tmp_path):
    text = (folder / "c.yaml").read_text().replace("[2, 1, 3, 4, 4, 4]", "2")
    text = text.replace('{torque: ["cos(t)", "0", "0", "0", "sin(t)", "0"]}', "{kind: constant}")
    swept = text.replace("{pose: haar, velocity: normal}", "{velocity: normal}")
    (tmp_path / "g.yaml").write_text(swept + "sweep: [{grid: {group: [SE3, SO3]}}]\n")
    brief = ["--set", "controllers=[eqt]", "--set", "ensemble.runs=1"]
    invoke("sweep", tmp_path / "g.yaml", *brief, "--out", tmp_path / "g")
    with open_result(tmp_path / "g") as both, open_at(tmp_path / "g", 0) as one:
        assert "effort_rotation" not in both.metrics
        assert "effort_rotation" in one.metrics
        np.testing.assert_array_equal(both["effort"][0], one["effort"])
