"""Keeps threads that need the same code from compiling it side by side."""

import threading
from collections.abc import Callable, Hashable
from functools import lru_cache
from typing import TypeVar

from eqt_cli.engines.taylor import crash_reports

Code = TypeVar("Code")


def once(compiled: Callable[..., Code], *law: Hashable) -> Code:
    """`compiled(*law)`, which caches; who asks while another thread compiles it waits for that.

    Different laws are compiled at the same time: heyoka does so outside Python.
    """
    with _lock(compiled, law), crash_reports.damage_told():
        return compiled(*law)


@lru_cache(maxsize=64)
def _lock(compiled: Callable[..., object], law: Hashable) -> threading.Lock:
    return threading.Lock()
