"""The gravity gradient: the torque of point masses, and what does not fit it."""

import numpy as np
import pytest

from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import group_named
from eqt_cli.extensions.spacecraft.gravity import GravityGradient

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
