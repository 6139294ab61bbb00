"""What the parts of a vehicle compute, in closed form; and what is said of wrong options."""

import dataclasses
from functools import partial

import numpy as np
import pytest
from case_tables import from_yaml
from ports import ports
from said import says
from small_loops import expressions

from eqt_cli.components.actuators import (
    Actuator,
    Deadband,
    Lag,
    Limit,
    Quantisation,
    RateLimit,
    Scaled,
)
from eqt_cli.components.blocks import beyond_limits
from eqt_cli.components.inertia import Inertia, PrescribedInertia
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.sensors import Bias, Channel, Errors, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import (
    ConstantInertia,
    Normal,
    RelativeInertia,
    Sampling,
    Uniform,
    VaryingInertia,
    check_limits,
    check_numbers,
    drawn,
    is_drawn,
    lowest,
    mean_square,
)
from eqt_cli.extend import (
    ClosedLoop,
    Complementary,
    ConstantForce,
    ConstantReference,
    Drag,
    EqT,
    Gains,
    Gust,
    Invariant,
    Problems,
    Restoring,
    Schedule,
    group_named,
)
from eqt_cli.numbers.leaves import leaves

SO3, SE2, SE3 = (group_named(name) for name in ("SO3", "SE2", "SE3"))
ROUNDING = 1e-14

