"""Values that nobody can mean are remarked on, once, and ordinary ones are not."""

from typing import Any

import pytest
from rotor_vehicles import ARM, HIGH, W, rotors

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.config.remarks import remarks

SPINS = [1, -1, 1, -1]
QUAD = rotors([45, 135, 225, 315], SPINS)
CUBE: dict[str, Any] = {
    "group": "SO3",
    "inertia": [0.3, 0.28, 0.2],
    "gains": {"kp": 0.012, "kd": 0.13},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "actuators": [
        {"kind": "wheels", "pyramid": "54.7 deg", "limit": "20 mN m", "momentum": "50 mN m s"}
    ],
    "control": {"period": 0.1},
    "time": {"duration": 200.0},
}


def changed(config: dict[str, Any], **options: Any) -> dict[str, Any]:
    """The configuration with other options of its actuator, or other sections."""
    of_actuator = {key: options.pop(key) for key in [*options] if key not in {*config, "model"}}
    actuator = {**config["actuators"][0], **of_actuator}
    return {**config, "actuators": [actuator], **options}


def quad_by(turns: float) -> list[dict[str, Any]]:
    return [{**each, "turns": turns * s} for each, s in zip(PLACES, SPINS, strict=True)]


PLACES = QUAD["actuators"][0]["thrusters"]
ROTORS: dict[str, Any] = {"thrust_constant": 1e5, "moment_constant": 1.4e-7, "low_speed": 0}
ROTORS |= {"high_speed": 15, "kind": "thrusters", "thrusters": quad_by(1.0)}
OF_ANOTHER_UNIT = {**QUAD, "actuators": [ROTORS]}
FREE = {**CUBE, "controllers": [{"kind": "gt", "known_forces": False}]}


def told(config: dict[str, Any]) -> list[str]:
    return [str(each) for each in remarks(eqt_cli.load_experiment(config).base)]


@pytest.mark.parametrize(
    ("config", "key", "word"),
    [
        (changed(QUAD, fails={"rotor": 1, "at": 30.0}), "actuators[0].fails.at", "never fails"),
        (changed(QUAD, efficiency=[90, 100, 100, 100]), "actuators[0].efficiency", "write 1"),
        (
            changed(QUAD, efficiency=0.8, efficiency_from={"uniform": [30, 40]}),
            "actuators[0].efficiency_from",
            "loses thrust",
        ),
        (changed(QUAD, time_constant=40.0), "actuators[0].time_constant", "'40 ms'"),
        (changed(QUAD, high=HIGH * 1e5), "actuators[0].high", "accelerate"),
        (changed(QUAD, thrusters=quad_by(1.0)), "actuators[0].thrusters", "moment_constant"),
        (OF_ANOTHER_UNIT, "actuators[0].thrust_constant", "accelerate"),
        (
            changed(QUAD, thrusters=[{**PLACES[0], "at": [200.0, 200.0, 0.0]}, *PLACES[1:]]),
            "actuators[0].thrusters[0].at",
            "write '200 mm'",
        ),
        (changed(CUBE, momentum=50.0), "actuators[0].momentum", "'50 mN m s'"),
        (changed(CUBE, limit=20.0), "actuators[0].limit", "'20 mN m'"),
        (
            {**CUBE, "controllers": [{"kind": "goodarzi2013", "anti_windup": "clamp"}]},
            "controllers[0].anti_windup",
            "momentum limit",
        ),
        (FREE, "controllers[0].known_forces", "changes nothing"),
        ({**FREE, "model": {"forces": "plant"}}, "model.forces", "has none"),
        ({**CUBE, "plant": {"inertia": {"uniform": [80, 120]}}}, "plant.inertia", "relative"),
    ],
    ids=lambda x: x if isinstance(x, str) else "",
)
def test_a_slip_is_told_at_its_key(config: dict[str, Any], key: str, word: str) -> None:
    said = told(config)
    of_key = [text for text in said if text.startswith(f"{key}: ")]
    assert len(of_key) == 1 and word in of_key[0]
    assert not any(text.startswith("actuators[0]: ") for text in said)


K = HIGH / 500.0**2
SPUN = changed(OF_ANOTHER_UNIT, thrust_constant=K, moment_constant=0.02 * K, high_speed=500.0)


@pytest.mark.parametrize(
    ("config", "key", "words"),
    [
        (changed(QUAD, high=51 * W / 4), "actuators[0].high", ["51 times its weight"]),
        (changed(SPUN, high_speed=6000), "actuators[0].thrust_constant", ["'6000 rpm'"]),
        (changed(SPUN, thrust_constant=0.1), "actuators[0].thrust_constant", ["its exponent"]),
        (
            changed(SPUN, moment_constant=0.02),
            "actuators[0].moment_constant",
            [f"{0.02 / K:.3g} N m", "0.02 times"],
        ),
        (
            changed(SPUN, moment_constant=ARM * K * 1.01),
            "actuators[0].moment_constant",
            [f"{1.01 * ARM:.3g} N m", f"{ARM:.3g} N m"],
        ),
        (changed(SPUN, moment_constant=1.0), "actuators[0].moment_constant", ["its exponent"]),
    ],
)
def test_thrusts_and_moments_of_no_rotor(
    config: dict[str, Any], key: str, words: list[str]
) -> None:
    """Thrusts over 50 weights, torques over the lever: 4 F/(m g), k_m/k and the arm by hand."""
    (said,) = [text for text in told(config) if text.startswith(f"{key}: ")]
    assert all(word in said for word in words)


@pytest.mark.parametrize(
    "config",
    [
        QUAD,
        SPUN,
        changed(QUAD, high=49 * W / 4),
        changed(SPUN, moment_constant=ARM * K * 0.99),
        changed(QUAD, time_constant=0.04),
        changed(QUAD, thrusters=quad_by(0.05)),
        changed(QUAD, sag="1 - 0.02*t"),
        CUBE,
        {**CUBE, "model": {"forces": [{"kind": "constant", "force": 1e-6}]}},
    ],
)
def test_an_ordinary_vehicle_has_no_remark(config: dict[str, Any]) -> None:
    assert not told(config)


@pytest.mark.parametrize(
    ("sag", "said"),
    [
        ("1 - 2*t", "got 0 at 0.5 s"),
        ("1 + 0.1*t", "got 1.0001 at 0.001 s"),
        ("max(0, 1 - t)", "got 0 at 1 s"),
    ],
)
def test_a_battery_that_turns_thrusts_round_is_refused(sag: str, said: str) -> None:
    with pytest.raises(ConfigError, match=said):
        eqt_cli.load_experiment(changed(QUAD, sag=sag))
