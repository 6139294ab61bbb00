"""Smoothed poses: SciPy's smoothing spline in a vector space, and less noise on any group."""

import numpy as np
import pytest
from said import says
from scipy.interpolate import make_smoothing_spline

from eqt_cli.base.errors import InputError
from eqt_cli.extend import group_named
from eqt_cli.extensions.logs.smoothing import MATCHED, _Bending, smoothed

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


def test_the_weight_of_cross_validation_is_at_the_minimum():
    """Of n Σ|r_i|² / tr(I − A)², by the whole matrix A of SciPy's spline."""
    G, y = group_named("R1"), CURVE[:, :1] + 0.02 * np.random.default_rng(2).normal(size=(60, 1))

    def score(weight):
        A = make_smoothing_spline(TIMES, np.eye(60), lam=weight)(TIMES)
        return 60 * np.sum((y - A @ y) ** 2) / np.trace(np.eye(60) - A) ** 2

    [weight] = smoothed(G, TIMES, places(G, y), [None]).weights
    assert score(weight) < min(score(weight * 0.99), score(weight * 1.01))


@pytest.mark.parametrize("weight", [1e-6, 1e-3, 1.0])
def test_freedom_is_the_trace_of_what_smoothing_takes_out(weight):
    A = make_smoothing_spline(TIMES, np.eye(60), lam=weight)(TIMES)
    assert _Bending(TIMES).freedom(weight) == pytest.approx(60 - np.trace(A), rel=1e-10)


@pytest.mark.parametrize(
    ("curve", "deviation", "relative"),
    [
        (CURVE[:, :1], 1e-12, 1e-6),  # less than any weight gives
        (CURVE[:, :1], 1e3, 1e11),  # more than a constant velocity leaves
        (CURVE[:, :1], None, 1e-6),  # without noise
        (0.1 * TIMES[:, None] + 0.02 * RNG.normal(size=(60, 1)), None, 1e11),
    ],
    ids=["tiny", "huge", "no noise", "no curve"],
)
def test_weights_are_within_their_bounds(curve, deviation, relative):
    """Relative to the cube of the mean step; the search of cross-validation ends near them."""
    G = group_named("R1")
    [weight] = smoothed(G, TIMES, places(G, curve), [deviation]).weights
    expected = relative * np.diff(TIMES).mean() ** 3
    assert weight == pytest.approx(expected, rel=1e-6 if deviation else 1e-3)


@pytest.mark.parametrize(("extreme", "beyond"), [(1e-12, 0.6), (1e3, 1.5)])
def test_a_deviation_just_beyond_the_bounds_of_the_weight(extreme, beyond):
    """It is that of the extreme weight, as one far beyond."""
    G = group_named("R1")
    far = smoothed(G, TIMES, places(G, CURVE[:, :1]), [extreme])
    near = smoothed(G, TIMES, places(G, CURVE[:, :1]), [beyond * far.residuals[0]])
    assert near.weights == pytest.approx(far.weights, rel=1e-12)
    assert near.residuals == pytest.approx(far.residuals, rel=1e-9)


def test_on_a_group_the_residuals_are_those_of_the_second_derivatives():
    """log(Q_i⁻¹P_i) is λQu with Ru = Qᵀy of the smooth poses, Q and R as in Reinsch (1967)."""
    G, random = group_named("SO3"), np.random.default_rng(5)
    t = np.cumsum(random.uniform(0.1, 0.3, 12))
    turns = np.c_[np.sin(t), 0.5 * t, np.cos(2 * t)]
    noisy = G.exp(turns) @ G.exp(0.1 * random.normal(size=(12, 3)))
    found = smoothed(G, t, noisy, [0.1])
    h, n = np.diff(t), len(t)
    Q, R = np.zeros((n, n - 2)), np.zeros((n - 2, n - 2))
    for i in range(n - 2):
        Q[i : i + 3, i] = 1 / h[i], -1 / h[i] - 1 / h[i + 1], 1 / h[i + 1]
        R[i, i] = (h[i] + h[i + 1]) / 3
    for i in range(n - 3):
        R[i, i + 1] = R[i + 1, i] = h[i + 1] / 6
    steps = G.log(G.inverse(found.poses[:-1]) @ found.poses[1:])
    u = np.linalg.solve(R, np.diff(steps / h[:, None], axis=0))
    residuals = G.log(G.inverse(found.poses) @ noisy)
    np.testing.assert_allclose(residuals, found.weights[0] * Q @ u, rtol=0, atol=1e-10)
    size = np.sqrt(np.mean(np.sum(residuals**2, axis=1)))
    assert [size] == pytest.approx(found.residuals, rel=1e-9)
    assert size == pytest.approx(0.1, rel=1e-4)


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
        matched = 1e-4 if asked is deviations else 0.15
        np.testing.assert_allclose(found.residuals, deviations, rtol=matched)
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
    assert says(str(caught.value), "no smooth motion was found near these poses…")
