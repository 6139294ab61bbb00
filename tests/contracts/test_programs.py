"""Every law as a program, in C: the same numbers as the law on arrays."""

import numpy as np
import pytest

from eqt_cli.components.laws import controllers
from eqt_cli.components.sensors import Errors
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.engines.native import at_instants, law_of, programs, sampled
from eqt_cli.extend import Problems
from eqt_cli.loop.law_program import INPUT, NUMBER
from eqt_cli.loop.signals import at_state
from eqt_cli.numbers.leaves import leaves

# NumPy adds products in another order: tens of last places of numbers up to hundreds.
ROUNDING = 1e-11


def flat(numbers):
    """Numbers by name as one vector."""
    return np.concatenate(
        [np.empty(0), *(np.asarray(each).reshape(-1) for each in numbers.values())]
    )


def given(loop, t, state, **errors):
    """The inputs of the programs of a loop."""
    numbers = {"parameters": flat(leaves(loop)), "held": flat(loop.holding(t).held_leaves)}
    return {"state": state, "time": [t], **numbers, **errors}


EVERY = pytest.mark.ci("compiles every law")


@pytest.mark.parametrize(
    "group", ["SO3", *(pytest.param(name, marks=EVERY) for name in ("SE3", "SE2"))]
)
def test_c_gives_the_same_field_as_the_law(loop_with, make, controller_class, states, in_c, group):
    loop, problems = loop_with(group, make(controller_class)), Problems(str)
    loop.controller.check(loop.group, problems)
    if problems:
        pytest.skip(f"not for {group}")
    program = programs(loop).field
    for state in states(loop, (3,)):
        found = in_c(program, **given(loop, 0.3, state))["derivative"]
        expected = loop.holding(0.3).vector_field(0.3, state)
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def signals(loop, t, state):
    return dict(at_state(loop, loop.tracking(t, state), loop.work(state)))


@pytest.mark.parametrize("group", ["SO3", "SE2"])
def test_c_gives_the_same_signals(loop_with, states, in_c, group):
    loop = loop_with(group)
    [state] = states(loop, (1,))
    found = in_c(sampled(signals, loop, (len(state),)), **given(loop, 0.3, state))
    for name, expected in signals(loop, 0.3, state[None]).items():
        np.testing.assert_allclose(found[name], expected[0], rtol=0, atol=ROUNDING, err_msg=name)


MOVING = """group: SO3
inertia: [1.0, 2.0, 2.5]
reference: {kind: rates, rates: [0.5*cos(t), 0.3, 0.4*sin(t)]}
controllers: [{kind: lqr, pieces: 7}]
initial: {pose: {kind: exp_normal, std: 0.6}}
ensemble: {runs: 1, seed: 4}
time: {duration: 2, samples: 3}
"""


@pytest.mark.needs("designed_laws")
def test_c_gives_the_same_gains_and_l_between_knots(tmp_path, states, in_c):
    path = tmp_path / "flight.yaml"
    path.write_text(MOVING, encoding="utf-8")
    [loop] = build(read_config(path)).loops.values()
    [state] = states(loop, (1,))
    field, shown = programs(loop).field, sampled(signals, loop, (len(state),))
    for since, t in ((0.0, 0.13), (2 / 7, 0.4), (12 / 7, 2.0)):
        held = loop.holding(since)
        inputs = {"state": state, "time": [t], "parameters": flat(leaves(loop))}
        inputs["held"] = flat(held.held_leaves)
        expected = loop.holding(t).vector_field(t, state)
        np.testing.assert_array_equal(held.vector_field(t, state), expected)
        found = in_c(field, **inputs)["derivative"]
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)
        found = in_c(shown, **inputs)["lyapunov"]
        expected = signals(loop, np.array([t]), state[None])["lyapunov"]
        np.testing.assert_allclose(found, expected[0], rtol=0, atol=ROUNDING)


