"""Numbers of data sheets in the units in which they stand there."""

import re

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import ConfigError
from eqt_cli.base.units import factor
from eqt_cli.extensions.budget.remarks import remarks

BODY = {
    "group": "SE3",
    "inertia": 1.0,
    "gains": {"kp": 1, "kd": 1},
    "reference": {"kind": "constant", "pose": {}},
    "controllers": ["lee2010"],
    "control": {"period": 0.1},
    "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
    "ensemble": {"runs": 1},
    "time": {"duration": 1, "samples": 11},
}
DEG, ARCSEC, G0 = np.pi / 180, np.pi / 648_000, 9.80665


def sensors(signal, **options):
    study = eqt_cli.load_experiment({**BODY, "sensors": {signal: [options]}})
    vehicle = study.experiment(0).loops["lee2010"].vehicle
    return {"pose": vehicle.pose_sensors, "velocity": vehicle.velocity_sensors}[signal]


@pytest.mark.parametrize(
    ("key", "text", "value"),
    [
        ("density", "0.15 deg/sqrt(h)", 0.15 * DEG / 60),
        ("density", "0.15 deg/√h", 0.15 * DEG / 60),
        ("density", "0.15 °/√hr", 0.15 * DEG / 60),
        ("density", "9 deg/h/sqrt(Hz)", 0.15 * DEG / 60),  # 9 deg/h at 1 Hz: 9 / 60 deg in an hour
        ("density", "0.0025 deg/s/√Hz", 0.15 * DEG / 60),
        ("walk", "6 deg/h/√(h)", 6 * DEG / 3600 / 60),
        ("instability", "0.5 deg/h", 0.5 * DEG / 3600),
    ],
)
def test_a_gyro_in_units_of_its_sheet(key, text, value):
    kinds = {"density": {"kind": "noise"}, "walk": {"kind": "bias"}}
    options = kinds.get(key, {"kind": "drift", "time": "10 min"})
    (sensor,) = sensors("velocity", of="rotation", **options, **{key: text})
    assert getattr(sensor, key) == pytest.approx(value, rel=1e-15)


def test_other_sensors_in_units_of_their_sheets():
    (tracker,) = sensors("pose", kind="noise", of="rotation", density="5 arcsec/√Hz")
    assert tracker.density == pytest.approx(5 * ARCSEC, rel=1e-15)
    (log,) = sensors("velocity", kind="noise", of="translation", density="0.02 mm/s/√Hz")
    assert log.density == pytest.approx(2e-5, rel=1e-15)
    assert factor("ug/√Hz", "m/s^2 sqrt(s)") == pytest.approx(1e-6 * G0, rel=1e-15)
    assert factor("m/s/sqrt(h)", "m/s^2 sqrt(s)") == pytest.approx(1 / 60, rel=1e-15)
    assert factor("nT/sqrt(Hz)", "T sqrt(s)") == pytest.approx(1e-9, rel=1e-15)


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"kind": "noise", "density": "0.15 deg/h"}, "an angle random walk in .*deg/sqrt.h"),
        ({"kind": "bias", "walk": "0.15 deg/√h"}, "a rate random walk in .*deg/h/sqrt.h"),
        ({"kind": "noise", "std": "0.15 deg/√h"}, "an angular velocity in rad/s"),
        ({"kind": "drift", "time": 60, "instability": "1 deg"}, "an angular velocity in rad/s"),
        ({"kind": "drift", "time": 60}, "expected instability or std, got neither"),
    ],
)
def test_a_unit_that_does_not_fit_names_those_that_do(options, words):
    with pytest.raises(ConfigError, match=words):
        sensors("velocity", of="rotation", **options)


@pytest.mark.parametrize(
    ("place", "options", "words"),
    [
        ("velocity", {"kind": "noise", "density": 0.26}, r"density: 0.26 .* 894 deg/sqrt\(h\)"),
        ("velocity", {"kind": "noise", "density": {"uniform": [0, 0.26]}}, "density: 0.26 "),
        ("velocity", {"kind": "bias", "walk": [0, 0.1, 0]}, r"walk: 0.1 .* rad/s/sqrt\(s\)"),
        ("velocity", {"kind": "drift", "time": 9, "instability": 0.5}, "or 1.03e.05 deg/h"),
        ("pose", {"kind": "noise", "density": 5}, r"or 1.03e.06 arcsec/sqrt\(Hz\)"),
        ("velocity", {"kind": "noise", "density": "0.26 deg/√h"}, ""),
        ("velocity", {"kind": "noise", "density": 1e-4}, ""),
        ("velocity", {"kind": "noise", "density": 0.26, "of": "translation"}, ""),
    ],
)
def test_a_number_that_lacks_its_unit_is_remarked_on(place, options, words):
    config = {**BODY, "sensors": {place: [{"of": "rotation", **options}]}}
    experiment = eqt_cli.load_experiment(config).experiment(0)
    said = [str(experiment.document.problem(key, text)) for key, text in remarks(experiment, None)]
    assert len(said) == bool(words)
    assert re.search(words, "".join(said))


@pytest.mark.parametrize(
    ("density", "words"),
    [
        ([5e-5, 5e-5, 5e-5, 0.002, 0.002, 0.002], ""),  # 0.002 m/√s of a velocity
        ([5e-3, 5e-5, 5e-5, 0.002, 0.9, 0.002], r"density: 0.005 .* 17.2 deg/sqrt\(h\)"),
        (["0.3 deg/√h", "0.3 deg/√h", "0.3 deg/√h", 0.002, 0.002, 0.002], ""),
        (["0.3 deg/√h", 0.26, "0.3 deg/√h", 0.002, 0.002, 0.002], r"0.26 .* 894 deg/sqrt\(h\)"),
        (0.26, r"density: 0.26 .* 894 deg/sqrt\(h\)"),
    ],
)
def test_each_coordinate_has_its_unit(density, words):
    """Of a turn and a translation: rad/√s is in no entry of the latter; 0.26 · 60 · 180/π = 894."""
    config = {**BODY, "sensors": {"velocity": [{"kind": "noise", "density": density}]}}
    experiment = eqt_cli.load_experiment(config).experiment(0)
    said = [str(experiment.document.problem(key, text)) for key, text in remarks(experiment, None)]
    assert len(said) == bool(words)
    assert re.search(words, "".join(said))
