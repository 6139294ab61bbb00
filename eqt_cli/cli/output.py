"""What commands print: text, tables, JSON, progress."""

from __future__ import annotations

import json
import math
import os
import re
import shutil
import sys
import textwrap
import threading
import time
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from typing import TYPE_CHECKING, Any, TextIO

from eqt_cli.base.errors import EqtError, EqtWarning, HarmWarning, InputProblem, printable
from eqt_cli.base.process import drop_stdout
from eqt_cli.base.reporting import WORD, Block, Reporter, TextTable, reporter
from eqt_cli.base.reporting import count_of as count_of

if TYPE_CHECKING:
    from rich.progress import Progress
    from rich.text import Text

    from eqt_cli.results.result import Result

# Text that stays on one line: words, norms, integrals, intervals, shares; knows no layout ---------


def folded(line: str, width: int, indent: str = "") -> str:
    """Wrap a line to a width, with the further lines indented."""
    joined = WORD.sub(lambda word: word[0].replace(" ", "\u00a0"), line)
    return textwrap.fill(
        joined, width, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False
    ).replace("\u00a0", " ")


_LINES = "\n\t"
"""Control characters allowed in texts of several lines, such as the source of a plugin."""


PIPED = 100
"""Width of a line of text if the output is not a terminal."""

_silent = False
_documents: TextIO | None = None
"""Whether the command prints errors only."""


def be_quiet(quiet: bool) -> bool:
    """Apply ``--quiet``: omit tables and remarks, but print errors and documents."""
    global _silent
    _silent = quiet
    return quiet


def print_text(*pieces: str | Text) -> None:
    """Print a result on stdout, with lines wrapped between words; on a terminal, colour tables."""
    if _silent:
        return
    for piece in pieces or ("",):
        if isinstance(piece, str):
            text = printable(piece, _LINES)
            print("\n".join(_fold(line, room_of_tables() or PIPED) for line in text.split("\n")))
        else:
            from rich.console import Console

            console = Console(file=sys.stdout, soft_wrap=True, highlight=False)
            with console.capture() as captured:  # else a reader who has left ends the process
                console.print(piece)
            print(captured.get(), end="")


def print_verbatim(text: str) -> None:
    """Print a document, such as a configuration or CSV, on stdout without wrapping lines."""
    print(printable(text.removesuffix("\n"), _LINES))


def say(message: str) -> None:
    """Print a remark on stderr, unless the command is quiet."""
    if not _silent:
        complain(message)


def complain(message: str, label: str = "", heading: str = "") -> None:
    """Print a text on stderr, also if the command is quiet.

    It begins with a heading or a label, ``eqt: error:``. In colour, the name of the program is left
    out.
    """
    shown = heading or (f"{label}:" if label else "")
    start = f"eqt: {label}:" if label and not heading else heading
    between = "\n" if heading else " " if label else ""
    text = printable(f"{start}{between}{message}", _LINES)
    if width := room(sys.stderr):  # a terminal would break lines within words
        text = "\n".join(_fold(line, width) for line in text.split("\n"))
    if label and sys.stderr.isatty() and not os.environ.get("NO_COLOR"):
        colour = f"\033[1;{31 if label == 'error' else 33}m"
        text = f"{colour}{shown}\033[0m{text.removeprefix(start)}"
    print(text, file=sys.stderr, flush=True)


def warn(remark: EqtWarning) -> None:
    """Print a warning about a result on stderr."""
    if isinstance(remark, HarmWarning) or not _silent:
        complain(remark.with_advice(option), "warning")


def option(argument: str) -> str:
    """Return an argument as an option of a command, such as ``--out``."""
    return f"--{argument.replace('_', '-')}"


@contextmanager
def as_remark() -> Iterator[None]:
    """Treat output on stdout as a remark, since the work is done and stored.

    A full disk is then no error.
    """
    try:
        yield
        sys.stdout.flush()
    except BrokenPipeError:  # the reader has left, which needs no remark
        raise
    except OSError as error:
        drop_stdout()
        reason = str(error.strerror).lower()
        say(f"standard output: cannot be written: {reason}; the result is complete")


