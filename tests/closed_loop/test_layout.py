"""The layout of a flat state, and the memory of a law as a stretch of it."""

from dataclasses import dataclass, replace

import numpy as np
import pytest

from eqt_cli.closed_loop import ClosedLoop, StateLayout
from eqt_cli.closed_loop.law_program import law_program
from eqt_cli.controllers.eqt import EqT
from eqt_cli.controllers.goodarzi2013 import Goodarzi2013
from eqt_cli.engines import Problem, engines
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import Inertia
from eqt_cli.mechanics.tracking import Gains
from eqt_cli.program.decimals import evaluated
from eqt_cli.references.torque import TorqueReference
from eqt_cli.vehicle import Vehicle
from eqt_cli.vehicle.forces.constant import ConstantForce
from eqt_cli.vehicle.sampling import Sampling

RTOL = 1e-9


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


def test_a_force_that_the_law_does_not_know_puts_its_power_into_L():
    push = np.array([0.1, -0.2, 0.3])
    vehicle = Vehicle(forces=(ConstantForce(push.tolist()),))
    loop = replace(loop_with(EqT()), vehicle=vehicle)
    s = loop.tracking(0.3, start(loop))
    found = loop.outflow(s, loop.controller.torque(s) + push)
    np.testing.assert_allclose(found, loop.dissipation(s) - s.V_tilde @ push, rtol=0, atol=1e-14)


def test_join_undoes_split():
    layout = StateLayout({"a": 2, "b": 0, "c": 3})
    state = np.arange(10.0).reshape(2, 5)
    assert layout.length == 5
    assert layout.slices["c"] == slice(2, 5)
    np.testing.assert_array_equal(layout.join(layout.split(state), state), state)


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
    solution = engines.get(engine)(rtol=RTOL).solve(Problem(loop, start(loop), times))
    s = loop.tracking(times, solution.states)
    np.testing.assert_allclose(s.memory["clock"][..., 0], 2.0 + times + np.zeros((4, 1)), atol=RTOL)
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
