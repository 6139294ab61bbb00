"""How well predictions order settings as flights do, beside rules that need no simulation.

It takes a table with a row for a flight and knows no model, law or file.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import InputError

FEWEST_SETTINGS = 5
"""Number of settings from which an interval, and a verdict, is given."""

LEAST = 0.05
"""Default least predicted difference of two settings that are compared, as a share."""

LEVEL = 0.95
"""Of all intervals."""

RIGHT, FEWEST_PAIRS = 0.9, 10
"""Share of right signs at which a predicted difference is to be trusted, and the least number of
pairs of other settings that say so."""

SIZES = (0.0, 0.02, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5, 1.0)
"""Predicted differences among which the one to be trusted is chosen."""

INDEPENDENT = 6
"""Most pairs that count as independent, for each setting: so many leave an interval where no pair
has the wrong sign, and no jackknife says anything."""

HALF = 0.5
"""Settings that count as right and as wrong, in addition. With it, 93 to 97 of 100 intervals of
simulated sets hold the share, for 6 to 40 settings and shares of 0.5 to 0.94.
"""

EQUAL, OTHER_CONDITIONS, SINGLE = "all equal", "the order in other conditions", "best single number"


class Verdict(StrEnum):
    """What flights say of predictions."""

    CONFIRMED = "confirmed"
    CONTRADICTED = "contradicted"
    NOT_SHOWN = "not shown"


class Row(NamedTuple):
    """A flight.

    Attributes
    ----------
    flight, law, setting, condition, day
        Its name, its law, the law with its gains, what it shares with others, and when it was
        flown. Settings are compared within a condition; flights of a day share what is unknown.
    measured, predicted
        The size of its error, flown and simulated, in one unit.
    gains
        Numbers that a rule may order settings by, such as gains, without any simulation.
    variants
        The error that wrong models predict, by the name of what is wrong.
    """

    flight: str
    law: str
    setting: str
    condition: str
    day: str
    measured: float
    predicted: float
    gains: Mapping[str, float] = {}
    variants: Mapping[str, float] = {}


class Share(NamedTuple):
    """A share with its 95 % interval, which is NaN where none is given."""

    value: float
    low: float = np.nan
    high: float = np.nan


class Null(NamedTuple):
    """A rule beside the simulation.

    Attributes
    ----------
    name
        What it is.
    share
        Its share of right signs, of the same pairs; a pair that it does not order counts one half.
    choice
        The number that it chose for most pairs, with the sign: ``−kp`` means that more is better.
    """

    name: str
    share: float
    choice: str = ""


@dataclass(frozen=True)
class Agreement:
    """How predictions agree with flights.

    Attributes
    ----------
    flights, settings, laws, conditions, days
        Their numbers.
    pairs
        Number of pairs of settings in a condition whose predicted difference is at least `least`.
    share
        The share of these pairs that flights order as predicted.
    nulls
        Rules that need no simulation, for the same pairs.
    variants
        Models that are wrong by a quarter, for the same pairs.
    verdict, plant
        What flights say of the order, against the best rule; and of the plant, against the best of
        the rules and the wrong models.
    rank
        Spearman's correlation of predicted and measured errors, the mean over conditions.
    level, spread, spread_flown
        Predicted over measured error, geometric mean, with its interval; its scatter as a factor;
        and the scatter of the measured errors about their mean in a condition.
    trusted, trusted_share, trusted_pairs
        The predicted difference above which signs were right in nine of ten pairs of other
        settings, its share and number of pairs; NaN if there is none.
    """

    flights: int
    settings: int
    laws: int
    conditions: int
    days: int
    pairs: int
    least: float
    share: Share
    nulls: list[Null]
    variants: list[Null]
    verdict: Verdict
    plant: Verdict | None
    rank: float
    level: Share
    spread: float
    spread_flown: float
    trusted: float
    trusted_share: float
    trusted_pairs: int
    notes: list[str] = field(default_factory=list)

    @property
    def best(self) -> Null:
        """The best rule."""
        return max(self.nulls, key=lambda null: null.share)

    @property
    def best_variant(self) -> Null | None:
        """The wrong model that orders best."""
        return max(self.variants, key=lambda null: null.share, default=None)


def agreement(rows: Sequence[Row], least: float = LEAST) -> Agreement:
    """Compare predictions with flights.

    Raises
    ------
    InputError
        If there are fewer than `FEWEST_SETTINGS` settings, an error that is no positive number, or
        no pair of settings in one condition whose predictions differ.
    """
    _check(rows)
    flown = _Flown.of(rows)
    pairs = flown.pairs(np.ones(len(rows)))
    chosen = abs(pairs.predicted) >= np.log1p(least)
    if not chosen.any():
        most = np.expm1(abs(pairs.predicted).max(initial=0.0))
        if not len(pairs.first):
            why = "no two settings were flown in one condition"
        else:
            why = f"no two settings in one condition are predicted {100 * least:g} % apart, at most"
            why += f" {100 * most:.2g} %"
        raise InputError(f"{why}; nothing is ordered")
    value = float(_right(pairs.predicted, pairs.measured)[chosen].mean())
    low, high, notes = _interval(flown, value, least)
    numbers, choice = _single(pairs, flown)
    nulls = [Null(EQUAL, 0.5)]
    if len(flown.names):
        nulls.append(Null(SINGLE, float(_right(numbers, pairs.measured)[chosen].mean()), choice))
    if len({*flown.condition.tolist()}) > 1:
        others = _elsewhere(pairs)
        share = float(_right(others, pairs.measured)[chosen].mean())
        nulls.append(Null(OTHER_CONDITIONS, share))
    variants = [
        Null(name, float(_right(predicted, pairs.measured)[chosen].mean()))
        for name, predicted in zip(flown.variant_names, pairs.variants, strict=True)
    ]
    verdict = _verdict(low, high, nulls)
    return Agreement(
        len(rows),
        len({*flown.setting.tolist()}),
        len({row.law for row in rows}),
        len({*flown.condition.tolist()}),
        len({row.day for row in rows if row.day}),
        int(chosen.sum()),
        least,
        Share(value, low, high),
        nulls,
        variants,
        verdict,
        _verdict(low, high, [*nulls, *variants]) if variants else None,
        _rank(flown),
        *_levels(flown),
        *_trusted(pairs),
        notes,
    )


def _check(rows: Sequence[Row]) -> None:
    """Refuse rows that no statistics can be of."""
    for row in rows:
        sizes = {"measured": row.measured, "predicted": row.predicted} | dict(row.variants)
        for name, size in sizes.items():
            if not (np.isfinite(size) and size > 0):
                raise InputError(f"{row.flight}: {name}: expected an error above 0, got {size:g}")
    settings = {row.setting for row in rows}
    if len(settings) < FEWEST_SETTINGS:
        raise InputError(
            f"{len(settings)} settings were flown; expected at least {FEWEST_SETTINGS}, because "
            "intervals are by settings: add flights of other gains or laws"
        )
    flights_per_law = len(rows) / len({row.law for row in rows})
    if flights_per_law == 1 and not any(row.gains for row in rows):
        raise InputError(
            "one flight of each law: how much flights of a law differ is unknown; add flights of "
            "the same laws in other conditions, or columns with their gains"
        )


def _verdict(low: float, high: float, nulls: Sequence[Null]) -> Verdict:
    if low > max(null.share for null in nulls):
        return Verdict.CONFIRMED
    return Verdict.CONTRADICTED if high < 0.5 else Verdict.NOT_SHOWN


# Pairs --------------------------------------------------------------------------------------------


class _Pairs(NamedTuple):
    """Two settings in a condition: differences of the logarithms of their mean errors.

    Attributes
    ----------
    first, second : (k,)
        The settings.
    condition : (k,)
        Where both were flown.
    measured, predicted : (k,)
        The differences, first less second.
    variants, numbers : (v, k), (g, k)
        Those of wrong models, and of the numbers that rules may read.
    """

    first: Array
    second: Array
    condition: Array
    measured: Array
    predicted: Array
    variants: Array
    numbers: Array

    def others(self, values: Array) -> Array:
        """Return sums of values over all pairs without the two settings of a pair, ``(n, k)``."""
        count = int(max(self.second.max(), self.first.max())) + 1
        table = np.zeros((len(values), count, count))
        for one, into in zip(values, table, strict=True):
            np.add.at(into, (self.first, self.second), one)
        table = table + table.swapaxes(1, 2)
        of_one, whole = table.sum(axis=2), table.sum(axis=(1, 2)) / 2
        both = table[:, self.first, self.second]
        sums: Array = whole[:, None] - of_one[:, self.first] - of_one[:, self.second] + both
        return sums


class _Flown(NamedTuple):
    """The rows as arrays: indices of setting, condition and day, and logarithms of errors."""

    setting: Array
    condition: Array
    day: Array
    measured: Array
    predicted: Array
    variants: Array
    numbers: Array
    names: list[str]
    variant_names: list[str]
    is_day: bool

    @classmethod
    def of(cls, rows: Sequence[Row]) -> "_Flown":
        def index(texts: Sequence[str]) -> Array:
            return np.unique(texts, return_inverse=True)[1]

        names = sorted({name for row in rows for name in row.gains})
        numbers = np.array([[row.gains.get(name, np.nan) for row in rows] for name in names])
        numbers = numbers.reshape(len(names), len(rows))
        differ = [k for k, x in enumerate(numbers) if np.isfinite(x).all() and np.ptp(x) > 0]
        variants = sorted({*rows[0].variants})
        wrong = np.array([[row.variants[name] for row in rows] for name in variants])
        return cls(
            index([row.setting for row in rows]),
            index([row.condition for row in rows]),
            index([row.day for row in rows]),
            np.log([row.measured for row in rows]),
            np.log([row.predicted for row in rows]),
            np.log(wrong.reshape(len(variants), len(rows))),
            numbers[differ],
            [names[k] for k in differ],
            variants,
            all(row.day for row in rows),
        )

    def cells(self, weights: Array) -> tuple[Array, Array, Array]:
        """Return setting and condition of all means, and the means of all values, ``(n, c)``."""
        count = int(self.condition.max()) + 1
        which = self.setting * count + self.condition
        cells = np.unique(which[weights > 0])
        values = np.concatenate(
            [self.measured[None], self.predicted[None], self.variants, self.numbers]
        )
        total = np.bincount(which, weights)[cells]
        sums = np.array([np.bincount(which, weights * x)[cells] for x in values])
        return cells // count, cells % count, sums / total

    def pairs(self, weights: Array) -> _Pairs:
        """Return all pairs of settings of flights with a weight."""
        setting, condition, means = self.cells(weights)
        i, j = np.triu_indices(len(setting), 1)
        same = condition[i] == condition[j]
        i, j = i[same], j[same]
        x, count = means[:, i] - means[:, j], len(self.variants)
        parts = x[0], x[1], x[2 : 2 + count], x[2 + count :]
        return _Pairs(setting[i], setting[j], condition[i], *parts)


def _right(said: Array, measured: Array) -> Array:
    """Return 1 where two signs agree, 0 where they differ, and ½ where one of them is 0."""
    score: Array = (1.0 + np.sign(said) * np.sign(measured)) / 2.0
    return score


def _single(pairs: _Pairs, flown: _Flown) -> tuple[Array, str]:
    """Return how the best number orders pairs: chosen, with its sign, by all other settings."""
    if not len(flown.names):
        return np.zeros_like(pairs.measured), ""
    signs = np.sign(pairs.numbers) * np.sign(pairs.measured)
    sums = pairs.others(signs)
    best = abs(sums).argmax(axis=0)
    column = np.arange(len(best))
    way = np.sign(sums[best, column])
    said: Array = way * pairs.numbers[best, column]
    most = int(np.bincount(best).argmax())
    more_is_better = way[best == most].sum() < 0
    return said, f"{'−' if more_is_better else ''}{flown.names[most]}"


def _elsewhere(pairs: _Pairs) -> Array:
    """Return the mean difference of two settings in other conditions; 0 if there is none."""
    count = int(max(pairs.second.max(), pairs.first.max())) + 1
    which = pairs.first * count + pairs.second
    sums = np.bincount(which, pairs.measured)[which] - pairs.measured
    return np.where(np.bincount(which)[which] > 1, sums, 0.0)


def _trusted(pairs: _Pairs) -> tuple[float, float, int]:
    """Return the predicted difference to trust, learned on other settings, its share and pairs."""
    right, sizes = _right(pairs.predicted, pairs.measured), np.log1p(SIZES)
    inside = abs(pairs.predicted) >= sizes[:, None]
    counts = pairs.others(inside.astype(float))
    shares = pairs.others(inside * right) / np.maximum(counts, 1)
    fits = (shares >= RIGHT) & (counts >= FEWEST_PAIRS)
    least = np.where(fits.any(axis=0), sizes[fits.argmax(axis=0)], np.inf)
    counted = abs(pairs.predicted) >= least
    if not counted.any():
        return np.nan, np.nan, 0
    size = float(np.expm1(np.median(least[np.isfinite(least)])))
    return size, float(right[counted].mean()), int(counted.sum())


# Levels and intervals -----------------------------------------------------------------------------


def _rank(flown: _Flown) -> float:
    """Return Spearman's correlation over settings, the mean over conditions of three or more."""
    from scipy.stats import spearmanr  # slow to import

    _, condition, means = flown.cells(np.ones(len(flown.setting)))
    ranks, counts = [], []
    for k in np.unique(condition):
        x, y = means[:2, condition == k]
        if len(x) > 2 and np.ptp(x) > 0 and np.ptp(y) > 0:
            ranks.append(float(spearmanr(x, y)[0]))
            counts.append(len(x))
    return float(np.average(ranks, weights=counts)) if ranks else np.nan


