"""Gates: whether numbers became worse by more than a margin, by one-sided bounds, and in words.

Knows neither results nor flights: who has a change and its bounds makes a `Finding`.
"""

from __future__ import annotations

import math
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

from eqt_cli.analysis.intervals import UNKNOWN, Interval
from eqt_cli.base import units
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import count_of, fixed

TWO_SIDED = 0.90
"""Confidence of an interval whose ends are both one-sided bounds of 95 %."""

Outcome = StrEnum("Outcome", {"WORSE": "worse", "NOT_SHOWN": "not shown", "HOLDS": "holds"})
"""What the bounds of a change say of a margin, the worst first."""

_RULE = re.compile(r"(\S.*?)\s+worse\s+by\s+(-?\d*\.?\d+(?:e-?\d+)?)\s*([^\d\s.,].*)?")


class Rule(NamedTuple):
    """A number that must not become worse by more than a margin.

    Attributes
    ----------
    metric
        Its name. ``worse`` and ``failed`` without a margin: no number may be called worse, and no
        run may fail that did not fail before.
    margin, unit
        The margin and its unit: ``%`` of the mean before, ``points`` of 100 for shares, or a unit
        of the number; empty for a pure number.
    """

    metric: str
    margin: float = math.inf
    unit: str = ""

    def __str__(self) -> str:
        """The rule as a user writes it."""
        by = f" worse by {self.margin:g} {self.unit}".rstrip()
        return self.metric + by * (self.margin < math.inf)

    def factor(self, unit: str, *, is_share: bool = False) -> float:
        """Return the factor from a change to the unit of the margin.

        The change is in the unit of the number, or a fraction for ``%`` and ``points``.

        Parameters
        ----------
        unit
            Unit of the number; empty or 1 of a pure one.
        is_share
            Whether it is a share of runs or of time, whose margin is in points.

        Raises
        ------
        EqtError
            If the margin has another unit.
        """
        is_fraction = self.unit == ("points" if is_share else "%")
        ratio = 100.0 if is_fraction else units.factor(unit or "1", self.unit or "1")
        if ratio is None or (is_share and not is_fraction):
            number = "a number without a unit" if unit in ("", "1") else units.offered(unit)
            or_number = f"%, or {number}" if unit != "mixed" else "%"
            expected = "points of 100, as 2 points" if is_share else or_number
            raise EqtError(f"'{self}': expected a margin in {expected}")
        return ratio


def rules_of(texts: Sequence[str]) -> list[Rule]:
    """Parse ``METRIC worse by MARGIN``, ``worse`` and ``failed``.

    Raises
    ------
    EqtError
        If a text is none of these, or its margin is not above 0.
    """
    rules = [Rule(text) for text in texts if text in ("worse", "failed")]
    for text in (text for text in texts if text not in ("worse", "failed")):
        if not (match := _RULE.fullmatch(text.strip())):
            expected = "METRIC worse by MARGIN, as 'effort worse by 5 %'; or worse; or failed"
            raise EqtError(f"'{text}': expected {expected}")
        if not 0 < float(match[2]) < math.inf:
            advice = "`eqt diff` tests whether two results are equal"
            raise EqtError(f"'{text}': expected a margin above 0; {advice}")
        rules.append(Rule("_".join(match[1].split()), float(match[2]), (match[3] or "").strip()))
    return rules


