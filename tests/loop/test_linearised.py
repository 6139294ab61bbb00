"""Loops to first order: where they rest, what has no derivative, and what changes in time."""

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import pytest

import eqt_cli
from eqt_cli.components.inertia import PrescribedInertia
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import (
    ConstantForce,
    Controller,
    EqT,
    ExpressionForce,
    Force,
    Lag,
    less,
    parse,
    where,
)
from eqt_cli.loop.linearised import flow, linearised

J, STIFFNESS, DAMPING = 0.4, 2.0, 0.8
"""Of the wheel: Υ = 2(1 − cos θ)."""

WHEEL = {
    "group": "SO2",
    "inertia": J,
    "gains": {"kp": 1.0, "kd": DAMPING},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "time": {"duration": 5.0},
}
BODY = {
    **WHEEL,
    "group": "SO3",
    "inertia": [2.0, 1.0, 3.0],
    "reference": {"kind": "constant", "pose": {"rotvec": [0.4, -0.2, 0.7]}},
}


def about_reference(config, times=(0.0,), of=linearised, **changes):
    """The loop of the first law, changed, about its reference at rest at these times."""
    experiment = eqt_cli.load_experiment(config).base
    loop = replace(next(iter(experiment.loops.values())), **changes)
    Qd, Vd = experiment.desired.pose, experiment.desired.velocity
    times = np.array(times)
    poses, velocities = (np.stack([each] * len(times)) for each in (Qd, Vd))
    return loop, of(loop, times, poses, velocities)


@dataclass(frozen=True)
class Dry(Force):
    """Dry friction, which jumps with the direction of the motion."""

    name: ClassVar[str] = "dry"
    size: float = 0.1

    def acting(self, G, t, Q, V):
        return where(less(V, 0.0), self.size, -self.size)


@dataclass(frozen=True)
class Thickening(Force):
    """Drag that grows with time."""

    name: ClassVar[str] = "thickening"
    rate: float = 1.0

    def acting(self, G, t, Q, V):
        return -self.rate * (np.asarray(t)[..., None] * V)


@dataclass(frozen=True)
class Jumping(EqT):
    """EqT with a torque that jumps with the direction of the error."""

    jump: float = 0.1

    def torque(self, s):
        return super().torque(s) + where(less(s.V_tilde, 0 * s.P), self.jump, -self.jump)


@dataclass(frozen=True)
class Step(EqT):
    """EqT with a torque that jumps at 0.6 rad, where a first step from 0 against 1.2 N m ends."""

    def torque(self, s):
        return super().torque(s) + where(less(np.sin(0.6), s.Q[..., 1, :1]), 1.0, 0.0)


@dataclass(frozen=True)
class Brake(Controller):
    """Twice the velocity, and nothing that would know of the inertia."""

    def torque(self, s):
        return -2.0 * s.V


def test_the_flow_of_a_wheel():
    expected = [[0.0, 1.0], [-STIFFNESS / J, -DAMPING / J]]
    _, found = about_reference(WHEEL)
    np.testing.assert_allclose(found.closed, [expected], rtol=1e-9, atol=1e-9)
    _, found = about_reference(WHEEL, of=flow)
    np.testing.assert_allclose(found, [expected], rtol=1e-9, atol=1e-9)
    # While its command is held, nothing restores or damps it; the command is a state, too.
    _, found = about_reference(WHEEL, of=flow, vehicle=Vehicle(control=Sampling(period=0.1)))
    np.testing.assert_allclose(found[0, :2], [[0, 1, 0], [0, 0, 1 / J]], rtol=1e-9, atol=1e-9)


@pytest.mark.needs("proofs")
def test_bandwidth_and_damping_of_small_errors():
    """Along each axis alone Jε̈ + kd ε̇ + 2 kp ε = 0; of a position ẍ + kv ẋ + kx x = 0."""
    from eqt_cli.extensions.proofs.meaning import by_axis

    loop, _ = about_reference(BODY)
    for axis, inertia in zip("xyz", BODY["inertia"], strict=True):
        expected = (STIFFNESS / inertia) ** 0.5, DAMPING / (2 * (STIFFNESS * inertia) ** 0.5)
        assert by_axis(loop)[0][f"ω{axis}"] == pytest.approx(expected, rel=1e-12)
    gains, position = WHEEL["gains"], {"kx": 16.0, "kv": 5.6}
    cascade = {"kind": "cascade", "attitude": "eqt", "gains": gains, "position": position}
    cascade["along"] = [0, 0, 1]
    loop, _ = about_reference(
        {
            **WHEEL,
            "group": "SE3",
            "inertia": [1.0, 1.0, 1.0, 2.0, 2.0, 2.0],
            "controllers": [cascade],
            "reference": {"kind": "flat", "position": ["0", "0", "0"]},
            "model": {"forces": [{"kind": "restoring", "weight": 19.62}]},
        }
    )
    found = by_axis(loop)[0]
    assert found["z"] == pytest.approx((4.0, 0.7), rel=1e-12)
    assert found["ωx"] == pytest.approx((2**0.5, 0.4 / 2**0.5), rel=1e-12)


