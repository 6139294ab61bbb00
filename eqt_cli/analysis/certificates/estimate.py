"""A filter errs as its covariance says, and what is new in a fix cannot be foreseen."""

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck, Verdict
from eqt_cli.analysis.certificates.flight import DEVIATIONS, rare_mean_squares
from eqt_cli.analysis.evidence.runs import Runs
from eqt_cli.core.arrays import Array

Excess = tuple[float, float, str]
"""How far a number is off, how far it may be, and the number in words."""


class EstimateCheck(TrajectoryCheck):
    """A statement about a filter that has a covariance."""

    def applies(self, runs: Runs) -> bool:
        """To runs whose law reads the estimate of one."""
        return runs.estimate is not None

    def check(self, runs: Runs) -> Row:
        """The number that is largest over its bound."""
        found = list(self.excesses(runs.estimate)) if runs.estimate else []
        if not found:
            remark = runs.remark or "no trajectories are kept"
            return self.row(Verdict.UNDECIDED, remark=remark, controller=runs.label)
        measured, bound, words = max(found, key=lambda each: each[0] / each[1])
        return self.compared(measured, bound, words, runs.label)

    @abstractmethod
    def excesses(self, signals: dict[str, Array]) -> Iterator[Excess]:
        """Numbers of the signals of the runs, ``(runs, samples)`` each."""


class Consistent(EstimateCheck):
    """The mean of NEES over runs and times is its degrees of freedom.

    Errors at two times of a run depend on each other, however much; runs do not. So the mean over
    n runs spreads no more than that of χ² with n times the degrees of freedom.
    """

    name: ClassVar[str] = "estimate errs as its covariance says"
    statement: ClassVar[str] = "NEES within the limits of χ²"
    section: ClassVar[float] = 9.51

    def excesses(self, signals: dict[str, Array]) -> Iterator[Excess]:
        """The mean over the degrees of freedom, less 1."""
        nees, degrees = signals["nees"], signals["nees_dof"]
        if not nees.size:
            return
        mean = float((nees / degrees).mean())
        low, high = rare_mean_squares(float(degrees[:, 0].sum()))
        yield abs(mean - 1), 1 - low if mean < 1 else high - 1, f"NEES is {mean:.3g} times its mean"


class WhiteInnovations(EstimateCheck):
    """Innovations over their own deviations have the mean square 1 and do not foretell the next."""

    name: ClassVar[str] = "innovations are white"
    statement: ClassVar[str] = "mean square 1, correlation 0"
    section: ClassVar[float] = 9.52

    def excesses(self, signals: dict[str, Array]) -> Iterator[Excess]:
        """Their mean square less 1, and the correlation of successive ones, over all runs."""
        count, square, correlation = (
            signals[name][:, -1]
            for name in ("innovations", "innovation_square", "innovation_correlation")
        )
        total = float(count.sum())
        if not total:
            return
        squares = np.where(count > 0, count * square, 0.0)
        mean = float(squares.sum() / total)
        low, high = rare_mean_squares(total)
        words = f"mean square {mean:.3g} of {total:.0f} innovations"
        yield abs(mean - 1), 1 - low if mean < 1 else high - 1, words
        if squares.sum() > 0:
            products = np.where(squares > 0, squares * correlation, 0.0).sum()
            found = float(products / squares.sum())
            yield abs(found), DEVIATIONS / np.sqrt(total), f"correlation {found:.3g}"
