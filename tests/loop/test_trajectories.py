"""States of a closed loop: what holds along every trajectory, and what they are made of.

Tolerances are multiples of the solver's rtol. A step commits an error of about rtol, the steps of
these horizons number some dozens, and the damping forgets most of it: measured over all groups and
controllers at rtol 1e-6, 1e-8 and 1e-10, the energy balance is kept to between 0.2 and 3 rtol·L(0).
"""

import dataclasses
from dataclasses import dataclass, replace

import numpy as np
import pytest
from small_loops import closed_loop

from eqt_cli.components.groups import command_axes
from eqt_cli.components.laws import Controller, Designed, EqT, Family, controllers
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.engines.engine import Problem, engines
from eqt_cli.extend import (
    ConstantForce,
    ConstantReference,
    Gains,
    Goodarzi2013,
    Inertia,
    Lag,
    Limit,
    SolveIvp,
    TorqueReference,
    dot,
    group_named,
)
from eqt_cli.loop.closed_loop import ClosedLoop, StateLayout
from eqt_cli.loop.law_program import law_program
from eqt_cli.loop.signals import FORMULAS, at_state, compute
from eqt_cli.numbers.rounded import evaluated

RTOL = 1e-6
TOLERANCE = 20 * RTOL
TIMES = np.linspace(0.0, 3.0, 31)
RUNS = 3


@dataclass(frozen=True)
class Free(Controller):
    """No force at all."""

    def torque(self, s):
        return 0 * s.P


@dataclass(frozen=True)
class Feedforward(Controller):
    """The desired torque and nothing else."""

    def torque(self, s):
        return s.tau_d


def initial_states(loop):
    G, random = loop.group, np.random.default_rng(4)
    Q, Qd = (G.exp(random.standard_normal((RUNS, G.dimension))) for _ in range(2))
    V, Vd = random.standard_normal((2, RUNS, G.dimension))
    at_rest = "track" not in loop.controller.tasks
    return loop.initial_state(Q, V, Qd, 0 * Vd if at_rest else Vd)


def trajectories(loop, times=TIMES, states=None, rtol=RTOL):
    """States ``(runs, samples, n)``."""
    engine = SolveIvp(rtol=rtol, atol=rtol * 1e-3, block=RUNS)
    start = initial_states(loop) if states is None else states
    solution = engine.solve(Problem(loop, start, times))
    assert not solution.status.any()
    return solution.states


def assert_constant(quantity):
    """A quantity ``(runs, samples, …)`` keeps its initial value."""
    change = np.abs(quantity - quantity[:, :1])
    assert change.max() < TOLERANCE * np.abs(quantity).max()


# Theorems 3.2 and 6.2 along trajectories ----------------------------------------------------------


@pytest.fixture(
    scope="module", params=["eqt SE3*SO2", "stabilising SE23", "goodarzi2013 SO3", "lee2010 SE3"]
)
def controlled(request):
    """A loop of laws of each kind, and L and W along its trajectories.

    The rate of L of every law is tested in contracts/test_controllers.py.
    """
    name, group = request.param.split()
    loop = closed_loop(group_named(group), controllers.get(name)())
    states = trajectories(loop)
    return loop, loop.lyapunov(loop.tracking(TIMES, states)), loop.work(states)


def test_energy_balance(controlled):
    """L(t) + W(t) = L(0), W the work that the law's dissipation has taken out."""
    _, L, W = controlled
    assert_constant(L + W)


def test_lyapunov_function_decreases(controlled):
    loop, L, _ = controlled
    if not loop.claims_decrease:
        pytest.skip(f"{loop.controller.name} does not claim it")
    assert (np.diff(L, axis=1) < TOLERANCE * L[:, :1]).all()
    assert (L[:, -1] < L[:, 0]).all()


def test_energy_balance_off_the_plane():
    """Also where c + n ≠ 1, and L may well grow."""
    G = group_named("SE3*SO2")
    loop = closed_loop(G, Family(gyroscopic=0.3, transport=-0.5, connection=0.2, damping="body"))
    states = trajectories(loop)
    assert_constant(loop.tracking(TIMES, states).lyapunov + loop.work(states))


