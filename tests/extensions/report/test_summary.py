"""What the page holds of a result: accuracy, the experiment in words, runs in a few bytes."""

from base64 import b64decode

import numpy as np
import pytest

from eqt_cli import api
from eqt_cli.api.loading import open_at
from eqt_cli.extensions.report import summary
from eqt_cli.extensions.report.summary import (
    LEVELS,
    POWER,
    _group,
    _words,
    accuracy,
    called,
    curves,
    in_words,
    laws,
    quantised,
    run_table,
    stated_values,
)


@pytest.fixture
def energy_sentence(make_result):
    """The sentence on energy, of results with these residuals and runs that failed."""

    def of(residuals, status=None):
        labels = [f"law{k}" for k in range(len(residuals))]
        result = make_result(labels, metrics={"energy_residual": residuals}, status=status)
        return [sentence for sentence in accuracy(result) if sentence.startswith("Energy")]

    return of


BALANCE = "Energy balance: |L(t) + ∫dissipation − L(0)| stays below 4e-09 of L(0) in every run"


def test_laws_that_all_claim_a_balance_need_no_names(energy_sentence):
    assert energy_sentence([[1e-9, 2e-9], [4e-9, 3e-9]]) == [f"{BALANCE}."]


def test_laws_that_claim_no_balance_are_named(energy_sentence):
    nothing = [np.nan, np.nan]
    assert energy_sentence([[1e-9, 4e-9], nothing, nothing]) == [
        f"{BALANCE} of law0; no balance is claimed for law1 and law2."
    ]


def test_a_run_that_failed_does_not_take_the_claim_away(energy_sentence):
    assert energy_sentence([[4e-9, np.nan]], status=[[0, 1]]) == [f"{BALANCE}."]


def test_without_a_balance_nothing_is_said(energy_sentence):
    assert energy_sentence([[np.nan, np.nan]]) == []


# The experiment in words


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (1.0, "1"),
        (-np.pi, "−π"),
        (1_000_000, "1000000"),
        (0.5, "0.5"),
        (float("inf"), "inf"),
        (-1e-9, "−1e−09"),
        (True, "yes"),
        (None, ""),
        ([0.0, -1], "(0, −1)"),
        ({"kind": "normal", "std": 1.0}, "normal: std 1"),
        ({"kind": "haar", "position": None}, "haar"),
        ({"low": 0, "relative_to": "a"}, "low 0, relative to a"),
        ({"ideal": {}, "late": {"delay": 2}}, "ideal, late delay 2"),
        (list(range(300)), "300 values (0, 1, 2, 3, 4, 5, …, 299)"),
        ([{"kind": "limit", "limit": 1.5}, "lag"], "limit: limit 1.5; lag"),
    ],
)
def test_values_as_running_text(value, words):
    assert in_words(value) == words


def test_values_of_the_paper(paper_result):
    with open_at(paper_result) as result:
        values = {name: value for name, _, value in stated_values(result)}
    assert values["Inertia"][0] == ["0.824", "0", "0.12"]
    assert values["Weight of the navigation function"] == "1 · I"
    assert values["Runs"] == "60 of each law, from seed 2025"


def test_members_of_the_family_have_weights(make_result):
    result = make_result(
        ["eqt", "mine"], metrics={"effort": [[1.0], [1.0]]}, kinds=["eqt", "quaternion"]
    )
    assert [(law["weights"], law["damping"]) for law in laws(result)] == [
        (["1", "1", "0", "0"], "spatial"),
        ([], ""),
    ]


def test_a_law_of_a_plugin_has_its_name_only(make_result):
    result = make_result(["mine"], metrics={"effort": [[1.0]]}, kinds=["no_such_law"])
    assert [(law["kind"], law["says"]) for law in laws(result)] == [("no_such_law", "")]


def test_own_gains_and_options_of_laws_and_keys_of_the_engine_alone(tmp_path):
    config = tmp_path / "c.yaml"
    config.write_text(
        "{group: SO3, inertia: 1, gains: {kp: 1, kd: 1}, reference: {kind: constant},"
        " controllers: [gt, {kind: gt, label: mine, gains: {kp: 4}}, {kind: family, label: off,"
        " transport: 0.2}], initial: {pose: haar}, ensemble: {runs: 2}, time: {duration: 1,"
        " samples: 5}, solver: {engine: native, method: DOP853, cross_check: 0}}",
        encoding="utf-8",
    )
    api.run(config, out=tmp_path / "out")
    with open_at(tmp_path / "out") as result:
        assert [law["settings"] for law in laws(result)] == [
            "",
            "gains: kp 4",
            "gyroscopic 1, transport 0.2, connection 0, damping spatial, error spatial, "
            "quadratic 0",
        ]
        (solver,) = [value for name, _, value in stated_values(result) if name == "Integration"]
    assert solver.startswith("engine native, ") and "method" not in solver


TITLED = (
    "# yaml-language-server: $schema=eqt.schema.json\n\n# A wheel, at rest.\n"
    "{group: SO2, inertia: 1, gains: {kp: 1, kd: 1}, reference: {kind: constant},"
    " controllers: [eqt], initial: {pose: haar}, ensemble: {runs: 1},"
    " time: {duration: 1, samples: 2}, solver: {cross_check: 0}}"
)


def test_the_first_comment_is_the_title_also_of_a_run_of_the_result_and_of_a_point(tmp_path):
    (tmp_path / "c.yaml").write_text(TITLED, encoding="utf-8")
    api.run(tmp_path / "c.yaml", out=tmp_path / "out")
    api.run(tmp_path / "out", out=tmp_path / "again")
    grid = {"sweep": [{"grid": {"gains.kp": [1, 2]}}]}
    api.run(api.load_experiment(tmp_path / "c.yaml", grid), out=tmp_path / "swept")
    for folder, point in (("out", None), ("again", None), ("swept", None), ("swept", 1)):
        with open_at(tmp_path / folder, point) as result:
            assert called(result) == "A wheel, at rest"


def test_without_a_comment_the_title_says_what_is_compared(make_result):
    result = make_result(["eqt", "gt"], metrics={"effort": [[1.0], [1.0]]}, title="first")
    assert called(result) == f"first: EqT and GT on {_group(result)}"


@pytest.mark.parametrize(
    ("command", "words"),
    [
        ("eqt run /home/ada/c.yaml --out=/data/r/", "eqt run c.yaml --out=r/"),
        ("eqt run ../../c.yaml --out ~/results/c", "eqt run c.yaml --out c"),
        (r"eqt run C:\Users\ada\c.yaml", "eqt run c.yaml"),
        ("eqt run configs/c.yaml --set a=[cos(t)/2]", "eqt run configs/c.yaml --set a=[cos(t)/2]"),
    ],
)
def test_commands_name_no_folder_above_that_of_the_command(command, words):
    assert _words(command, {}) == words


# Runs in a few bytes: what is kept of them


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
    with open_at(paper_result) as results:
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
    with open_at(paper_result) as results:
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
    monkeypatch.setattr(summary, "LARGEST", 50_000)
    with open_at(paper_result) as results:
        found = curves(results)
    assert found["stored"] == 60
    assert sum(len(panel["codes"]) for panel in found["panels"]) <= 50_000 + 16
    assert found["runs"] == list(range(len(found["runs"])))


def test_controllers_look_as_in_the_figures(paper_result):
    with open_at(paper_result) as results:
        looks = curves(results)["controllers"]
    assert [(look["title"], look["colour"], bool(look["dashes"])) for look in looks[:2]] == [
        ("EqT", "#0a62ae", False),
        ("GT", "#d9600a", True),
    ]
