"""What every estimator must do, whoever wrote it."""

from functools import partial

import numpy as np
import pytest
from ports import after_measuring

from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.sensors import Bias, Errors, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import group_named
from eqt_cli.numbers.leaves import leaves, with_leaves

G = group_named("SE2")
ROUNDING = 1e-11
INSTANTS, LONG = 6, 100
PERIOD = 0.1

POSE = (
    Noise(std=0.01, of="rotation"),
    Noise(std=0.05, of="translation", period=0.2, delay=2, dropout=0.3),
)
VELOCITY = (Noise(std=0.02), Bias(value=0.05, walk=0.01))


def vehicle(estimator, run=0, pose=POSE):
    found = Vehicle(None, (), (), Sampling(PERIOD), pose, VELOCITY, estimator)
    return found.of_run(G, lambda place: generator_at(1, Stream.VEHICLE, run, place))


def motion(run):
    """Q and V at instants, with a constant velocity."""
    V = 0.3 * np.random.default_rng(run).standard_normal(G.dimension)
    start = G.exp(np.random.default_rng(9 + run).standard_normal(G.dimension))
    return [(start @ G.exp(PERIOD * k * V), V) for k in range(INSTANTS)]


def errors_of(flying, run):
    random_of = partial(generator_at, 1, Stream.VEHICLE, run)
    return flying.measurement_errors(G, INSTANTS, [random_of]).measured(G, 0)


def none_of(errors):
    """The same without errors; what is lost stays lost."""
    still = 0 * errors.velocity
    return Errors(np.broadcast_to(G.identity, errors.pose.shape), still, errors.arrived, still)


def flown(flying, moving, errors, convert=lambda values: values):
    """The states behind each instant, with the leading axes of what moves."""
    batch = moving[0][1].shape[:-1]
    states = {name: convert(np.zeros((*batch, n))) for name, n in flying.states(G).items()}
    for k, (Q, V) in enumerate(moving):
        at = Errors(*(convert(part[..., k, :, :] if part is errors.pose else part[..., k, :])
                      for part in errors[:4]))  # fmt: skip
        states = states | after_measuring(flying, G, convert(Q), convert(V), at, states)
        yield states


def own(states):
    return {name: values for name, values in states.items() if name.startswith("estimator_")}


def test_runs_together_and_symbols_give_what_a_run_alone_gives(
    estimator_class, make, symbols, noted
):
    part, (to, back) = make(estimator_class, G.dimension), symbols
    assert noted(part, G) == []
    flying = [vehicle(part, run) for run in range(2)]
    errors = [errors_of(each, run) for run, each in enumerate(flying)]
    *_, alone = flown(flying[0], motion(0), errors[0])
    rows = [leaves(each) for each in flying]
    both = with_leaves(flying[0], {path: np.stack([row[path] for row in rows]) for path in rows[0]})
    pairs = list(zip(motion(0), motion(1), strict=True))
    moving = [(np.stack([a[0], b[0]]), np.stack([a[1], b[1]])) for a, b in pairs]
    *_, together = flown(both, moving, Errors(*map(np.stack, zip(*errors, strict=True))))
    for name, values in own(alone).items():
        np.testing.assert_allclose(together[name][0], values, rtol=0, atol=ROUNDING, err_msg=name)
    symbolic = with_leaves(flying[0], {path: to(row[None]) for path, row in rows[0].items()})
    one = [(Q[None], V[None]) for Q, V in motion(0)]
    *_, traced = flown(symbolic, one, Errors(*(part[None] for part in errors[0][:4])), to)
    for name, values in own(alone).items():
        np.testing.assert_allclose(
            back(traced[name])[0], values, rtol=0, atol=ROUNDING, err_msg=name
        )


def test_what_is_measured_without_errors_is_estimated_without_errors(estimator_class, make):
    flying = vehicle(make(estimator_class, G.dimension))
    errors = none_of(errors_of(flying, 0))
    for states, (Q, V) in zip(flown(flying, motion(0), errors), motion(0), strict=True):
        Q_hat, V_hat = G.unpack(states["estimator_pose"]), states["estimator_velocity"]
        np.testing.assert_allclose(Q_hat, Q, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(V_hat, V, rtol=0, atol=ROUNDING)
        np.testing.assert_allclose(states["estimator_error"], 0, rtol=0, atol=ROUNDING)


def test_it_finds_a_bias_and_forgets_its_start(estimator_class, make):
    start = make(estimator_class, G.dimension)
    flying, b = vehicle(start, pose=(Noise(std=0.01),)), np.array([0.05, -0.03, 0.02])
    Q, V = motion(0)[0]
    moving = [(Q @ G.exp(PERIOD * k * V), V) for k in range(LONG)]
    biased = np.tile(b, (LONG, 1))
    none = np.empty((LONG, 0))
    errors = Errors(np.tile(G.identity, (LONG, 1, 1)), biased, none, biased)
    *_, last = flown(flying, moving, errors)
    np.testing.assert_allclose(last["estimator_bias"], b, rtol=0, atol=0.01)
    assert np.abs(last["estimator_error"]).max() < 0.02


@pytest.mark.parametrize("name", ["SO2", "SO3*R3"])
def test_it_has_as_many_numbers_as_it_says_on_every_group(estimator_class, make, name):
    other = group_named(name)
    still = Vehicle(None, (), (), Sampling(PERIOD), (Noise(std=0.1, delay=1),), (Noise(std=0.1),),
                    make(estimator_class, other.dimension)).of_run(other)  # fmt: skip
    states = {name: np.zeros(n) for name, n in still.states(other).items()}
    m = other.dimension
    errors = Errors(
        other.identity, np.zeros(m), np.full(len(still.holding(other)), 2.0), np.zeros(m)
    )
    found = after_measuring(still, other, other.identity, np.zeros(m), errors, states)
    assert {name: values.shape for name, values in found.items()} == {
        name: states[name].shape for name in found
    }
    assert set(own(found)) == set(own(states))