@pytest.mark.parametrize("force", [[0.5, -0.9, 0.3], [-1.0, 0.4, 0.8]])
def test_a_body_rests_where_law_and_force_are_in_balance(force):
    vehicle = Vehicle(forces=(ConstantForce(force),))
    loop, found = about_reference(BODY, (0.0, 1.0, 3.0), vehicle=vehicle)
    assert found.is_constant and found.closed.shape == (1, 6, 6)
    G, Qd, still = loop.group, loop.group.exp(np.array([0.4, -0.2, 0.7])), np.zeros(3)
    assert np.linalg.norm(found.offset) > 0.1
    there = loop.initial_state(Qd @ G.exp(found.offset[0]), still, Qd, still)
    rates = loop.layout.split(loop.vector_field(0.0, there))
    np.testing.assert_allclose(rates["momentum"], 0.0, rtol=0, atol=1e-5)


@pytest.mark.parametrize("push", [1.2, -1.2])
def test_a_sampled_loop_rests_where_the_continuous_one_does(push):
    vehicle = Vehicle(
        forces=(ConstantForce([push]),),
        actuators=(Lag(time_constant=0.03),),
        control=Sampling(period=0.02, delay=1),
    )
    _, found = about_reference(WHEEL, vehicle=vehicle)
    assert found.is_constant
    assert found.offset[0] == pytest.approx([np.arcsin(push / STIFFNESS)], rel=1e-6)


@pytest.mark.parametrize("control", [None, Sampling(period=1e-4)])
def test_an_integral_takes_the_force_over(control):
    """Js³ + ds² + (k + kᵢ)s + kᵢc₂, on the reference itself, whatever the force."""
    ki, c2 = 0.3, 0.5
    law = {"kind": "goodarzi2013", "ki": ki, "c2": c2}
    vehicle = Vehicle(forces=(ConstantForce([1.2]),), control=control)
    _, found = about_reference({**WHEEL, "controllers": [law]}, vehicle=vehicle)
    assert found.is_constant
    assert found.offset[0] == pytest.approx([0.0], abs=1e-6)
    roots = np.roots([J, DAMPING, STIFFNESS + ki, ki * c2])
    rates = np.linalg.eigvals(found.closed[0]).astype(complex)
    if control is not None:
        rates = np.log(rates[np.abs(rates) > 0.5]) / control.period
    assert rates.real.max() == pytest.approx(roots.real.max(), rel=1e-3 if control else 1e-6)


@pytest.mark.parametrize("jump", [0.1, -0.1])
def test_what_jumps_has_no_derivative(jump):
    _, found = about_reference(WHEEL, controller=Jumping(jump=jump))
    assert np.isnan(found.closed).all() and not found.is_constant
    _, found = about_reference(WHEEL, vehicle=Vehicle(forces=(Dry(jump),)))
    assert np.isnan(found.closed).all()
    control = Sampling(period=0.1)
    _, found = about_reference(WHEEL, vehicle=Vehicle(forces=(Dry(jump),), control=control))
    assert np.isnan(found.closed).all()


def test_a_loop_that_jumps_on_the_way_to_its_rest_is_linearised_about_its_reference():
    vehicle = Vehicle(forces=(ConstantForce([1.2]),))
    _, found = about_reference(WHEEL, controller=Step(), vehicle=vehicle)
    assert not found.is_constant
    np.testing.assert_array_equal(found.offset, [[0.0]])
    np.testing.assert_allclose(found.closed[0, 1], [-STIFFNESS / J, -DAMPING / J], rtol=1e-9)


@pytest.mark.parametrize("rate", [0.3, -0.3])
def test_a_loop_that_changes_in_time_is_linearised_at_each_time(rate):
    times = (0.0, 0.5, 2.0)
    vehicle = Vehicle(forces=(Thickening(rate),))
    _, found = about_reference(WHEEL, times, vehicle=vehicle)
    assert not found.is_constant
    drags = [-(DAMPING + rate * t) / J for t in times]
    np.testing.assert_allclose(found.closed[:, 1, 1], drags, rtol=1e-9)
    np.testing.assert_allclose(found.closed[:, 1, 0], -STIFFNESS / J, rtol=1e-9)


@pytest.mark.parametrize("force", ["t", "-t"])
def test_a_loop_that_a_force_moves_over_time_rests_nowhere(force):
    vehicle = Vehicle(forces=(ExpressionForce([force]),))
    _, found = about_reference(WHEEL, (0.0, 0.5, 2.0), vehicle=vehicle)
    assert not found.is_constant
    assert (found.closed.shape, found.offset.any()) == ((3, 2, 2), False)


def test_the_rate_of_the_inertia_is_part_of_the_loop():
    """(JV)˙ = −2V with J = 2 + t is V̇ = −(2 + J̇)V/J; where mass joins with V, JV̇ = −2V."""
    for leaves, expected in ((False, [-1.0, -0.5]), (True, [-2 / 3, -1 / 3])):
        inertia = PrescribedInertia(((parse("2 + t"),),), leaves)
        _, found = about_reference(WHEEL, (1.0, 4.0), inertia=inertia, controller=Brake())
        np.testing.assert_allclose(found.closed[:, 1, 1], expected, rtol=1e-9)


def test_gains_are_multiplied_one_by_one():
    for control in (None, Sampling(period=0.1)):
        _, loop = about_reference(WHEEL, vehicle=Vehicle(control=control))
        changed = loop.multiplied({"gains.K": 3.0, "gains.K_d": 0.5})
        gains = {"kp": 3.0, "kd": 0.5 * DAMPING}
        _, expected = about_reference({**WHEEL, "gains": gains}, vehicle=Vehicle(control=control))
        np.testing.assert_allclose(changed.closed, expected.closed, rtol=0, atol=1e-8)
        np.testing.assert_array_equal(loop.multiplied({}).closed, loop.closed)
        assert (changed.period, changed.is_constant) == (loop.period, True)
