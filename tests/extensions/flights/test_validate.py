"""Flights that a program of its own flies, their predictions, and slips in lists and models."""

import json
from pathlib import Path

import numpy as np
import pytest
import yaml
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.files import write_record
from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights.agreement import Verdict
from eqt_cli.extensions.flights.flying import lap_of
from eqt_cli.extensions.flights.statement import answers, remarks
from eqt_cli.extensions.flights.validation import digest_of_model
from eqt_cli.extensions.logs.logs import Series

J, LIMIT, H = np.array([6.0, 7.0, 3.0]), 1.0, 0.01
MODEL = {
    "group": "SO3",
    "inertia": [6, 7, 3],
    "reference": {"kind": "waypoints", "file": "setpoints.csv"},
    "controllers": [{"kind": "lee2010", "label": "lee"}],
    "gains": {"k_R": 1, "k_Omega": 3},
    "actuators": [{"kind": "limit", "limit": LIMIT}],
    "time": {"duration": 40},
}
HEAD = "t,qx,qy,qz,qw,wx,wy,wz,qx_ref,qy_ref,qz_ref,qw_ref"


def fly(k_R, k_Omega, turn=(1.2, -0.5, 0.8), seconds=40.0):
    """A slew to the identity as rows of a recording, by explicit Euler."""
    R, w, rows = Rotation.from_rotvec(turn), np.zeros(3), []
    for k in range(round(seconds / H)):
        if k % 50 == 0:
            rows.append([k * H, *R.as_quat(), *w, 0, 0, 0, 1])
        M = R.as_matrix()
        e = 0.5 * np.array([M[2, 1] - M[1, 2], M[0, 2] - M[2, 0], M[1, 0] - M[0, 1]])
        torque = np.clip(-k_R * e - k_Omega * w + np.cross(w, J * w), -LIMIT, LIMIT)
        R = R * Rotation.from_rotvec(H * w)
        w = w + H * (torque - np.cross(w, J * w)) / J
    return np.array(rows)


GAINS = [(0.6, 1.0), (3.5, 2.0), (2.0, 6.0), (1.0, 11.0), (3.0, 9.0), (0.8, 4.0), (2.6, 0.9)]
LIST = [f"{k}.csv,lee,{k % 3},{a},{b}" for k, (a, b) in enumerate(GAINS)]
TOP = "file,law,day,gains.k_R,gains.k_Omega"


@pytest.fixture(scope="module")
def flights(tmp_path_factory):
    """A folder with flights and a model."""
    folder = tmp_path_factory.mktemp("flights")
    for k, gains in enumerate(GAINS):
        np.savetxt(folder / f"{k}.csv", fly(*gains), "%.9f", ",", header=HEAD, comments="")
    (folder / "flights.csv").write_text("\n".join([TOP, *LIST]) + "\n")
    (folder / "model.yaml").write_text(yaml.safe_dump(MODEL))
    return folder


@pytest.mark.ci("flies seven flights")
def test_predictions_are_those_of_a_plain_program(flights, tmp_path):
    before = tmp_path / "before.csv"
    how = {"predictions": before}
    assert eqt_cli.validate(flights / "flights.csv", flights / "model.yaml", **how) is None
    found = eqt_cli.validate(flights / "flights.csv", flights / "model.yaml", out=tmp_path, **how)
    for one in found.flown:
        row = one.row()
        assert row.predicted == pytest.approx(row.measured, rel=0.02)  # of the steps of Euler
        assert row.gains["start error"] == pytest.approx(
            np.degrees(np.linalg.norm([1.2, -0.5, 0.8]))
        )
    assert found.agreement.share.value == 1
    assert found.agreement.verdict in (Verdict.CONFIRMED, Verdict.NOT_SHOWN)
    assert {null.name for null in found.agreement.variants} == {
        "inertia +25 %", "inertia −25 %", "torque +25 %", "torque −25 %"
    }  # fmt: skip
    heavy = eqt_cli.validate(
        flights / "flights.csv", MODEL | {"plant": {"inertia": [7.5, 8.75, 3.75]}}
    )
    for one, other in zip(found.flown, heavy.flown, strict=True):
        sizes = one.row().variants, other.row()
        assert sizes[0]["inertia +25 %"] == pytest.approx(sizes[1].predicted, rel=1e-3)
    record = json.loads((tmp_path / "validation.json").read_text())
    assert record["answer"] == found.headline
    assert record["digest"] != heavy.digest
    text = before.read_text().splitlines()
    before.write_text("\n".join([text[0], text[1].replace("lee,,", "lee,,9"), *text[2:]]))
    with pytest.raises(EqtError) as refused:
        eqt_cli.validate(flights / "flights.csv", flights / "model.yaml", **how)
    assert says(str(refused.value), "…before.csv: another prediction of 0.csv…")


