"""What every distribution of initial poses must do, whoever wrote it."""

import numpy as np
import pytest
from drawn_starts import draw_initial_states

from eqt_cli.components.initial_states import Stream, generator, velocity_distributions
from eqt_cli.extend import group_named

# Tens of last places.
ROUNDING = 1e-13


@pytest.fixture(params=["SO3", "SE2", "SE3", "R3", "SO2"])
def case(request, make, pose_class, noted):
    """A group with a distribution that fits it."""
    G, poses = group_named(request.param), make(pose_class)
    if noted(poses, G):
        pytest.skip("says that it does not fit the group")
    return G, poses


def drawn(G, poses, runs, seed=1):
    return draw_initial_states(
        G,
        poses,
        velocity_distributions.get("normal")(),
        Qd=G.identity,
        Vd=np.zeros(G.dimension),
        seed=seed,
        runs=runs,
    )


def test_a_run_has_the_same_start_in_any_company(case):
    for ensemble, runs in zip(drawn(*case, range(7)), drawn(*case, [5, 2]), strict=True):
        np.testing.assert_array_equal(runs, ensemble[[5, 2]])


def test_poses_are_on_the_group(case):
    G, _ = case
    for Q in drawn(*case, range(5))[0]:
        assert G.violation(Q) < ROUNDING


def test_numbers_of_one_run_are_a_vector_that_a_seed_decides(case):
    G, poses = case
    one, again = (poses.draw(G, generator(1, Stream.INITIAL_STATE, 0)) for _ in range(2))
    assert one.ndim == 1
    np.testing.assert_array_equal(one, again)
    assert poses.place(G, one[None]).shape == (1, G.size, G.size)
