"""Random streams that depend only on the root seed and the run's number.

Run k draws the same numbers for any number and order of runs, workers and controllers.
"""

from enum import IntEnum
from zlib import crc32

import numpy as np


class Stream(IntEnum):
    """The purpose of a stream; its number affects every result and must not change."""

    INITIAL_STATE = 0
    CROSS_CHECK = 1
    CERTIFICATES = 2
    VEHICLE = 3
    EXACT_STATES = 4
    EXPORTED_STATES = 5
    CODE = 6


def generator(root: int, stream: Stream, run: int) -> np.random.Generator:
    """Return the generator of one run in one stream."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run))
    return np.random.Generator(np.random.PCG64DXSM(sequence))


def generator_at(root: int, stream: Stream, run: int, place: str) -> np.random.Generator:
    """Return the generator of one run for the component at a place of the configuration."""
    sequence = np.random.SeedSequence(root, spawn_key=(int(stream), run, crc32(place.encode())))
    return np.random.Generator(np.random.Philox(sequence))