@pytest.mark.ci("flies a fit")
def test_a_model_that_was_fitted_on_a_flight(flights, tmp_path):
    rows = fly(1.0, 3.0)
    torque = np.clip(-3.0 * rows[:, 5:8], -LIMIT, LIMIT)
    head = HEAD.replace("qx_ref", "tx,ty,tz,qx_ref", 1)
    for name, late in ("one.csv", 0.0), ("again.csv", 5.0):
        table = np.c_[rows[:, 0] + late, rows[:, 1:8], torque, rows[:, 8:]]
        np.savetxt(tmp_path / name, table, "%.9f", ",", header=head, comments="")
    fitted = eqt_cli.fit(
        MODEL | {"reference": {"kind": "constant"}},
        tmp_path / "one.csv",
        ["inertia[0]"],
        horizon=2.0,
        out=tmp_path / "fitted",
    )
    for name in "one.csv", "again.csv":
        listed = tmp_path / "list.csv"
        listed.write_text(f"{TOP}\n{name},lee,1,1,3\n")
        with pytest.raises(EqtError) as refused:
            eqt_cli.validate(listed, fitted.config)
        assert says(str(refused.value), f"…{name}: the model was fitted on it…")


def rows_with(change):
    """The list with a change: an index and a row, or more rows."""
    lines = list(LIST)
    for place, line in change.items():
        lines[place:] = [line, *lines[place + 1 :]] if place < len(lines) else [line]
    return lines


SLIPS = [
    ({}, {0: "9.csv,lee,1,1,3"}, TOP, "…file: '9.csv' was not found…"),
    ({}, {0: "0.csv,eqt,1,1,3"}, TOP, "…:2: law: the model has lee, got 'eqt'…"),
    ({}, {7: "0.csv,lee,1,1,3"}, TOP, "…0.csv…in line 2, too…"),
    ({}, {0: "0.csv,lee,1,1"}, TOP, "…:2: expected 5 cells…"),
    ({}, {}, TOP.replace("gains.k_R", "gain.k_R"), "…gain.k_R: the model has no gain…"),
    ({}, {}, TOP.replace("gains.k_R", "gains[k_R"), "…:2: expected a key such as…"),
    ({}, {0: "0.csv,lee,1,fast,3"}, TOP, "…gains.k_R: expected a number…"),
    ({}, {}, TOP.replace("day", "laws"), "…column 'laws'; did you mean 'law'?…"),
    ({}, {0: "0.csv,lee,a,1,3"}, TOP.replace("day", "vehicle"), "vehicle: these are flights of…"),
    ({"metric": "position"}, {}, TOP, "…:2: no position is measured and wanted; it has attitude…"),
    ({"lap": 50.0}, {}, TOP, "…:2: it lasts 39.5 s, no longer than a lap of 50 s…"),
    ({"hold_out": "flight", "over": ["inertia"]}, {}, TOP, "hold_out: expected one of setting…"),
    ({"hold_out": "law", "over": ["inertia"]}, {}, TOP, "hold_out: all flights have one law…"),
    ({"model": {"inertia": [6, 7]}}, {}, TOP, "…inertia: expected…"),
    ({"model": {"group": "SO4"}}, {}, TOP, "…unknown group 'SO4'…"),
]


