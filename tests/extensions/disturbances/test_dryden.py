"""Turbulent wind: its spectrum, its correlation in closed form, and the drag in it."""

import numpy as np
import pytest
import yaml
from case_tables import refusal
from said import mentions
from scipy.integrate import quad

from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import group_named
from eqt_cli.extensions.disturbances.dryden import SINES, Dryden, frequencies, share_below

pytestmark = pytest.mark.needs("disturbances")
STD, LENGTH, WIND = [1.2, 0.8, 0.5], [50.0, 30.0, 20.0], [3.0, 4.0, 0.0]
SPEED, D = 5.0, [0, 0, 0, 0.5, 0.6, 0.7]
ENTRY = {"kind": "dryden", "linear": D, "current": WIND, "std": STD, "length": LENGTH}


def wind(seed=1):
    random = np.random.default_rng(seed)
    return Dryden(D, current=WIND, std=STD, length=LENGTH).of_run(group_named("SE3"), random)


@pytest.mark.parametrize("across", [False, True])
def test_its_sines_divide_the_spectrum_of_the_standard(across):
    """The variance below each frequency, by quadrature of Φ; each sine has 1/48 of it."""
    x = frequencies(across)

    def phi(x):
        return (1 + 3 * x * x) / (1 + x * x) ** 2 / np.pi if across else 2 / np.pi / (1 + x * x)

    shares = [quad(phi, 0, end)[0] for end in x]
    np.testing.assert_allclose(shares, (np.arange(SINES) + 0.5) / SINES, atol=1e-9)
    assert share_below(np.array([1e9]), across)[0] == pytest.approx(1.0)


def test_its_correlation_is_that_of_dryden():
    """σ²e^{−r/L} along, and σ²(1 − r/2L)e^{−r/L} across, r = Vτ; 48 sines miss 8 % of σ²."""
    part, tau = wind(), np.linspace(0.0, 10.0, 60)
    power = (part.sine**2 + part.cosine**2) / 2
    found = (power[:, :, None] * np.cos(part.omega[:, :, None] * tau)).sum(axis=1)
    for k in range(3):
        r = SPEED * tau / LENGTH[k]
        expected = STD[k] ** 2 * np.exp(-r) * (1 if k == 0 else 1 - r / 2)
        np.testing.assert_allclose(found[k], expected, atol=0.083 * STD[k] ** 2)
    np.testing.assert_allclose(power.sum(axis=1), np.square(STD), rtol=1e-12)
    known = Dryden(D, current=WIND, std=STD, length=LENGTH).of_run(group_named("SE3"), None)
    assert not known.turbulence(np.arange(4.0)).any()  # a law knows the mean


def test_the_drag_is_that_in_the_wind_of_its_sines():
    """−D(v − c − u e₁ − v e₂ − w e₃) of a vehicle that turned, at several times."""
    G, part = group_named("SE3"), wind()
    Q, V, times = G.exp(np.array([0.3, -0.2, 0.9, 1, 2, 3])), np.arange(6) / 5.0, np.arange(4.0)
    R, e1 = Q[:3, :3], np.array([0.6, 0.8, 0.0])
    axes = [e1, np.array([-0.8, 0.6, 0.0]), np.array([0.0, 0.0, 1.0])]
    batch = np.broadcast_to(Q, (4, 4, 4)), np.broadcast_to(V, (4, 6))
    found = part.in_body(G, times, *batch)
    for t, force in zip(times, found, strict=True):
        air = np.array(WIND)
        for k in range(3):
            phase = part.omega[k] * t
            air = air + axes[k] * (part.sine[k] @ np.sin(phase) + part.cosine[k] @ np.cos(phase))
        expected = [0, 0, 0, *(-np.array(D[3:]) * (V[3:] - R.T @ air))]
        np.testing.assert_allclose(force, expected, atol=1e-12)


VEHICLE = {
    "group": "SE3",
    "inertia": [0.005, 0.005, 0.008, 0.8, 0.8, 0.8],
    "gains": {"kp": 2.0, "kd": 1.0},
    "reference": {"kind": "constant"},
    "controllers": ["lee2010"],
    "time": {"duration": 2.0, "samples": 21},
    "ensemble": {"runs": 2, "seed": 3},
}


@pytest.mark.ci("runs of both engines")
def test_both_engines_fly_it_and_each_run_draws_its_wind(solved):
    ends = []
    for engine in ("native", "solve_ivp"):
        solver = {"engine": engine, "rtol": 1e-11, "atol": 1e-12}
        text = yaml.safe_dump({**VEHICLE, "plant": {"forces": [ENTRY]}, "solver": solver})
        problem, solution = solved(text, label="lee2010")
        ends.append(problem.loop.tracking(problem.times, solution.states).Q[:, -1, :3, 3])
    np.testing.assert_allclose(*ends, rtol=0, atol=1e-9)
    assert np.abs(ends[0][0] - ends[0][1]).max() > 0.01


@pytest.mark.parametrize(
    ("change", "said"),
    [
        ({"std": [1, 2]}, "plant.forces[0].std: expected 3 numbers…got 2"),
        ({"length": [0, 1, 1]}, "plant.forces[0].length: expected numbers of at least 0.001…"),
        ({"current": ["t", 0, 0]}, "plant.forces[0].current: expected the mean wind as numbers…"),
        ({"current": [0, 0, 0]}, "plant.forces[0].speed: missing…"),
    ],
)
def test_what_is_wrong_is_said_at_its_place(experiment_of, change, said):
    text = yaml.safe_dump({**VEHICLE, "plant": {"forces": [{**ENTRY, **change}]}})
    assert mentions(refusal(ConfigError, experiment_of, text), said)
