"""Progress on stderr: a bar on a terminal, a plain line now and then elsewhere."""

import os
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

from eqt_cli.cli.shared.output import duration, is_quiet, say
from eqt_cli.core.activity import watched

SHOW_AFTER = 1.0
"""s; shorter work shows nothing."""

LINE_EVERY = 5.0
"""s between plain lines."""

GUESS_AFTER = 0.02
"""Of all runs; what fewer of them say of the time that is left may be wrong by far."""


class Meter:
    """Counts runs; without more, it shows nothing.

    Attributes
    ----------
    note
        What else is told beside the numbers, such as the best that was found so far.
    under_way
        What cannot be counted.
    """

    under_way = ""
    _since = 0.0
    _reminder: threading.Timer | None = None

    def __init__(self, total: int, what: str = "runs") -> None:
        self.begin(what, total)

    def begin(self, what: str, total: int) -> None:
        """What is counted from now on, and how many there are."""
        self.total, self.what, self.done, self.found = total, what, 0.0, 0.0
        self.note = ""
        self.started = time.monotonic()

    def __call__(self, runs: float) -> None:
        """So many more runs are done, in fractions."""
        self.done += runs
        self.show()

    def skip(self, runs: float) -> None:
        """So many runs had been done before; they say nothing of the rate."""
        self.found += runs
        self(runs)

    @property
    def rate(self) -> float:
        """Runs per second."""
        return (self.done - self.found) / max(time.monotonic() - self.started, 1e-9)

    @property
    def speed(self) -> str:
        """The rate in words; slow work has a decimal."""
        return f"{self.rate:.{1 if self.rate < 10 else 0}f} {self.what.split()[0]}/s"

    @property
    def left(self) -> str:
        """The time that is left; empty where too little is done to tell."""
        remaining = max(self.total - self.done, 0.0)
        if self.done - self.found < GUESS_AFTER * (self.total - self.found):
            return ""
        seconds = remaining / max(self.rate, 1e-9)
        return (f"{seconds:.0f} s" if seconds < 120 else duration(seconds)) + " left"

    def show(self) -> None:
        """Show how far it is, if it is time."""

    def meanwhile(self, words: str) -> None:
        """Tell what is under way that cannot be counted, if it takes long; no words: nothing."""
        if self._reminder:
            self._reminder.cancel()
        self._reminder = None
        now = time.monotonic()
        if self.under_way:  # which says nothing of the rate
            self.started += now - self._since
        self.under_way, self._since = words, now
        if words:
            self._reminder = threading.Timer(SHOW_AFTER, self.remind)
            self._reminder.daemon = True
            self._reminder.start()

    def remind(self) -> None:
        """Show what is under way, though nothing has been counted."""


@contextmanager
def progress(total: int, what: str = "runs") -> Iterator[Meter]:
    """Show how many of `total` runs, or what else it is, are done, with rate and remaining time.

    Yields what is to be called with the number of further runs, in fractions.
    """
    if is_quiet():
        yield Meter(total, what)
    elif sys.stderr.isatty() and os.environ.get("TERM") != "dumb":
        bar = _Bar(total, what)
        try:
            with watched(bar.meanwhile):
                yield bar
        finally:
            bar.bar.stop()
    else:
        lines = _Lines(total, what)
        with watched(lines.meanwhile):
            yield lines


class _Bar(Meter):
    def __init__(self, total: int, what: str) -> None:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        self.bar = Progress(
            TextColumn("{task.completed:.0f}/{task.total:.0f} {task.description}"),
            BarColumn(),
            TextColumn("{task.fields[rate]}"),
            TextColumn("{task.fields[left]}"),
            TextColumn("{task.fields[note]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self.task = self.bar.add_task(what, total=total, rate="", left="", note="")
        self.shown = False
        super().__init__(total, what)

    def begin(self, what: str, total: int) -> None:
        """Start the bar anew."""
        super().begin(what, total)
        self.bar.update(
            self.task, total=total, completed=0, description=what, rate="", left="", note=""
        )

    def remind(self) -> None:
        """Show the bar."""
        self.show()

    def show(self) -> None:
        """Move the bar."""
        if not self.shown and time.monotonic() > self.started + SHOW_AFTER:
            self.bar.start()
            self.shown = True
        note = self.under_way or self.note
        self.bar.update(self.task, completed=self.done, rate=self.speed, left=self.left, note=note)


class _Lines(Meter):
    def begin(self, what: str, total: int) -> None:
        """Count anew."""
        super().begin(what, total)
        self.next_line = self.started + SHOW_AFTER

    def remind(self) -> None:
        """Print what is under way."""
        say(self.under_way)

    def show(self) -> None:
        """Print a line now and then."""
        now = time.monotonic()
        if now < self.next_line or self.done < self.found + 1:
            return
        self.next_line = now + LINE_EVERY
        told = [f"{self.done:.0f}/{self.total} {self.what}", self.speed, self.left, self.note]
        say(", ".join(filter(None, told)))
