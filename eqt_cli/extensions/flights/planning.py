"""How many flights a comparison needs: planned or with looks, in pairs, by a model."""

import math
from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.analysis.intervals import FEWEST, Interval
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable, significant
from eqt_cli.extensions.flights.judging import CONFIDENCE, Design
from eqt_cli.extensions.flights.one_look import LEAST_PAIRS_OF_A_MODEL, drift

LEAST_P_OF_A_DRIFT = 0.05
"""P-value below which a drift is told. It costs little to fly in turns."""


class Planned(NamedTuple):
    """A design, and the flights of each side, or pairs, that decide with probability 0.8.

    Attributes
    ----------
    design
        In words.
    needed, low, high
        With the spread as measured, and at the ends of its interval; None for more than a billion.
    """

    design: str
    needed: int | None
    low: int | None
    high: int | None


class FlightPlan(NamedTuple):
    """How many flights show an effect.

    Attributes
    ----------
    effect
        The relative difference of errors to be found.
    spread
        Standard deviation of the logarithms of the errors of a law, from flight to flight, with its
        95 % interval.
    of_pairs, by_model
        The same of differences in pairs, and of what a model leaves; None if unknown.
    rows
        The designs.
    notes
        What the numbers are, and what the pilot flights say besides.
    """

    effect: float
    spread: Interval
    of_pairs: Interval | None
    by_model: Interval | None
    rows: list[Planned]
    notes: list[str]

    def table(self) -> TextTable:
        """Return the designs."""
        rows = []
        for row in self.rows:
            ends = "" if row.low == row.high else f"[{_counted(row.low)}, {_counted(row.high)}]"
            rows.append([row.design, _counted(row.needed), ends])
        header = ["design", "of each", "if the spread is"]
        return TextTable("plan", "", header, [Block("", rows)], self.notes)


def _counted(needed: int | None) -> str:
    return "-" if needed is None else f"{needed}" if needed < 10_000 else f"{needed:.1g}"


def spread_of(parts: Sequence[Array], lost: int = 0) -> Interval:
    """Return the pooled standard deviation within parts, with its interval by chi-squared.

    `lost` counts degrees of freedom besides the means of the parts.
    """
    from scipy.special import chdtri  # slow to import

    freedom = sum(len(part) - 1 for part in parts) - lost
    if freedom < 1:
        return Interval(math.nan, math.nan, math.nan)
    squares = sum(float(((part - part.mean()) ** 2).sum()) for part in parts)
    tail = (1 - CONFIDENCE) / 2
    ends = (math.sqrt(squares / float(chdtri(freedom, x))) for x in (tail, 1 - tail))
    return Interval(math.sqrt(squares / freedom), *ends)


def planned(
    effect: float,
    spread: Interval,
    of_pairs: Interval | None,
    by_model: Interval | None,
    notes: Sequence[str] = (),
) -> FlightPlan:
    """Return the numbers of flights of all designs.

    Raises
    ------
    EqtError
        If the effect is none.
    """
    if not 0 < effect < math.inf:
        raise EqtError(f"effect: expected a relative difference above 0, as 0.1, got {effect:g}")
    size, rows = math.log1p(effect), list[Planned]()
    of_two = [math.sqrt(2) * x for x in spread]
    designs: list[tuple[str, Sequence[float], Design, int]] = [
        ("flights, planned", of_two, Design(), FEWEST),
        ("flights, a look after each", of_two, Design(blocks=()), 0),
    ]
    if of_pairs:
        designs += [
            ("pairs, planned", of_pairs, Design(paired=True), Design(paired=True).least(1)),
            ("pairs, a look after each", of_pairs, Design(paired=True, blocks=()), 0),
        ]
    if by_model:
        less = [math.sqrt(2) * x for x in by_model]
        designs.append(("flights, planned, with the model", less, Design(), FEWEST))
    for words, deviations, design, least in designs:
        counts = [design.needed(size / x, CONFIDENCE) if x > 0 else least for x in deviations]
        rows.append(Planned(words, *(None if n is None else max(n, least) for n in counts)))
    lines = [*notes]
    share = f"{100 * effect:g} %"
    value, low, high = (significant(100 * x, 2) for x in spread)
    ends = "" if low == high else f" [{low}, {high}]"
    lines.append(
        f"a difference of {share} is found with probability 0.8, at 95 %; errors of a law differ "
        f"by {value} %{ends} from flight to flight (standard deviation of logarithms)"
    )
    return FlightPlan(effect, spread, of_pairs, by_model, rows, lines)


def of_pilot(
    laws: Sequence[Array],
    places: Sequence[Sequence[int]],
    differences: Array | None,
    predictions: Sequence[Array] | None,
) -> tuple[Interval, Interval | None, Interval | None, list[str]]:
    """Return the spreads that pilot flights have, and what they say of drift and model.

    Parameters
    ----------
    laws
        Logarithms of the errors of each law.
    places
        Their numbers in the order flown.
    differences
        Of pairs; None without pairs.
    predictions
        Logarithms of what a model predicts, of each law; None without one.

    Raises
    ------
    EqtError
        If there are fewer than two flights of a law.
    """
    spread, notes = spread_of(laws), [*_drifts(laws, places)]
    if math.isnan(spread.value):
        raise EqtError("pilot: expected two flights of a law, or more, to know how they differ")
    of_pairs = None if differences is None or len(differences) < 2 else spread_of([differences])
    if predictions is None:
        return spread, of_pairs, None, notes
    pairs = [*zip(laws, predictions, strict=True)]
    x, y = (np.concatenate([pair[k] - pair[k].mean() for pair in pairs]) for k in (1, 0))
    slope = float(x @ y / (x @ x)) if x.any() else 0.0
    by_model = spread_of([z - slope * c for z, c in pairs], lost=1)
    size = float(np.sqrt((x @ x) * (y @ y)))
    correlation = float(x @ y) / size if size else 0.0
    words = f"errors and predictions correlate by {correlation:.2f}".replace("-", "−")
    if by_model.value < spread.value:
        gain = (spread.value / by_model.value) ** 2
        notes.append(f"{words}: 10 flights with the model are worth {10 * gain:.0f}")
    else:
        notes.append(f"{words}: the model gives nothing; leave it out")
    notes.append(f"with the model, pairs need to be {LEAST_PAIRS_OF_A_MODEL} or more")
    return spread, of_pairs, by_model, notes


def _drifts(laws: Sequence[Array], places: Sequence[Sequence[int]]) -> Iterator[str]:
    slope, p = drift(laws, places)
    if p <= LEAST_P_OF_A_DRIFT:
        change = f"{100 * math.expm1(slope):+.1f}".replace("-", "−")
        yield (
            f"drift: errors change by {change} % from flight to flight (p {p:.2g}), as by "
            "batteries or wear: fly A and B in turns (ABBA), or in pairs; with A before B, it "
            "looks like a difference"
        )


def record_of(plan: FlightPlan) -> dict[str, Any]:
    """Return the numbers, for programs."""
    spreads = {name: getattr(plan, name) for name in ("spread", "of_pairs", "by_model")}
    return {
        "effect": plan.effect,
        **{name: x and x._asdict() for name, x in spreads.items()},
        "designs": [row._asdict() for row in plan.rows],
        "notes": plan.notes,
    }