CONFIG = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {{kp: 2, kd: 2}}
reference: {{torque: [0, 0, 0]}}
controllers: [eqt]
time: {{duration: 1}}
{}
"""


def acting(force, G, Q, V, t=0.0):
    return force.of_run(G, None).in_body(G, t, Q, V)


def test_a_drawn_inertia_is_definite():
    """Half of the draws of one entry are not."""
    G, drawn_entry = group_named("R2"), Normal([0.0, 1.0])
    inertia = ConstantInertia([[drawn_entry, 0.0], [0.0, 1.0]])
    for run in range(20):
        found = inertia.of_run(G, generator_at(1, Stream.VEHICLE, run, "inertia"))
        assert np.linalg.eigvalsh(found.matrix).min() > 0


@pytest.mark.parametrize("number", [Uniform([1.0, 4.0]), Normal([-3.0, 0.5]), -2.0])
def test_the_mean_square_of_a_number_is_that_of_many_draws(number):
    random = np.random.default_rng(7)
    squares = np.array([drawn(number, random) for _ in range(20_000)]) ** 2
    # Five standard errors.
    spread = 5 * squares.std() / np.sqrt(len(squares)) + 1e-12
    assert mean_square(number) == pytest.approx(squares.mean(), abs=spread)


def test_drag_is_odd_and_takes_power():
    """And is none unless told."""
    V, steep = np.array([[0.3, -2.0, 1.0]]), [1.0, 2.0, 3.0]
    for drag, expected in (
        (Drag(linear=2.0), -2.0 * V),
        (Drag(quadratic=2.0), -2.0 * V * abs(V)),
        (Drag(linear=0.5, quadratic=steep), -(0.5 + np.array(steep) * abs(V)) * V),
    ):
        np.testing.assert_allclose(acting(drag, SO3, np.eye(3)[None], V), expected, atol=ROUNDING)


def test_a_spatial_force_acts_as_its_dual_adjoint():
    Q = SE3.exp(np.array([[0.3, -0.2, 0.5, 1.0, 2.0, -1.0]]))
    V = np.zeros((1, 6))
    drag = Drag(linear=1.0, frame="spatial", at="line")
    V = V + 0.4
    expected = -SE3.Ad_star(Q, SE3.Ad(Q, V))
    np.testing.assert_allclose(acting(drag, SE3, Q, V), expected, atol=10 * ROUNDING)


def test_a_push_in_space_acts_on_a_body_at_rest():
    Q, push = SE3.exp(np.array([0.3, -0.2, 0.5, 1.0, 2.0, -1.0])), [0.1, -0.2, 0.3, 1.0, 2.0, 3.0]
    found = acting(ConstantForce(push, frame="spatial", at="line"), SE3, Q, np.zeros(6))
    np.testing.assert_allclose(found, SE3.Ad_star(Q, np.array(push)), atol=ROUNDING)


@pytest.mark.parametrize("G", [SE2, SE3], ids=lambda G: G.name)
def test_weight_and_buoyancy_are_the_slope_of_their_energy(G, derivative):
    """Along every axis of the body: U = W h_G − B h_B, with both centres off every axis."""
    weight, lift, n, m = 10.0, 12.0, G.space, G.dimension
    mass, float_ = [0.1, -0.2, -0.3][-n:], [-0.15, 0.05, 0.25][-n:]
    force = Restoring(weight, lift, centre_of_mass=mass, centre_of_buoyancy=float_)
    Q = G.exp(np.array([[0.3, -0.4, 0.5, 1.0, 2.0, -1.0][:m]]))

    def energy(Q):
        height_of_mass, height_of_float = (float((Q @ [*r, 1.0])[0, -2]) for r in (mass, float_))
        return np.array(weight * height_of_mass - lift * height_of_float)

    slope = [derivative(lambda h, e=e: energy(Q @ G.exp(h * e))) for e in np.eye(m)]
    found = acting(force, G, Q, np.zeros((1, m)))[0]
    np.testing.assert_allclose(found, np.negative(slope), atol=1e-9)  # energies of 10 J


@pytest.mark.parametrize(("up", "down"), [(None, [0, 0, -1]), ([0, 3, 4], [0, -0.6, -0.8])])
def test_weight_alone_pulls_at_the_origin(up, down):
    found = acting(Restoring(weight=10.0, up=up), SE3, np.eye(4)[None], np.zeros((1, 6)))[0]
    np.testing.assert_allclose(found, [0, 0, 0, *np.multiply(10, down)], atol=ROUNDING)


def test_gusts_forget_within_their_time_constant():
    """The correlation Σ ½a² cos(ωs) of the sines is e^(−s/T), up to their number."""
    gust = Gust(std=0.3, time_constant=2.0).of_run(SO3, None)
    power = (gust.sine[:, 0] ** 2 + gust.cosine[:, 0] ** 2) / 2
    for lapse in (0.0, 1.0, 2.0, 4.0):
        found = (power * np.cos(gust.frequency * lapse)).sum()
        assert found == pytest.approx(0.09 * np.exp(-lapse / 2.0), abs=0.1 * 0.09)


def test_a_gust_is_a_sum_of_sines_with_phases_of_the_run_and_still_where_std_is_0():
    """Σ √(2/12) σ sin(ω t + φ) with the phases as they are drawn."""
    place = generator_at, 0, Stream.VEHICLE, 0, "plant.forces[0]"
    phase = partial(*place)().uniform(0.0, 2 * np.pi, (12, 3))
    std, times = np.array([0.3, 0.0, 0.1]), np.array([0.0, 0.7, 31.0])
    gust = Gust(std=std.tolist(), time_constant=2.0).of_run(SO3, partial(*place)())
    found = gust.in_body(SO3, times, np.broadcast_to(np.eye(3), (3, 3, 3)), np.ones((3, 3)))
    omega = np.tan(np.pi * (np.arange(12) + 0.5) / 24) / 2.0
    waves = np.sin(omega[:, None] * times[:, None, None] + phase).sum(axis=1)
    np.testing.assert_allclose(found, np.sqrt(2 / 12) * std * waves, rtol=0, atol=1e-13)
    assert gust.sine.shape == (12, 2) and not found[:, 1].any()


@pytest.mark.parametrize("std", [0.0, [0, 0, 0.0]])
def test_a_gust_without_deviation_is_still(std):
    gust = Gust(std=std, time_constant=2.0).of_run(SO3, np.random.default_rng(0))
    assert not gust.in_body(SO3, 1.0, np.eye(3), np.ones(3)).any()


def test_a_gust_blows_along_axes_whose_deviation_is_drawn():
    drawn = Gust(std=[Uniform([0.0, 1.0]), 0.0, 0.0], time_constant=2.0)
    assert drawn.of_run(SO3, None).axes == drawn.of_run(SO3, np.random.default_rng(0)).axes == [0]


def test_a_limit_cuts_along_each_axis_or_keeps_the_direction():
    command, none = np.array([[3.0, -0.2, 4.0]]), np.zeros((1, 0))
    each, whole = (Limit(limit=1.0, norm=norm).of_run(SO3, None) for norm in (False, True))
    cut = each.output(SO3, command, none)
    np.testing.assert_array_equal(cut, [[1.0, -0.2, 1.0]])
    cut = whole.output(SO3, command, none)
    np.testing.assert_allclose(cut, command / np.linalg.norm(command), atol=ROUNDING)


def test_a_limit_is_reached_by_more_than_it():
    limit, none = [1.0, 2.0, 3.0], np.zeros((3, 0))
    each, whole = (Limit(limit=limit, norm=norm).of_run(SO3, None) for norm in (False, True))
    command = np.array([[1.0, -2.0, 3.0], [1.0, -2.0, 3.1], [0.6, -1.0, 1.0]])
    assert each.at_limit(SO3, command, none).tolist() == [False, True, False]
    assert whole.at_limit(SO3, command, none).tolist() == [True, True, False]
    needed, low, high, _ = each.needed(SO3, np.zeros(1), command)
    np.testing.assert_array_equal(needed, command)
    np.testing.assert_array_equal(np.array([high, 0 - low]), [[1.0, 2.0, 3.0]] * 2)
    sizes, _, most, _ = whole.needed(SO3, np.zeros(1), command[:1])  # in the longest axis
    assert (sizes.item(), most.item()) == (pytest.approx(3 * np.sqrt(3)), 3.0)


def test_limits_along_the_axes_are_the_narrowest_of_all_actuators():
    """The limit of a norm, and what has no limit, have none along an axis."""
    parts = Limit([1.0, 2.0, 3.0]), Lag(0.5), Limit(low=-1.5, high=[0.5, 2.5, 1.0])
    whole = Limit(1.0, norm=True)
    low, high = Vehicle(actuators=(*parts, whole)).of_run(SO3).range_of("torque")
    np.testing.assert_array_equal([low, high], [[-1.0, -1.5, -1.5], [0.5, 2.0, 1.0]])
    assert Vehicle(actuators=(whole, Lag(0.5))).of_run(SO3).range_of("torque") is None


def test_a_limit_of_the_norm_counts_in_units_of_the_limits():
    part, command = Limit(limit=[1.0, 2.0, 4.0], norm=True), np.diag([2.0, 2.0, 2.0])
    part, none = part.of_run(SO3, None), np.zeros((3, 0))
    found = part.output(SO3, command, none)
    np.testing.assert_allclose(found, np.diag([1.0, 2.0, 2.0]), atol=ROUNDING)
    assert part.at_limit(SO3, command, none).tolist() == [True, False, False]


def test_what_rounding_takes_from_a_command_is_no_limit():
    part, x = RateLimit(rate=1e6), np.full((50, 3), 1000 * np.pi)
    part, command = part.of_run(SO3, None), np.linspace(2.0, 20.0, 150).reshape(50, 3)
    after = part.step(SO3, command, x, period=1.0)
    assert (after != command).any()
    assert not part.at_limit(SO3, command, after).any()
    assert not part.at_limit(SO3, -command, -after).any()
    assert part.at_limit(SO3, command + 1e-6, after).all()


def test_quantisation_gives_the_nearest_multiple():
    part, none = Quantisation(resolution=[0.1, 0.25, 1.0]), np.zeros((1, 0))
    command = np.array([[0.26, -0.4, 1234.4]])
    found = part.of_run(SO3, None).output(SO3, command, none)
    np.testing.assert_allclose(found, [[0.3, -0.5, 1234.0]], rtol=2 * ROUNDING)
    assert part.sampled


def test_a_deadband_swallows_what_is_small_and_nothing_of_the_rest():
    part, none = Deadband(width=[0.4, 0.4, 1.0]), np.zeros((1, 0))
    command = np.array([[0.39, -0.4, -0.9], [-0.39, 0.41, 1.5], [3.0, -7.0, 0.0]])
    found = part.of_run(SO3, None).output(SO3, command, none)
    np.testing.assert_array_equal(found, [[0, -0.4, 0], [0, 0.41, 1.5], [3.0, -7.0, 0]])
    assert part.sampled


def test_a_scaled_command_follows_the_thrust_curve(noted):
    """PX4's model of thrust, (1 − f) u + f u², for either sign."""
    part, none = Scaled(factor=[2.0, 2.0, 30.0], curve=[0, 0, 0.25]), np.zeros((1, 0))
    found = part.of_run(SO3, None).output(SO3, np.array([[0.5, -0.5, -0.4]]), none)
    thrust = -30 * (0.75 * 0.4 + 0.25 * 0.4**2)
    np.testing.assert_allclose(found, [[1.0, -1.0, thrust]], rtol=2 * ROUNDING)
    [(place, _)] = noted(Scaled(1.0, curve=Uniform([0.1])), SO3)
    assert place == "curve.uniform"
    assert noted(Scaled(1.0, curve=[0, 1.5, 0]), SO3) == [
        ("curve", "expected a share from 0 to 1, got 1.5")
    ]


