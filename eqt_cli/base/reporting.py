"""Progress, remarks and tables of text, which code that computes makes, whoever shows them."""

from __future__ import annotations

import inspect
import math
import re
import threading
import time
import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from dataclasses import dataclass, field, replace
from html import escape
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError, EqtWarning

RUNS_DONE = "runs"
"""The usual unit of progress."""

_PACKAGE = str(Path(__file__).parents[1])


class Reporter:
    """Receives progress and remarks of eqt; this one shows no progress, and remarks as warnings.

    Override the methods for what you want to show, and activate your class with `reporting`.

    Examples
    --------
    >>> class Printer(eqt_cli.Reporter):
    ...     def begin(self, what, count):
    ...         print(count, what)
    >>> few = {"ensemble.runs": 2, "time.duration": 1, "name": "few", "solver.cross_check": 0}
    >>> with eqt_cli.reporting(Printer()):
    ...     result = eqt_cli.run(eqt_cli.load_experiment("configs/paper.yaml", few))
    4 runs
    1 parts packed
    """

    def begin(self, what: str, count: int) -> None:
        """Begin a step that counts something, such as ``runs``."""

    def advance(self, amount: float) -> None:
        """Count progress of the step; fractions are possible."""

    def skip(self, amount: float) -> None:
        """Count progress of the step that an earlier session made."""

    def end(self) -> None:
        """End the step, finished or not."""

    def note(self, about: str, words: str) -> None:
        """Show an intermediate result, for example of a law that is tuned."""

    def busy(self, words: str) -> AbstractContextManager[None]:
        """Show work in the block that cannot be counted, such as compiling."""
        return nullcontext()

    def remark(self, warning: EqtWarning) -> None:
        """Show a remark, which is no error."""
        frame, level = inspect.currentframe(), 1
        while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
            frame, level = frame.f_back, level + 1  # up to the user's line
        warnings.warn(warning, stacklevel=level)


class _Step(Reporter):
    """Reporter within a step: passes on all but inner steps, which count only in the same unit."""

    def __init__(self, to: Reporter, what: str, counts: bool) -> None:
        self.to, self.what, self.counts, self.uncounted = to, what, counts, 0.0
        self._lock, self._busy, self._since = threading.Lock(), 0, 0.0

    def advance(self, amount: float) -> None:
        if self.counts:
            self.to.advance(amount)

    def skip(self, amount: float) -> None:
        if self.counts:
            self.to.skip(amount)

    def note(self, about: str, words: str) -> None:
        self.to.note(about, words)

    @contextmanager
    def busy(self, words: str) -> Iterator[None]:
        self._count_busy(1)
        try:
            with self.to.busy(words):
                yield
        finally:
            self._count_busy(-1)

    def _count_busy(self, change: int) -> None:
        """Add the time in which threads do uncounted work, once where several do."""
        with self._lock:
            now = time.perf_counter()
            self.uncounted += now - self._since if self._busy else 0.0
            self._busy, self._since = self._busy + change, now

    def remark(self, warning: EqtWarning) -> None:
        self.to.remark(warning)


_current: ContextVar[Reporter | None] = ContextVar("reporter", default=None)
_DEFAULT = Reporter()


def reporter() -> Reporter:
    """Return the active reporter."""
    return _current.get() or _DEFAULT


@contextmanager
def reporting(to: Reporter) -> Iterator[None]:
    """Send the progress and the remarks of the block to a reporter.

    Parameters
    ----------
    to
        The reporter, of a class derived from `Reporter`.

    Returns
    -------
    context manager
        For a ``with`` statement; blocks may be nested, and the innermost is active.

    Examples
    --------
    >>> class Remarks(eqt_cli.Reporter):
    ...     def remark(self, warning):
    ...         print(warning)
    >>> with eqt_cli.reporting(Remarks()):
    ...     loaded = eqt_cli.load_experiment("configs/paper.yaml")
    """
    token = _current.set(to)
    try:
        yield
    finally:
        _current.reset(token)


