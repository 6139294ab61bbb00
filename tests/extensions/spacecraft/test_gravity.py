"""The gravity gradient: the torque of point masses, and what does not fit it."""

import numpy as np
import pytest

import eqt_cli
from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import group_named
from eqt_cli.extensions.spacecraft.gravity import GravityGradient
from eqt_cli.extensions.spacecraft.remarks import remarks

pytestmark = pytest.mark.needs("spacecraft")
SO3, SE3 = group_named("SO3"), group_named("SE3")


@pytest.mark.parametrize(("G", "e", "nu"), [(SO3, 0.0, 0.0), (SE3, 0.0, 0.0), (SO3, 0.6, 1.5)])
def test_gravity_gradient_is_the_torque_of_point_masses(G, e, nu):
    """Two masses on a rod, and gravity μ r / |r|³ on each: the torque to first order in 1/|r|."""
    ends, mass, orbit, n = np.array([[0.3, 0.4, 1.2], [-0.3, -0.4, -1.2]]), 2.0, 1e6, 0.02
    inertia = mass * sum(np.eye(3) * (r @ r) - np.outer(r, r) for r in ends)
    part = GravityGradient(rate=n, inertia=inertia.tolist(), eccentricity=e, anomaly=nu)
    t = 17.0
    # Kepler's equation by fixed points, each 0.6 times nearer.
    E = begin = 2 * np.arctan(np.sqrt((1 - e) / (1 + e)) * np.tan(nu / 2))
    for _ in range(100):
        E = begin - e * np.sin(begin) + n * t + e * np.sin(E)
    angle = 2 * np.arctan(np.sqrt((1 + e) / (1 - e)) * np.tan(E / 2)) - nu
    Q = G.exp(np.array([[0.3, -0.2, 0.5, 0, 0, 0]])[:, : G.dimension])
    distance = orbit * (1 - e * np.cos(E))
    R, centre = Q[0, :3, :3], distance * np.array([np.cos(angle), np.sin(angle), 0.0])
    expected = np.zeros(3)
    for r in ends:
        place = centre + R @ r
        pull = -(n**2) * orbit**3 * mass * place / np.linalg.norm(place) ** 3
        expected += np.cross(r, R.T @ pull)
    found = part.of_run(G, None).acting(G, t, Q, np.zeros((1, G.dimension)))[0]
    # The next order is 1.3/1e6 of it; forces of 800 N on arms of a metre cancel but for 1e-3.
    np.testing.assert_allclose(found[:3], expected, rtol=1e-5, atol=1e-10)
    assert not found[3:].any()


def test_it_turns_bodies_in_space_only(noted):
    force = GravityGradient(rate=0.3, inertia=[1.0, 2.0, 2.5])
    for name in ("R3", "SE2", "SE23", "SO3*SO2"):
        G = group_named(name)
        assert ("", f"gravity_gradient needs group SO3 or SE3, got {G.name}") in noted(force, G)
    assert noted(force, SO3) == noted(force, SE3) == []


@pytest.mark.parametrize(
    ("force", "place", "said"),
    [
        (GravityGradient(0.3, 1.0, frame="spatial"), "frame", "gravity_gradient computes its own "
         "frame; remove this key"),
        (GravityGradient(0.3, [1.0, 2.0]), "inertia", "expected 3 diagonal entries for SE3, got 2"),
        (GravityGradient(Uniform([2.0, 1.0]), 1.0), "rate.uniform", "expected the smaller number "
         "first, got [2, 1]"),
        (GravityGradient(1.0, [1.0, Uniform([2.0, 1.0]), 1.0]), "inertia[1].uniform", "expected "
         "the smaller number first, got [2, 1]"),
    ],
)  # fmt: skip
def test_what_does_not_fit_it_is_said(noted, force, place, said):
    assert noted(force, SE3) == [(place, said)]


MU, R = 3.986004418e14, 6371.2e3


def satellite(*, orbit=None, **gradient):
    """Remarks on a satellite with a gravity gradient, and a field on an orbit."""
    force = {"kind": "gravity_gradient", "inertia": [0.05, 0.06, 0.03], **gradient}
    torquers = {
        "kind": "magnetorquers",
        "limit": 0.4,
        "orbit": {"inclination": 0.1, **(orbit or {})},
    }
    config = {
        "group": "SO3",
        "inertia": [0.05, 0.06, 0.03],
        "gains": {"kp": 2e-3, "kd": 0.015},
        "reference": {"kind": "constant"},
        "controllers": ["lee2010"],
        "plant": {"forces": [force]},
        "actuators": [torquers] if orbit else None,
        "control": {"period": 0.5},
        "time": {"duration": 10},
    }
    experiment = eqt_cli.load_experiment(config).experiment(0)
    return {".".join(map(str, key)): text for key, text in remarks(experiment, None)}


@pytest.mark.parametrize(
    ("height", "e", "factor"),
    [(500e3, 0.0, 1.0), (500e3, 0.3, 1.0), (35786e3, 0.0, 1.01), (500e3, 0.72, 1.0)],
)
def test_one_orbit_in_two_places_is_not_remarked_on(height, e, factor):
    """n = √(μ/a³) with a = (R + h)/(1 − e), to the digits that people write."""
    n = factor * np.sqrt(MU * ((1 - e) / (R + height)) ** 3)
    orbit = {"altitude": height, "eccentricity": e, "anomaly": 2.0}
    assert not satellite(rate=float(n), eccentricity=e, anomaly=2.0 - 2 * np.pi, orbit=orbit)


@pytest.mark.parametrize(
    ("changed", "key", "words"),
    [
        ({"rate": np.sqrt(MU / (R + 5e5) ** 3)}, "rate", f"{0.7**-3:.3g} times"),
        ({"rate": {"uniform": [6e-4, 9e-4]}}, "rate", "0.00075 rad/s"),
        ({"eccentricity": 0.2}, "eccentricity", "actuators[0].orbit has 0.3"),
        ({"anomaly": np.pi}, "anomaly", "is 180 deg, but actuators[0].orbit has 0 deg"),
    ],
)
def test_orbits_that_contradict_are_told(changed, key, words):
    """The circle at the perigee of e = 0.3 turns 0.7^(−3/2) times as fast, its torque 0.7^(−3)."""
    n = float(np.sqrt(MU * (0.7 / (R + 5e5)) ** 3))
    gradient = {"rate": n, "eccentricity": 0.3, "anomaly": 0.0} | changed
    said = satellite(**gradient, orbit={"altitude": 5e5, "eccentricity": 0.3})
    assert [*said] == [f"plant.forces.0.{key}"]
    assert words in said[f"plant.forces.0.{key}"]


def test_heights_and_rates_of_no_orbit_are_told():
    low = satellite(rate=1.2e-3, orbit={"altitude": 500})
    assert "'500 km'" in low["actuators.0.orbit.altitude"]
    assert "'0.06 deg/s'" in satellite(rate=0.06)["plant.forces.0.rate"]
    assert not satellite(rate=1.2e-3)  # 5 300 s, at 130 km
    assert "rate" in "".join(satellite(rate=1.2e-3, eccentricity=0.1))  # a perigee in the ground