@pytest.mark.parametrize(
    "name",
    [
        pytest.param(
            name, marks=[pytest.mark.ci("a minute of flight")] * (name not in ("eqt", "nog"))
        )
        for name in controllers.names()
        # Else it is code, and no formula, or is designed from a loop, or has no feedforward.
        if controllers.get(name).tasks and not issubclass(controllers.get(name), Designed)
        if name != "pd"
    ],
)
def test_trajectories_reach_the_desired_one(name):
    loop = closed_loop(group_named("SO3"), controllers.get(name)())
    times = np.array([0.0, 60.0])  # the slowest of them, nog, then has L = 1.4e-4 L(0)
    L = loop.lyapunov(loop.tracking(times, trajectories(loop, times, rtol=1e-4)))
    assert (L[:, 1] < 1e-3 * L[:, 0]).all()


# Symmetry: the free system ------------------------------------------------------------------------


@pytest.fixture(scope="module")
def free(G):
    """The quantities along a motion without any force."""
    loop = closed_loop(G, Free())
    return loop.tracking(TIMES, trajectories(loop))


def test_free_motion_conserves_energy(free):
    assert_constant(dot(free.P, free.V) / 2)


def test_free_motion_conserves_spatial_momentum(free):
    """Ad*_{Q⁻¹} P is constant: P stays on its coadjoint orbit."""
    assert_constant(free.G.Ad_star(free.G.inverse(free.Q), free.P))


def test_free_rigid_body_conserves_the_casimir():
    """‖π‖ on SO(3)."""
    loop = closed_loop(group_named("SO3"), Free())
    s = loop.tracking(TIMES, trajectories(loop))
    assert_constant(np.linalg.norm(s.P, axis=-1))


# References ---------------------------------------------------------------------------------------


def test_constant_reference_keeps_its_velocity(G):
    """V_d(t) = V_d(0) and Q_d(t) = Q_d(0) exp(t V_d), which takes no state."""
    V = np.linspace(0.2, 0.5, G.dimension)
    loop = closed_loop(G, controllers.get("eqt")(), ConstantReference(velocity=V.tolist()))
    assert "desired_pose" not in loop.layout.lengths
    s = loop.tracking(TIMES, trajectories(loop))
    assert_constant(s.Vd)
    assert (s.Qd.shape, s.Pd.shape, s.Vd.shape) == (s.Q.shape, s.P.shape, s.V.shape)
    expected = np.broadcast_to(G.exp(TIMES[:, None] * V), s.Qd.shape)
    np.testing.assert_allclose(s.Qd, expected, rtol=0, atol=TOLERANCE * np.abs(expected).max())


def test_reference_moves_as_a_system_driven_by_its_torque(G):
    """A system that starts on the reference and is given τ = τ_d stays on it."""
    loop = closed_loop(G, Feedforward())
    s = loop.tracking(0.0, initial_states(loop))
    s = loop.tracking(TIMES, trajectories(loop, states=loop.initial_state(s.Qd, s.Vd, s.Qd, s.Vd)))
    # Both halves of a state take the same steps: they differ by rounding at most.
    np.testing.assert_allclose(s.Q, s.Qd, rtol=0, atol=1e-12)
    np.testing.assert_allclose(s.P, s.Pd, rtol=0, atol=1e-12)


def test_torque_reference_takes_one_time_or_many(G, free):
    loop = closed_loop(G, Free())
    expected = np.stack([np.cos(TIMES), np.sin(TIMES), np.cos(TIMES) * np.sin(TIMES)] * 9, axis=-1)
    np.testing.assert_allclose(free.tau_d, expected[:, : G.dimension], rtol=1e-15, atol=1e-15)
    one = loop.tracking(TIMES[7], initial_states(loop)).tau_d
    np.testing.assert_allclose(one, expected[7, : G.dimension], rtol=1e-15, atol=1e-15)


# The vector field ---------------------------------------------------------------------------------


def test_flat_state_holds_what_it_was_made_of(G):
    random = np.random.default_rng(5)
    Q, Qd = (G.exp(random.standard_normal((RUNS, G.dimension))) for _ in range(2))
    V, Vd = random.standard_normal((2, RUNS, G.dimension))
    loop = closed_loop(G, Free())
    state = loop.initial_state(Q, V, Qd, Vd)
    assert state.shape == (RUNS, loop.state_length)
    s = loop.tracking(0.0, state)
    for held, given in ((s.Q, Q), (s.V, V), (s.Qd, Qd), (s.Vd, Vd), (loop.work(state), 0.0)):
        np.testing.assert_allclose(held, given, rtol=0, atol=1e-14)


# Signals ------------------------------------------------------------------------------------------


