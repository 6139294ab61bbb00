"""Torques that differ from a law by known parts are explained by these, on every group."""

import dataclasses

import numpy as np
import pytest
from small_loops import closed_loop

from eqt_cli.components.laws import controllers
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import Gains, group_named
from eqt_cli.extensions.code.code_evidence import Question, drawn_states, explained

OTHER = pytest.mark.ci("SE(3) has what they have")


def one_fast(first, *others):
    """A law, and others that are explained by the same parts."""
    in_ci = pytest.mark.ci("another law is tried fast")
    return pytest.mark.parametrize("law", [first, *(pytest.param(x, marks=in_ci) for x in others)])


@pytest.fixture(params=["SE3", *(pytest.param(name, marks=OTHER) for name in ("SO3", "SE2"))])
def question(request):
    """A law on a group, at random states, with gains and an inertia that are alike in no frame."""

    def ask(name):
        G, law = group_named(request.param), controllers.get(name)()
        m, random = G.dimension, np.random.default_rng(1)
        gains = Gains(np.eye(G.size), random.standard_normal((m, m)) + m * np.eye(m))
        loop = closed_loop(G, law, gains=gains, vehicle=Vehicle(control=Sampling(0.02)))
        return Question(loop, *drawn_states(loop, 5.0, random))

    return ask


@pytest.mark.parametrize("law", ["eqt", "gt", "nog", "lee2010", "slotine_li", "goodarzi2013"])
def test_nothing_is_said_of_the_law_itself(law, question):
    asked = question(law)
    found = explained(asked, asked.torque(), "double")
    assert found.is_complete
    assert found.words == ""


@pytest.mark.parametrize("law", ["eqt", "gt", "lee2010", "slotine_li", "goodarzi2013"])
def test_no_desired_acceleration(law, question):
    asked = question(law)
    still = asked.inputs._replace(desired_acceleration=0 * asked.inputs.desired_acceleration)
    found = explained(asked, asked.torque(inputs=still), "double")
    assert found.words.startswith("lacks desired acceleration: coefficient 0.00 of 1; the same")


@one_fast("lee2010", "eqt", "goodarzi2013")
def test_more_damping(law, question):
    asked = question(law)
    found = explained(asked, asked.torque(K_d=1.5), "double")
    assert set(found.changed) == {"damping", "damping of the desired velocity"}
    assert found.changed["damping"] == pytest.approx((1.5, 1.0), rel=1e-9)


def test_weights_of_the_family(question):
    """A term that is dropped is told from those like it."""
    asked = question("eqt")
    law = dataclasses.replace(controllers.get("family")(), transport=0.0)
    found = explained(asked, asked.torque(law=law), "double")
    assert "lacks transport (weight c): coefficient 0.00 of 1" in found.words


@one_fast("eqt", "lee2010", "slotine_li")
def test_a_transposed_gain(law, question):
    asked = question(law)
    turned = Gains(asked.loop.gains.K, asked.loop.gains.K_d.T)
    other = dataclasses.replace(asked, loop=dataclasses.replace(asked.loop, gains=turned))
    assert explained(asked, other.torque(), "double").words == "kd is transposed"
