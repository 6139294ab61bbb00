"""Setpoints in the table of the flight, and names of other programs."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import says

import eqt_cli
from eqt_cli.base.errors import ConfigError, EqtError

T = np.arange(0.0, 12.0, 0.02)
WANTED = np.c_[np.cos(T), np.sin(1.3 * T), 1 + 0.1 * np.sin(T)]
FLOWN = WANTED + np.c_[0.1 * np.sin(3 * T), 0.05 * np.cos(2 * T), 0 * T + 0.02]
RMS = np.sqrt(((FLOWN - WANTED) ** 2).sum(axis=1).mean())


def write(header, *columns, name="f.csv"):
    np.savetxt(name, np.column_stack(columns), "%.17g", ",", header=header, comments="")


def rms(*args, **how):
    errors = eqt_cli.log_errors("f.csv", *args, **how)
    return {size.quantity: size.rms for size in errors.sizes if size.axis in ("all", "angle")}


@pytest.mark.parametrize(
    "header",
    [
        "t,x,y,z,x_ref,y_ref,z_ref",
        "t,x,y,z,x_d,y_d,z_d",
        "time,px,py,pz,sp_ctrltarget_x,sp_ctrltarget_y,sp_ctrltarget_z",
        "timestamp,position.x,position.y,position.z,ctrltarget.x,ctrltarget.y,ctrltarget.z",
        "t,p[0],p[1],p[2],p_d[0],p_d[1],p_d[2]",
        "t (s),stateEstimate.x,stateEstimate.y,stateEstimate.z,cmd_x,cmd_y,cmd_z",
    ],
)
def test_setpoints_stand_beside_the_state_by_usual_names(header):
    write(header, T, FLOWN, WANTED)
    assert rms() == {"position": pytest.approx(RMS, rel=1e-12)}  # rounding


def test_a_mapping_names_columns_numbers_and_units_of_setpoints():
    write("t,x,y,z,goal a,goal b", T, FLOWN, 100 * WANTED[:, :2])
    mapping = {"setpoint": {"x": "goal a", "y": "goal b", "z": 1}}
    mapping["units"] = {"goal a": "cm", "goal b": "cm"}
    e = FLOWN - np.c_[WANTED[:, :2], 0 * T + 1]
    expected = np.sqrt((e**2).sum(axis=1).mean())
    assert rms(None, mapping) == {"position": pytest.approx(expected, rel=1e-12)}


def test_a_setpoint_without_a_unit_has_that_of_the_state():
    write("t,x (mm),y (mm),z (mm),x_ref,y_ref,z_ref", T, 1e3 * FLOWN, 1e3 * WANTED)
    assert rms() == {"position": pytest.approx(RMS, rel=1e-12)}


def test_a_blank_setpoint_holds_what_was_before():
    rows = ["t,x,y,z,x_ref,y_ref,z_ref"]
    held = WANTED[np.arange(len(T)) // 5 * 5]
    for k, (t, p, q) in enumerate(zip(T, FLOWN, WANTED, strict=True)):
        cells = [*map(repr, q.tolist())] if k % 5 == 0 else ["", "", "nan"]
        rows.append(",".join([repr(float(t)), *map(repr, p.tolist()), *cells]))
    Path("f.csv").write_text("\n".join(rows))
    expected = np.sqrt(((FLOWN - held) ** 2).sum(axis=1).mean())
    assert rms() == {"position": pytest.approx(expected, rel=1e-12)}


def test_only_what_has_a_setpoint_is_compared():
    """Velocities that were measured are nobody's setpoint."""
    write("t,x,y,z,vx,vy,vz,x_ref,y_ref,z_ref", T, FLOWN, FLOWN, WANTED)
    assert [*rms()] == ["position"]


def test_an_attitude_that_should_be_0_has_the_angle_of_its_quaternion():
    half = 0.2 * np.sin(T)
    write("t,q0,q1,q2,q3", T, np.cos(half), np.sin(half), 0 * T, 0 * T)
    mapping = {"quaternion": "wxyz", "setpoint": {"qw": 1, "qx": 0, "qy": 0, "qz": 0}}
    expected = np.sqrt(np.mean(np.rad2deg(2 * half) ** 2))
    assert rms(None, mapping) == {"attitude": pytest.approx(expected, rel=1e-9)}


def test_wrong_setpoints_are_told():
    write("t,x,y,z,x_ref", T, FLOWN, WANTED[:, 0])
    assert says(refusal(EqtError, rms), "f.csv: has no columns of setpoints…`setpoint: {x:…")
    twice = {"setpoint": {"x": "x_ref", "y": "x_ref", "z": 1}}
    said = refusal(ConfigError, rms, None, twice)
    assert says(said, "…setpoint.x: 'x_ref' is given for two columns")
    part = {"setpoint": {"x": "x_ref"}}
    assert says(refusal(ConfigError, rms, None, part), "…setpoint.x: a quantity has all…x, y, z;…")
    wrong = {"setpoint": {"x": "x_rev", "y": 0, "z": 0}}
    said = refusal(ConfigError, rms, None, wrong)
    assert says(said, "…setpoint.x: f.csv:1: no column 'x_rev'; did you mean 'x_ref'…")