@contextmanager
def documents_alone() -> Iterator[None]:
    """Keep stdout for documents: what plugins print meanwhile is on stderr."""
    global _documents
    _documents = sys.stdout
    try:
        with redirect_stdout(sys.stderr):
            yield
    finally:
        _documents = None


def print_json(document: Any) -> None:
    """Print a JSON document on stdout; numbers that JSON cannot hold become null."""
    print(json_text(document, indent=2), file=_documents or sys.stdout)


def json_text(document: Any, indent: int | None = None) -> str:
    """Return a document as JSON that is safe on a terminal and parses to the same text.

    Characters that stdout cannot encode are escaped.
    """
    encoding = ((_documents or sys.stdout).encoding or "utf-8").lower().replace("_", "-")
    text = json.dumps(_plain(document), indent=indent, ensure_ascii=encoding[:3] != "utf")
    return printable(text, _LINES, lambda character: json.dumps(character)[1:-1])


def print_findings(document: Any, *pieces: str | Text, json: bool, nothing: str = "") -> None:
    """Print findings as one JSON document or as text; say `nothing` if there are none."""
    if json:
        print_json(document)
    elif any(pieces):
        print_text(*pieces)
    elif nothing:
        say(nothing)


def print_source(document: Any, text: str, *, json: bool, nothing: str = "") -> None:
    """Print findings as one JSON document or verbatim; say `nothing`, if given, without a text."""
    if json:
        print_json(document)
    elif text or not nothing:
        print_verbatim(text)
    else:
        say(nothing)


def print_error(error: EqtError) -> None:
    """Print an error as one JSON document, with the place of every problem that has one."""
    document = {"error": error.with_advice(option), "exit_code": error.exit_code}
    print_json(document | {"problems": problem_records(getattr(error, "problems", ()))})


def problem_records(problems: Iterable[InputProblem]) -> list[dict[str, str]]:
    """Return the path, message and place of each problem, for programs."""
    return [{"path": p.path, "message": p.with_advice(option), "place": p.place} for p in problems]


