"""What every distribution of initial velocities must do, whoever wrote it."""

import numpy as np
import pytest

from eqt_cli.components.initial_states import Stream, generator
from eqt_cli.extend import group_named


@pytest.mark.parametrize("name", ["SO3", "SE3", "R1"])
def test_a_seed_decides_as_many_numbers_as_the_group_has_axes(make, velocity_class, name, noted):
    G, velocities = group_named(name), make(velocity_class)
    assert noted(velocities, G) == []
    one, again = (velocities.draw(G, generator(1, Stream.INITIAL_STATE, 0)) for _ in range(2))
    assert one.shape == (G.dimension,)
    assert np.isfinite(one).all()
    np.testing.assert_array_equal(one, again)