def test_a_weight_needs_a_body_in_space_or_in_the_plane(noted):
    for name in ("SO3", "SE23", "SO3*SO2"):
        expected = f"restoring needs group SE2 or SE3, got {name}"
        assert noted(Restoring(1.0), group_named(name)) == [("", expected)]
    assert noted(Restoring(1.0, up=[0.0, 1.0]), SE2) == []
    assert noted(Restoring(1.0), SE3) == []


@pytest.mark.parametrize(
    ("force", "place", "said"),
    [
        (Restoring(1.0, frame="spatial"), "frame", "restoring fixes the frame of each of its "
         "numbers; remove this key"),
        (Restoring(1.0, up=[0.0, 0.0, 0.0]), "up", "expected a direction, got a vector of zeros"),
        (Restoring(1.0, up=[0.0, 1.0]), "up", "expected 3 numbers, got 2"),
        (Restoring(1.0, centre_of_mass=[0.0] * 4), "centre_of_mass", "expected 3 numbers, got 4"),
        (Drag(linear=[1.0, 2.0]), "linear", "expected 6 diagonal entries for SE3, got 2"),
        (Drag(current=[0.0, "sin(", 0.0]), "current[1]", "'sin(': expected a number, a name or '(' "
         "at column 5, but the expression ends"),
    ],
)  # fmt: skip
def test_a_force_says_what_does_not_fit_it(noted, force, place, said):
    assert noted(force, SE3) == [(place, said)]