@contextmanager
def step(what: str, count: int) -> Iterator[_Step]:
    """Count something in the block, by `reporter().advance`; its `uncounted` are s of other work.

    A step within another one is not reported. If it counts the same, it advances the outer step, as
    the runs of an experiment do within a search.
    """
    outer = reporter()
    if isinstance(outer, _Step):
        inner = _Step(outer.to, outer.what, outer.counts and outer.what == what)
        with reporting(inner):
            yield inner
        return
    outer.begin(what, count)
    inner = _Step(outer, what, counts=True)
    try:
        with reporting(inner):
            yield inner
    finally:
        outer.end()


_subject: ContextVar[str] = ContextVar("subject", default="the laws")


def subject() -> str:
    """Return which of the laws the current work is for, in words."""
    return _subject.get()


@contextmanager
def working_for(words: str) -> Iterator[None]:
    """Name what the work in the block is for, such as ``law 2 of 4 (gt)``."""
    token = _subject.set(words)
    try:
        yield
    finally:
        _subject.reset(token)


# Text tables: blocks of rows under a header, independent of contents and output formats -----------


_UNIT = r"(?:%|\(N m\)² s|N m\b|(?:deg|rad|kg|1|N|J|m|s)\b(?:/s)?)"

WORD = re.compile(
    r"(?:‖[^‖]*‖|\|\|[^|]*\|\||∫.*? dt|\[[-−+\d.e, ]{1,40}\]|p = \d|N m\b|\(N m\)² s"
    rf"|(?<=[\d\]]) {_UNIT}|(?<=\w) − (?=\w)| [✓✗=?](?!\S)|--set '[^']{{1,70}}'|\S)+"
)
"""A piece of a text that stays on one line: a word, a norm, a number with its unit, an option."""


def words(text: str) -> list[str]:
    """Return the pieces of a text between which a line may be broken."""
    return WORD.findall(text)


def listed(words: Sequence[str], conjunction: str = "and") -> str:
    """Join words: ``a, b and c``."""
    return f" {conjunction} ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


MARKS = {"better": "✓", "worse": "✗", "no difference": "=", "undecided": "?"}
"""What ends a number that is compared with another one, by its word."""


@dataclass(frozen=True)
class Block:
    """Rows under a common heading, which may be empty."""

    title: str
    rows: list[list[str]]


@dataclass(frozen=True)
class TextTable:
    """A table.

    Attributes
    ----------
    name
        Name of the table, for options and files.
    caption
        Sentence that describes the content.
    header
        Headings of the columns.
    blocks
        Blocks of rows.
    notes
        Notes below the table.
    spare
        Headings of columns that a narrow display may leave out, the least important first.
    keys
        Number of leading columns that identify a row.
    """

    name: str
    caption: str
    header: list[str]
    blocks: list[Block]
    notes: list[str] = field(default_factory=list)
    spare: tuple[str, ...] = ()
    keys: int = 1

    def of_columns(self, columns: Sequence[int]) -> TextTable:
        """Some of its columns, by position."""

        def those(row: Sequence[str]) -> list[str]:
            return [row[k] for k in columns]

        blocks = [Block(block.title, list(map(those, block.rows))) for block in self.blocks]
        return replace(self, header=those(self.header), blocks=blocks)

    def without(self, headings: Sequence[str]) -> TextTable:
        """Return the table without some columns, and without the notes that explain them."""
        remaining = [k for k, heading in enumerate(self.header) if heading not in headings]
        return replace(self.of_columns(remaining), notes=self.notes_without(headings))

    def notes_without(self, headings: Sequence[str]) -> list[str]:
        """Return the notes but those that explain one of these columns: ``d: mean over …``."""
        return [note for note in self.notes if note.partition(":")[0] not in headings]

    def narrow(self, most: int) -> list[TextTable]:
        """Return the table split into tables of at most so many columns.

        Spare columns are left out first. Each table repeats the first columns.
        """
        remaining = list(range(len(self.header)))
        for heading in self.spare:
            if len(remaining) > most and heading in self.header:
                remaining.remove(self.header.index(heading))
        keys, others = remaining[: self.keys], remaining[self.keys :]
        room = max(1, most - len(keys))
        pieces = [others[k : k + room] for k in range(0, len(others), room)] or [[]]
        *first, last = [self.of_columns([*keys, *piece]) for piece in pieces]
        return [*(replace(table, notes=[]) for table in first), last]

    @property
    def rows(self) -> list[list[str]]:
        """Rows of all blocks."""
        return [row for block in self.blocks for row in block.rows]


