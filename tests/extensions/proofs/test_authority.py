"""What limits leave of torque and force, against closed forms."""

from typing import Any

import numpy as np
import pytest
from rotor_vehicles import ARM, HIGH, TURNS, W, rotors

import eqt_cli
from eqt_cli.config.remarks import remarks
from eqt_cli.extensions.proofs.authority import members_of

SPINS = {"alternating": [1, -1, 1, -1, 1, -1], "PPNNPN": [1, 1, -1, -1, 1, -1]}


def members(config: dict[str, Any]) -> Any:
    [only] = members_of(eqt_cli.load_experiment(config).base)
    return only


def said(config: dict[str, Any]) -> list[str]:
    experiment = eqt_cli.load_experiment(config).base
    return [str(x) for x in remarks(experiment, experiment.reference_over_horizon())]


def test_of_a_quadrotor_at_hover() -> None:
    """Each rotor gives W/4 and can change by min(W/4, high − W/4), two up and two down."""
    quad = members(rotors([45, 135, 225, 315], [1, -1, 1, -1]))
    change = 4 * min(W / 4, HIGH - W / 4)
    turned = change * ARM * np.sqrt(0.5)
    assert quad.names == ("torque x", "torque y", "torque z", "force z")
    expected = [turned, turned, change * TURNS]
    left = quad.left()
    np.testing.assert_allclose(left[:3], np.outer(expected, [-1, 1]), rtol=1e-6)
    np.testing.assert_allclose(left[3], [-W, 4 * HIGH - W], rtol=1e-6)


@pytest.mark.parametrize(("tilt", "axes"), [(54.735610317, "xyz"), (90.0, "xy")])
def test_of_a_pyramid_of_wheels(tilt: float, axes: str) -> None:
    """4 u cos β about z, and 4 u sin β/√2 about x and y: all four at their limit."""
    body = {
        "group": "SO3",
        "inertia": [1, 2, 3],
        "gains": {"kp": 1.0, "kd": 1.0},
        "reference": {"kind": "constant"},
        "controllers": ["eqt"],
        "actuators": [{"kind": "wheels", "pyramid": f"{tilt} deg", "limit": 0.01}],
        "plant": {"forces": [{"kind": "constant", "force": [0, 0, 0]}]},
        "time": {"duration": 4.0},
    }
    wheels, b = members(body), np.radians(tilt)
    sides = {"x": np.sin(b) / np.sqrt(2), "y": np.sin(b) / np.sqrt(2), "z": np.cos(b)}
    most = [0.04 * sides[axis] for axis in axes]
    np.testing.assert_allclose(wheels.left(), np.outer(most, [-1, 1]), rtol=1e-6)
    assert wheels.names == tuple(f"torque {axis}" for axis in axes)
    body["plant"]["forces"][0]["force"] = [0.001, 0, 0]  # each wheel gives a part of it
    left = members(body).left()
    np.testing.assert_allclose(left[0], [-most[0] + 0.001, most[0] + 0.001], rtol=1e-6)
    beside = np.array(most[1:]) - 0.001 * np.array(most[1:]) / most[0]
    np.testing.assert_allclose(left[1:], np.outer(beside, [-1, 1]), rtol=1e-6)


HEXAGON = [0.0, 60.0, 120.0, 180.0, 240.0, 300.0]


@pytest.mark.parametrize(
    ("spins", "lost", "told"),
    [
        ("alternating", 1, "no torque −y and no torque +z"),
        ("PPNNPN", 1, ""),
        ("PPNNPN", 5, "cannot be held at hover by the thrusts that are left"),
    ],
)
def test_a_hexarotor_that_loses_a_rotor(spins: str, lost: int, told: str) -> None:
    """Runs of it topple by ±0.01 N m in one sense only; the numbers are of another program."""
    fails = {"rotor": lost, "at": 2.0, "to": 0.0}
    config = rotors(HEXAGON, SPINS[spins], fails=fails, told=True)
    found = members(config).left(failed=True)
    if told.startswith("cannot"):
        assert found is None
    else:
        pitch, yaw = ((0.0, 2.25), (-0.2943, 0.0))
        if not told:
            pitch, yaw = ((-1.1606, 1.8394), (-0.1857, 0.1857))
        expected = [(-2.0103, 2.0103), pitch, yaw]
        np.testing.assert_allclose(found[:3], expected, atol=1e-4)
    remarked = [text for text in said(config) if "actuators[0].fails" in text]
    assert len(remarked) == bool(told) and all(told in text for text in remarked)


