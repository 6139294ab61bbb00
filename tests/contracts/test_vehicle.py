"""What every force and every actuator must do, whoever wrote it."""

import numpy as np
import pytest
from ports import after_measuring, ports

from eqt_cli.components.actuators import Solving, actuators
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.sensors import Errors, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import group_named
from eqt_cli.numbers.leaves import leaves, with_leaves

G = group_named("SE3")
ROUNDING = 1e-13


def of_run(part, run=0):
    return part.of_run(G, generator_at(1, Stream.VEHICLE, run, "place"))


def changed(part, change):
    return with_leaves(part, {path: change(number) for path, number in leaves(part).items()})


def spread(part):
    """A part with the numbers of two runs, along a leading axis."""
    return changed(part, lambda number: np.stack([number, number]))


def states(seed=2):
    random = np.random.default_rng(seed)
    return G.exp(random.standard_normal((2, 6))), random.standard_normal((2, 6))


def test_a_force_takes_runs_together_and_symbols(force_class, make, symbols, noted):
    force, (Q, V), (to, back) = make(force_class, 6), states(), symbols
    assert noted(force, G) == []
    force = of_run(force)
    alone = np.stack([force.in_body(G, 0.3, Q[k], V[k]) + 0 * V[k] for k in range(2)])
    together = spread(force).in_body(G, 0.3, Q, V) + 0 * V
    np.testing.assert_allclose(together, alone, rtol=0, atol=ROUNDING)
    symbolic = changed(force, lambda number: to(number[None]))
    traced = symbolic.in_body(G, to(0.3), to(Q[:1]), to(V[:1])) + to(0 * V[:1])
    np.testing.assert_allclose(back(traced), alone[:1], rtol=0, atol=ROUNDING)


def test_an_actuator_takes_runs_together_and_symbols(actuator_class, make, symbols, noted):
    actuator, (_, command), (to, back) = make(actuator_class, 6), states(), symbols
    assert noted(actuator, G) == []
    actuator, x = of_run(actuator), np.full((2, actuator.states(G)), 0.3)
    for name in ("output", "state_rate") if x.size else ("output",):
        alone = np.stack([getattr(actuator, name)(G, command[k], x[k]) for k in range(2)])
        together = getattr(spread(actuator), name)(G, command, x)
        np.testing.assert_allclose(together, alone, rtol=0, atol=ROUNDING)
        symbolic = changed(actuator, lambda number: to(number[None]))
        traced = getattr(symbolic, name)(G, to(command[:1]), to(x[:1]))
        np.testing.assert_allclose(back(traced), alone[:1], rtol=0, atol=ROUNDING)


def test_an_actuator_hides_no_command_that_is_not_a_number(actuator_class, make):
    actuator = of_run(make(actuator_class, 6))
    command, x = np.full((1, 6), np.nan), np.zeros((1, actuator.states(G)))
    solves = isinstance(actuator, Solving) and actuator.solves
    taken = actuator.solution(G, command) if solves else command
    after = actuator.step(G, taken, x, 0.1)
    found = actuator.output(G, command, x), actuator.output(G, command, after), after
    rates = [actuator.state_rate(G, command, x)] if x.size else []
    assert not all(np.isfinite(each).all() for each in (*found, *rates))


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize(
    "kind", ["limit", pytest.param("thrusters", marks=pytest.mark.needs("thrusters"))]
)
def test_no_limit_makes_a_command_finite(kind, value):
    thrusters = {"matrix": np.eye(6).tolist(), "low": 0.0, "high": 1.0}
    options = {"limit": {"limit": 2.0}, "thrusters": thrusters}[kind]
    actuator = of_run(actuators.get(kind)(**options))
    vehicle = Vehicle(actuators=(actuator,))
    with np.errstate(invalid="ignore"):
        torque = ports(vehicle, G, {}, command=np.array([1.0, value, 0, 0, 0, 0]))["forces.torque"]
    assert np.isnan(torque).any()


@pytest.mark.parametrize("shape", [(), (2,), (2, 3)])
def test_an_actuator_says_of_each_command_whether_it_is_beyond_its_limit(
    actuator_class, make, shape
):
    actuator = of_run(make(actuator_class, 6))
    command = 1e3 + np.random.default_rng(2).random((*shape, 6))
    x = np.zeros((*shape, actuator.states(G)))
    found = actuator.at_limit(G, command, x)
    assert (found is None) == (not actuator.limits)
    if found is not None:
        assert found.shape == shape
        assert found.all()
        assert actuator.at_limit(G, -command, x).all()
        assert not actuator.at_limit(G, 0 * command, x).any()


