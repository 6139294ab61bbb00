"""Filters err as their covariance says, and how many converge from far away."""

import numpy as np
import pytest
from ports import after_measuring
from scipy.stats import binomtest, chi2

from eqt_cli.components.sensors import CHANNEL_MEASURED, FIRST, NOTHING, Bias, Errors, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import Eqf, Invariant, group_named
from eqt_cli.loop.signals import compute

TEXT = """
group: {group}
inertia: 1.0
gains: {{kp: 2, kd: 2}}
reference: {{kind: constant, velocity: {velocity}}}
controllers: [lee2010]
initial: {{pose: {{kind: exp_normal, std: 0.3}}, velocity: {{kind: normal, std: 0.3}}}}
ensemble: {{runs: {runs}, seed: 3}}
control: {{period: 0.1}}
sensors:
  pose: [{{kind: noise, std: {pose}, period: {every}}}]
  velocity:
    - {{kind: noise, std: 0.02}}
    - {{kind: bias, value: {bias}, walk: 0.005}}
estimator: {{kind: {kind}{options}}}
time: {{duration: {duration}, samples: {samples}}}
solver: {{engine: native, rtol: 1.0e-7}}
"""

DIMENSION = {"SO3": 3, "SE2": 3, "SE3": 6, "SE23": 9}
TURNING = [0.2, -0.1, 0.3, 0.2, 0.1, -0.2, 0.1, 0.2, 0.1]


def signals(solved, group, kind, runs, duration, *, every=1.0, pose=0.05, options=""):
    """By name, ``(runs, samples, …)``, of runs none of which fails."""
    samples = round(duration) + 1
    velocity = TURNING[: DIMENSION[group]]
    # A number for each coordinate: one for all would depend on each other, as no filter assumes.
    bias = "[" + ", ".join(DIMENSION[group] * ["{normal: [0, 0.05]}"]) + "]"
    given = {"bias": bias, "velocity": velocity, "every": every, "pose": pose, "options": options}
    sizes = {"runs": runs, "duration": duration, "samples": samples}
    text = TEXT.format(group=group, kind=kind, **sizes, **given)
    problem, solution = solved(text, label="lee2010")
    assert not solution.status.any()
    with np.errstate(all="ignore"):
        return compute(problem.batched_loop(extra_axes=1), problem.times, solution.states)


def within(nees, degrees, probability=0.999):
    """Whether a mean over runs lies where that of χ² does, but for one time in a thousand."""
    runs, tail = len(nees), (1 - probability) / 2
    low, high = chi2.ppf([tail, 1 - tail], runs * degrees) / runs
    return low < nees.mean() < high


