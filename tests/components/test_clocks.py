"""Loops whose law, sensors and actuators have clocks of their own, in ticks."""

import numpy as np
import plain
import pytest
from case_tables import from_yaml, refusal
from said import mentions

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.vehicle_parts import Clock, Sampling
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import along_reference
from eqt_cli.loop.linearised import linearised

INERTIA, TICK, DURATION = [1.0, 2.0, 2.5], 0.05, 1.5
LAG, LIMIT = 0.3, 1.0

CLOCKS = {"law": (2, 1), "pose": (5, 0), "velocity": (1, 0), "lag": (4, 2)}
"""Every so many ticks, from which one on."""

DELAYS = {"law": 3, "pose": 1}
"""Ticks until a command, or a measurement, arrives."""

TEXT = """
group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {kp: 1.5, kd: 1.2}
reference: {kind: torque, torque: ["0.3*cos(t)", "0.2*sin(t)", "0.1"]}
controllers: [eqt]
actuators:
  - {kind: limit, limit: 1.0}
  - {kind: lag, time_constant: 0.3, period: 0.2, offset: 100 ms}
control: {period: 0.1, offset: 50 ms, delay: 150 ms}
sensors:
  pose: [{kind: noise, std: 0, period: 0.25, delay: 50 ms}]
  velocity: [{kind: noise, std: 0, period: 0.05}]
initial:
  pose: {kind: exp_normal, std: 0.0, centre: [0.9, -0.5, 0.7]}
  velocity: {kind: fixed, coordinates: [0.7, -0.5, 0.9]}
time: {duration: 1.5, samples: 31}
solver: {engine: solve_ivp, rtol: 1.0e-10}
"""


def due(name, tick):
    every, first = CLOCKS[name]
    return (tick - first) % every == 0


def expected():
    """Q and V at the ticks, by a program without eqt that counts them."""
    program = plain.Plain(
        "SO3",
        INERTIA,
        1.5,
        1.2,
        lambda t: np.array([0.3 * np.cos(t), 0.2 * np.sin(t), 0.1]),
        limit=LIMIT,
    )
    y = program.start(
        plain.exp("SO3", [0.9, -0.5, 0.7]), np.array([0.7, -0.5, 0.9]), np.eye(3), np.zeros(3)
    )
    poses, commands, taken = [], [], np.zeros(3)
    found, last = [y], np.zeros(3)
    for tick in range(round(DURATION / TICK)):
        Q, V, Qd, Pd, _ = program.split(y)
        poses.append(Q if due("pose", tick) else poses[-1])
        if due("law", tick):
            seen = poses[max(0, tick - DELAYS["pose"])]
            last = program.law(tick * TICK, seen, V, Qd, Pd)
        commands.append(last)
        late = tick - DELAYS["law"]
        if due("lag", tick):
            taken = np.clip(commands[late] if late >= 0 else np.zeros(3), -LIMIT, LIMIT)
        y = plain.solve_ivp(
            program.field,
            (tick * TICK, (tick + 1) * TICK),
            y,
            args=(lambda t, y, held=taken: held, LAG),
            **plain.TIGHT,
        ).y[:, -1]
        found.append(y)
    found = np.array(found)
    return found[:, :9].reshape(-1, 3, 3), found[:, 9:12]


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_states_are_those_of_a_program_that_counts_ticks(solved, engine):
    """Both integrate each tick at 1e-10 or less, and errors grow by less than 100."""
    problem, solution = solved(TEXT.replace("solve_ivp", engine))
    s = problem.loop.tracking(problem.times, solution.states)
    Q, V = expected()
    np.testing.assert_allclose(s.Q[0], Q, rtol=0, atol=1e-8)
    np.testing.assert_allclose(s.V[0], V, rtol=0, atol=1e-8)


@pytest.mark.parametrize(("tick", "left"), [(0, [1, 2]), (1, [0, 1]), (3, [0, 3]), (6, [1, 0])])
def test_ticks_left_until_law_and_lag_act(experiment_of, tick, left):
    """The law acts at 1, 3, 5, … and the lag at 2, 6, 10, …"""
    [loop] = experiment_of(TEXT).loops.values()
    assert loop.vehicle.ticks_left(tick).tolist() == left


def test_a_clock_counts_its_instants_and_measures_at_0_whatever_its_offset():
    clock = Clock(3, 1)
    assert clock.is_due(np.arange(6)).tolist() == [False, True, False, False, True, False]
    assert clock.numbers(8).tolist() == [0, 1, 1, 1, 2, 2, 2, 3]
    assert Clock(2).numbers(5).tolist() == [0, 0, 1, 1, 2]
    assert [each.acts_always for each in (Clock(), Clock(2), clock)] == [True, False, False]


def test_times_of_parts_are_ticks():
    law = Sampling(period=0.2, clock=Clock(4, 1))
    assert law.tick == pytest.approx(0.05)
    given = [(None, None), (0.15, None), (None, 0.1), (0.15, 0.05)]
    assert [law.clock_of(*each) for each in given] == [(4, 1), (3, 0), (4, 2), (3, 1)]
    assert [law.ticks_of(delay) for delay in (2, "150 ms")] == [8, 3]


