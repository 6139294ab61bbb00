"""Progress on stderr: a bar on a terminal, plain lines at intervals elsewhere."""

from __future__ import annotations

import os
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import TYPE_CHECKING

from eqt_cli.cli.shared.output import duration, is_quiet, say, warn
from eqt_cli.core.errors import EqtWarning
from eqt_cli.core.reporting import Reporter, reporter

if TYPE_CHECKING:
    from rich.progress import Progress

SHOW_AFTER = 1.0
"""Time before progress is shown, s."""

LINE_EVERY = 5.0
"""Interval between plain lines, s."""

GUESS_AFTER = 0.001
"""Share of the runs to be done before the remaining time is estimated."""


class Meter(Reporter):
    """Counter of the progress of a step; this base class shows no count.

    Attributes
    ----------
    notes
        Findings so far, by subject.
    """

    def __init__(self) -> None:
        self.notes: dict[str, str] = {}
        self.latest = ""
        self._under_way: list[str] = []
        self._since = 0.0
        self._reminded = {""}
        self._reminder: threading.Timer | None = None
        self._lock = threading.RLock()
        Meter.begin(self, "", 0)

    def begin(self, what: str, count: int) -> None:
        """Restart the count."""
        self.total, self.what, self.done, self.found = count, what, 0.0, 0.0
        self.latest = ""
        self.started = time.monotonic()

    def end(self) -> None:
        """Stop counting."""
        self.what = ""

    def advance(self, amount: float) -> None:
        """Count an amount and show the progress."""
        self.done += amount
        self.show()

    def skip(self, amount: float) -> None:
        """Count an amount that is left out of the rate."""
        self.found += amount
        self.advance(amount)

    def note(self, about: str, words: str) -> None:
        """Store a note, which is shown beside the numbers."""
        self.notes[about] = words
        self.latest = f"{about}, {words}"

    def remark(self, warning: EqtWarning) -> None:
        """Print a warning."""
        warn(warning)

    @property
    def rate(self) -> float:
        """Return the number of runs per second."""
        return (self.done - self.found) / max(time.monotonic() - self.started, 1e-9)

    @property
    def speed(self) -> str:
        """Return the rate in words, with one decimal if it is below 10 per second."""
        return f"{self.rate:.{1 if self.rate < 10 else 0}f} {self.what.split()[0]}/s"

    @property
    def left(self) -> str:
        """Return the remaining time in words; empty if too little is done to estimate it."""
        remaining = max(self.total - self.done, 0.0)
        if self.done - self.found < GUESS_AFTER * (self.total - self.found):
            return ""
        seconds = remaining / max(self.rate, 1e-9)
        return (f"{seconds:.0f} s" if seconds < 120 else duration(seconds)) + " left"

    def show(self) -> None:
        """Show the progress if it is due."""

    @property
    def under_way(self) -> str:
        """Return the latest uncounted activity that is under way; empty if there is none."""
        return self._under_way[-1] if self._under_way else ""

    @contextmanager
    def busy(self, words: str) -> Iterator[None]:
        """Name an uncounted activity if it takes long, and leave its time out of the rate."""
        self._change(self._under_way.append, words)
        try:
            yield
        finally:
            self._change(self._under_way.remove, words)

    def _change(self, change: Callable[[str], None], words: str) -> None:
        with self._lock:
            if self._reminder:
                self._reminder.cancel()
            self._reminder = None
            now = time.monotonic()
            if self._under_way:
                self.started += now - self._since
            change(words)
            self._since = now
            if self._under_way:
                self._reminder = threading.Timer(SHOW_AFTER, self.remind)
                self._reminder.daemon = True
                self._reminder.start()

    def remind(self) -> None:
        """Show the activity that is under way, once, even if another one was shown since."""
        if self.under_way not in self._reminded:
            self._reminded.add(self.under_way)
            say(self.under_way)


def meter() -> Meter:
    """Return the progress display: a bar on a terminal, else lines; silent if the command is."""
    if sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        return _Bar()
    return _Lines()


def notes() -> dict[str, str]:
    """Return the findings of the command so far, by subject."""
    shown = reporter()
    return shown.notes if isinstance(shown, Meter) else {}


class _Bar(Meter):
    bar: Progress | None = None

    def end(self) -> None:
        """Remove the bar."""
        super().end()
        if self.bar is not None:
            self.bar.stop()
            self.bar = None

    def remind(self) -> None:
        """Show the bar if something is counted, else the activity."""
        if self.what:
            self.show()
        else:
            super().remind()

    def show(self) -> None:
        """Move the bar."""
        if self.bar is None:
            if is_quiet() or time.monotonic() <= self.started + SHOW_AFTER:
                return
            self.bar = _bar()
            self.task = self.bar.add_task(self.what, total=self.total, rate="", left="", note="")
            self.bar.start()
        note = self.under_way or self.latest
        self.bar.update(self.task, completed=self.done, rate=self.speed, left=self.left, note=note)


def _bar() -> Progress:
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn

    return Progress(
        TextColumn("{task.completed:.0f}/{task.total:.0f} {task.description}"),
        BarColumn(),
        TextColumn("{task.fields[rate]}"),
        TextColumn("{task.fields[left]}"),
        TextColumn("{task.fields[note]}"),
        console=Console(stderr=True),
        transient=True,
    )


class _Lines(Meter):
    next_line = 0.0

    def begin(self, what: str, count: int) -> None:
        """Restart the count."""
        super().begin(what, count)
        self.next_line = self.started + SHOW_AFTER

    def end(self) -> None:
        """Say that the step is done, if it took long enough to be shown."""
        took = time.monotonic() - self.started
        if took >= SHOW_AFTER and self.found + 1 <= round(self.done) >= self.total:
            say(f"{self.total}/{self.total} {self.what}: done in {duration(took)}")
        super().end()

    def show(self) -> None:
        """Print a line at intervals, but none for the last count."""
        now, first = time.monotonic(), round(self.done) < self.found + 1
        if now < self.next_line or round(self.done) >= self.total:
            return
        if first and now < self.started + LINE_EVERY:
            return
        self.next_line = now + LINE_EVERY
        speed = "" if first else self.speed
        told = [f"{self.done:.0f}/{self.total} {self.what}", speed, self.left, self.latest]
        say(", ".join(filter(None, told)))
