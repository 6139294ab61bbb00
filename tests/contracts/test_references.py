"""What every desired trajectory must do, whoever wrote it."""

import numpy as np
import pytest

from eqt_cli.components.motions import PlantModel
from eqt_cli.extend import Inertia, Problems, group_named
from eqt_cli.numbers.leaves import leaves, with_leaves

# Tens of last places of torques up to ten.
ROUNDING = 1e-12


@pytest.fixture(params=["SO3", "SE3"])
def loop(request, loop_with, make, noted, reference_class):
    m = {"SO3": 3, "SE3": 6}[request.param]
    reference, G = make(reference_class, m), group_named(request.param)
    if refused := noted(reference, G):
        pytest.skip(refused[0][1])
    inertia = Inertia(np.eye(m), np.eye(m))
    plant = PlantModel(inertia, (Push(),), None, True, 3.0, along=[0.0, 0.0, 1.0])
    known = reference.for_plant(G, plant, Problems())
    return loop_with(request.param, reference=known)


class Push:
    """A known force, without which there is no thrust at rest."""

    def in_space(self, G, t, moving):
        return np.array([0.0, 0.0, -9.81])

    def apart(self, G, along, even):
        return self, None


@pytest.mark.parametrize("batch", [(), (4,), (2, 3)], ids=str)
def test_torque_takes_any_batch_axes(loop, states, batch):
    s = loop.tracking(0.3, states(loop, batch))
    assert np.broadcast_shapes(np.shape(s.tau_d), (*batch, loop.group.dimension)) == s.Pd.shape


@pytest.mark.parametrize("t", [0.0, 0.3, 1.7])
def test_many_states_equal_one_by_one(loop, states, t):
    y = states(loop, (3,))
    together = loop.tracking(t, y).tau_d
    alone = np.stack([loop.tracking(t, one).tau_d for one in y])
    np.testing.assert_allclose(*np.broadcast_arrays(together, alone), rtol=0, atol=ROUNDING)


def test_symbols_give_the_same_as_floats(loop, states, symbols):
    to, back = symbols
    y = states(loop, (2,))
    held = loop.holding(0.3)
    traced = with_leaves(held, {path: to(number) for path, number in leaves(held).items()})
    found = back(traced.tracking(to(0.3), to(y)).tau_d)
    expected = loop.tracking(0.3, y).tau_d
    np.testing.assert_allclose(*np.broadcast_arrays(found, expected), rtol=0, atol=ROUNDING)


def test_a_reference_says_whether_it_keeps_its_velocity(loop, states):
    """By an Euler step, in which a velocity that changes does so by h V̇_d."""
    t, y, h = 0.3, states(loop, (3,)), 1e-3
    later = y + h * loop.vector_field(t, y)
    moved = np.abs(loop.tracking(t + h, later).Vd - loop.tracking(t, y).Vd).max()
    assert (moved < ROUNDING) == loop.reference.keeps_velocity


def test_its_options_fit_the_group(loop, noted):
    assert noted(loop.reference, loop.group) == []
