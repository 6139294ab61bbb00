"""Runs in a few bytes: what is kept of them."""

from base64 import b64decode

import numpy as np
import pytest

from eqt_cli.report import summary as module
from eqt_cli.report.summary import LEVELS, POWER, curves, quantised, run_table
from eqt_cli.results.result import open_result


def test_values_keep_their_relative_accuracy():
    values = np.geomspace(1e-6, 1, 1000) * 7
    codes, largest = quantised(values)
    restored = largest * (codes / LEVELS) ** POWER
    # Half a step of 1/65534 on the scale of 4th roots, at (1e-6)^(1/4) = 0.032:
    # 4 · 0.5/65534/0.032.
    assert np.abs(restored / values - 1).max() < 1.0e-3


def test_what_is_not_a_number_has_a_code_of_its_own():
    codes, largest = quantised(np.array([np.nan, 0.0, 2.0, np.inf]))
    assert codes.tolist() == [LEVELS + 1, 0, LEVELS, LEVELS + 1]
    assert largest == 2.0


def test_all_zero_values():
    codes, largest = quantised(np.zeros(3))
    assert codes.tolist() == [0, 0, 0] and largest == 1.0


def test_curves_of_a_result(paper_result):
    with open_result(paper_result) as results:
        found = curves(results)
        torque = results.read("torque_norm", controller=1, run=7)
    assert [panel["name"] for panel in found["panels"]] == ["‖I − Q_E‖", "‖V − V_d‖", "‖τ‖", "L"]
    assert (len(found["times"]), found["samples"]) == (101, 201)
    assert found["runs"] == list(range(60))
    panel = found["panels"][2]
    codes = np.frombuffer(b64decode(panel["codes"]), "<u2").reshape(4, 60, 101)
    restored = panel["largest"] * (codes[1, 7] / LEVELS) ** POWER
    assert restored == pytest.approx(torque[::2], rel=1e-3)


def test_units_of_a_user(paper_result):
    with open_result(paper_result) as results:
        usual, other = results, results.in_units(["mN m"])
        (torque,) = (panel for panel in curves(usual)["panels"] if panel["unit"] == "N m")
        (shown,) = (panel for panel in curves(other)["panels"] if panel["unit"] == "mN m")
        tables = run_table(usual), run_table(other)
    assert shown["largest"] == pytest.approx(1e3 * torque["largest"], rel=1e-14)
    at = [column["unit"] for column in tables[0]["columns"]].index("N m")
    assert tables[1]["columns"][at]["unit"] == "mN m"
    first, second = (table["rows"][0][3 + at] for table in tables)
    assert second == pytest.approx(1e3 * first, rel=1e-5)  # six digits


def test_runs_that_would_not_fit_are_left_out(paper_result, monkeypatch):
    monkeypatch.setattr(module, "LARGEST", 50_000)
    with open_result(paper_result) as results:
        found = curves(results)
    assert found["stored"] == 60
    assert sum(len(panel["codes"]) for panel in found["panels"]) <= 50_000 + 16
    assert found["runs"] == list(range(len(found["runs"])))


def test_controllers_look_as_in_the_figures(paper_result):
    with open_result(paper_result) as results:
        looks = curves(results)["controllers"]
    assert [(look["title"], look["colour"], bool(look["dashes"])) for look in looks[:2]] == [
        ("EqT", "#0a62ae", False),
        ("GT", "#d9600a", True),
    ]