def test_signals_are_the_norms_they_are_named_after(G):
    loop = closed_loop(G, controllers.get("gt")())
    states = trajectories(loop)
    found, s = compute(loop, TIMES, states), loop.tracking(TIMES, states)
    # Estimates are not, nor errors of what the group does not have.
    here = [signal for signal in FORMULAS.values() if not signal.only_there and signal.exists_on(G)]
    norms = [s.name for s in here if s.norm in ("axes", "entries") and len(G.parts) > 1]
    parts = {f"{norm}_{part.name}" for norm in norms for part in G.parts}
    parts |= {f"cut_{name}".replace(" ", "_") for name in command_axes(G)}
    of_actuators = {"thrust", "wheel_momentum", "wheel_speed", "gimbal_angle", "gimbal_rate"}
    names = {signal.name for signal in here} - of_actuators
    names -= {"law_output"}  # of a law with memory
    assert set(found) == names | parts | {"energy_balance"}
    assert {values.shape[:2] for values in found.values()} == {(RUNS, len(TIMES))}
    tau = loop.controller.torque(s)
    error = np.eye(G.size) - s.Q @ np.linalg.inv(s.Qd)
    expected = {
        "pose": s.Q,
        "velocity": s.V,
        "torque": tau,
        "pose_error": np.linalg.norm(error, axis=(-2, -1)),
        "velocity_error": np.linalg.norm(s.V - s.Vd, axis=-1),
        "torque_norm": np.linalg.norm(tau, axis=-1),
        "lyapunov": s.lyapunov,
    }
    # The closed-form inverse sees a drift of rtol off the group differently than `inv` does.
    for name, values in expected.items():
        np.testing.assert_allclose(found[name], values, rtol=0, atol=TOLERANCE * 10, err_msg=name)


def test_parts_of_a_norm_make_up_the_whole():
    G = group_named("SE23")
    loop = closed_loop(G, controllers.get("eqt")())
    found = compute(loop, TIMES, trajectories(loop))
    for norm in ("pose_error", "velocity_error", "torque_norm"):
        parts = [found[f"{norm}_{part}"] for part in ("rotation", "velocity", "position")]
        np.testing.assert_allclose(np.sqrt(sum(part**2 for part in parts)), found[norm], rtol=1e-12)


def test_the_energy_balance_is_L_and_the_work_taken_out_of_it():
    loop = closed_loop(group_named("SO3"), controllers.get("eqt")())
    states = np.random.default_rng(2).standard_normal((2, 5, loop.layout.length))
    found = compute(loop, TIMES[:5], states)
    assert np.array_equal(found["energy_balance"], found["lyapunov"] + loop.work(states))
    assert np.abs(loop.work(states)).min() > 1e-3


def test_a_law_that_says_nothing_of_its_dissipation_has_no_energy_balance():
    loop = closed_loop(group_named("SO3"), Feedforward())
    states = np.random.default_rng(2).standard_normal((2, 5, loop.layout.length))
    assert np.isnan(compute(loop, TIMES[:5], states)["energy_balance"]).all()


def test_memory_goes_on_by_its_rate_at_an_instant_and_what_L_loses_is_work():
    loop = dataclasses.replace(
        closed_loop(group_named("SO3"), controllers.get("goodarzi2013")()),
        vehicle=Vehicle(control=Sampling(period=0.2)),
    )
    states = [np.random.default_rng(5).standard_normal(loop.layout.length)]
    states.append(loop.after_instant(0.0, states[0]))
    before, after = (loop.tracking(0.0, state) for state in states)
    rate = loop.controller.memory_rate(before)["integral"]
    change = after.memory["integral"] - before.memory["integral"]
    assert change == pytest.approx(0.2 * rate, rel=1e-12)
    lost = loop.lyapunov(before) - loop.lyapunov(after)
    assert abs(lost) > 1e-3
    assert loop.work(states[1]) - loop.work(states[0]) == pytest.approx(lost)


@pytest.mark.parametrize("control", [None, Sampling(period=0.2)])
@pytest.mark.parametrize("law", ["eqt", "goodarzi2013"])
def test_work_is_what_L_loses_under_a_force_that_the_law_does_not_know(law, control):
    """Along the vector field, by a difference; a memory stands still between instants."""
    loop = dataclasses.replace(
        closed_loop(group_named("SE3"), controllers.get(law)(), ConstantReference()),
        vehicle=Vehicle(control=control, forces=(ConstantForce([0.3, -0.2, 0.5, 0.1, 0.7, -0.4]),)),
    )
    state = initial_states(loop)
    if control is not None:
        state = loop.after_instant(0.0, state)
    if loop.controller.memory(loop.group):
        state[..., loop.layout.slices["controller.integral"]] = [0.2, -0.1, 0.4, 0.3, -0.6, 0.5]
    rates, h = loop.vector_field(0.0, state), 1e-5
    L = [loop.lyapunov(loop.tracking(0.0, state + k * h * rates)) for k in (1, -1)]
    assert (L[1] - L[0]) / (2 * h) == pytest.approx(loop.work(rates), rel=1e-6)
    memory = loop.memory(rates)
    assert all(values.any() == (control is None) for values in memory.values())