def test_a_lag_follows_its_command():
    lag = Lag(time_constant=0.5).of_run(SO3, None)
    rate = lag.state_rate(SO3, np.ones((1, 3)), np.full((1, 3), 0.25))
    np.testing.assert_array_equal(rate, np.full((1, 3), 1.5))


def test_numbers_that_are_drawn_stand_for_their_means():
    uniform, normal = Uniform([1.0, 4.0]), Normal([2.0, 0.5])
    assert (drawn([uniform, [normal, 7.0]], None), lowest(uniform)) == ([2.5, [2.0, 7.0]], 1.0)
    assert lowest(normal) == 2.0
    assert [is_drawn(value) for value in (3.0, [1.0, [normal]], [1.0])] == [False, True, False]
    many = np.array([normal.draw(np.random.default_rng(k)) for k in range(400)])
    assert (many.mean(), many.std()) == (pytest.approx(2, abs=0.1), pytest.approx(0.5, abs=0.08))


@pytest.mark.parametrize(
    ("wrong", "said"),
    [
        (Uniform([1.0]), "uniform: expected two numbers, the lowest and the highest, got 1"),
        (Uniform([1.0, 2.0, 3.0]), "uniform: expected two numbers, the lowest and the highest, "
         "got 3"),
        (Uniform([2.0, 1.0]), "uniform: expected the smaller number first, got [2, 1]"),
        (Normal([1.0]), "normal: expected two numbers, the mean and the standard deviation, got 1"),
        (Normal([1.0, -0.5]), "normal: expected a standard deviation of at least 0, got -0.5"),
    ],
)  # fmt: skip
@pytest.mark.parametrize("positive", [False, True])
def test_a_distribution_without_its_two_numbers_is_told(wrong, said, positive):
    problems = Problems()
    wrong.check(problems, positive)
    assert [f"{problem.path}: {problem.message}" for problem in problems] == [said]


