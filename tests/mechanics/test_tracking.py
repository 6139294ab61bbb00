"""What a control law reads of the desired motion, against motions that are known."""

import numpy as np
import pytest

from eqt_cli.core.expressions import parse
from eqt_cli.groups import group_named
from eqt_cli.mechanics.inertia import FactoredInertia, PrescribedInertia
from eqt_cli.mechanics.tracking import Gains, Tracking

T = 0.7
RATES = np.array([1 + T, T**2, -0.5])
"""V_d(t) = (1 + t, t², −½)."""
ACCELERATION = np.array([1.0, 2 * T, 0.0])


def test_the_desired_acceleration_is_that_of_the_velocity_while_the_inertia_varies():
    """d(𝕀V_d)/dt = τ_d + ad*_{V_d} 𝕀V_d, of an 𝕀 and a V_d that are written out."""
    G = group_named("SO3")
    rows = [["2 + t**2", "0", "0"], ["0", "3", "t"], ["0", "t", "5"]]
    law = PrescribedInertia(tuple(tuple(parse(entry) for entry in row) for row in rows))
    matrix = np.array([[2 + T**2, 0, 0], [0, 3, T], [0, T, 5]])
    change = np.array([[2 * T, 0, 0], [0, 0, 1], [0, 1, 0]])
    momentum = matrix @ RATES
    torque = change @ RATES + matrix @ ACCELERATION + np.cross(RATES, momentum)
    gains = Gains(np.eye(3), np.eye(3))
    s = Tracking(G, law.at(T), gains, T, np.eye(3), momentum, np.eye(3), momentum, torque)
    assert s.Vd_dot == pytest.approx(ACCELERATION, abs=1e-12)
    again = s.following(RATES, ACCELERATION)
    assert again.Pd == pytest.approx(momentum, abs=1e-12)
    assert again.tau_d == pytest.approx(torque, abs=1e-12)


def test_the_cancelling_feedforward_is_that_with_the_weights_1_1_0_1():
    """Also while the inertia varies, by a factor that is written out."""
    G, random = group_named("SO3"), np.random.default_rng(0)
    rows = [["1 + t/4", "0", "0"], ["sin(t)/5", "1", "0"], ["0", "0", "exp(-t/9)"]]
    factor = tuple(tuple(parse(entry) for entry in row) for row in rows)
    inertia = FactoredInertia(np.diag([1.0, 2.0, 3.0]), factor).at(T)
    P, Pd, torque = random.standard_normal((3, 3))
    Q, Qd = G.exp(random.standard_normal((2, 3)))
    s = Tracking(G, inertia, Gains(np.eye(3), np.eye(3)), T, Q, P, Qd, Pd, torque)
    assert np.abs(s.inertia_force).max() > 0.01
    assert s.cancelling_feedforward == pytest.approx(s.feedforward(1, 1, 0, 1), abs=1e-14)
