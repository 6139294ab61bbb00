"""Windows that a configuration chooses: what is measured, what the file says, what readers show."""

import numpy as np
import pytest
from small_experiment import mapping

from eqt_cli.api import compare, run
from eqt_cli.cli.result_tables import print_outcome
from eqt_cli.results.metrics import METRICS
from eqt_cli.results.quantity import WHOLE, Latex
from eqt_cli.results.result import open_result

CONFIG = mapping(
    plant={"forces": [{"kind": "constant", "force": 0.1}]},
    ensemble={"runs": 2},
    time={"duration": 8, "samples": 81},
    measure={"start": 2},
    early_window=2,
    closing_window=0.5,
)

ROWS = {row.name: row for row in METRICS}


@pytest.fixture(scope="module")
def result(tmp_path_factory):
    return run(CONFIG, tmp_path_factory.mktemp("windows") / "out")


def test_metrics_are_taken_over_the_windows(result):
    with open_result(result) as file:
        times, torque = file["time"], file["torque_norm"][0]
        early, closing = file["early_torque"][0], file["closing_torque"][0]
        whole = file["mean_torque"][0]
    first, rest, last = times <= 2 + 1e-9, times >= 2 - 1e-9, times >= 5 - 1e-9
    mean = np.trapezoid(torque[:, first], times[first], axis=1) / 2
    np.testing.assert_allclose(early, mean, rtol=1e-12)
    square = np.trapezoid(torque[:, last] ** 2, times[last], axis=1) / 3
    np.testing.assert_allclose(closing, np.sqrt(square), rtol=1e-12)
    mean = np.trapezoid(torque[:, rest], times[rest], axis=1) / 6
    np.testing.assert_allclose(whole, mean, rtol=1e-12)


def test_readers_know_the_windows(result):
    with open_result(result.path) as found:
        early, closing = found.quantity("early_torque"), found.quantity("closing_torque")
        assert found.long_name("early_torque") == early.long_name
        assert found.long_name("closing_torque") == closing.attributes["long_name"]
        assert early.window.stop == 2.0
    assert (early.long_name, early.plain) == (
        "mean ||tau|| over the first 2 s",
        "mean ‖τ‖, first 2 s",
    )
    assert closing.plain == "closing rms of ‖τ‖, last 50 % from 2 s"


def test_readers_say_the_window_of_all_metrics(result, capsys):
    with open_result(result.path) as found:
        assert found.attributes_of("mean_torque")["start_s"] == 2.0
        assert found.long_name("mean_torque") == "mean ||tau|| from 2 s"
        assert found.long_name("settling_time").endswith("settling threshold")
        effort = found.quantity("effort")
        assert effort.described == "effort ∫‖τ‖² dt from 2 s"
        assert Latex().name(effort).endswith(r"$ from 2\,s")
        print_outcome(found)
        assert "mean attitude error from 2 s" in capsys.readouterr().out
        peak = found.comparable["peak_attitude_error"]
        whole = found.per_run(peak, WHOLE)
        assert (whole.quantity.plain, whole.window.stop) == ("largest attitude error", 8.0)
        assert (whole.values >= found.metric("peak_attitude_error")).all()


def test_a_comparison_is_over_the_windows_of_the_result(result):
    windows = {str(level.measured.window) for level in compare(result).levels}
    assert windows == {"0:2", "2:8", "0:8"}  # the early torque; others; settling


@pytest.mark.parametrize("value", [None, -1.0, float("nan"), float("inf"), "long"])
def test_what_is_no_window_leaves_the_default(value):
    assert ROWS["early_torque"].with_choices({"window_s": value}) is ROWS["early_torque"]


@pytest.mark.parametrize("name", ["early_torque", "closing_pose_error", "closing_torque"])
def test_the_defaults_given_are_the_defaults(name):
    row = ROWS[name]
    usual = {"window_s": 5.0, "share_of_time": 0.25}
    again = row.with_choices({key: usual[key] for key in row.choices})
    assert (again.of, again.window) == (row.of, row.window)
    assert (again.long_name, again.label, again.attributes) == (
        row.long_name,
        row.label,
        row.attributes,
    )


def test_words_say_the_windows():
    closing = ROWS["closing_pose_error"].with_choices({"share_of_time": 0.1})
    assert closing.long_name == ("root mean square of ||I - Q_E||_F over the last 10 % of the time")
    usual = ROWS["closing_pose_error"]
    assert ROWS["closing_torque"].long_name == (
        "root mean square of ||tau|| over the last quarter of the time"
    )
    assert usual.plain == "closing rms of ‖I − Q_E‖"