def test_without_a_force_to_hold_rotors_of_one_sense_are_always_cut() -> None:
    B = [[-1, 1, 1, -1], [-1, 1, -1, 1], [-0.1, -0.1, 0.1, 0.1]]
    body = {
        "group": "SO3",
        "inertia": [0.02, 0.02, 0.04],
        "gains": {"kp": 1.0, "kd": 0.3},
        "reference": {"kind": "constant"},
        "controllers": ["lee2010"],
        "actuators": [{"kind": "thrusters", "matrix": B, "low": 0, "high": 8}],
        "control": {"period": 0.01},
        "time": {"duration": 4.0},
    }
    [text] = said(body)
    assert "every command is cut" in text and text.startswith("actuators[0]")
    assert (members(body).left() != 0).all()
    for change in ({"allocation": "bounded"}, {"low": -8}):
        assert not said({**body, "actuators": [body["actuators"][0] | change]})


def tilted_hexarotor(tilt: float, high: float = HIGH) -> dict[str, Any]:
    """Six rotors, tilted about their arms to both sides, under a law that never tilts."""
    config = rotors(HEXAGON, SPINS["alternating"])
    config["actuators"][0]["high"] = high
    del config["model"], config["control"]
    config |= {
        "plant": {"forces": [{"kind": "restoring", "weight": W}]},
        "reference": {"kind": "constant"},
        "controllers": ["eqt"],
        "gains": {"kp": 1.0, "kd": 1.0},
    }
    for k, rotor in enumerate(config["actuators"][0]["thrusters"]):
        x, y, _ = np.array(rotor["at"]) / ARM
        lean = np.radians(tilt) * (-1) ** k
        rotor["along"] = [-y * np.sin(lean), x * np.sin(lean), np.cos(lean)]
    return config


def test_a_vehicle_that_holds_its_weight_only_up_to_a_small_tilt() -> None:
    """The least tilt along ±x and ±y at which no thrusts within limits balance the weight."""
    from scipy.optimize import linprog

    config = tilted_hexarotor(5.0)
    hexa = members(config)
    B, tilts = np.asarray(hexa.part.matrix), []

    def is_held(angle: float, way: tuple[float, float]) -> bool:
        weight = W * np.array([0, 0, 0, *(np.sin(angle) * np.array(way)), np.cos(angle)])
        tried = linprog(np.zeros(6), A_eq=B, b_eq=weight, bounds=[(0, HIGH)] * 6)
        return bool(tried.status == 0)

    for way in ((1.0, 0.0), (-1.0, 0.0), (0.0, 1.0), (0.0, -1.0)):
        low, high = 0.0, np.radians(30)
        for _ in range(10):
            middle = (low + high) / 2
            low, high = (middle, high) if is_held(middle, way) else (low, middle)
        tilts.append(low)
    assert hexa.tilt(hexa.left()) == pytest.approx(min(tilts), rel=0.02)
    [remark] = [text for text in said(config) if "tilt of" in text]
    assert "cascade" in remark
    assert not any("tilt of" in text for text in said(tilted_hexarotor(50.0, high=20.0)))


def test_what_canted_rotors_push_besides_is_said() -> None:
    """A torque about z takes a side force of each rotor: B (W B)⁺ by NumPy, outside of W."""
    config = rotors([30, 150, 210, 330], [1, -1, 1, -1])
    for rotor in config["actuators"][0]["thrusters"]:
        rotor["along"] = [0.0, 0.2 * np.sign(rotor["turns"]), 1.0]
    law = config["controllers"][0]
    law["along"] = [0.0, 0.0, 1.0]
    quad = members(config)
    B, W4 = np.asarray(quad.part.matrix), np.eye(6)[[0, 1, 2, 5]]
    moved = (B @ np.linalg.pinv(W4 @ B))[4]
    [words] = [text for text in said(config) if "more than the law asks for" in text]
    for name, force in zip(quad.names, moved.tolist(), strict=True):
        part = f"{force:.3g} N of force y with 1 of {name}".replace("-", "−")
        assert (part in words) == (abs(force) > 1e-3)


def test_an_efficiency_from_the_start_or_from_a_time_takes_from_what_is_left() -> None:
    """Of all rotors 0.8: 4 · 0.8 high − W upwards; at drawn times in the mean."""
    arms, turns = [45, 135, 225, 315], [1, -1, 1, -1]
    quad = members(rotors(arms, turns, efficiency=0.8))
    np.testing.assert_allclose(quad.left()[3], [-W, 4 * 0.8 * HIGH - W], rtol=1e-6)
    late = {"efficiency": 0.8, "efficiency_from": {"uniform": [1.0, 2.0]}}
    quad = members(rotors(arms, turns, **late))
    assert quad.begins == 1.5
    np.testing.assert_allclose(quad.left()[3], [-W, 4 * HIGH - W], rtol=1e-6)
    np.testing.assert_allclose(quad.left(failed=True)[3], [-W, 4 * 0.8 * HIGH - W], rtol=1e-6)
    weak = said(rotors(arms, turns, **late | {"efficiency": 0.1}))
    assert any("actuators[0].efficiency_from: from 1.5 s on, the body cannot" in x for x in weak)