@pytest.mark.parametrize(
    ("number", "said"),
    [
        (0.5, None),
        (0.0, "expected a number greater than 0, got 0"),
        (Uniform([0.5, 0.5]), None),  # one number is a range
        (Uniform([0.0, 2.0]), "expected numbers greater than 0, got 0"),
        (Uniform([-1.0, 2.0]), "expected numbers greater than 0, got -1"),
        (1e299, "expected a number from 1e-15 to 1e+15, got 1e+299"),
        (Uniform([1e-300, 2.0]), "expected numbers from 1e-15 to 1e+15, got 1e-300"),
        (Normal([0.5, 3.0]), None),
        (Normal([0.5, 0.0]), None),  # nor need it have a spread
        (Normal([0.0, 0.0]), "expected a mean greater than 0, got 0"),
        (Normal([-0.5, 3.0]), "expected a mean greater than 0, got -0.5"),
    ],
)
def test_where_numbers_must_be_positive_so_must_a_distribution(number, said):
    for value, place in ((number, ""), ([1.0, number], "[1]")):
        problems, free = Problems(), Problems()
        check_numbers(value, problems, positive=True)
        check_numbers(value, free)
        own = f".{'uniform' if isinstance(number, Uniform) else 'normal'}"
        at = f"{place}{own if isinstance(number, Uniform | Normal) else ''}".removeprefix(".")
        expected = [] if said is None else [(at, said)]
        assert [(problem.path, problem.message) for problem in problems] == expected
        assert bool(free) == (number == 1e299)


@pytest.mark.parametrize(
    ("low", "high", "said"),
    [
        (None, None, None),
        (-1.0, 1.0, None),
        (-1.0, None, "high: missing; give both limits, low and high"),
        (None, 1.0, "low: missing; give both limits, low and high"),
        ([-1.0, 0.5], [0.5, 1.0], None),
        ([-1.0, 0.5], 0.5, "low[1]: expected a number less than high, 0.5, got 0.5"),
        (0.5, [1.0, 0.0], "low: expected a number less than high, 0, got 0.5"),
        ([2.0], 1.0, "low: expected a number less than high, 1, got 2"),
        (Normal([0.0, 9.0]), Uniform([0.0, 1.0]), None),  # their means are 0 and 0.5
        (Uniform([1.0, 0.0]), 2.0, "low.uniform: expected the smaller number first, got [1, 0]"),
        (0.0, Uniform([3.0, 2.0]), "high.uniform: expected the smaller number first, got [3, 2]"),
    ],
)
def test_limits_leave_a_range_along_each_axis(low, high, said):
    problems = Problems()
    check_limits(low, high, problems)
    assert [f"{problem.path}: {problem.message}" for problem in problems] == [said] * bool(said)


class Listed(Uniform):
    """Draws these numbers, one after the other."""

    def __init__(self, *numbers):
        object.__setattr__(self, "numbers", iter(numbers))

    def draw(self, random):
        return next(self.numbers)


def test_numbers_that_will_not_do_are_drawn_anew():
    random = np.random.default_rng(1)
    assert drawn(Listed(-2.0, 0.0, 0.5), random, positive=True) == 0.5
    assert drawn(Listed(-2.0, 0.5), random) == -2.0
    assert RelativeInertia(Listed(-1.5, -1.0, -0.5, 0.5)).of_run(SO3, random).relative == -0.5
    matrix = ConstantInertia([1.0, 2.0, Listed(-1.0, 0.0, 0.5, 2.0)]).of_run(SO3, random).matrix
    np.testing.assert_array_equal(matrix, np.diag([1.0, 2.0, 0.5]))


class Stateless(Actuator):
    """Adds all of its states to a command."""

    limits = True

    def output(self, G, command, x):
        return command + x.sum(axis=-1, keepdims=True)


def test_an_actuator_without_states_is_handed_none():
    vehicle, command = Vehicle(actuators=(Stateless(), Stateless())), np.array([1.0, 2.0, 3.0])
    now = ports(vehicle, SO3, {}, command=command)
    np.testing.assert_array_equal(now["forces.torque"], command)
    assert not now.rates() and not beyond_limits(now)
    clocked = dataclasses.replace(vehicle, control=Sampling(0.1))
    states = {name: np.zeros(count) for name, count in clocked.states(SO3).items()}
    now = ports(clocked, SO3, states, command=command, acts=True)
    np.testing.assert_array_equal(now.stepped()["held"], command)


@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
@pytest.mark.parametrize("control", [None, Sampling(0.1, delay=1)])
def test_a_vehicle_is_at_a_limit_where_any_actuator_is(shape, control):
    """What reaches the second one is what the first one lets through."""
    parts = Limit([1.0, 9.0, 9.0]), Limit([2.0, 5.0, 9.0]), Deadband(0.1)
    vehicle = Vehicle(actuators=parts, control=control).of_run(SO3)
    assert vehicle.limits and not Vehicle(actuators=parts[2:]).limits
    for command, at in (([1.5, 0.0, 0.0], True), ([0.0, 6.0, 0.0], True), ([0.5, 4.0, 8.0], False)):
        given = np.broadcast_to(command, (*shape, 3))
        queue = np.concatenate([given, 0.0 * given], axis=-1)
        states = {} if control is None else {"commands": queue}
        found = beyond_limits(ports(vehicle, SO3, states, command=given))
        assert found.shape == shape and (found == at).all()


