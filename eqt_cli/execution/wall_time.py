"""The wall time of what a session does."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Note the wall time of the block, under a name."""
    started = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - started, 3)
