"""Estimates against filters that were written without eqt, on the same measurements.

The truth is that of eqt's own run, at the control instants, and the errors of measurement are those
that the run drew. So nothing is integrated twice, and only rounding can differ.
"""

from functools import partial

import numpy as np
import plain_filters as plain
import pytest
from ports import after_measuring
from scipy.linalg import solve_discrete_are

from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import Bias, Complementary, Eqf, Invariant, Noise, group_named
from eqt_cli.loop.signals import compute

FILTERS = {"invariant": plain.InvariantFilter, "eqf": plain.EquivariantFilter}
DIMENSION = {"R1": 1, "R3": 3, "SO2": 1, "SO3": 3, "SE2": 3, "SE3": 6, "SE23": 9}
POSE, VELOCITY, BIAS, WALK = 0.05, 0.02, 0.1, 0.01
PERIOD = 0.1


def text(group, kind, *, every=0.5, duration=2.0, fixes="", options="", rates="", walk=WALK):
    """A loop whose law reads an estimate; samples are the control instants."""
    pose = f"[{{kind: noise, std: {POSE}, period: {every}{fixes}}}]"
    samples = round(duration / PERIOD) + 1
    turning = [0.3, -0.2, 0.4, 0.2, 0.1, -0.3, 0.2, 0.1, -0.1][: DIMENSION[group]]
    return f"""
group: {group}
inertia: 1.0
gains: {{kp: 2, kd: 2}}
reference: {{kind: constant, velocity: {turning}}}
controllers: [eqt]
initial: {{pose: {{kind: exp_normal, std: 0.5}}, velocity: {{kind: normal, std: 0.5}}}}
ensemble: {{runs: 2, seed: 4}}
control: {{period: {PERIOD}}}
sensors:
  pose: {pose}
  velocity:
    - {{kind: noise, std: {VELOCITY}{rates}}}
    - {{kind: bias, value: {BIAS}, walk: {walk}}}
estimator: {{kind: {kind}{options}}}
time: {{duration: {duration}, samples: {samples}}}
solver: {{engine: solve_ivp}}
"""


def told(problem, solution):
    """The truth of each run, what is measured of it, and the signals, up to the last instant."""
    loop = problem.batched_loop(extra_axes=1)
    with np.errstate(all="ignore"):
        found = compute(loop, problem.times, solution.states)
    k = slice(0, len(problem.times) - 1)  # the last sample is before its instant
    signals = {name: values[:, k] for name, values in found.items()}
    errors = problem.errors.of(problem.rows).measured(loop.group)
    E, b = (part[:, k] for part in errors[:2])
    return signals, signals["pose"] @ E, signals["velocity"] + b