# Findings in a notebook ---------------------------------------------------------------------------


SHOWN_AT_ONCE = 6
"""Most rows of a table that a notebook shows without a click."""

MOST_LINES = 20
"""Largest number of lines or rows of a finding that a notebook shows."""


def pandas_frame(data: Any) -> Any:
    """Return columns or records as a pandas DataFrame.

    Raises
    ------
    EqtError
        If pandas is not installed.
    """
    try:
        import pandas
    except ImportError:
        raise EqtError("a table needs pandas (extra xarray): pip install pandas") from None
    return pandas.DataFrame(data)


class InNotebook(ABC):
    """A finding that Python shows in a few lines, and a notebook with a table."""

    @abstractmethod
    def answer(self) -> list[str]:
        """Return the finding in lines, the most important first."""

    @abstractmethod
    def records(self) -> list[dict[str, Any]]:
        """Return the numbers, one record per row."""

    def to_dataframe(self) -> Any:
        """Return `records` as a pandas DataFrame (extra xarray)."""
        return pandas_frame(self.records())

    def __repr__(self) -> str:
        lines = self.answer()
        more = [f"… {len(lines) - MOST_LINES + 1} more lines"] if len(lines) > MOST_LINES else []
        return "\n".join([*lines[: MOST_LINES - len(more)], *more])

    def _repr_html_(self) -> str:
        rows = self.records()
        names = list(dict.fromkeys(name for row in rows for name in row if row[name] is not None))
        lines = ["".join(f"<th>{escape(str(name))}</th>" for name in names)]
        for row in rows[:MOST_LINES]:
            values = [row.get(name, "") for name in names]
            cells = [brief(value) if isinstance(value, float) else str(value) for value in values]
            lines.append("".join(f"<td>{escape(cell)}</td>" for cell in cells))
        table = "".join(f"<tr>{line}</tr>" for line in lines)
        more = f"<p>… {len(rows) - MOST_LINES} more rows</p>" if len(rows) > MOST_LINES else ""
        nested = any(isinstance(value, list | dict) for row in rows for value in row.values())
        is_short = " open" if len(rows) <= SHOWN_AT_ONCE and not nested else ""
        head = f"<details{is_short}><summary>{count_of(len(rows), 'row')}</summary>"
        return f"<pre>{escape(repr(self))}</pre>{head}<table>{table}</table>{more}</details>"


def count_of(number: int, noun: str) -> str:
    """Return a count with its noun: ``1 run``, ``200 runs``."""
    return f"{number} {noun}{'' if number == 1 else 's'}"


NOTHING = 1e-30
"""Sizes that are written as 0: nothing physical is so small beside errors of rounding."""


def significant(value: float, digits: int = 4) -> str:
    """A number with so many digits, zeros at its end among them; ``-`` if there is none."""
    if not math.isfinite(value):
        return "-"
    if abs(value) < NOTHING:
        return "0"
    text = f"{value:.{digits - 1}e}"
    size = int(text.partition("e")[2])
    if not -3 <= size < 6:
        return text
    return f"{value:.{max(0, digits - 1 - size)}f}"


def brief(value: float, digits: int = 4) -> str:
    """A number with at most so many digits."""
    return f"{0.0 if abs(value) < NOTHING else value:.{digits}g}"


def percent(share: float, *, signed: bool = False) -> str:
    """Return a share in per cent with one decimal place, or with one digit if that is all 0."""
    is_small = 5e-9 < abs(share) < 1
    digits = max(1, -math.floor(math.log10(100 * abs(share)))) if is_small else 1
    return f"{fixed(100 * share, min(digits, 6), signed=signed)} %"


def fixed(value: float, digits: int, *, signed: bool = False) -> str:
    """Format a number with decimal places, 0 without a sign; - if not finite."""
    if not math.isfinite(value):
        return "-"
    text = f"{value:{'+' if signed else ''}.{digits}f}"
    return text.lstrip("+-") if float(text) == 0 else text
