"""The data of a comparison of laws: means, differences of pairs, judged claims, and the answer."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import TYPE_CHECKING, Any

from eqt_cli.analysis.intervals import NEGLIGIBLE, Level, Pair
from eqt_cli.base.reporting import InNotebook
from eqt_cli.results.result import PerRun

if TYPE_CHECKING:
    from eqt_cli.analysis.gate import Finding


class ClaimVerdict(StrEnum):
    """The verdict on a claim."""

    SUPPORTED = "supported"
    NOT_SUPPORTED = "not supported"
    UNDECIDED = "undecided"
    NOT_COVERED = "not covered"
    NOT_COMPARABLE = "not comparable"


@dataclass(frozen=True)
class Judgement:
    """A row of a claim, measured.

    Attributes
    ----------
    source, says
        Source of the claim, and its words.
    verdict
        Verdict for the available runs.
    runs_to_decide
        Number of runs that would decide if all stays as measured; None if no number would.
    pair
        The difference of two controllers, for a claim that one has less than the other.
    measured, controller
        The measure and the controller, for a claim about every run.
    statement
        The claim about every run in words; of laws that are not comparable, how their gains differ.
    held, runs
        Number of runs in which it held, and of runs with a value.
    low
        Lower end of the one-sided interval for the share of runs in which it holds.
    absent
        Kinds of controllers that the claim mentions and the result does not have.
    is_at_home
        Whether the result is the experiment of the source, so that the verdict is told unasked.
    """

    source: str
    says: str
    verdict: ClaimVerdict
    runs_to_decide: int | None
    pair: Pair | None = None
    measured: PerRun | None = None
    controller: str = ""
    statement: str = ""
    held: int = 0
    runs: int = 0
    low: float = float("nan")
    absent: tuple[str, ...] = ()
    is_at_home: bool = True


@dataclass(frozen=True, repr=False)
class Comparison(InNotebook):
    """The outcome of `compare`.

    Attributes
    ----------
    title, group, labels, runs
        Title, group and labels of the result, and its runs per law.
    titles
        Display name of each controller, by label.
    kinds
        Kind of each controller, by label.
    failed
        Number of failed runs of each controller, by label.
    horizon
        Duration of the runs, s.
    levels, pairs
        One row per measure and controller, and per measure and pair of controllers.
    judgements
        One row per claim and measure; empty if no claim applies.
    departures
        How the loop departs from that of the claims, in words; then no claim is judged.
    lyapunov_functions
        Name of each law's function L, by label; empty if it is the same for all.
    not_matched
        Labels of laws whose gains are not matched to those of the others.
    gains
        How stiffness and damping of laws, at the poses that they flew, are not those of their gains
        or of the law that they are compared with, by label.
    resolution
        Largest error estimate of the runs; 0 where none is known. Smaller errors are not judged.
    missing
        Sentences about numbers that could not be computed.
    confidence, resamples, seed
        Settings of the bootstrap.
    negligible
        Relative difference within which there is none.
    points
        Number of points of the sweep of which this is one; tests are corrected for them, too.
    identical
        Whether all runs of every law are identical; then there are no statistics.
    bases
        Of two results: the law of the first with which each law of the second is compared.
    between
        Sentences on two results: whether their runs are pairs, and what differs.
    gate
        Of two results: a finding for each rule and law; None without a gate.
    in_words, in_rows
        How `answer` and `records` follow.
    """

    title: str
    group: str
    labels: list[str]
    titles: dict[str, str]
    runs: int
    kinds: dict[str, str]
    failed: dict[str, int]
    horizon: float
    levels: list[Level]
    pairs: list[Pair]
    missing: list[str]
    confidence: float
    resamples: int
    seed: int
    negligible: float = NEGLIGIBLE
    judgements: Sequence[Judgement] = ()
    departures: str = ""
    lyapunov_functions: Mapping[str, str] = field(default_factory=dict)
    not_matched: Sequence[str] = ()
    gains: Mapping[str, str] = field(default_factory=dict)
    resolution: float = 0.0
    points: int = 1
    identical: bool = False
    bases: Mapping[str, str] = field(default_factory=dict)
    between: Sequence[str] = ()
    gate: Sequence[Finding] | None = None
    in_words: Callable[[Comparison], list[str]] = lambda comparison: []
    in_rows: Callable[[Comparison], list[dict[str, Any]]] = lambda comparison: []

    def answer(self) -> list[str]:
        """Return the experiment, and then what `eqt compare` prints first, in words."""
        return self.in_words(self)

    def records(self) -> list[dict[str, Any]]:
        """Return a record per metric and pair of laws; per metric of a law that is alone.

        Of the pairs with the first law, ``answer`` is the word in `answer`, and ``adjusted_p`` its
        p-value after Holm; ``word`` follows from its row alone.
        """
        return self.in_rows(self)

    def against(self, *bases: str) -> list[Pair]:
        """Return every pair against the law that stands first of both, after these."""
        rank = [*bases, *self.labels].index
        return [p if rank(p.first) > rank(p.second) else p.swapped() for p in self.pairs]