def test_a_vehicle_without_parts_is_ideal():
    bare, clocked = Vehicle(), Vehicle(control=Sampling(0.1))
    assert bare.is_ideal and not bare.varies and not bare.measures
    assert not bare.estimates and not bare.knows_covariance
    assert bare == bare.of_run(SO3)  # which remembers how it was configured
    assert not clocked.is_ideal and clocked.departures == "sampled control"
    assert clocked.control == Sampling(0.1, delay=0)


def test_a_vehicle_knows_what_it_measures_and_estimates():
    for sensed in (Vehicle(pose_sensors=(Noise(0.1),)), Vehicle(velocity_sensors=(Noise(0.1),))):
        assert sensed.measures
    filtered, plain = Vehicle(estimator=Invariant()), Vehicle(estimator=Complementary())
    assert filtered.estimates and filtered.knows_covariance and not filtered.is_ideal
    assert plain.estimates and not plain.knows_covariance
    assert filtered.estimator_lengths(SO3) == {}  # nothing is told without a clock


def test_runs_differ_where_a_part_has_numbers_to_draw():
    differing = Vehicle(actuators=(Limit(Uniform([1.0, 2.0])),), control=Sampling(0.1))
    assert differing.varies and differing.of_run(SO3).varies
    assert not Vehicle(actuators=(Limit(1.0),), control=Sampling(0.1)).varies
    assert Gust(0.1, 2.0).varies and not VaryingInertia(VARYING).varies


def test_only_numbers_of_a_run_are_leaves():
    """Words and switches are not."""
    assert set(leaves(Limit(1.0).of_run(SO3, None))) == {"low", "high"}
    assert set(leaves(Drag(linear=1.0, frame="spatial").of_run(SO3, None))) == {
        "linear",
        "quadratic",
    }


def test_sensors_err_by_nothing_unless_told():
    """A walk begins at 0, and a value stays what it is."""
    random = np.random.default_rng
    walk, value = Bias(walk=0.3).errors(SO3, 5, 0.1, random(0)), Bias(value=[1.0, 2.0, 3.0])
    assert not walk[0].any() and walk[1:].all()
    np.testing.assert_array_equal(value.errors(SO3, 5, 0.1, random(0)), [[1.0, 2.0, 3.0]] * 5)
    assert not Noise(density=0.0).errors(SO3, 5, 0.1, random(0)).any()
    assert not Noise(0.1).lost(50, random(0)).any()


def test_a_value_may_have_any_sign_and_a_deviation_may_not(noted):
    assert noted(Bias(value=[-1.0, 0.0, 1.0]), SO3) == noted(Noise(0.0), SO3) == []
    negative = "expected a standard deviation of at least 0, got -1"
    assert noted(Bias(walk=-1.0), SO3) == [("walk", negative)]
    assert noted(Noise(density=-1.0), SO3) == [("density", negative)]
    assert noted(Noise(0.1, 0.1), SO3) == [("", "expected std or density, got both")]
    assert noted(Noise([0.1, 0.1]), SO3) == [("std", "expected 3 entries for SO3, got 2")]


def test_what_is_told_of_errors_is_what_the_sensors_say():
    """Variances add up; a density counts at the rate of its own part, and a bias of poses not."""
    G = group_named("SE2")
    vehicle = Vehicle(
        control=Sampling(0.1),
        pose_sensors=(
            Noise(0.3),
            Noise(density=[0.2, 0.4], of="translation", period=0.4),
            Bias(value=7.0),
        ),
        velocity_sensors=(
            Noise(0.05, of="rotation"),
            Bias(value=[3.0, Uniform([-3.0, 3.0])], walk=0.3, of="translation"),
            Bias(value=Normal([3.0, 2.0]), walk=[0.1, 0.4, 0.0]),
        ),
    )
    pose, velocity, bias, walk, _ = vehicle.deviations(G)
    np.testing.assert_allclose(pose**2, [0.09, 0.09 + 0.1, 0.09 + 0.4], rtol=1e-12)
    np.testing.assert_array_equal(velocity, [0.05, 0.0, 0.0])
    np.testing.assert_allclose(bias**2, [13.0, 9.0 + 13.0, 3.0 + 13.0], rtol=1e-12)
    np.testing.assert_allclose(walk, [0.1, 0.5, 0.3], rtol=1e-12)


