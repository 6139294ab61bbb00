"""Commands in the table of the flight, with their units; the right values are typed out here."""

from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import mentions, says

import eqt_cli
from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.api import driving
from tests.extensions.logs.test_echoes import mutated

T = np.arange(0.0, 4.0, 0.02)
STILL = np.tile([0.0, 0.0, 0.0, 1.0], (len(T), 1))
PLACES = np.c_[np.sin(T), np.cos(T), 0.1 * T]
U = np.c_[5 + np.sin(T), 0.1 * np.cos(T), 0.2 * np.sin(2 * T), 0.05 * np.cos(3 * T)]
"""Thrust, N, and torque, N m."""

POSE = "t,qx,qy,qz,qw,x,y,z,"
WRENCH = np.c_[U[:, 1:], 0 * T, 0 * T, U[:, 0]]
G = 9.80665
"""Standard gravity: a gram weighs 1e-3 of it in N."""


def write(header, *columns, name="f.csv"):
    rows = np.column_stack([T, STILL, PLACES, *columns])
    np.savetxt(name, rows, "%.17g", ",", header=POSE + header, comments="")


def read(mapping=None, group="SE3"):
    return driving("f.csv", group_named(group), mapping, "csv")


GIVEN = {
    "cmd_thrust (g),torque_x (mN m),torque_y (mN m),torque_z (mN m)": (
        [1e3 / G, 1e3, 1e3, 1e3],
        {},
    ),
    "thrust (N),tau_x,tau_y,tau_z": ([1, 1, 1, 1], {}),
    "lift,u1,u2,u3": (
        [1e3, 1, 1, 1],
        {
            "command": {"thrust": "lift", "tx": "u1", "ty": "u2", "tz": "u3"},
            "units": {"lift": "mN"},
        },
    ),
    "throttle,torque.x,torque.y,torque.z": (
        [0.1, 10, 10, 10],
        {"units": {"thrust": "normalised", "torque": "0 to 1"}},
    ),
    "fz (kg),tx,ty,tz": (
        [1 / G, 1, 1, 1],
        {"command": {"fx": 0, "fy": 0, "fz": "fz", "tx": "tx", "ty": "ty", "tz": "tz"}},
    ),
}
"""By the heading, what one N and one N m are in it, and the mapping."""


@pytest.mark.parametrize("header", GIVEN)
def test_a_thrust_and_torques_are_a_wrench(header):
    factors, mapping = GIVEN[header]
    if "throttle" in header:  # the shares of 10 N, and of 0.1 N m, are what is read
        mapping = mapping | {"units": mapping["units"] | {"torque": "-100 to 100"}}
        write(header, U * [0.1, 100, 100, 100])
        expected = WRENCH * [1, 1, 1, 0.1, 0.1, 0.1]
    else:
        write(header, U * factors)
        expected = WRENCH
    np.testing.assert_allclose(read(mapping).wrenches, expected, atol=1e-14, rtol=1e-12)


def test_a_thrust_is_against_z_of_a_body_whose_z_points_down():
    write("cmd_thrust (N),torque_x,torque_y,torque_z", U * [1, 1, -1, -1])
    wrenches = read({"world": "NED to ENU", "body": "FRD to FLU"}).wrenches
    np.testing.assert_allclose(wrenches, WRENCH, atol=1e-14)


@pytest.mark.parametrize(
    ("unit", "low", "high", "expected"),
    [
        ("0 to 65535", 0, 65535, [0, 1]),
        ("PWM 1000-2000", 1000, 2000, [0, 1]),
        ("rpm", 0, 3000, [0, 100 * np.pi]),
        ("rad/s", 0, 3000, [0, 3000]),
    ],
)
def test_commands_of_motors_are_speeds_or_shares_of_the_largest(unit, low, high, expected):
    share = 0.5 + 0.5 * np.sin(T[:, None] + np.arange(4))
    write("motor.m1,motor.m2,motor.m3,motor.m4", low + (high - low) * share)
    speeds = read({"units": {"n": unit}}).speeds
    np.testing.assert_allclose(speeds, np.interp(share, [0, 1], expected), atol=1e-11)


