"""Steps that take long, each counted under its own name; it does not know who shows them."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass

from eqt_cli.execution.executors.base import Progress

Stage = Callable[[str, int], None]
"""Called with the name and the size of each step that begins."""


def silent(amount: float) -> None:
    """What is done with progress where nobody asks for it."""


def scaled(progress: Progress, share: float) -> Progress:
    """Counts what is a share of the work."""
    return lambda amount: progress(share * amount)


@dataclass(frozen=True)
class Steps:
    """Who is told of steps.

    Attributes
    ----------
    progress
        Called with how much more of the current step is done.
    stage
        Without it, `progress` counts what was there before the first step, and no step.
    """

    progress: Progress = silent
    stage: Stage | None = None

    def begin(self, name: str, count: int) -> Progress:
        """Begin a step of this size; what counts it from now on."""
        if self.stage is None:
            return silent
        self.stage(name, count)
        return self.progress


SILENT = Steps()
"""Nobody is told."""


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Note the wall time of the block, under a name."""
    started = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - started, 3)