def true_bias(group, run, instants, every=1):
    """The bias at every instant, as the sensor draws it once in so many."""
    random = generator_at(4, Stream.VEHICLE, run, "sensors.velocity[1]")
    steps = random.standard_normal((instants, DIMENSION[group]))
    drift = np.cumsum(steps, axis=0) - steps[:1]
    return BIAS + WALK * np.sqrt(every * PERIOD) * drift[np.arange(instants) // every]


def close(found, expected, tolerance=1e-8):
    assert np.isfinite(expected).all()  # of a run that failed, both are NaN
    np.testing.assert_allclose(found, expected, rtol=0, atol=tolerance)


MORE = pytest.mark.ci("the filters are written once for all groups")


@pytest.mark.parametrize(
    ("group", "instants"),
    [("SE2", 6), *(pytest.param(name, 20, marks=MORE) for name in ("SO3", "SE3", "SE23"))],
)
@pytest.mark.parametrize("kind", FILTERS)
def test_estimates_are_those_of_a_plain_filter(solved, group, instants, kind):
    """From 70 degrees off, so that corrections are large and the two filters differ."""
    m, A = DIMENSION[group], plain.Algebra(group)
    error = [1.0, -0.6, 0.4, 0.5, -0.5, 0.3, 0.2, 0.1, -0.2][:m]
    options = f", initial_error: {error}, initial_pose_std: 0.8, initial_bias_std: 0.2"
    every, duration = instants // 3 * PERIOD, instants * PERIOD
    given = text(group, kind, every=every, duration=duration, options=options)
    s, Q_m, V_m = told(*solved(given, runs=[1]))
    P = plain.covariance_of(m, 0.8, 0.2, VELOCITY)
    b = true_bias(group, 1, instants)

    Q = s["pose"][0, 0] @ A.exp(-np.array(error))
    F = FILTERS[kind](group, PERIOD, VELOCITY, WALK, Q, np.zeros(m), P)
    for k in range(instants):
        if k:
            F.predict(V_m[0, k - 1], V_m[0, k])
        if k % (instants // 3) == 0:
            off = A.log(np.linalg.inv(F.pose) @ Q_m[0, k])
            F.correct(off, list(range(m)), POSE**2 * np.eye(m))
        close(s["estimated_pose"][0, k], F.pose)
        close(s["estimated_bias"][0, k], F.bias)
        close(s["estimated_velocity"][0, k], V_m[0, k] - F.bias)
        close(s["nees"][0, k] / F.nees(s["pose"][0, k], b[k]), 1.0)


def coordinates(group, Q):
    """The vector of R^n, or the angle of SO2 without its whole turns."""
    if group == "SO2":
        return np.unwrap(np.arctan2(Q[..., 1, 0], Q[..., 0, 0]), axis=-1)[..., None]
    return Q[..., :-1, -1]


def by_turns(*groups):
    """Every group with every filter, of which each is fast once."""
    return pytest.mark.parametrize(
        ("group", "kind"),
        [
            pytest.param(group, kind, marks=[MORE] * (i != j))
            for i, group in enumerate(groups)
            for j, kind in enumerate(FILTERS)
        ],
    )


@pytest.mark.parametrize(
    ("fixes", "rates"),
    [
        ((5, 0), (1, 0)),
        pytest.param((1, 0), (3, 0), marks=MORE),
        ((2, 3), (3, 1)),
        pytest.param((2, 1), (1, 2), marks=MORE),
    ],
    ids=["slow fixes", "slow velocities", "late fixes", "late velocities"],
)
@by_turns("R3", "SO2")
def test_on_vectors_and_on_the_circle_it_is_kalmans_filter(solved, group, kind, fixes, rates):
    """The first fix begins it. Fixes and velocities come once in so many ticks, so many late."""
    n, ((every, late), (held, behind)) = DIMENSION[group], (fixes, rates)
    timing = {"every": every * PERIOD, "fixes": f", delay: {late}"}
    timing["rates"] = f", period: {held * PERIOD}, delay: {behind}"
    s, Q_m, V_m = told(*solved(text(group, kind, **timing)))
    q, q_m, q_hat = (coordinates(group, Q) for Q in (s["pose"], Q_m, s["estimated_pose"]))
    ticks = range(0, 20, every), range(0, 20, held)
    F = plain.Kalman(PERIOD, *ticks, POSE, VELOCITY, BIAS, WALK)
    for run in range(2):
        b = true_bias(group, run, 20, held)
        given = [(q_m[run, ::every, axis], V_m[run, ::held, axis]) for axis in range(n)]
        for k in range(20):
            known, settled = max(k - behind, 0) // held + 1, k - max(late, behind)
            white = np.array([F.innovations(settled, *one, known) for one in given])
            assert s["innovations"][run, k] == white.size
            if white.size:
                close(s["innovation_square"][run, k], (white**2).mean(), 1e-10)
                products = (white[:, 1:] * white[:, :-1]).sum()
                close(s["innovation_correlation"][run, k], products / (white**2).sum(), 1e-10)
            x, P = zip(*(F.estimate(k, k - late, *one, known) for one in given), strict=True)
            x, P = np.array(x), np.array(P)
            e = np.stack([q[run, k], b[k]], axis=1) - x
            close(q_hat[run, k], x[:, 0], 1e-10)
            close(s["estimated_bias"][run, k], x[:, 1], 1e-10)
            close(s["pose_estimate_error"][run, k], e[:, 0], 1e-10)
            close(s["bias_estimate_error"][run, k], e[:, 1], 1e-10)
            close(s["pose_estimate_std"][run, k] ** 2, P[:, 0, 0], 1e-10)
            close(s["bias_estimate_std"][run, k] ** 2, P[:, 1, 1], 1e-10)
            nees = np.einsum("ai,aij,aj", e, np.linalg.inv(P), e)
            close(s["nees"][run, k], nees, 1e-10 * (1 + nees))


@by_turns("SO2", "R1")
def test_its_steady_covariance_solves_the_riccati_equation(solved, group, kind):
    """With a fix at every instant, and deviations with which it is steady after some seconds."""
    noise = ", pose_std: 0.1, velocity_std: 2.0, bias_walk: 4.0"
    given = text(group, kind, every=PERIOD, duration=3.0, options=noise)
    s, _, _ = told(*solved(given, runs=[0]))
    F = np.array([[1, -PERIOD, -PERIOD / 2], [0, 1, 0], [0, 0, 0]])
    noise, walk = np.array([-PERIOD / 2, 0, 1]) * 2.0, np.array([-PERIOD / 2, 1, 0]) * 4.0
    N = np.outer(noise, noise) + PERIOD * np.outer(walk, walk)
    H, R = np.array([[1.0, 0.0, 0.0]]), np.array([[0.1**2]])
    before = solve_discrete_are(F.T, H.T, N, R)
    P = before - before @ H.T @ np.linalg.inv(H @ before @ H.T + R) @ H @ before
    close(s["pose_estimate_std"][0, -1, 0] ** 2, P[0, 0], 1e-10)
    close(s["bias_estimate_std"][0, -1, 0] ** 2, P[1, 1], 1e-10)


def test_the_complementary_filter_is_that_of_its_paper(solved):
    """From 100 degrees off, where the sine of an angle is not the angle."""
    error = [1.2, -1.0, 0.8]
    options = f", kp: 0.6, ki: 0.2, initial_error: {error}"
    s, Q_m, V_m = told(*solved(text("SO3", "complementary", options=options)))
    for run in range(2):
        R = s["pose"][run, 0] @ plain.Algebra("SO3").exp(-np.array(error))
        F = plain.PassiveFilter(R, np.zeros(3), 0.6, 0.2, PERIOD, 0.5)
        for k in range(20):
            if k:
                F.predict((V_m[run, k] + V_m[run, k - 1]) / 2)
            if k % 5 == 0:
                F.correct(Q_m[run, k])
            close(s["estimated_pose"][run, k], F.pose)
            close(s["estimated_bias"][run, k], F.bias)
            close(s["estimated_velocity"][run, k], V_m[run, k] - F.bias)


# Rates and delays of each part, without a loop ----------------------------------------------------

SE2, INSTANTS = group_named("SE2"), 10


def body(run):
    """Poses and velocities of a body at the instants, from rest."""
    random, A = np.random.default_rng(run), plain.Algebra("SE2")
    V = np.cumsum(random.standard_normal((INSTANTS, 3)), axis=0)
    V -= V[0]
    Q = [A.exp(random.standard_normal(3))]
    for v in V[:-1]:
        Q.append(Q[-1] @ A.exp(PERIOD * v))
    return np.array(Q), V


def sensed(run, Q, V):
    """What sensors tell of it, the bias, and which of the positions arrive."""
    A, k = plain.Algebra("SE2"), np.arange(INSTANTS)

    def draws(place, count, of):
        random = generator_at(4, Stream.VEHICLE, run, place)
        return random.standard_normal((count, len(of)))

    n = np.zeros((INSTANTS, 3))
    n[:, :1] = 0.02 * draws("sensors.pose[0]", INSTANTS, [0])
    n[:, 1:] = 0.05 * draws("sensors.pose[1]", 4, [1, 2])[k // 3]
    white = 0.04 * draws("sensors.velocity[0]", 6, [1, 2])
    steps = draws("sensors.velocity[1]", 6, [1, 2])
    steps[0] = 0.0
    b = np.zeros((INSTANTS, 3))
    b[:, 1:] = (0.1 + 0.03 * np.sqrt(0.2) * np.cumsum(steps, axis=0))[k // 2]
    V_m = V + b
    V_m[:, 1:] += white[k // 2]
    radio = generator_at(4, Stream.VEHICLE, run, "measured_pose_translation.arrived")
    arrives = radio.random(4) >= 0.4
    arrives[0] = True
    return np.array([Q[j] @ A.exp(n[j]) for j in k]), V_m, b, arrives


def given_vehicle(estimator):
    """An attitude at every instant; position and speed at some, late, the position with losses."""
    return Vehicle(
        control=Sampling(PERIOD),
        pose_sensors=(
            Noise(std=0.02, of="rotation"),
            Noise(std=0.05, of="translation", period=0.3, delay=3, dropout=0.4),
        ),
        velocity_sensors=(
            Noise(std=0.04, of="translation", period=0.2, delay=2),
            Bias(value=0.1, walk=0.03, of="translation"),
        ),
        estimator=estimator,
    )


def states_of(vehicle, bodies):
    """The states after every instant, by name, of several runs side by side."""
    runs = [partial(generator_at, 4, Stream.VEHICLE, run) for run in range(len(bodies))]
    errors = vehicle.measurement_errors(SE2, INSTANTS, runs)
    flown = vehicle.of_run(SE2)
    states = {name: np.zeros((len(bodies), count)) for name, count in flown.states(SE2).items()}
    for k in range(INSTANTS):
        now = errors.measured(SE2, slice(None), k)
        Q, V = (np.stack([each[part][k] for each in bodies]) for part in range(2))
        states = states | after_measuring(flown, SE2, Q, V, now, states)
        yield states


ERROR = [0.5, -1.0, 1.0]
DEVIATIONS = {"velocity_std": [0.03, 0.04, 0.04]}  # of the turn, which has no sensor
START = {"initial_error": ERROR, "initial_pose_std": 0.8}
KP, KI = [1.0, 0.8, 0.6], [0.3, 0.2, 0.1]


def started(kind, given, Q, Q_m):
    """A plain filter as it is before what is measured at t = 0 corrects it, if that does."""
    pose = Q @ plain.Algebra("SE2").exp(-np.array(ERROR)) if given else Q_m
    if kind == "complementary":
        between = [0.1, 0.3, 0.3]
        return plain.GradientFilter("SE2", PERIOD, pose, np.array(KP), np.array(KI), between)
    std, walk = np.array([0.03, 0.04, 0.04]), np.array([0, 0.03, 0.03])
    P = plain.covariance_of(3, 0.8 if given else [0.02, 0.05, 0.05], [0, 0.1, 0.1], std)
    return FILTERS[kind]("SE2", PERIOD, std, walk, pose, np.zeros(3), P)


def velocity(V_m, j, k):
    """That of instant j, as far as it has arrived by instant k."""
    known = min(j, max(k - 2, 0))
    return np.concatenate([V_m[j, :1], V_m[known - known % 2, 1:]])


def replayed(F, k, given, Q_m, V_m, arrives):
    """Takes a plain filter to instant k, by what is known then.

    Returns
    -------
    tuple
        Coordinates and whitened residual of the fix of which nothing more can arrive.
    """
    found, R = ([], np.zeros(0)), np.diag([0.02, 0.05, 0.05]) ** 2
    for j in range(k + 1):
        if j:
            drift = np.where([True, j % 2 == 0, j % 2 == 0], [1.0, 2.0, 2.0], 0.0)
            share = drift / 2 * [True, j + 2 <= k, j + 2 <= k]
            F.predict(velocity(V_m, j - 1, k), velocity(V_m, j, k), share, drift)
        elif not given:
            continue
        there = j % 3 == 0 and arrives[j // 3] and (k >= j + 3 or j == 0)
        measured, rows = F.pose.copy(), [0, 1, 2] if there else [0]
        measured[:2, :2] = Q_m[j, :2, :2]
        measured[:2, 2] = Q_m[j, :2, 2] if there else F.pose[:2, 2]
        if isinstance(F, plain.GradientFilter):
            F.correct(np.linalg.inv(F.pose) @ measured, rows)
            continue
        off = F.A.log(np.linalg.inv(F.pose) @ measured)
        white = F.correct(off[rows], rows, R[np.ix_(rows, rows)])
        if j == (k - 3 if j else k):
            found = rows, white
    return found


@pytest.mark.parametrize(
    ("kind", "estimator"),
    [
        pytest.param("invariant", Invariant(**DEVIATIONS), marks=MORE),
        ("eqf", Eqf(**DEVIATIONS, **START)),
        pytest.param("complementary", Complementary(KP, KI), marks=MORE),
    ],
    ids=["invariant", "eqf", "complementary"],
)
def test_each_part_counts_at_its_own_time(kind, estimator):
    """However late its pose and its velocity arrive; until then, the last velocity stands in.

    A new one then makes up for it: a speed at every second tick counts for the whole of the second.
    """
    bodies, given = [body(run) for run in range(2)], estimator.initial_error is not None
    told = {1: sensed(1, *bodies[1])}  # a run beside another
    assert not told[1][-1].all()
    sums, last = np.zeros((2, 3)), np.zeros((2, 3))
    for k, states in enumerate(states_of(given_vehicle(estimator), bodies)):
        for run, (Q_m, V_m, b, arrives) in told.items():
            Q = bodies[run][0]
            F = started(kind, given, Q[0], Q_m[0])
            rows, white = replayed(F, k, given, Q_m, V_m, arrives)
            found = {name.removeprefix("estimator_"): each[run] for name, each in states.items()}
            close(SE2.unpack(found["pose"]), F.pose)
            close(found["bias"], F.bias)
            close(found["velocity"], velocity(V_m, k, k) - F.bias)
            error = F.A.log(np.linalg.inv(F.pose) @ Q[k])
            close(found["error"], np.concatenate([error, b[k] - F.bias]))
            if kind != "complementary":
                sums[run] += len(rows), white @ white, white @ last[run, rows]
                last[run, rows] = white
                close(found["innovations"], sums[run])
                close(found["last_innovation"], last[run])
                assert found["lost"] == 0