def _levels(flown: _Flown) -> tuple[Share, float, float]:
    """Return predicted over measured errors, its scatter, and that of measured errors."""
    weights = np.ones(len(flown.setting))

    def level(weights: Array) -> float:
        means = flown.cells(weights)[2]
        return float((means[1] - means[0]).mean())

    value = level(weights)
    half = _half_width(flown, weights, level)
    _, condition, means = flown.cells(weights)
    ratios, within = means[1] - means[0], means[0].copy()
    for k in np.unique(condition):
        within[condition == k] -= within[condition == k].mean()
    ends = (float(np.exp(value + x)) for x in (0.0, -half, half))
    return Share(*ends), float(np.exp(ratios.std(ddof=1))), float(np.exp(within.std(ddof=1)))


def _interval(flown: _Flown, value: float, least: float) -> tuple[float, float, list[str]]:
    """Return the ends of the interval of the share of right signs.

    On the scale of logits, moved away from 0 and 1 by a part of a setting, by a jackknife over
    settings and days.
    """
    size, effective = np.log1p(least), len({*flown.setting.tolist()})

    def logit(weights: Array) -> float:
        pairs = flown.pairs(weights)
        chosen = abs(pairs.predicted) >= size
        if not chosen.any():
            return 0.0
        x = _right(pairs.predicted, pairs.measured)[chosen].mean()
        x = (x * effective + HALF) / (effective + 2 * HALF)
        return float(np.log(x / (1.0 - x)))

    weights = np.ones(len(flown.setting))
    centre, shrunk = logit(weights), (value * effective + HALF) / (effective + 2 * HALF)
    least_variance = 1.0 / (INDEPENDENT * effective * shrunk * (1.0 - shrunk))
    half = _half_width(flown, weights, logit, least_variance)
    low, high = (1.0 / (1.0 + np.exp(-centre - x)) for x in (-half, half))
    notes = []
    if not flown.is_day:
        notes.append("no days are given, so that the interval is by settings alone: add a column")
    return min(float(low), value), max(float(high), value), notes


def _half_width(flown: _Flown, weights: Array, statistic: Any, least: float = 0.0) -> float:
    """Return half the width of an interval by leaving out settings and days.

    Of a jackknife over settings, one over days and one over flights, the first two are added and
    the third, which both contain, is subtracted. Quantiles are those of normal numbers: with those
    of Student, a jackknife of shares of pairs is too wide.
    """
    from scipy.special import ndtri  # slow to import

    def variance(groups: Array) -> float:
        values = np.array([statistic(weights * (groups != k)) for k in np.unique(groups)])
        n = len(values)
        return float((n - 1) / n * ((values - values.mean()) ** 2).sum())

    total = by_setting = variance(flown.setting)
    if flown.is_day and len({*flown.day.tolist()}) > 1:
        by_day, by_flight = variance(flown.day), variance(np.arange(len(weights)))
        total = max(by_setting + by_day - by_flight, by_setting, by_day)
    return float(ndtri((1 + LEVEL) / 2) * np.sqrt(max(total, least)))
