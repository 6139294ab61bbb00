"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager

SHOW_AFTER = 1.0
"""s; shorter work shows nothing."""

LINE_EVERY = 5.0
"""s between plain lines."""


@contextmanager
def progress(total: int, *, quiet: bool) -> Iterator[Callable[[float], None]]:
    """Show how many of `total` runs are done, with rate and remaining time.

    Yields the function to call with the number of further runs, in fractions.
    """
    if quiet:
        yield lambda runs: None
    elif sys.stderr.isatty():
        with _bar(total) as advance:
            yield advance
    else:
        yield _Lines(total)


@contextmanager
def _bar(total: int) -> Iterator[Callable[[float], None]]:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    bar = Progress(
        TextColumn("{task.completed:.0f}/{task.total:.0f} runs"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        transient=True,
    )
    task = bar.add_task("", total=total, rate="")
    started = time.monotonic()
    shown = False

    def advance(runs: float) -> None:
        nonlocal shown
        elapsed = time.monotonic() - started
        if not shown and elapsed > SHOW_AFTER:
            bar.start()
            shown = True
        done = bar.tasks[task].completed + runs
        bar.update(task, advance=runs, rate=f"{done / max(elapsed, 1e-9):.0f} runs/s")

    try:
        yield advance
    finally:
        bar.stop()


class _Lines:
    def __init__(self, total: int) -> None:
        self.total, self.done = total, 0.0
        self.started = time.monotonic()
        self.next_line = self.started + SHOW_AFTER

    def __call__(self, runs: float) -> None:
        self.done += runs
        now = time.monotonic()
        if now < self.next_line or not self.done:
            return
        self.next_line = now + LINE_EVERY
        rate = self.done / (now - self.started)
        left = (self.total - self.done) / rate
        print(
            f"{self.done:.0f}/{self.total} runs, {rate:.0f} runs/s, {left:.0f} s left",
            file=sys.stderr,
            flush=True,
        )