@pytest.mark.parametrize("control", [None, Sampling(period=0.2)])
def test_without_a_gradient_of_its_memory_a_law_knows_its_dissipation_only_while_it_moves(control):
    class Forgetful(controllers.get("goodarzi2013")):
        def memory_gradient(self, s):
            return None

    loop = closed_loop(group_named("SO3"), Forgetful())
    loop = dataclasses.replace(loop, vehicle=Vehicle(control=control))
    s = loop.tracking(0.0, initial_states(loop))
    assert (loop.dissipation(s) is None) == (control is not None)


def test_a_decrease_is_claimed_of_ideal_vehicles_only():
    loop = closed_loop(group_named("SO3"), controllers.get("eqt")())
    assert loop.claims_decrease is True
    pushed = Vehicle(forces=(ConstantForce([0.1, 0.0, 0.0]),))
    assert dataclasses.replace(loop, vehicle=pushed).claims_decrease is None


@pytest.mark.parametrize("batched", range(4))
def test_any_of_the_initial_values_may_be_one_for_all_runs(batched):
    """A flat state has the runs of whichever has them."""
    loop = closed_loop(group_named("SE2"), controllers.get("goodarzi2013")())
    G, random = loop.group, np.random.default_rng(7)
    given = [G.exp(np.ones(3)), np.arange(3.0), G.exp(-np.ones(3)), -np.arange(3.0)]
    values = random.standard_normal((5, 3))
    given[batched] = values if batched % 2 else G.exp(values)
    states = loop.initial_state(*given)
    assert states.shape == (5, loop.state_length)
    for run, state in enumerate(states):
        alone = [each[run] if k == batched else each for k, each in enumerate(given)]
        np.testing.assert_allclose(state, loop.initial_state(*alone), rtol=0, atol=1e-14)


@pytest.mark.parametrize("group", ["R1", "SE2"])
def test_signals_of_an_estimate_are_not_a_number_where_there_is_none(group):
    """In the shapes that they have elsewhere, if they are asked for; else they are left out."""
    loop = closed_loop(group_named(group), controllers.get("eqt")())
    m, d = loop.group.dimension, loop.group.size
    states = initial_states(loop)[:, None]
    s, work = loop.tracking(0.0, states), loop.work(states)
    usual = dict(at_state(loop, s, work))
    only = {signal.name: signal for signal in FORMULAS.values() if signal.only_there}
    assert not set(usual) & set(only)
    shapes = {("row", "col"): (d, d), ("axis",): (m,), (): ()}
    found = dict(at_state(loop, s, work, set(only)))
    assert set(found) == set(usual) | set(only)
    for name, signal in only.items():
        assert found[name].shape == (RUNS, 1, *shapes[signal.dims])
        assert np.isnan(found[name]).all()
    some = dict(at_state(loop, s, work, {"nees", "bias_error"}))
    assert set(some) == set(usual) | {"nees", "bias_error"}


def test_what_is_stored_of_a_vehicle():
    lag, limit = Lag(time_constant=0.1), Limit(limit=1.0)
    vehicles = {
        "ideal": Vehicle(),
        "sampled": Vehicle(control=Sampling(period=0.1)),
        "late": Vehicle(actuators=(lag,)),
        "limited": Vehicle(actuators=(limit,)),
    }
    always = {signal.name for signal in FORMULAS.values() if signal.stored_of(vehicles["ideal"])}
    more = {
        name: {signal.name for signal in FORMULAS.values() if signal.stored_of(vehicle)} - always
        for name, vehicle in vehicles.items()
    }
    kept = "pose velocity torque pose_error velocity_error torque_norm lyapunov position_error"
    more_of_some = {"attitude_angle", "heading_error", "attitude_command_error", "law_output"}
    more_of_some |= {"pointing_error"}
    assert always == {*kept.split(), *more_of_some}
    assert more == {
        "ideal": set(),
        "sampled": {"command"},
        "late": {"command"},
        "limited": {"command", "at_limit"},
    }


# The layout of a state, and the memory of a law as a stretch of it --------------------------------


TIGHT = 1e-9