def _plain(value: Any) -> Any:
    if isinstance(value, dict):
        return {str(key): _plain(entry) for key, entry in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return value + 0.0 if math.isfinite(value) else None  # never −0.0
    return value


def print_records(header: list[str], rows: Sequence[Sequence[Any]], *, json: bool) -> None:
    """Print a table, or its rows as JSON objects, where a cell of several words is a list."""
    records = [dict(zip(header, row, strict=True)) for row in rows]
    cells = [[cell if isinstance(cell, str) else ", ".join(cell) for cell in row] for row in rows]
    print_findings(records, table(header, cells), json=json)


def table(header: list[str], rows: list[list[str]]) -> Text:
    """Return columns under their headings: text aligned left, numbers right."""
    return laid_out(TextTable("", "", header, [Block("", rows)]))


def laid_out(table: TextTable) -> Text:
    """Lay out a table in the width of the terminal or COLUMNS; in full for a pipe."""
    from eqt_cli.cli.tables import table_text

    return table_text(table, room_of_tables())


def room(stream: TextIO | None = None) -> int | None:
    """Return the width of the terminal; None if the stream is not a terminal."""
    if not (stream or sys.stdout).isatty():
        return None
    return shutil.get_terminal_size().columns


def room_of_tables() -> int | None:
    """Return the width for tables, which obey COLUMNS also without a terminal."""
    columns = os.environ.get("COLUMNS", "")
    return room() or (int(columns) if columns.isdecimal() else 0) or None


def _fold(line: str, width: int) -> str:
    if len(line) <= width:
        return line
    indent = min(len(_HANGING.match(line)[0]), width // 2)  # type: ignore[index]  # every line matches
    return folded(line, width, " " * indent)


_HANGING = re.compile(r" *(\S+ {2,})?")
"""Hanging indent of wrapped lines: the indentation, and the word that labels the line."""


def remarked(*results: Result) -> list[str]:
    """Return what was remarked on the configurations of results before they were run, once each."""
    texts = (text for result in results for text in result.described.remarks)
    return [*dict.fromkeys(texts)]


def duration(seconds: float) -> str:
    """Return a time span in a suitable unit."""
    for unit, length in (("d", 86_400), ("h", 3_600), ("min", 60)):
        if seconds >= 2 * length:
            return f"{seconds / length:.1f} {unit}"
    return f"{seconds:.1f} s"


# Progress on stderr: a bar on a terminal, plain lines at intervals elsewhere ----------------------


SHOW_AFTER = 1.0
"""Time before progress is shown, s."""

LINE_EVERY = 5.0
"""Interval between plain lines, s."""

GUESS_AFTER, GUESS_AFTER_ONE = 0.001, 0.02
"""Shares of the runs to be done before a rate is known: the former, and one run or the latter."""


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
        self.total, self.what, self.done, self.skipped = count, what, 0.0, 0.0
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
        self.skipped += amount
        self.advance(amount)

    def note(self, about: str, words: str) -> None:
        """Store a note, which is shown beside the numbers."""
        self.notes[about] = words
        self.latest = f"{about}, {words}"

    def remark(self, warning: EqtWarning) -> None:
        """Print a warning."""
        warn(warning)

    @property
    def pace(self) -> list[str]:
        """Return the rate and the remaining time in words; nothing if too little is done."""
        remaining, done = max(self.total - self.done, 0.0), self.done - self.skipped
        work = self.total - self.skipped
        if done < max(GUESS_AFTER * work, min(1.0, GUESS_AFTER_ONE * work)):
            return []
        rate = done / max(time.monotonic() - self.started, 1e-9)
        seconds = remaining / max(rate, 1e-9)
        left = f"{seconds:.0f} s" if seconds < 120 else duration(seconds)
        speed = f"{rate:.0f}" if rate >= 10 else f"{rate:.2g}"
        return [f"{speed} {self.what.split()[0]}/s", f"{left} left"]

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
    _first: threading.Timer | None = None

    def begin(self, what: str, count: int) -> None:
        """Restart the count; the bar comes in time, also where the first of them takes long."""
        super().begin(what, count)
        self._first = threading.Timer(SHOW_AFTER + 0.1, self.show)
        self._first.daemon = True
        self._first.start()

    def end(self) -> None:
        """Remove the bar."""
        if self._first is not None:
            self._first.cancel()
        with self._lock:
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
        with self._lock:
            if self.bar is None:
                early = time.monotonic() <= self.started + SHOW_AFTER
                if _silent or early or not self.what:
                    return
                self.bar = self._drawn()
            note, pace = self.under_way or self.latest, ", ".join(self.pace)
            self.bar.update(self.task, completed=self.done, pace=pace, note=note)

    def _drawn(self) -> Progress:
        from rich.console import Console
        from rich.progress import BarColumn, Progress, TextColumn

        bar = Progress(
            TextColumn("{task.completed:.0f}/{task.total:.0f} {task.description}"),
            BarColumn(),
            TextColumn("{task.fields[pace]}"),
            TextColumn("{task.fields[note]}"),
            console=Console(stderr=True),
            transient=True,
        )
        self.task = bar.add_task(self.what, total=self.total, pace="", note="")
        bar.start()
        return bar


class _Lines(Meter):
    next_line = 0.0

    def begin(self, what: str, count: int) -> None:
        """Restart the count."""
        super().begin(what, count)
        self.next_line = self.started + SHOW_AFTER

    def end(self) -> None:
        """Say that the step is done, if it took long enough to be shown."""
        took = time.monotonic() - self.started
        if took >= SHOW_AFTER and self.skipped + 1 <= round(self.done) >= self.total:
            say(f"{self.total}/{self.total} {self.what}: done in {duration(took)}")
        super().end()

    def show(self) -> None:
        """Print a line at intervals, but none for the last count."""
        now, first = time.monotonic(), round(self.done) < self.skipped + 1
        if now < self.next_line or round(self.done) >= self.total:
            return
        if first and now < self.started + LINE_EVERY:
            return
        self.next_line = now + LINE_EVERY
        counted = f"{self.done:.0f}/{self.total} {self.what}"
        say(", ".join(filter(None, [counted, *self.pace, self.latest])))