def test_a_finer_tick_changes_nothing(solved):
    """The same measurements are drawn, and steps end at more instants: by the tolerance."""
    text = TEXT.replace("{period: 0.1, offset: 50 ms, delay: 150 ms}", "{period: 0.1}")
    text = text.replace("std: 0, period: 0.25, delay: 50 ms", "std: 0.1, delay: 1")
    text = text.replace("std: 0, period: 0.05", "std: 0.1").replace(
        ", period: 0.2, offset: 100 ms", ""
    )
    states = []
    for control in ("{period: 0.1}", "{period: 0.1, tick: 25 ms}"):
        problem, solution = solved(text.replace("{period: 0.1}", control))
        s = problem.loop.tracking(problem.times, solution.states)
        states.append(np.concatenate([s.Q[0].reshape(-1, 9), s.V[0]], axis=1))
    np.testing.assert_allclose(*states, rtol=0, atol=1e-8)


@pytest.mark.parametrize("at", ["{period: 0.1", "std: 0.1"])
def test_a_delay_has_a_limit(tmp_path, at):
    """What was commanded in 1e9 periods of 2 ticks would take 48 GB for each run."""
    text = TEXT.replace("{period: 0.1, offset: 50 ms, delay: 150 ms}", "{period: 0.1}")
    text = text.replace("std: 0, period: 0.25, delay: 50 ms", "std: 0.1")
    path = tmp_path / "c.yaml"
    path.write_text(text.replace(at, f"{at}, delay: 1000000000"), encoding="utf-8")
    with pytest.raises(ConfigError, match="delay: expected at most 1,000 ticks, got 2,000,000,000"):
        build(read_config(path))


def monodromy(J, pose, law, lag, delay, gains):
    """The map of one axis over all ticks of a cycle, in steps of plain matrices."""
    from scipy.linalg import expm

    (k, d), h = gains, TICK
    # Angle, rate, lag; then held: angle seen, command by command, and what the lag has taken.
    n = 3 + 1 + (delay + 1) + 1
    A = np.zeros((n, n))
    A[0, 1], A[1, 2], A[2, 2], A[2, -1] = 1.0, 1 / J, -1 / LAG, 1 / LAG
    flow, found = expm(h * A), np.eye(n)
    for tick in range(int(np.lcm.reduce([pose, law, lag]))):
        at = np.eye(n)
        if tick % pose == 0:
            at[3] = np.eye(n)[0]
        shift = np.eye(n)
        queue = range(4, 4 + delay + 1)
        for place in queue[:-1]:
            shift[place] = np.eye(n)[place + 1]
        if tick % law == 0:
            shift[queue[-1]] = -k * np.eye(n)[3] - d * np.eye(n)[1]
        take = np.eye(n)
        if tick % lag == 0:
            take[-1] = np.eye(n)[queue[0]]
        found = flow @ take @ shift @ at @ found
    return found


def multipliers(*cycles):
    """The sizes of all eigenvalues that are not 0, the largest first."""
    sizes = np.abs(np.concatenate([np.linalg.eigvals(each) for each in cycles]))
    return np.sort(sizes[sizes > 1e-4])[::-1]


def test_margins_are_those_of_a_monodromy_by_hand(experiment_of):
    """A body at rest on three axes, whose law, star tracker, gyro and lag have clocks."""
    text = TEXT.replace('["0.3*cos(t)", "0.2*sin(t)", "0.1"]', "[0, 0, 0]").replace(
        ", offset: 100 ms", ""
    )
    text = text.replace(
        "{period: 0.1, offset: 50 ms, delay: 150 ms}", "{period: 0.1, delay: 50 ms}"
    )
    text = text.replace("period: 0.25, delay: 50 ms", "period: 0.25")
    experiment = experiment_of(text)
    [loop] = experiment.loops.values()
    along = along_reference(experiment, experiment.reference_over_horizon())
    found = linearised(loop, *along, with_estimator=True)
    assert found.cycle == pytest.approx(1.0)  # 20 ticks
    hand = [monodromy(J, 5, 2, 4, 1, (2 * 1.5, 1.2)) for J in INERTIA]
    expected = multipliers(*hand)
    np.testing.assert_allclose(multipliers(*found.closed), expected, rtol=1e-6)
    # From the second instant of the law on, everything is later by a tick: the same multipliers.
    [late] = experiment_of(
        text.replace("delay: 50 ms}", "delay: 50 ms, offset: 50 ms}")
        .replace("period: 0.25}", "period: 0.25, offset: 50 ms}")
        .replace("period: 0.2}", "period: 0.2, offset: 50 ms}")
    ).loops.values()
    again = linearised(late, *along, with_estimator=True)
    np.testing.assert_allclose(multipliers(*again.closed), expected, rtol=1e-6)


@from_yaml
def test_times_of_clocks_are_checked(experiment_of, sections, message):
    control, entry = sections.splitlines()
    text = TEXT.replace("{period: 0.1, offset: 50 ms, delay: 150 ms}", control)
    text = text.replace("{kind: noise, std: 0, period: 0.25, delay: 50 ms}", entry)
    text = text.replace(", period: 0.2, offset: 100 ms", "").replace(", period: 0.05", "")
    assert mentions(refusal(ConfigError, experiment_of, text), message)