def test_columns_that_a_second_mapping_does_not_name_are_not_compared_with_themselves():
    write("t,x,y,z,vx,vy,vz,sx,sy,sz", T, FLOWN, FLOWN, WANTED)
    second = {"columns": {"x": "sx", "y": "sy", "z": "sz"}}
    errors = eqt_cli.log_errors("f.csv", "f.csv", {}, second_mapping=second)
    assert {size.quantity for size in errors.sizes} == {"position"}
    assert "velocity: left out, as both are vx, vy, vz of f.csv" in errors.remarks


# Names and cells ----------------------------------------------------------------------------------


def test_a_time_without_a_unit_is_read_where_its_steps_are_those_of_seconds():
    write("stamp,x,y,z", 1000 * T, FLOWN)
    said = refusal(EqtError, eqt_cli.check_log, "f.csv")
    assert says(said, "f.csv:1: missing column t…`columns: {t: stamp}`…`units: {t: ms}`…")
    mapping = {"columns": {"t": "stamp"}, "units": {"t": "ms"}}
    assert eqt_cli.check_log("f.csv", mapping).rate == pytest.approx(50)
    write("stamp (ms),x,y,z", 1000 * T, FLOWN)
    assert eqt_cli.check_log("f.csv").rate == pytest.approx(50)


def test_eqt_names_come_first():
    write("t,x,y,z,px,py,pz", T, FLOWN, WANTED)
    used = {x.heading: x.name for x in eqt_cli.check_log("f.csv").columns if x.name}
    assert used == {"t": "t", "x": "x", "y": "y", "z": "z"}


def test_cells_with_lists_units_and_quoted_times_are_read():
    rows = ['\ufeff,"time","p","speed"']
    for k in range(20):
        rows.append(f'{k},2025-12-15 21:50:{k:02d},"[{k}, 1.5, -2e-1]",{k} °/s')
    Path("f.csv").write_text("\n".join(rows))
    check = eqt_cli.check_log("f.csv")
    assert (check.group, check.rate, check.rows) == ("R3", 1.0, 20)
    assert {x.heading: x.unit for x in check.columns}["speed"] == "°/s"
    rows[5] = rows[5].replace(", 1.5", "")
    Path("f.csv").write_text("\n".join(rows))
    said = refusal(EqtError, eqt_cli.check_log, "f.csv")
    assert said == "f.csv:6: expected a list of 3 numbers, as in the first row, in column p"


# Two sources in a table ---------------------------------------------------------------------------


@pytest.mark.parametrize("late", [0.045, -0.03])
def test_clocks_of_two_sources_are_compared(late):
    noise = np.random.default_rng(0)
    path = np.stack([np.interp(T - late, T, x) for x in FLOWN.T], axis=-1)
    estimate = path + [0.02, -0.01, 0.03] + 0.002 * noise.normal(size=path.shape)
    names = ",".join(f"est_stateEstimate_{axis}" for axis in "xyz")
    write(f"t,px,py,pz,{names},x_ref,y_ref,z_ref", T, FLOWN, estimate, WANTED)
    (note,) = [note for note in eqt_cli.check_log("f.csv").notes if "two clocks" in note]
    assert says(note, "two clocks: est_stateEstimate_x…are…ms…than px, py, pz,…mm at…")
    size = float(note.split(" are ")[1].split(" ")[0])
    assert size == pytest.approx(1e3 * abs(late), abs=0.6)  # three standard errors
    assert ("later" if late > 0 else "earlier") in note
    assert note in eqt_cli.log_errors("f.csv").remarks


# Flights against one desired motion ---------------------------------------------------------------


def test_one_desired_motion_does_not_fit_flights_that_start_otherwise():
    names = [[f"{side}{k}.csv" for k in range(5)] for side in "ab"]
    noise = np.random.default_rng(0)
    for late, files in zip((0.9, 0.1), names, strict=True):
        for k, file in enumerate(files):
            lag = T - late - 0.005 * k
            flown = np.c_[np.cos(lag), np.sin(1.3 * lag), 1 + 0.1 * np.sin(lag)]
            flown += 0.002 * noise.normal(size=flown.shape)  # or it were one flight, shifted
            write("t,x,y,z", T, flown, name=file)
    write("t,x,y,z", T, WANTED, name="wanted.csv")
    said = refusal(EqtError, eqt_cli.compare_flights, *names, second="wanted.csv")
    assert says(said, "second: the shift in time…b…a…more than 0.25 s apart…its own setpoints…")
