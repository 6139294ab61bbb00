"""What every certificate must be, whoever wrote it."""

from eqt_cli import api
from eqt_cli.analysis.certificates import Verdict, certificates
from eqt_cli.analysis.certificates.base import Hypothesis, Identity, TrajectoryCheck

CONFIG = {
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "0"]},
    "controllers": ["eqt", "nog"],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 1.0, "samples": 11},
    "solver": {"rtol": 1e-6, "cross_check": 0},
}
KINDS = {Identity: "identity", TrajectoryCheck: "trajectory", Hypothesis: "hypothesis"}


def test_it_says_what_and_where_in_the_paper(certificate_class):
    assert certificate_class.name
    assert certificate_class.statement
    assert certificate_class.section > 0
    assert certificate_class.__doc__


def test_it_is_of_one_kind(certificate_class):
    assert [kind for base, kind in KINDS.items() if issubclass(certificate_class, base)] == [
        certificate_class.kind
    ]


def test_names_tell_rows_apart():
    names = [found.name for found in certificates.all()]
    assert len(names) == len(set(names))


def test_a_row_is_of_its_certificate(certificate_class):
    row = certificate_class().row(Verdict.HOLDS, 1.0, 2.0, controller="eqt")
    assert (row.name, row.kind, row.controller) == (
        certificate_class.name,
        certificate_class.kind,
        "eqt",
    )


def test_certificates_of_plugins_join_those_of_eqt(load_plugins, tmp_path):
    experiment = api.load_experiment(CONFIG)
    before = api.verify(experiment).rows
    load_plugins("certificates")
    after = api.verify(experiment).rows
    mine = ["the g-term has no power", "the error ends small", "the reference moves"]
    assert {row.name for row in after} - {row.name for row in before} == set(mine)
    assert [row for row in after if row.name not in mine] == list(before)
    assert all(row.verdict == "holds" for row in after if row.name == mine[0])
