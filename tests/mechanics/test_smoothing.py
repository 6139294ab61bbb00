"""Smoothed poses: SciPy's smoothing spline in a vector space, and less noise on any group."""

import numpy as np
import pytest
from scipy.interpolate import make_smoothing_spline

from eqt_cli.core.errors import InputError
from eqt_cli.groups import group_named
from eqt_cli.mechanics.smoothing import MATCHED, smoothed

RNG = np.random.default_rng(0)
TIMES = np.cumsum(RNG.uniform(0.05, 0.2, 60))
CURVE = np.c_[np.sin(TIMES), np.cos(TIMES), 0.1 * TIMES]
ROUNDING = 1e-12
"""Of two ways to solve the same banded equations, of condition about 1e3."""


def places(G, x):
    return G.assemble(np.broadcast_to(np.eye(G.space), (len(x), G.space, G.space)), x[..., None])


@pytest.mark.parametrize("deviation", [0.005, 0.03, 0.1])
def test_in_a_vector_space_it_is_the_smoothing_spline(deviation):
    G, y = group_named("R3"), CURVE + 0.02 * np.random.default_rng(1).normal(size=CURVE.shape)
    found = smoothed(G, TIMES, places(G, y), [deviation])
    expected = make_smoothing_spline(TIMES, y, lam=found.weights[0])(TIMES)
    np.testing.assert_allclose(G.translations(found.poses)[..., 0], expected, atol=ROUNDING)
    residual = np.sqrt(np.mean(np.sum((expected - y) ** 2, axis=1)))
    np.testing.assert_allclose(residual, deviation, rtol=MATCHED)


def test_cross_validation_finds_what_scipy_finds():
    G, y = group_named("R1"), CURVE[:, :1] + 0.02 * np.random.default_rng(2).normal(size=(60, 1))
    found = smoothed(G, TIMES, places(G, y), [None])
    expected = make_smoothing_spline(TIMES, y[:, 0])(TIMES)
    flat = 1e-5  # the least is flat, and both stop near it
    np.testing.assert_allclose(G.translations(found.poses)[:, 0, 0], expected, atol=flat)


@pytest.mark.parametrize("name", ["SO3", "SE3", "SE2", "SO3*R1"])
def test_noise_on_a_group_is_taken_out(name):
    G, rng = group_named(name), np.random.default_rng(3)
    t = np.linspace(0.0, 10.0, 150)
    a, b = rng.uniform(-0.5, 0.5, (2, G.dimension))
    true = G.exp(a * np.sin(t)[:, None]) @ G.exp(b * t[:, None])
    noisy = true @ G.exp(0.02 * rng.normal(size=(len(t), G.dimension)))
    deviations = [0.02 * np.sqrt(len(range(*part.axes.indices(G.dimension)))) for part in G.parts]
    for asked in (deviations, [None] * len(deviations)):
        found = smoothed(G, t, noisy, asked)
        left = G.log(G.inverse(true) @ found.poses)
        assert np.sqrt(np.mean(left**2)) < 0.02 / 2
        np.testing.assert_allclose(found.residuals, deviations, rtol=0.15)
    assert G.violation(found.poses[75]) < ROUNDING


@pytest.mark.parametrize("name", ["SO3", "SE3"])
def test_a_constant_velocity_stays_as_it_is(name):
    G, t = group_named(name), np.linspace(0.0, 3.0, 20)
    poses = G.exp(t[:, None] * np.linspace(0.2, 0.9, G.dimension))
    found = smoothed(G, t, poses, [0.5] * len(G.parts))
    np.testing.assert_allclose(found.poses, poses, atol=1e-6)  # rounding times the largest λ


def test_poses_too_far_apart():
    G = group_named("SO3")
    wild = G.exp(np.random.default_rng(0).uniform(-3.1, 3.1, (30, 3)))
    with pytest.raises(InputError) as caught:
        smoothed(G, np.arange(30.0), wild, [3.0])
    assert str(caught.value) == (
        "no smooth motion was found near these poses; give a smaller deviation, or more poses "
        "where they turn"
    )