@dataclass(frozen=True)
class Finding:
    """A rule and its evidence: the bounds by which it holds or not.

    Attributes
    ----------
    rule
        The rule. Those without a margin have findings only of what is worse.
    number
        The number in words: ``EqT: mean attitude error``.
    change
        The number now minus the one before, in the unit of the margin. Its ends are one-sided
        bounds of 95 % (`TWO_SIDED`); NaN with too few pairs.
    pairs, to_show
        How many pairs it rests on, and how many would show that it holds if nothing changed.
    is_gain
        Whether higher numbers are better.
    why
        What stands in the place of numbers.
    noun
        What a pair is: ``run``, ``flight``.
    names
        Names of the number and what has it, for programs.
    """

    rule: Rule
    number: str
    change: Interval = UNKNOWN
    pairs: int = 0
    to_show: int | None = None
    is_gain: bool = False
    why: str = ""
    noun: str = "run"
    names: Mapping[str, str] = field(default_factory=dict)

    @property
    def outcome(self) -> Outcome:
        """*Holds* if both bounds are within the margin on the worse side, *worse* if none is.

        Else it is *not shown*.
        """
        low, high = sorted(-end if self.is_gain else end for end in self.change[1:])
        if low > self.rule.margin or self.rule.margin == math.inf:
            return Outcome.WORSE
        return Outcome.HOLDS if high <= self.rule.margin else Outcome.NOT_SHOWN

    def __str__(self) -> str:
        """``holds: EqT: effort not worse by 5 %: +1.4 %, at most +4.1 % (95 %)``."""
        is_worse, text = self.outcome is Outcome.WORSE, self.why
        if not self.why:
            is_upper = is_worse == self.is_gain
            bound = self.change.high if is_upper else self.change.low
            text = f"no bound from {count_of(self.pairs, self.noun)}"
            if math.isfinite(bound):
                text = f"at {'most' if is_upper else 'least'} {self._written(bound)} (95 %)"
            says = "worse by more than" if is_worse else "not worse by"
            margin = str(self.rule).partition(" by ")[2]
            text = f"{says} {margin}: {self._written(self.change.value)}, {text}"
        worsening = -self.change.value if self.is_gain else self.change.value
        if self.to_show and self.outcome is Outcome.NOT_SHOWN and worsening <= self.rule.margin:
            text += f"; {count_of(self.to_show, self.noun)} would show it if nothing changed"
        return f"{self.outcome}: {self.number}{':' if self.why else ''} {text}"

    def _written(self, value: float) -> str:
        """Return a number to a tenth of the first digit of the margin, and more beside it."""
        digits = max(0, 1 - math.floor(math.log10(self.rule.margin)))
        if math.isfinite(value) and round(abs(value), digits) == self.rule.margin:
            digits += 2
        return f"{fixed(value, digits, signed=True).replace('-', '−')} {self.rule.unit}".rstrip()

    def record(self) -> dict[str, Any]:
        """Return the finding for programs."""
        words = {"rule": str(self.rule), "outcome": self.outcome, "words": str(self)}
        numbers = {"pairs": self.pairs, "pairs_to_show": self.to_show, "margin": self.rule.margin}
        return {**self.names, **words, **self.change._asdict(), **numbers, "unit": self.rule.unit}


def passes(findings: Sequence[Finding], *, undecided: bool = False) -> bool:
    """Whether every rule holds; with `undecided`, also if some are not shown."""
    allowed = {Outcome.HOLDS, Outcome.NOT_SHOWN} if undecided else {Outcome.HOLDS}
    return all(finding.outcome in allowed for finding in findings)


def outcome(
    findings: Sequence[Finding], *, undecided: bool = False
) -> tuple[bool, dict[str, Any], list[str]]:
    """Return whether a gate passes, a record of it for programs, and its lines."""
    is_open = passes(findings, undecided=undecided)
    record = {"passes": is_open, "findings": [finding.record() for finding in findings]}
    return is_open, record, lines(findings, undecided=undecided)


def lines(findings: Sequence[Finding], *, undecided: bool = False) -> list[str]:
    """Say whether the gate passes, and then each finding, the worst first."""
    ranked = sorted(findings, key=lambda finding: list(Outcome).index(finding.outcome))
    counts = Counter(finding.outcome for finding in ranked)
    word = "passes" if passes(findings, undecided=undecided) else "fails"
    though = " although not shown" if word == "passes" and counts[Outcome.NOT_SHOWN] else ""
    parts = [f"{n} {'hold' if n > 1 and o == 'holds' else o}" for o, n in counts.items() if n]
    return [f"gate {word}{though}: {', '.join(parts) or 'nothing failed'}", *map(str, ranked)]