def test_errors_may_be_without_a_bias_that_is_estimated():
    parts = np.zeros((2, 5, 3, 3)), np.ones((2, 5, 3)), np.zeros((2, 5, 0))
    errors = Errors(*parts)
    assert errors.bias.shape == (0,) and len(errors.of_runs) == 3
    assert [part.shape for part in errors.of(1, 4)] == [(3, 3), (3,), *[(0,)] * 5]
    clocked = Vehicle(control=Sampling(0.1), velocity_sensors=(Bias(value=0.1),))
    random_of = lambda place: np.random.default_rng(1)  # noqa: E731 shorter than a function
    assert clocked.measurement_errors(SO3, 5, [random_of]).bias.shape == (1, 5, 0)


def test_a_channel_holds_nothing_unless_told():
    [part] = SO3.parts
    channel = Channel("velocity", part, (3,))
    assert (channel.every, channel.delay, channel.holds, channel.states) == (1, 0, False, 0)
    assert Schedule(SO3, [], 0.1).depth == 0


@pytest.mark.parametrize(
    ("timing", "every", "delay", "holds"),
    [
        ({}, 1, 0, False),
        ({"delay": 0, "dropout": 0.0}, 1, 0, False),
        ({"period": 0.1}, 1, 0, True),
        ({"period": 0.3}, 3, 0, True),
        ({"delay": 2}, 1, 2, True),
        ({"dropout": 0.2}, 1, 0, True),
    ],
)
def test_a_measurement_is_held_where_it_is_slow_late_or_lost(timing, every, delay, holds):
    sensors = Noise(0.1, of="translation"), Bias(value=0.1, of="translation", **timing)
    vehicle = Vehicle(control=Sampling(0.1), velocity_sensors=sensors)
    [channel] = vehicle.channels(SE3)  # nothing measures the rotation
    found = channel.name, channel.every, channel.delay, channel.holds
    assert found == ("measured_velocity_translation", every, delay, holds)
    assert vehicle.holding(SE3) == [channel] * holds
    assert (channel.loses is None) == (not timing.get("dropout"))


@pytest.mark.parametrize(
    ("part", "place"),
    [
        (Bias(value=Uniform([2.0, 1.0])), "value.uniform"),
        (Bias(walk=Uniform([2.0, 1.0])), "walk.uniform"),
        (Noise(std=Uniform([2.0, 1.0])), "std.uniform"),
        (
            Restoring(1.0, centre_of_mass=[0.0, Uniform([2.0, 1.0]), 0.0]),
            "centre_of_mass[1].uniform",
        ),
        (Restoring(1.0, up=[0.0, 1.0, Uniform([2.0, 1.0])]), "up[2].uniform"),
        (Restoring(Uniform([2.0, 1.0])), "weight.uniform"),
        (Restoring(1.0, buoyancy=Uniform([2.0, 1.0])), "buoyancy.uniform"),
        (Drag(linear=[0.0] * 5 + [Uniform([2.0, 1.0])]), "linear[5].uniform"),
        (Drag(current=["sin(t)", 0.0, Uniform([2.0, 1.0])]), "current[2].uniform"),
    ],
    ids=lambda value: value if isinstance(value, str) else type(value).__name__,
)
def test_a_distribution_upside_down_is_found_in_every_part(part, place, noted):
    assert noted(part, SE3) == [(place, "expected the smaller number first, got [2, 1]")]


def test_relative_and_constant_inertia():
    model = Inertia(np.diag([1.0, 2.0, 4.0]), np.diag([1.0, 0.5, 0.25]))
    part = RelativeInertia(0.25)
    true = part.of_run(SO3, None).at(model, 0.0)
    np.testing.assert_array_equal(true.matrix, 1.25 * model.matrix)
    np.testing.assert_allclose(true.inverse @ true.matrix, np.eye(3), atol=ROUNDING)
    part = ConstantInertia([1.0, Uniform([1.0, 3.0]), 4.0])
    np.testing.assert_array_equal(part.of_run(SO3, None).matrix, model.matrix)


