"""The experiment in words."""

import pytest

from eqt_cli import api
from eqt_cli.report.summary import given, in_words, laws
from eqt_cli.results.result import open_result


@pytest.mark.parametrize(
    ("value", "words"),
    [
        (1.0, "1"),
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
    with open_result(paper_result) as result:
        values = {entry.name: entry.words or entry.matrix for entry in given(result)}
    assert values["Inertia"][0] == ["0.824", "0", "0.12"]
    assert values["Weight of the navigation function"] == "1 · I"
    assert values["Runs"] == "60 of each law, from seed 2025"


def test_members_of_the_family_have_weights(make_result):
    result = make_result(
        ["eqt", "mine"], metrics={"effort": [[1.0], [1.0]]}, kinds=["eqt", "quaternion"]
    )
    assert [(law.weights, law.damping) for law in laws(result)] == [
        (("1", "1", "0", "0"), "spatial"),
        ((), ""),
    ]


def test_a_law_of_a_plugin_has_its_name_only(make_result):
    result = make_result(["mine"], metrics={"effort": [[1.0]]}, kinds=["no_such_law"])
    assert [(law.kind, law.says) for law in laws(result)] == [("no_such_law", "")]


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
    with open_result(tmp_path / "out") as result:
        assert [law.own for law in laws(result)] == [
            "",
            "gains: kp 4",
            "gyroscopic 1, transport 0.2, connection 0, damping spatial, error spatial, "
            "quadratic 0",
        ]
        (solver,) = [entry.words for entry in given(result) if entry.name == "Integration"]
    assert solver.startswith("engine native, ") and "method" not in solver
