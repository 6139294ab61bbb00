"""Logs of the SD-card deck of a Crazyflie, which the tests write byte by byte."""

import struct
import zlib
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import EqtError, InputError

T = np.arange(0.0, 12.0, 0.02)
WANTED = np.c_[np.cos(T), np.sin(1.3 * T), 1 + 0.1 * np.sin(T)]
FLOWN = WANTED + np.c_[0.1 * np.sin(3 * T), 0.05 * np.cos(2 * T), 0 * T + 0.02]


def log(events, version=2, crc=True):
    """Return a log: of each event its name, variables with types, times in s, and rows."""
    head = b"\xbc" + struct.pack("<HH", version, len(events))
    rows = []
    for number, (name, variables, times, numbers) in enumerate(events, start=7):
        head += struct.pack("<H", number) + name.encode() + b"\0"
        head += struct.pack("<H", len(variables))
        head += b"".join(f"{x}({kind})".encode() + b"\0" for x, kind in variables)
        layout = "<H" + "QI"[version == 1] + "".join(kind for _, kind in variables)
        for t, row in zip(times, numbers, strict=True):
            stamp = round(t * (1e6 if version == 2 else 1e3))
            rows.append((t, struct.pack(layout, number, stamp, *row)))
    data = head + b"".join(row for _, row in sorted(rows, key=lambda row: row[0]))
    return data + struct.pack("<I", zlib.crc32(data)) if crc else data


def axes(name, kind):
    return [(f"{name}.{axis}", kind) for axis in "xyz"]


def flight(**how):
    """State and setpoint of other rates, in mm as the firmware's short forms have them."""
    state, goal = (np.round(1000 * x).astype(int).tolist() for x in (FLOWN, WANTED))
    events = [
        ("fast", axes("stateEstimateZ", "h"), T, state),
        ("slow", axes("ctrltargetZ", "h"), T[::5], goal[::5]),
    ]
    return log(events, **how)


@pytest.mark.parametrize("version", [1, 2])
def test_events_have_their_own_rates(version):
    Path("log00").write_bytes(flight(version=version))
    errors = eqt_cli.log_errors("log00")
    t, found = errors.curves["position"]
    expected = np.stack([np.interp(t, T, e) for e in (FLOWN - WANTED).T], axis=-1)
    assert errors.topics["position"] == "fast − slow"
    # Whole mm on both sides, and chords of 0.1 s: 0.1²/8 of 1.7 m/s².
    assert abs(found[:, 1:] - expected).max() < 0.001 + 0.1**2 / 8 * 1.7
    rates = {topic[0]: round(topic[3]) for topic in eqt_cli.check_log("log00").topics}
    assert rates == {"fast": 50, "slow": 10}


def packed(q):
    """The firmware's 32 bits of a quaternion x, y, z, w: its largest part, then nine bits each."""
    k = int(np.argmax(abs(q)))
    word, negate = k, q[k] < 0
    for i in range(4):
        if i != k:
            sign = int((q[i] < 0) ^ negate)
            word = (word << 10) | (sign << 9) | int(511 * abs(q[i]) * np.sqrt(2) + 0.5)
    return word


@pytest.mark.ci("starts a process for each log, as the test before")
def test_packed_quaternions_are_turns():
    turns = Rotation.random(len(T), rng=3)
    rows = [[*p, packed(q)] for p, q in zip(FLOWN.tolist(), turns.as_quat(), strict=True)]
    variables = [*axes("stateEstimate", "f"), ("stateEstimateZ.quat", "I")]
    Path("log00").write_bytes(log([("all", variables, T, rows)]))
    Path("f.csv").write_text("")
    table = np.c_[T, FLOWN, turns.as_quat()]
    np.savetxt("f.csv", table, delimiter=",", header="t,x,y,z,qx,qy,qz,qw", comments="")
    errors = eqt_cli.log_errors("log00", "f.csv", association="nearest")
    angle = next(size for size in errors.sizes if size.axis == "angle")
    # Three parts of half a step each, 1/(511 √2) / 2, turn it by twice their norm at most; the
    # largest part amplifies it by 1/cos, at most √4 times.
    assert angle.largest < np.rad2deg(2 * 2 * np.sqrt(3) / (2 * 511 * np.sqrt(2)))


@pytest.mark.ci("starts a process for each log")
def test_what_was_cut_is_read_and_told():
    whole = flight()
    Path("log00").write_bytes(whole[: len(whole) // 2])
    check = eqt_cli.check_log("log00")
    assert 200 < check.rows < 400
    assert any("damaged" in note for note in check.notes)
    Path("log00").write_bytes(whole[:-1] + bytes([whole[-1] ^ 1]))
    assert any("damaged" in note for note in eqt_cli.check_log("log00").notes)


@pytest.mark.ci("starts a process for each log")
def test_what_is_no_such_log_is_told():
    Path("log00").write_bytes(b"\xbc\x02\x00" + b"\xff" * 40)
    assert says(refusal(InputError, eqt_cli.check_log, "log00"), "log00: cannot be read as a log…")
    Path("log00").write_bytes(log([("all", [("a.b", "f")], T, T[:, None])]))
    assert says(refusal(EqtError, eqt_cli.check_log, "log00"), "log00: holds no poses…")


@pytest.mark.ci("starts a process for each of 60 files")
def test_mutated_logs_end_in_an_error_of_eqt():
    rng, whole = np.random.default_rng(0), bytearray(flight())
    for _ in range(60):
        data = bytearray(whole)
        for place in rng.integers(0, 200 if rng.random() < 0.7 else len(data), size=3):
            data[place] = rng.integers(256)
        Path("log00").write_bytes(data[: rng.integers(5, len(data))])
        with suppress(EqtError):
            eqt_cli.check_log("log00")