@pytest.mark.ci("reads seven flights for a slip")
@pytest.mark.parametrize(("how", "change", "head", "message"), SLIPS)
def test_a_slip_in_the_list_the_options_or_the_model(flights, how, change, head, message):
    listed = flights / "slip.csv"
    listed.write_text("\n".join([head, *rows_with(change)]) + "\n")
    model = MODEL | how.get("model", {})
    with pytest.raises(EqtError) as refused:
        eqt_cli.validate(listed, model, **{k: v for k, v in how.items() if k != "model"})
    assert says(str(refused.value).splitlines()[0], message)


@pytest.mark.ci("reads flights twice")
def test_flights_that_are_no_evidence(flights, tmp_path):
    def refusal(rows, top=TOP):
        (tmp_path / "list.csv").write_text("\n".join([top, *rows]) + "\n")
        with pytest.raises(EqtError) as refused:
            eqt_cli.validate(tmp_path / "list.csv", MODEL)
        return str(refused.value)

    four = [f"{flights}/{line}" for line in LIST[:4]]
    assert says(refusal(four), "4 settings were flown; expected at least 5…")
    copy = Path(tmp_path / "copy.csv")
    copy.write_bytes((flights / "0.csv").read_bytes())
    twice = [*(f"{flights}/{line}" for line in LIST), "copy.csv,lee,1,1,3"]
    assert says(refusal(twice), "…:9: the same recording as…0.csv…")
    rows = np.loadtxt(flights / "0.csv", delimiter=",", skiprows=1)
    rows[:, 0] += 7.0
    np.savetxt(copy, rows, "%.9f", ",", header=HEAD, comments="")
    assert says(refusal(twice), "…copy.csv: the same motion…")
    up = np.maximum(np.linspace(-1, 5, 100), 0)
    table = np.c_[np.linspace(0, 10, 100), 0 * up, 0 * up, up, 0 * up, 0 * up, up]
    head = "t,x,y,z,x_ref,y_ref,z_ref"
    np.savetxt(tmp_path / "up.csv", table, "%.9f", ",", header=head, comments="")
    assert says(refusal(["up.csv,lee,1,1,3"]), "…:2: it stands at its lowest height until…")


def test_the_lap_of_setpoints():
    t = np.linspace(0, 21, 700)
    path = Series("", t, np.stack([np.sin(t), np.sin(2 * t), 0 * t], axis=-1))
    assert lap_of(path, 0.0, 21.0) == pytest.approx(2 * np.pi, rel=0.01)
    slow = Series("", t, np.stack([np.sin(t / 5), 0 * t, 0 * t], axis=-1))
    assert lap_of(slow, 0.0, 21.0) == 0
    assert lap_of(Series("", t, np.ones((700, 3))), 0.0, 21.0) == 0


@pytest.mark.ci("runs an experiment")
def test_a_statement_is_stored_and_said_for_the_same_plant_only(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    config = MODEL | {"reference": {"kind": "constant"}, "initial": {"pose": "haar"}}
    config |= {"ensemble": {"runs": 5}, "time": {"duration": 2}}
    digest = digest_of_model(eqt_cli.load_experiment(config).base.document)
    said = {"answer": "a", "digest": digest, "line": "flights: confirmed: …", "speed": float("nan")}
    write_record(tmp_path / "validation.json", said)
    stated = config | {"validation": "validation.json"}
    for one, words in (config, "none"), (stated, said["line"]):
        eqt_cli.run(eqt_cli.load_experiment(one), tmp_path / words[:4]).close()
        with open_at(tmp_path / words[:4]) as result:
            assert answers(result)[0] == {"confirmed": words}
            assert [*remarks(result)] == ([] if words == "none" else [words])
    for change, words in (
        ({"inertia": [6, 7, 4]}, "…is of another plant or of other laws…"),
        (
            {"validation": "no.json"},
            "…expected a file that eqt validate --out wrote, got 'no.json'…",
        ),
    ):
        with pytest.raises(EqtError) as refused:
            eqt_cli.load_experiment(stated | change)
        assert says(str(refused.value), words)
