"""What programs print: echoes of topics, logs of cfclient, and the heads of Betaflight's logs."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import EqtError

T = np.arange(0.0, 12.0, 0.05)
WANTED = np.c_[np.cos(T), np.sin(1.3 * T), 1 + 0.1 * np.sin(T)]
FLOWN = WANTED + np.c_[0.1 * np.sin(3 * T), 0.05 * np.cos(2 * T), 0 * T + 0.02]
RMS = np.sqrt(((FLOWN - WANTED) ** 2).sum(axis=1).mean())


MAPPING = {
    "columns": {"t": "message", "x": "data[0]", "y": "data[1]", "z": "data[2]"},
    "setpoint": {"x": "data[3]", "y": "data[4]", "z": "data[5]"},
    "time": {"scale": 0.05},
}


def poses(rows=240):
    """An echo of geometry_msgs/PoseStamped."""
    turns = Rotation.from_rotvec(0.3 * FLOWN).as_quat()
    text = ""
    for t, p, q in zip(T[:rows], FLOWN, turns, strict=False):
        sec, nanosec = divmod(round(1e9 * (1.7e9 + t)), 10**9)
        text += f"header:\n  stamp:\n    sec: {sec}\n    nanosec: {nanosec}\n  frame_id: map\n"
        text += "pose:\n  position:\n"
        text += "".join(f"    {a}: {x!r}\n" for a, x in zip("xyz", p.tolist(), strict=True))
        text += "  orientation:\n"
        text += "".join(f"    {a}: {x!r}\n" for a, x in zip("xyzw", q.tolist(), strict=True))
        text += "---\n"
    return text


def numbers(rows=240):
    """An echo of std_msgs/Float64MultiArray, as in public data of a quadrotor."""
    head = "layout:\n  dim: []\n  data_offset: 0\ndata:\n"
    every = np.c_[FLOWN, WANTED][:rows].tolist()
    return "---\n".join(head + "".join(f"- {x!r}\n" for x in row) for row in every)


def test_an_echo_of_poses_has_stamps_and_names():
    Path("pose.csv").write_text(poses())
    check = eqt_cli.check_log("pose.csv")
    assert (check.group, check.rows, check.begin) == ("SE3", len(T), 1.7e9)
    assert check.rate == pytest.approx(20.0)
    read = {column.name: column.heading for column in check.columns if column.name}
    assert (read["x"], read["qw"]) == ("pose.position.x", "pose.orientation.w")


def test_an_echo_of_numbers_needs_a_mapping():
    Path("data.csv").write_text(numbers())
    with pytest.warns(match="data.csv: its messages have no times; add `columns: {t: message}"):
        errors = eqt_cli.log_errors("data.csv", None, MAPPING)
    assert errors.sizes[0].rms == pytest.approx(RMS, rel=1e-12)
    assert errors.curves["position"][0][[0, -1]] == pytest.approx(T[[0, -1]])


def test_an_echo_that_was_cut_is_read_and_a_wrong_message_named():
    whole = poses(40)
    Path("pose.csv").write_text(whole[: whole.rindex("orientation")])
    assert eqt_cli.check_log("pose.csv").rows == 39
    lines = whole.splitlines()
    lines[30:31] = []
    Path("pose.csv").write_text("\n".join(lines))
    said = refusal(EqtError, eqt_cli.check_log, "pose.csv")
    assert says(said, "pose.csv:17: expected a number pose.orientation.w, as in the first…")


def cfclient():
    header = ["Timestamp", *(f"stateEstimate.{a}" for a in "xyz")]
    header += [f"ctrltarget.{a}" for a in "xyz"]
    header += ["stabilizer.roll", "stabilizer.pitch", "stabilizer.yaw"]
    rows = np.c_[1000 * T, FLOWN, WANTED, np.rad2deg(0.2 * np.c_[np.sin(T), np.cos(T), 0.1 * T])]
    lines = (",".join([f"{row[0]:.0f}", *map(repr, row[1:].tolist())]) for row in rows)
    return "\n".join([",".join(header), *lines, ""])


def test_a_log_of_cfclient_has_ms_and_degrees_with_the_nose_down():
    Path("cf.csv").write_text(cfclient())
    assert eqt_cli.log_errors("cf.csv").sizes[0].rms == pytest.approx(RMS, rel=1e-9)
    check = eqt_cli.check_log("cf.csv")
    assert (check.group, check.rate) == ("SE3", pytest.approx(20.0))
    R = eqt_cli.extensions.logs.api.measured_series("cf.csv")["attitude"].numbers
    expected = Rotation.from_euler("ZYX", np.c_[0.02 * T, -0.2 * np.cos(T), 0.2 * np.sin(T)])
    turn = Rotation.from_quat(R, scalar_first=True) * expected.inv()
    assert turn.magnitude().max() < 1e-9


def blackbox(folder, number, gains=("45,80,40", "50,90,45")):
    """A table of blackbox_decode, and the raw file of two logs from which it is."""
    heads = [
        b"H Product:Blackbox flight data recorder\nH Field I name:time\nH I interval:32\n"
        + f"H Firmware revision:Betaflight 4.5.1\nH rollPID:{g}\nH looptime:125\n".encode()
        + b"\x45\x00rollPID:1\n\xff"
        for g in gains
    ]
    Path(folder).mkdir(exist_ok=True)
    Path(folder, "LOG00001.BBL").write_bytes(b"".join(heads))
    rows = ["loopIteration,time (us),gyroADC[0],gyroADC[1],gyroADC[2],setpoint[0],setpoint[1],"]
    rows[0] += "setpoint[2],roll,pitch,heading"
    for k, t in enumerate(T.tolist()):
        cells = [k, round(1e6 * t), 10 * np.sin(number * t), 0, 0, 11 * np.sin(t), 0, 0, 0, 0, 0]
        rows.append(",".join(map(str, cells)))
    table = Path(folder, f"LOG00001.0{number}.csv")
    table.write_text("\n".join(rows))
    return table


def test_gains_are_those_of_the_raw_log_next_to_the_table():
    a, b = blackbox("a", 1), blackbox("b", 2)
    settings = [eqt_cli.log_errors(x).flight.topics[-1].settings for x in (a, b)]
    assert dict(x[1:] for x in settings[0]) == {
        "release": "Betaflight 4.5.1",
        "rollPID": "45,80,40",
        "looptime": "125",
    }
    found = eqt_cli.compare_flights([a], [b], out="kept")
    assert found.premises[0] == "rollPID 50,90,45 → 45,80,40 in all"
    blackbox("a", 1, ("46,80,40", "50,90,45"))  # what is kept counts for one raw log only
    found = eqt_cli.compare_flights([a], [b], out="kept")
    assert found.premises[0] == "rollPID 50,90,45 → 46,80,40 in all"
    Path("a/LOG00001.BBL").unlink()
    assert len(eqt_cli.log_errors(a).flight.topics) == 1


# Damaged files ------------------------------------------------------------------------------------


def mutated(text, rng):
    """A text with some bytes changed, lines lost or twice, or cut."""
    data = bytearray(text.encode())
    for place in rng.integers(0, len(data), size=rng.integers(1, 6)):
        data[place] = rng.choice([*b"\n,-:. [0e", rng.integers(256)])
    lines = data.split(b"\n")
    for place in rng.integers(0, len(lines), size=rng.integers(0, 3)):
        lines[place : place + 1] = lines[place : place + 1] * rng.choice([0, 2])
    return b"\n".join(lines)[: rng.integers(1, len(data) + 1) if rng.random() < 0.3 else None]


LISTED = "file,law,begin,end,wind\n1.csv,pid,1,9,3\n2.csv,lee,+1,+9,4\n"


@pytest.mark.ci("60 mutations of three formats")
@pytest.mark.parametrize("make", [lambda: poses(40), lambda: numbers(40), cfclient])
@pytest.mark.filterwarnings("ignore")
def test_mutated_tables_end_in_an_error_of_eqt(make):
    rng, text = np.random.default_rng(0), make()
    mapping = MAPPING if "data:" in text else None
    for _ in range(60):
        Path("f.csv").write_bytes(mutated(text, rng))
        with suppress(EqtError):
            eqt_cli.check_log("f.csv", mapping)


@pytest.mark.ci("60 mutations of two formats")
@pytest.mark.filterwarnings("ignore")
def test_mutated_lists_and_heads_end_in_an_error_of_eqt():
    rng = np.random.default_rng(0)
    for name in ("1.csv", "2.csv"):
        rows = np.c_[T, FLOWN, WANTED]
        np.savetxt(name, rows, delimiter=",", header="t,x,y,z,x_d,y_d,z_d", comments="")
    table = blackbox("a", 1)
    raw = Path("a/LOG00001.BBL").read_bytes().decode("latin-1")
    for _ in range(60):
        Path("flights.csv").write_bytes(mutated(LISTED, rng))
        with suppress(EqtError):
            eqt_cli.check_flights("flights.csv")
        Path("a/LOG00001.BBL").write_bytes(mutated(raw, rng))
        with suppress(EqtError):
            eqt_cli.log_errors(table)