ROWS = [["1 + 0.3*sin(t)", "0", "0"], ["0", "2", "0.2*t"], ["0", "0.2*t", "4*exp(-0.2*t)"]]
VARYING = PrescribedInertia(expressions(ROWS))


def test_a_relative_inertia_changes_in_time_as_it_is(derivative):
    part = RelativeInertia(0.25)

    def true(t):
        return part.of_run(SO3, None).at(VARYING.at(t), t)

    change = true(0.7).change
    rate = derivative(lambda h: true(0.7 + h).matrix)
    np.testing.assert_allclose(change + change.T, rate, atol=1e-11)  # of the differences


@pytest.mark.parametrize(
    "true", [VaryingInertia(VARYING), RelativeInertia(0.25)], ids=["varying", "relative"]
)
def test_the_plant_obeys_its_own_inertia(true, derivative):
    """d/dt(𝕁V) = ad*_V 𝕁V + τ for the plant's 𝕁_t, of a loop whose law believes in another."""
    entries = ("2 + 0.1*cos(t)", "1.5 + 0.1*t", "3")
    rows = [[entries[i] if i == j else "0" for j in range(3)] for i in range(3)]
    believed = PrescribedInertia(expressions(rows))
    vehicle = Vehicle(inertia=true)
    loop = ClosedLoop(
        SO3, believed, Gains(np.eye(3), np.eye(3)), ConstantReference(), EqT(), vehicle.of_run(SO3)
    )
    Q, t = SO3.exp(np.array([0.4, -0.3, 0.6])), 0.7
    y = loop.initial_state(Q, np.array([0.5, -0.8, 1.1]), np.eye(3), np.zeros(3))
    rate = loop.vector_field(t, y)

    def momentum(h):
        s = loop.tracking(t + h, y + h * rate)
        return true.of_run(SO3, None).at(believed.at(t + h), t + h).momentum(s.V)

    s = loop.tracking(t, y)
    expected = SO3.ad_star(s.V, momentum(0.0)) + loop.torque(s)
    # A straight line in the state is curved in V: h⁴ of its fifth derivative, and rounding.
    np.testing.assert_allclose(derivative(momentum), expected, atol=1e-11)


def test_a_run_draws_its_own_numbers_whatever_else_there_is():
    limit = Limit(limit=Uniform([0.4, 0.6]))
    one, again, other = (
        limit.of_run(SO3, generator_at(5, Stream.VEHICLE, run, "actuators[0]")).high
        for run in (0, 0, 1)
    )
    np.testing.assert_array_equal(one, again)
    assert (one != other).all() and (0.4 <= one).all() and (one < 0.6).all()


def test_a_rate_limit_is_judged_by_the_change_of_the_torque():
    limit = RateLimit(rate=[1.0, 2.0, 3.0]).of_run(SO3, None)
    times, torque = np.array([0.0, 0.5, 0.75]), np.array([[0, 0, 0], [1, -1, 0], [1, -2, 1.0]])
    needed, _, most, _ = limit.needed(SO3, times, torque)
    np.testing.assert_array_equal(needed, [[2, -2, 0], [0, -4, 4]])
    np.testing.assert_array_equal(np.broadcast_to(most, (3,)), [1, 2, 3])


@from_yaml
def test_a_limit_below_what_the_reference_takes_is_warned_of(tmp_path, invoke, limit, warning):
    path = tmp_path / "c.yaml"
    text = CONFIG.replace("torque: [0, 0, 0]", "torque: [0.4*t, -0.3*t, 0]")
    kind = "" if "kind" in limit else "kind: limit, "
    clock = "control: {period: 0.1}\n" if "kind" in limit else ""
    path.write_text(
        text.format(f"{clock}actuators: [{{{kind}{limit}}}]\nensemble: {{runs: 1}}"),
        encoding="utf-8",
    )
    commands = [("config", "check", path), ("run", path, "--out", tmp_path / "out")]
    for arguments in commands if limit == "limit: [1, 0.2, 1]" else commands[:1]:
        said, at = invoke(*arguments).stderr.splitlines(), "8:13" if clock else "7:13"
        found = [line for line in said if "actuators" in line]
        assert len(found) == bool(warning)
        assert all(says(line, f"eqt: warning: {path}:{at}: {warning}") for line in found)
