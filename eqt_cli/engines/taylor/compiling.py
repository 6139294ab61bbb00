"""Locks that keep threads from compiling the same code side by side."""

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import TypeVar

from eqt_cli.engines.taylor import crash_reports

Code = TypeVar("Code")


def once(compiled: Callable[..., Code], *law: Hashable) -> Code:
    """Return `compiled(*law)`, which caches, after waiting for a thread that compiles it already.

    Different laws are compiled at the same time: heyoka does so outside Python.
    """
    with _lock(compiled, law), crash_reports.damage_told():
        return compiled(*law)


@lru_cache(maxsize=64)
def _lock(compiled: Callable[..., object], law: Hashable) -> threading.Lock:
    return threading.Lock()