def test_a_blank_command_holds_what_was_before():
    held = U[np.arange(len(T)) // 5 * 5]
    write(
        "thrust (N),tau_x,tau_y,tau_z", np.where((np.arange(len(T)) % 5 == 0)[:, None], U, np.nan)
    )
    np.testing.assert_allclose(read().wrenches[:, 5], held[:, 0], rtol=1e-15)


MOTORS = "m1,m2,m3,m4"
WRONG = {
    "f.csv:1: missing column tx…m1 may be the command n1; state its unit, `units: {n: …}`:…": {},
    "f.csv:1: command n1, column m1: expected rad/s, rpm, or, of PWM, a range…got 'V'": {
        "units": {"n": "V"}
    },
    "f.csv:1: command n1, column m1: expected…got '2000 to 1000'": {"units": {"n": "2000 to 1000"}},
    "f.csv:2: expected 1 to 2 in column m1, got 5; state another range": {"units": {"n": "1 to 2"}},
    "…command.n1: f.csv:1: no column 'm9'; write a heading, without a unit": {
        "command": {"n1": "m9"}
    },
    "…command.n1: 'm1' is given for two commands…": {"command": {"n1": "m1", "n2": "m1"}},
    "…command.push: eqt has no command of this name; expected thrust, tx…": {
        "command": {"push": "m1"}
    },
    "…command.thrust: acts along the body; use `force: body`…": {
        "command": {"thrust": "m1", "tx": 0, "ty": 0, "tz": 0},
        "units": {"thrust": "N"},
        "force": "spatial",
    },
    "…command.fz: and a thrust are given; remove one…": {
        "command": {"thrust": "m1", "fz": "m2"},
        "units": {"thrust": "N"},
    },
}


@pytest.mark.parametrize("message", WRONG)
def test_wrong_commands_are_told(message):
    write(MOTORS, U)
    kind = ConfigError if "…command" in message else EqtError
    said = refusal(kind, lambda: read(WRONG[message]).require_wrenches())
    assert says(said, message), said


def test_a_thrust_without_torques_is_no_wrench():
    write("cmd_thrust (N),roll_rate,pitch_rate,yaw_rate", U)
    said = refusal(EqtError, lambda: read().require_wrenches())
    assert says(said, "…cmd_thrust is a thrust without torques: commanded rates…an inner loop")


def test_a_check_shows_commands_and_a_mapping_that_reads_them():
    write("pwm_1,pwm_2", 1000 + 100 * U[:, :2])
    check = eqt_cli.check_log("f.csv")
    assert any(
        mentions(note, "pwm_1 may be the command n1; state its unit") for note in check.notes
    )
    check = eqt_cli.check_log("f.csv", {"units": {"n": "1000 to 2000"}})
    used = [(x.heading, x.name, x.unit) for x in check.columns if x.use == "command"]
    assert used == [("pwm_1", "n1", "1000 to 2000"), ("pwm_2", "n2", "1000 to 2000")]
    Path("m.yaml").write_text(check.mapping)  # what it prints can be pasted
    np.testing.assert_allclose(read("m.yaml").speeds, 0.1 * U[:, :2], atol=1e-14)


def test_commands_of_no_use_are_not_read():
    """Errors need no unit of a motor."""
    write("x_ref,y_ref,z_ref,m1,m2", PLACES + 0.1, U[:, :2])
    assert eqt_cli.log_errors("f.csv", None, {"units": {"n1": "0 to 1"}}).sizes[0].rms == (
        pytest.approx(0.1 * np.sqrt(3))
    )


def test_odd_bytes_end_in_a_message():
    write("cmd_thrust (g),torque_x,torque_y,torque_z,motor_m1 (0 to 10)", U, U[:, 0])
    text, random = Path("f.csv").read_text()[:4000], np.random.default_rng(5)
    for _ in range(60):
        Path("m.csv").write_bytes(mutated(text, random))
        with suppress(EqtError):
            driving("m.csv", group_named("SE3"), None, "csv")


@pytest.mark.ci("fits")
def test_a_mass_is_fitted_to_a_thrust_in_grams():
    """A body of 1.5 kg in gravity under a thrust that changes each 0.02 s, in closed form."""
    h, thrust = 0.02, 15 + 3 * np.sin(7 * T)
    a = thrust / 1.5 - G
    v = np.r_[0.3, 0.3 + np.cumsum(a * h)[:-1]]
    z = np.r_[0, np.cumsum(v * h + a * h**2 / 2)[:-1]]
    xy = np.random.default_rng(0).normal(size=(len(T), 2)) * 1e-3
    rows = np.c_[T, xy, z, xy, v, thrust * 1e3 / G]
    header = "t,x,y,z,vx,vy,vz,cmd_thrust (g)"
    np.savetxt("f.csv", rows, "%.17g", ",", header=header, comments="")
    config = {"group": "R3", "inertia": 1.0, "gains": {"kp": 1, "kd": 1}, "name": "mass"}
    config |= {"reference": {"kind": "constant"}, "controllers": ["eqt"]}
    config |= {"time": {"duration": 1, "samples": 2}, "actuators": [{"kind": "scale", "factor": 1}]}
    config["plant"] = {"forces": [{"kind": "constant", "force": [0, 0, -G]}]}
    (found,) = eqt_cli.fit(config, "f.csv", ["actuators[0].factor"], horizon=0.2).numbers
    assert found.value == pytest.approx(1 / 1.5, rel=1e-6)  # of the forces, in kg of the model
