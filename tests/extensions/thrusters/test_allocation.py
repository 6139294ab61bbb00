"""What an allocation meets and what it knows: against linear programmes, and against formulas."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.optimize import linprog

from eqt_cli.components.vehicle_parts import Uniform
from eqt_cli.extend import group_named
from eqt_cli.extensions.thrusters.parts import Failure, Jets, Priority, Thruster
from eqt_cli.extensions.thrusters.propellers import Propellers
from eqt_cli.extensions.thrusters.thrusters import Thrusters

SE3, SO3 = group_named("SE3"), group_named("SO3")
WEIGHT, HIGH = 14.71, 9.0


def rotors(count, cant=0.0, tilt=0.0, layers=1):
    """Rotors around the centre, canted along the circle and tilted outwards, above each other."""
    found = []
    for k in range(count):
        angle = np.pi / 4 + 2 * np.pi * k / count
        out = np.array([np.cos(angle), np.sin(angle)])
        along_circle = np.array([-out[1], out[0]])
        for layer in range(layers):
            spin = (-1.0) ** (k + layer)
            beside = np.tan(cant) * spin * along_circle + np.tan(tilt) * out
            at = [*(0.25 * out).tolist(), 0.02 * layer]
            found.append(Thruster(at, [*beside.tolist(), 1.0], 0.02 * spin))
    return found


def leaning():
    """Four rotors that lean forward, one of them more."""
    return [
        replace(rotor, along=[np.sin(angle), 0.0, np.cos(angle)])
        for rotor, angle in zip(rotors(4), (0.2, 0.2, 0.2, 0.35), strict=True)
    ]


VEHICLES = {
    "flat": rotors(4),
    "canted 2 deg": rotors(4, cant=np.radians(2)),
    "canted 10 deg": rotors(4, cant=np.radians(10)),
    "tilted 15 deg": rotors(4, tilt=np.radians(15)),
    "leaning": leaning(),
    "coaxial": rotors(4, layers=2),
    "coaxial, canted": rotors(4, cant=np.radians(8), layers=2),
    "hexarotor, canted": rotors(6, cant=np.radians(20)),
}
ORDER = Priority("priority", [["torque x", "torque y"], "force", "torque z"])


def wrenches(vehicle):
    columns = []
    for rotor in vehicle:
        axis = np.array(rotor.along) / np.linalg.norm(rotor.along)
        columns.append([*(np.cross(rotor.at, axis) + rotor.turns * axis), *axis])
    return np.array(columns).T


@pytest.mark.parametrize("allocation", ["pseudo_inverse", "bounded", ORDER], ids=str)
@pytest.mark.parametrize("name", VEHICLES)
def test_a_push_along_an_axis_and_torques_are_met_wherever_some_thrusts_do(name, allocation):
    """As a linear programme says, which has the same four rows and the limits alone."""
    vehicle, random = VEHICLES[name], np.random.default_rng(3)
    B, k = wrenches(vehicle), len(vehicle)
    push = B[3:].sum(axis=1)
    W = np.zeros((4, 6))
    W[:3, :3], W[3, 3:] = np.eye(3), push / np.linalg.norm(push)
    part = Thrusters(thrusters=vehicle, low=0.0, high=HIGH, allocation=allocation)
    flown, tried = part.for_law(SE3, W, False).of_run(SE3, None), 0
    for _ in range(12):
        command = random.normal(size=4) * [0.6, 0.6, 0.2, 3.0] + [0, 0, 0, WEIGHT]
        limits = [(0.0, HIGH)] * k
        if linprog(np.zeros(k), A_eq=W @ B, b_eq=command, bounds=limits).status:
            continue
        thrusts = flown._unlimited(W.T @ command)
        if flown.sampled:
            thrusts = flown.solution(SE3, (W.T @ command)[None])[0]
        elif k > 4 and (thrusts.min() < 0.0 or thrusts.max() > HIGH):
            continue
        tried += 1
        np.testing.assert_allclose(W @ B @ thrusts, command, rtol=0, atol=1e-12 * WEIGHT)
        assert -1e-12 <= thrusts.min() and thrusts.max() <= HIGH * (1 + 1e-12)
    assert tried >= 3


def test_what_arrives_of_a_torque_is_said_where_another_direction_competes():
    """With B of rank 4 of 6, diag(B B⁺); of four directions all arrives."""
    part = Thrusters(thrusters=VEHICLES["canted 10 deg"], low=0.0, high=HIGH)
    B = wrenches(VEHICLES["canted 10 deg"])
    shares = np.diagonal(B @ np.linalg.pinv(B))
    [said] = [text for text in part.remarks(SE3, np.eye(6)) if "alone" in text]
    for name, share in zip(SE3.axis_names, shares, strict=True):
        assert (f"{name} {100 * share:.2g} %" in said) == (1e-5 < share < 0.995)
    cascade = np.eye(6)[[0, 1, 2, 5]]
    assert not any("alone" in text for text in part.remarks(SE3, cascade))


def test_the_word_force_is_the_push_of_the_law():
    """Forces along y and z are no two directions for a law that pushes along one axis."""
    order = Priority("priority", ["torque", "force"])
    part = Thrusters(thrusters=leaning(), low=0.0, high=HIGH, allocation=order)
    W = np.zeros((4, 6))
    W[:3, :3], W[3, 3:] = np.eye(3), [0.6, 0.0, 0.8]
    flown = part.for_law(SE3, W, False)
    assert flown.asked_rows(SE3, flown.columns(SE3))[1][3] == "force"


# What is drawn for the plant is not known to its allocation ---------------------------------------

K, KM, FAST = 5.57e-6, 1.36e-7, 900.0
DRAWN = Thrusters(
    thrusters=[replace(each, turns=np.sign(each.turns)) for each in rotors(4)],
    thrust_constant=[Uniform([0.7 * K, 1.3 * K])] * 4,
    moment_constant=Uniform([0.5 * KM, 1.5 * KM]),
    low_speed=0.0,
    high_speed=Uniform([0.8 * FAST, 1.2 * FAST]),
)


def numbers(part):
    return (np.asarray(x) for x in (part.thrust_constant, part.moment_constant, part.high_speed))


@pytest.mark.parametrize("lag", [None, 0.03])
@pytest.mark.parametrize("told", [False, True])
def test_rotors_turn_as_their_mean_constants_ask_and_push_by_their_own(told, lag):
    part = replace(DRAWN, told=told, time_constant=lag)
    drawn = part.drawn(np.random.default_rng(1))
    flown = part.of_run(SE3, np.random.default_rng(1))
    k, km, top = numbers(drawn)

    def columns(k, km):
        return wrenches(
            [
                replace(each, turns=s * km / k_)
                for each, s, k_ in zip(
                    rotors(4),
                    np.sign([each.turns for each in rotors(4)]),
                    k * np.ones(4),
                    strict=True,
                )
            ]
        )

    command = np.array([0.3, -0.2, 0.02, 0.0, 0.0, 12.0])
    known = (k, km) if told else (np.full(4, K), KM)
    asked = np.linalg.pinv(columns(*known)) @ command
    speeds = np.minimum(np.sqrt(asked / known[0]), top)
    x = flown.running(SE3, command) if lag else np.empty(0)
    np.testing.assert_allclose(flown.thrust(SE3, command, x), k * speeds**2, rtol=1e-13)
    np.testing.assert_allclose(
        flown.output(SE3, command, x), columns(k, km) @ (k * speeds**2), rtol=1e-12, atol=1e-12
    )
    assert flown.at_limit(SE3, command, x) == (np.sqrt(asked / known[0]) > top).any()


@pytest.mark.parametrize("name", ["low", "high", "time_constant"])
def test_a_solved_allocation_keeps_the_mean_limits_and_the_plant_its_own(name):
    """Of limits that are drawn, it knows neither; a lag changes no allocation at all."""
    options = {"low": -1.0, "high": 1.0, "time_constant": 0.1}
    options[name] = Uniform(sorted([0.5 * options[name], 1.5 * options[name]]))
    part = Thrusters(matrix=np.eye(3).tolist(), allocation="bounded", **options)
    for seed in range(3):
        drawn = part.drawn(np.random.default_rng(seed))
        flown = part.of_run(SO3, np.random.default_rng(seed))
        for command, mean, own in ((9.0, 1.0, drawn.high), (-9.0, -1.0, drawn.low)):
            found = flown.solution(SO3, np.full((1, 3), command))
            np.testing.assert_array_equal(found, np.full((1, 3), mean))
            after = flown.step(SO3, found[0], np.zeros(6), 0.1)[:3]
            np.testing.assert_array_equal(after, np.sign(own) * np.minimum(abs(own), 1.0))


def test_jets_are_on_for_the_share_of_the_mean_thrust():
    jets = Jets(minimum=0.01, every=0.1)
    part = Thrusters(
        matrix=np.eye(3).tolist(),
        low=0.0,
        high=Uniform([0.5, 1.5]),
        allocation="bounded",
        jets=jets,
        period=0.01,
    )
    flown = part.of_run(SO3, np.random.default_rng(0))
    x = flown.step(SO3, np.full(3, 0.4), np.zeros(12), 0.01)
    np.testing.assert_allclose(x[9:12], 0.04 - 0.01)  # of 0.4 N, 40 % of each 0.1 s
    thrust = flown.thrust(SO3, np.zeros(3), x)
    assert (thrust == np.asarray(part.drawn(np.random.default_rng(0)).high)).all()


def test_propellers_turn_by_the_inverse_of_the_mean_curve():
    places = [Thruster([0.0, 0.0, 0.0], axis) for axis in np.eye(3).tolist()]
    part = Propellers(
        thrusters=places,
        thrust_constant=Uniform([2e-4, 6e-4]),
        astern=Uniform([0.4, 1.0]),
        dead_speed=Uniform([5.0, 15.0]),
        low_speed=-300.0,
        high_speed=300.0,
        time_constant=0.1,
        neutral=0.1,
    )
    drawn = part.drawn(np.random.default_rng(2))
    flown = part.of_run(SE3, np.random.default_rng(2))
    command = np.array([0.0, 0.0, 0.0, 5.0, -5.0, 30.0])
    speeds = np.sqrt(np.array([5.0, 5.0 / 0.7, 30.0]) / 4e-4 + 100) * [1, -1, 1]
    np.testing.assert_allclose(flown.running(SE3, command), speeds, rtol=1e-12)
    k, a, n0 = (float(getattr(drawn, name)) for name in ("thrust_constant", "astern", "dead_speed"))
    pushed = np.where(speeds > 0, 1.0, -a) * k * (speeds**2 - n0**2)
    np.testing.assert_allclose(flown.thrust(SE3, command, speeds), pushed, rtol=1e-12)


def test_a_failure_that_is_told_is_told_with_the_drawn_numbers():
    part = replace(DRAWN, told=True, fails=Failure(2, 1.0, 0.5))
    flown = part.of_run(SE3, np.random.default_rng(1))
    assert flown.believed is None
    assert replace(part, told=False).of_run(SE3, np.random.default_rng(1)).believed is not None


# Thrusts that a law commands ----------------------------------------------------------------------


@pytest.mark.parametrize("allocation", ["pseudo_inverse", "bounded"])
@pytest.mark.parametrize("count", [4, 6])
def test_commanded_thrusts_are_flown_within_the_limits(count, allocation):
    """Not what B⁺ makes of their torque, which has no part along the null space of B."""
    vehicle = rotors(count)
    part = Thrusters(thrusters=vehicle, low=0.0, high=HIGH, allocation=allocation)
    flown = part.for_law(SE3, np.eye(6)[:0], True).of_run(SE3, None)
    thrusts = np.linspace(-1.0, 10.0, count)
    command = np.concatenate([np.zeros(6), thrusts])
    x = flown.solution(SE3, command) if flown.sampled else np.empty(0)
    np.testing.assert_array_equal(flown.thrust(SE3, command, x), np.clip(thrusts, 0.0, HIGH))
    np.testing.assert_allclose(flown.requested(command), wrenches(vehicle) @ thrusts, atol=1e-13)
    assert flown.at_limit(SE3, command, x)
