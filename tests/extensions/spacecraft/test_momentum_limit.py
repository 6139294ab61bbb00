"""The limit of the momentum of wheels, by hand and by both engines."""

import numpy as np
import pytest

from eqt_cli.config.remarks import limits_below_reference
from eqt_cli.extend import MomentumLimit, group_named

SO3 = group_named("SO3")
TEXT = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {{kp: 2, kd: 2}}
reference: {{torque: {torque}}}
controllers: [eqt]
actuators: [{{kind: momentum_limit, momentum: {momentum}}}]
control: {{period: 0.1}}
initial: {{pose: {{kind: exp_normal, std: 0.6}}}}
ensemble: {{runs: 3, seed: 4}}
time: {{duration: {duration}, samples: {samples}}}
solver: {{engine: {engine}}}
"""


def test_wheels_are_judged_by_the_integral_of_the_torque():
    limit = MomentumLimit(momentum=[1.0, 2.0, 3.0]).of_run(SO3, None)
    times, torque = np.array([0.0, 0.5, 0.75]), np.array([[0, 0, 0], [1, -1, 4], [3, -1, 0.0]])
    needed, _, most, _ = limit.needed(SO3, times, torque)
    np.testing.assert_array_equal(needed, [[0.25, -0.25, 1.0], [0.75, -0.5, 1.5]])
    np.testing.assert_array_equal(np.broadcast_to(most, (3,)), [1, 2, 3])


def test_wheels_take_up_what_they_can():
    part, command = MomentumLimit(momentum=1.0), np.array([[0.4, -3.0, 0.0]])
    part, x, taken = part.of_run(SO3, None), np.zeros((1, 6)), []
    for _ in range(8):
        x = part.step(SO3, command, x, period=0.5)
        taken.append(part.output(SO3, command, x)[0])
    # 5 periods of 0.4 · 0.5 are 1; the second axis is full after one period of 2.
    expected = [[0.4, -2.0, 0.0], *[[0.4, 0.0, 0.0]] * 4, *[[0.0, 0.0, 0.0]] * 3]
    np.testing.assert_allclose(taken, expected, rtol=0, atol=1e-14)
    assert part.at_limit(SO3, command, x).all()


@pytest.mark.parametrize(("momentum", "beyond"), [([0.19, 1, 1], [0]), ([0.21, 0.16, 1], [])])
def test_a_limit_below_what_the_reference_takes_is_remarked(experiment_of, momentum, beyond):
    """∫ 0.4 t dt and ∫ 0.3 t dt over 1 s are 0.2 and 0.15."""
    more = {"duration": 1, "samples": 11, "engine": "solve_ivp", "momentum": momentum}
    experiment = experiment_of(TEXT.format(torque='["0.4*t", "-0.3*t", 0]', **more))
    remarks = list(limits_below_reference(experiment))
    assert [place for place, _ in remarks] == [("actuators", index) for index in beyond]
    assert all("momentum_limit gives at most a momentum of" in words for _, words in remarks)


@pytest.mark.ci("compiles a loop")
def test_engines_agree_on_what_wheels_take_up(solved):
    more = {"torque": '["0.2*cos(t)", "0.1", 0]', "duration": 2, "samples": 21, "momentum": 0.3}
    found = [solved(TEXT.format(engine=engine, **more)) for engine in ("solve_ivp", "native")]
    first, second = (p.loop.torque(p.loop.tracking(p.times, s.states)) for p, s in found)
    np.testing.assert_allclose(first, second, rtol=0, atol=1e-7)
    taken_up = np.abs(np.cumsum(first[:, :-1], axis=1) * 0.1).max()
    assert taken_up == pytest.approx(0.3, rel=1e-12)
