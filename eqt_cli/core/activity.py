"""What is under way and cannot be counted, such as compiling; it does not know who shows it."""

from __future__ import annotations

import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

Watcher = Callable[[str], None]
"""Called with what begins, in words, and with no words where nothing is under way any more."""

_watchers: list[Watcher] = []
_under_way: list[str] = []
_lock = threading.Lock()


@contextmanager
def activity(words: str) -> Iterator[None]:
    """Tell who watches in this process what the block does."""
    _change(_under_way.append, words)
    try:
        yield
    finally:
        _change(_under_way.remove, words)


@contextmanager
def watched(watcher: Watcher) -> Iterator[None]:
    """Tell the watcher of activities in any thread, as long as the block takes."""
    _watchers.append(watcher)
    try:
        yield
    finally:
        _watchers.remove(watcher)


def _change(change: Callable[[str], None], words: str) -> None:
    with _lock:
        change(words)
        for watcher in _watchers:
            watcher(_under_way[-1] if _under_way else "")
