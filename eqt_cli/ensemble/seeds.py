"""Random streams that depend on the root seed and the run's number, and on nothing else.

Run k draws the same numbers whatever the number of runs, workers or controllers, and in any order.
"""

from __future__ import annotations

from enum import IntEnum

import numpy as np


class Stream(IntEnum):
    """What a stream is for; the numbers are part of every result and never change."""

    INITIAL_STATE = 0
    CROSS_CHECK = 1
    CERTIFICATES = 2


def generator(root: int, stream: Stream, run: int) -> np.random.Generator:
    """The generator of one run in one stream."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run))
    return np.random.Generator(np.random.PCG64DXSM(sequence))
