"""Measures the wall time of the steps of a session."""

import time
from collections.abc import Iterator
from contextlib import contextmanager


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Record the wall time of the block under a name, s."""
    started = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - started, 3)