@dataclass(frozen=True)
class Remembering(EqT):
    """EqT, which notes the integral of the velocity error and a clock that starts at 2."""

    def memory(self, G):
        return {"integral": G.dimension, "clock": 1}

    def initial_memory(self, s):
        return {"clock": 2.0 + 0 * s.V[..., :1]}

    def memory_rate(self, s):
        return {"integral": s.V_tilde, "clock": 1.0}


def loop_with(controller):
    G, eye = group_named("SO3"), np.eye(3)
    inertia = Inertia(np.diag([1.0, 2.0, 3.0]), np.diag([1.0, 1 / 2, 1 / 3]))
    reference = TorqueReference(["cos(t)", "sin(t)", 0.1])
    return ClosedLoop(G, inertia, Gains(eye, eye), reference, controller)


def start(loop):
    random, G = np.random.default_rng(0), loop.group
    Q, Qd = G.exp(random.standard_normal((2, 4, 3)))
    V, Vd = random.standard_normal((2, 4, 3))
    return loop.initial_state(Q, V, Qd, Vd)


class Silent(EqT):
    """EqT, which does not say what it dissipates, since it has a torque of its own."""

    def torque(self, s):
        return super().torque(s)


def test_nothing_is_taken_out_of_L_where_the_dissipation_is_not_known():
    loop = loop_with(Silent())
    rates = loop.vector_field(0.0, start(loop))
    assert not loop.work(rates).any()
    assert loop.work(loop_with(EqT()).vector_field(0.0, start(loop))).all()


def test_join_leaves_out_what_the_layout_does_not_have():
    found = StateLayout({"a": 1}).join({"a": 3.0, "b": 4.0}, np.empty((2, 1)))
    np.testing.assert_array_equal(found, [[3.0], [3.0]])


def test_stretches_of_a_closed_loop_are_in_order():
    layout = loop_with(EqT()).layout
    assert layout.lengths == {
        "pose": 9,
        "momentum": 3,
        "desired_pose": 9,
        "desired_momentum": 3,
        "work": 1,
    }


def test_memory_follows_the_stretches_of_the_closed_loop():
    plain, remembering = loop_with(EqT()), loop_with(Remembering())
    assert list(remembering.layout.lengths)[5:] == ["controller.integral", "controller.clock"]
    np.testing.assert_array_equal(start(remembering)[:, :25], start(plain))
    np.testing.assert_array_equal(start(remembering)[:, 25:], [[0, 0, 0, 2]] * 4)


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_memory_is_integrated(engine):
    loop, times = loop_with(Remembering()), np.linspace(0.0, 2.0, 201)
    solution = engines.get(engine)(rtol=TIGHT).solve(Problem(loop, start(loop), times))
    s = loop.tracking(times, solution.states)
    clocks = np.tile(2.0 + times, (4, 1))
    np.testing.assert_allclose(s.memory["clock"][..., 0], clocks, atol=TIGHT)
    h = times[1]  # Simpson's rule errs by h⁴ times a fourth derivative of at most some thousands
    simpson = h / 3 * (s.V_tilde[:, :-2:2] + 4 * s.V_tilde[:, 1:-1:2] + s.V_tilde[:, 2::2])
    expected = simpson.sum(axis=1)
    np.testing.assert_allclose(s.memory["integral"][:, -1], expected, rtol=0, atol=1e-6)


@dataclass(frozen=True)
class Counting(Remembering):
    """A clock that begins one later than that of before, which there is none of."""

    def initial_memory(self, s):
        return {"clock": s.memory["clock"] + 1.0}


def test_a_memory_begins_as_if_it_had_been_0():
    loop = loop_with(Counting())
    np.testing.assert_array_equal(start(loop)[:, -1], 1.0)
    program = law_program(loop).start
    for before in (0.0, 3.0):
        given = {group: np.full(size, before) for group, size in program.inputs}
        found = evaluated(program, given)
        assert [float(each) for each in found["memory_clock"]] == [1.0]
        assert [float(each) for each in found["memory_integral"]] == [0.0] * 3


@pytest.mark.parametrize(("control", "period"), [(None, 0.0), (Sampling(period=0.25), 0.25)])
def test_the_numbers_of_a_law_end_with_the_period(control, period):
    loop = replace(loop_with(Goodarzi2013(ki=0.3, c2=0.5)), vehicle=Vehicle(control=control))
    program = law_program(loop)
    values = program.values(loop)
    assert list(values) == [entry.name for entry in program.numbers]
    assert list(values)[-1] == "period"
    assert (values["period"], values["ki"], values["c2"]) == (period, 0.3, 0.5)
    assert (values["kp"].shape, values["inertia"].shape) == ((3, 3), (3, 3))
