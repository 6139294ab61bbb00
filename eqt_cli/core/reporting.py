"""How far eqt is, and what a user should know; what computes does not know who shows it."""

from __future__ import annotations

import inspect
import warnings
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from contextvars import ContextVar
from pathlib import Path

from eqt_cli.core.errors import EqtWarning

RUNS_DONE = "runs"
"""What most steps count."""

_PACKAGE = str(Path(__file__).parents[1])


class Reporter:
    """Hears of the work that eqt does; this one shows nothing, and passes remarks on as warnings.

    Override what you want to show, and put it in place with `reporting`.

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
        """A step begins: what it counts, such as ``runs``, and how many there are."""

    def advance(self, amount: float) -> None:
        """So much more of the step is done, in fractions of what it counts."""

    def skip(self, amount: float) -> None:
        """So much of the step was done by earlier sessions."""

    def end(self) -> None:
        """The step ends, finished or not."""

    def note(self, about: str, words: str) -> None:
        """What was found so far about something, such as a law that is tuned."""

    def busy(self, words: str) -> AbstractContextManager[None]:
        """What the block does cannot be counted, such as compiling."""
        return nullcontext()

    def remark(self, warning: EqtWarning) -> None:
        """Something is worth knowing and no error."""
        warnings.warn(warning, stacklevel=_frames_of_eqt())


class _Step(Reporter):
    """Passes on what is said within a step; of further steps only those that count the same."""

    def __init__(self, to: Reporter, what: str, counts: bool) -> None:
        self.to, self.what, self.counts = to, what, counts

    def advance(self, amount: float) -> None:
        if self.counts:
            self.to.advance(amount)

    def skip(self, amount: float) -> None:
        if self.counts:
            self.to.skip(amount)

    def note(self, about: str, words: str) -> None:
        self.to.note(about, words)

    def busy(self, words: str) -> AbstractContextManager[None]:
        return self.to.busy(words)

    def remark(self, warning: EqtWarning) -> None:
        self.to.remark(warning)


_current: ContextVar[Reporter | None] = ContextVar("reporter", default=None)
_DEFAULT = Reporter()


def reporter() -> Reporter:
    """Who is to be told."""
    return _current.get() or _DEFAULT


@contextmanager
def reporting(to: Reporter) -> Iterator[None]:
    """Tell a reporter of all that eqt does in the block: how far it is, and what is worth knowing.

    Parameters
    ----------
    to
        Who is told, of a class derived from `Reporter`.

    Returns
    -------
    context manager
        For a ``with`` statement; blocks may be nested, and the innermost counts.

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
def step(what: str, count: int) -> Iterator[None]:
    """Count something in the block, by `reporter().advance`.

    A step within another one is not told, or it counts towards that if it counts the same: the runs
    of an experiment are among those of a search.
    """
    around = reporter()
    if isinstance(around, _Step):
        with reporting(_Step(around.to, around.what, around.counts and around.what == what)):
            yield
        return
    around.begin(what, count)
    try:
        with reporting(_Step(around, what, counts=True)):
            yield
    finally:
        around.end()


def _frames_of_eqt() -> int:
    """How many frames of the stack are eqt's, so that a warning names the line that called it."""
    frame, count = inspect.currentframe(), 0
    while frame is not None and frame.f_code.co_filename.startswith(_PACKAGE):
        frame, count = frame.f_back, count + 1
    return count