@pytest.mark.parametrize(
    "kind", ["invariant", pytest.param("eqf", marks=pytest.mark.ci("compiles a long program"))]
)
@pytest.mark.parametrize(
    ("group", "runs", "duration"),
    [
        ("SE2", 10, 5),
        *(
            pytest.param(group, 200, 20, marks=pytest.mark.ci("200 runs of 20 s at 10 Hz"))
            for group in ("SO3", "SE2", "SE3", "SE23")
        ),
    ],
)
def test_nees_is_in_the_interval_of_chi_squared(solved, group, kind, runs, duration):
    """At 10 Hz with fixes at 1 Hz, from the first fix, with the deviations of the sensors."""
    s = signals(solved, group, kind, runs, duration)
    degrees = 2 * DIMENSION[group]
    assert (s["nees_dof"] == degrees).all()
    for sample in {1, duration // 2, duration}:
        assert within(s["nees"][:, sample], degrees)
    # The mean over time spreads less than that of any one time.
    assert within(s["nees"].mean(axis=1), degrees)


@pytest.mark.parametrize("kind", ["invariant", "eqf"])
def test_a_filter_that_trusts_its_fixes_too_much_is_told(solved, kind):
    s = signals(solved, "SE2", kind, 10, 5, options=", pose_std: 0.02")
    assert not within(s["nees"][:, -1], 6)


# Linear: NEES and innovations of many runs side by side, without a loop ---------------------------


def judged(group, kind, pose, velocity, acceleration, runs=60_000, ticks=50):
    """Mean of NEES over its degrees of freedom, and the correlation of innovations, of one axis.

    The velocity is linear between the ticks, with this acceleration at first and at rest with 0.
    """
    G, random = group_named(group), np.random.default_rng(5)
    white, walk, first = 0.1, 0.02, 0.1
    sensors = Noise(std=white, **velocity), Bias(value=first, walk=walk)
    fixes = (Noise(std=0.05, **pose),)
    vehicle = Vehicle(
        control=Sampling(0.1), pose_sensors=fixes, velocity_sensors=sensors, estimator=kind()
    ).of_run(G)
    clocks = {channel.signal: channel.clock for channel in vehicle.channels(G)}
    states = {name: np.zeros((runs, count)) for name, count in vehicle.states(G).items()}
    V = acceleration * np.sin(0.13 * np.arange(ticks)) / 1.3
    q = np.concatenate([[0.0], np.cumsum(0.05 * (V[1:] + V[:-1]))])
    b = first * random.standard_normal((runs, 1))
    nees = []
    for k in range(ticks):
        due = {name: k == 0 or clock.is_due(k) for name, clock in clocks.items()}
        if due["pose"]:
            off = 0.05 * random.standard_normal((runs, 1))
        if due["velocity"]:
            drift = walk * np.sqrt(0.1 * clocks["velocity"].every) * (k > 0)
            b = b + drift * random.standard_normal((runs, 1))
            noise = white * random.standard_normal((runs, 1))
        events = [
            FIRST if k == 0 else CHANNEL_MEASURED if due[channel.signal] else NOTHING
            for channel in vehicle.holding(G)
        ]
        errors = Errors(G.exp(off), b + noise, np.full((runs, len(events)), events), b)
        motion = G.exp(np.full((runs, 1), q[k])), np.full((runs, 1), V[k])
        states = states | after_measuring(vehicle, G, *motion, errors, states)
        P, e = states["estimator_covariance"], states["estimator_error"]
        square = P[:, 3] * e[:, 0] ** 2 - 2 * P[:, 1] * e[:, 0] * e[:, 1] + P[:, 0] * e[:, 1] ** 2
        nees.append((square / (P[:, 0] * P[:, 3] - P[:, 1] ** 2)).mean() / 2)
    _, squares, products = states["estimator_innovations"].sum(axis=0)
    return np.mean(nees), products / squares


@pytest.mark.ci("60,000 runs")
@pytest.mark.parametrize("acceleration", [0.0, 0.5], ids=["at rest", "accelerated"])
@pytest.mark.parametrize(
    ("group", "kind", "pose", "velocity"),
    [
        ("SO2", Invariant, {}, {}),
        ("R1", Eqf, {}, {}),
        ("R1", Invariant, {"period": 0.3}, {"period": 0.3}),
        ("R1", Invariant, {"delay": 2}, {}),
        ("SO2", Invariant, {"period": 0.6, "delay": 1}, {"period": 0.2}),
    ],
)
def test_linear_filters_are_consistent(group, kind, pose, velocity, acceleration):
    """The estimate of Kalman with the exact covariance."""
    nees, correlation = judged(group, kind, pose, velocity, acceleration)
    assert abs(nees - 1) <= 0.01
    assert abs(correlation) <= 0.003


FROM_120 = ", initial_error: [1.2092, -1.2092, 1.2092]"
"""log(Q̂⁻¹Q), of 120 degrees."""


@pytest.mark.ci("200 runs of 30 s for each kind")
@pytest.mark.parametrize(
    ("kind", "options"),
    [
        ("invariant", ", initial_pose_std: 1.5, initial_bias_std: 0.05"),
        ("eqf", ", initial_pose_std: 1.5, initial_bias_std: 0.05"),
        ("complementary", ", kp: 0.5, ki: 0.05"),
    ],
)
def test_filters_converge_from_120_degrees(solved, kind, options):
    """The share of 200 runs that end within 15 degrees, with its exact 95 % interval."""
    s = signals(solved, "SO3", kind, 200, 30, options=FROM_120 + options)
    turn = np.linalg.norm(s["pose_estimate_error"], axis=-1)
    assert turn[:, 0].min() > 0  # behind the first fix
    settled = int((turn[:, -1] < np.radians(15)).sum())
    interval = binomtest(settled, 200).proportion_ci(0.95, "exact")
    print(f"{kind}: {settled} of 200 [{interval.low:.3f}, {interval.high:.3f}]")
    assert interval.low > 0.98
