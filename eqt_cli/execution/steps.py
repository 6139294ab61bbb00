"""Steps that take long, each counted under its own name; it does not know who shows them."""

from collections.abc import Callable
from dataclasses import dataclass

from eqt_cli.execution.executors.base import Progress

Stage = Callable[[str, int], None]
"""Called with the name and the size of each step that begins."""


def _silent(amount: float) -> None:
    """Show nothing."""


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

    progress: Progress = _silent
    stage: Stage | None = None

    def begin(self, name: str, count: int) -> Progress:
        """Begin a step of this size; what counts it from now on."""
        if self.stage is None:
            return _silent
        self.stage(name, count)
        return self.progress


SILENT = Steps()
"""Nobody is told."""