SAMPLED = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {kp: 2, kd: 2}
reference: {kind: waypoints, points: [{t: 0, pose: identity}, {t: 1, pose: {rotvec: [0, 0, 1]}}]}
controllers: [goodarzi2013]
initial: {pose: {kind: exp_normal, std: 0.6}, velocity: {kind: normal, std: 0.4}}
ensemble: {runs: 1, seed: 4}
time: {duration: 1, samples: 3}
actuators: [{kind: limit, limit: 0.8}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors: {pose: [{kind: noise, std: 0.01}], velocity: [{kind: bias, value: 0.1}]}
"""


def test_c_gives_the_same_sampled_loop(tmp_path, states, in_c):
    """A law with memory, a limit, a lag, a delay, errors of measurement and a spline in pieces."""
    path = tmp_path / "flight.yaml"
    path.write_text(SAMPLED, encoding="utf-8")
    [loop] = build(read_config(path)).loops.values()
    compiled, random = programs(loop), np.random.default_rng(1)
    n, b = 0.1 * random.standard_normal(3), random.standard_normal(3)
    E, measured = loop.group.exp(n), np.concatenate([n, b])
    for state in states(loop, (3,)):
        state = state + 0.1 * random.standard_normal(state.shape)  # what is on its way, too
        held = loop.holding(0.3)
        found = in_c(compiled.field, **given(loop, 0.3, state))["derivative"]
        np.testing.assert_allclose(found, held.vector_field(0.3, state), rtol=0, atol=ROUNDING)
        found = in_c(compiled.after_instant, **given(loop, 0.3, state, errors=measured))["state"]
        expected = held.after_instant(0.3, state, Errors(E, b, np.empty(0)))
        np.testing.assert_allclose(found, expected, rtol=0, atol=ROUNDING)


def test_an_instant_has_the_bits_of_the_law_by_itself(tmp_path, states, in_c):
    """What an engine evaluates at an instant is the law's own program between two others."""
    path = tmp_path / "flight.yaml"
    path.write_text(SAMPLED, encoding="utf-8")
    [loop] = build(read_config(path)).loops.values()
    parts, whole, random = at_instants(loop), programs(loop).after_instant, np.random.default_rng(1)
    measured = random.standard_normal(6)
    numbers = {NUMBER + name: values for name, values in parts.law.values(loop).items()}
    for state in states(loop, (3,)):
        state = state + 0.1 * random.standard_normal(state.shape)
        inputs = given(loop, 0.3, state)
        told = in_c(parts.input, **inputs, errors=measured)
        told = {INPUT + name: values for name, values in told.items()}
        integral = loop.memory(state)["integral"]
        answer = in_c(parts.law.step, **told, **numbers, memory_integral=integral)
        after = in_c(
            parts.after, **inputs, torque=answer["torque"], memory=answer["memory_integral"]
        )
        found = in_c(whole, **inputs, errors=measured)["state"]
        assert found.tobytes() == after["state"].tobytes()
        assert not np.array_equal(found, state)


def test_a_law_by_itself_says_what_goes_in_and_comes_out(loop_with, make):
    law = law_of(loop_with("SE2", make(controllers.get("goodarzi2013"))))
    assert [(each.name, each.shape, each.unit) for each in law.inputs] == [
        ("t", (), "s"),
        ("pose", (3, 3), "1 (rotation), m (translation)"),
        ("velocity", (3,), "rad/s (rotation), m/s (translation)"),
        ("desired_pose", (3, 3), "1 (rotation), m (translation)"),
        ("desired_velocity", (3,), "rad/s (rotation), m/s (translation)"),
        ("desired_acceleration", (3,), "rad/s/s (rotation), m/s/s (translation)"),
    ]
    assert [(each.name, each.source) for each in law.numbers] == [
        *(("inertia", "inertia.matrix"), ("kp", "gains.K"), ("kd", "gains.K_d")),
        *(("ki", "controller.ki"), ("c2", "controller.c2"), ("period", "period")),
    ]
    assert [(each.name, each.shape) for each in law.memory] == [("integral", (3,))]
    assert law.torque.unit == "N m (rotation), N (translation)"
