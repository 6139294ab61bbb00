"""What engines share, apart from any of them."""

import numpy as np
import pytest

from eqt_cli.engines.base import _nearest


@pytest.mark.parametrize(
    ("instant", "found"),
    [
        (0.3 + 1e-16, 0.3),
        (0.1 * 3, 0.3),
        (0.5, 0.5),
        (0.0, 0.0),
        (1.0, 1.0),
        (0.31, 0.31),
        (2.0, 2.0),
    ],
)
def test_instants_are_sample_times_but_for_rounding(instant, found):
    """So that no step of rounding's size lies between the two."""
    times = np.array([0.0, 0.3, 0.6, 1.0])
    assert _nearest(np.array([instant]), times).tolist() == [found]


def test_without_instants_there_is_nothing_to_move():
    assert _nearest(np.empty(0), np.array([0.0])).size == 0