def test_what_is_left_without_limits_and_steps_is_linear(actuator_class, make):
    actuator = of_run(make(actuator_class, 6))
    linear = actuator.linear_part
    if linear is actuator and not actuator_class.__module__.startswith("eqt_cli."):
        pytest.skip("a plugin need not say what of it is linear")
    n, random = linear.states(G), np.random.default_rng(4)
    one, other = (1e3 * random.standard_normal(6 + n) for _ in range(2))

    def found(y):
        parts = [linear.output(G, y[:6], y[6:])]
        return np.concatenate([*parts, linear.state_rate(G, y[:6], y[6:])] if n else parts)

    sums = found(2 * one - 3 * other), 2 * found(one) - 3 * found(other)
    np.testing.assert_allclose(*sums, rtol=0, atol=1e5 * ROUNDING)
    assert linear.linear_part is linear


def test_a_sensor_errs_by_run_and_instant_alone(sensor_class, make, noted):
    sensor = make(sensor_class, 6)
    assert noted(sensor, G) == []
    many, few, other = (
        sensor.errors(G, count, 0.1, generator_at(1, Stream.VEHICLE, run, "place"))
        for count, run in ((50, 0), (20, 0), (20, 1))
    )
    assert many.shape == (50, 6)
    np.testing.assert_array_equal(many[:20], few)
    assert (few == other).all() == (not few.any())


@pytest.mark.parametrize("run", [0, 7])
def test_the_numbers_of_a_run_are_its_own(force_class, make, run):
    force = make(force_class, 6)
    one, again = (leaves(of_run(force, run)) for _ in range(2))
    for path in one:
        np.testing.assert_array_equal(one[path], again[path])


SE2 = group_named("SE2")


def test_an_estimator_takes_any_leading_axes(estimator_class, make):
    """One run, many, and a table of them: here with a position that is late."""
    vehicle = Vehicle(
        control=Sampling(0.1),
        pose_sensors=(Noise(0.1, of="rotation"), Noise(0.1, of="translation", delay=1)),
        velocity_sensors=(Noise(0.1),),
        estimator=make(estimator_class, 3),
    ).of_run(SE2)
    random, lengths = np.random.default_rng(2), vehicle.states(SE2)
    numbers = random.standard_normal((4, 6, 12))
    arrived = np.array([2.0, 1.0, 0.0, 1.0])  # the first, measured, lost, measured

    def estimates(chosen, shape):
        states = {name: np.zeros((*shape, count)) for name, count in lengths.items()}
        for k in range(4):
            Q, V, E, n = np.split(numbers[k, chosen].reshape(*shape, 12), 4, axis=-1)
            flags = np.full((*shape, 1), arrived[k])
            errors = Errors(SE2.exp(0.1 * E), 0.1 * n, flags, 0.1 * n)
            states |= after_measuring(vehicle, SE2, SE2.exp(Q), V, errors, states)
        return states

    flat = estimates(slice(None), (6,))
    assert {name: values.shape[-1] for name, values in flat.items()} == lengths
    alone, table = estimates(4, ()), estimates(slice(None), (2, 3))
    for name, values in flat.items():
        assert alone[name].shape == values[4].shape
        np.testing.assert_allclose(alone[name], values[4], rtol=0, atol=1e-11)
        np.testing.assert_allclose(table[name].reshape(values.shape), values, rtol=0, atol=1e-11)


@pytest.mark.parametrize("shape", [(), (2, 3)])
def test_an_actuator_takes_any_leading_axes(actuator_class, make, shape):
    actuator, command = of_run(make(actuator_class, 6)), states()[1][0]
    x = np.full(actuator.states(G), 0.3)

    def spread(values):
        return np.broadcast_to(values, (*shape, *np.shape(values)))

    def values(command, x):
        shown = actuator.signals(G, 0.0 * command, command, x)
        assert set(shown) == {signal.name for signal in actuator.shows}
        return {"step": actuator.step(G, command, x, 0.1), **shown}

    alone = values(command[None], x[None])
    for name, found in values(spread(command), spread(x)).items():
        [one] = alone[name]
        assert found.shape == (*shape, *np.shape(one))
        np.testing.assert_allclose(found, spread(one), rtol=0, atol=ROUNDING)
