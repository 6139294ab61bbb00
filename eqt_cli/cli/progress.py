"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

from __future__ import annotations

import os
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager

SHOW_AFTER = 1.0
"""s; shorter work shows nothing."""

LINE_EVERY = 5.0
"""s between plain lines."""


class Meter:
    """Counts runs; without more, it shows nothing."""

    def __init__(self, total: int) -> None:
        self.total, self.done, self.found = total, 0.0, 0.0
        self.started = time.monotonic()

    def __call__(self, runs: float) -> None:
        """So many more runs are done, in fractions."""
        self.done += runs
        self.show()

    def skip(self, runs: float) -> None:
        """So many runs had been done before; they say nothing of the rate."""
        self.done += runs
        self.found += runs
        self.show()

    @property
    def rate(self) -> float:
        """Runs per second."""
        return (self.done - self.found) / max(time.monotonic() - self.started, 1e-9)

    def show(self) -> None:
        """Show how far it is, if it is time."""


@contextmanager
def progress(total: int, *, quiet: bool) -> Iterator[Meter]:
    """Show how many of `total` runs are done, with rate and remaining time.

    Yields what is to be called with the number of further runs, in fractions.
    """
    if quiet:
        yield Meter(total)
    elif sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        bar = _Bar(total)
        try:
            yield bar
        finally:
            bar.bar.stop()
    else:
        yield _Lines(total)


class _Bar(Meter):
    def __init__(self, total: int) -> None:
        super().__init__(total)
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

        self.bar = Progress(
            TextColumn("{task.completed:.0f}/{task.total:.0f} runs"),
            BarColumn(),
            TextColumn("{task.fields[rate]}"),
            TimeRemainingColumn(),
            console=Console(stderr=True),
            transient=True,
        )
        self.task = self.bar.add_task("", total=total, rate="")
        self.shown = False

    def show(self) -> None:
        """Move the bar."""
        if not self.shown and time.monotonic() > self.started + SHOW_AFTER:
            self.bar.start()
            self.shown = True
        self.bar.update(self.task, completed=self.done, rate=f"{self.rate:.0f} runs/s")


class _Lines(Meter):
    def __init__(self, total: int) -> None:
        super().__init__(total)
        self.next_line = self.started + SHOW_AFTER

    def show(self) -> None:
        """Print a line now and then."""
        now = time.monotonic()
        if now < self.next_line or self.done < self.found + 1:
            return
        self.next_line = now + LINE_EVERY
        left = (self.total - self.done) / self.rate
        print(
            f"{self.done:.0f}/{self.total} runs, {self.rate:.0f} runs/s, {left:.0f} s left",
            file=sys.stderr,
            flush=True,
        )
