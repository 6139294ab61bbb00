"""Which share of pairs predictions order as flights do, against plain programs and closed forms."""

from itertools import combinations

import numpy as np
import pytest
from said import says

from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights.agreement import Row, Verdict, agreement


def rows_of(measured, predicted, gains=None, condition=None, day=None, law=None, variants=None):
    """A flight of each setting, of logarithms of errors."""
    n = len(measured)
    gains = np.zeros((n, 0)) if gains is None else np.asarray(gains)
    return [
        Row(
            f"{k}.csv",
            law[k] if law else "a",
            law[k] if law else f"{k}",
            condition[k] if condition else "",
            f"{day[k]}" if day is not None else "",
            float(np.exp(measured[k])),
            float(np.exp(predicted[k])),
            {f"g{j}": float(x) for j, x in enumerate(gains[k])},
            {name: float(np.exp(x[k])) for name, x in (variants or {}).items()},
        )
        for k in range(n)
    ]


def normal(rng, n, rho):
    """Measured and predicted logarithms with a correlation."""
    x, y = rng.normal(size=(2, n))
    return rho * x + np.sqrt(1 - rho**2) * y, x


def share(rng, n, rho, days, size):
    """The agreement of one simulated set; settings of a day share an error of this size."""
    measured, predicted = normal(rng, n, rho)
    day = np.arange(n) % days if days else None
    shared = size * rng.normal(size=max(days, 1))
    measured = measured + (shared[day] if days else 0.0)
    return agreement(rows_of(measured, predicted, day=day), 0.0).share


def test_the_share_and_the_best_number_are_those_of_a_plain_program():
    rng = np.random.default_rng(0)
    gains = rng.normal(size=(12, 3))
    measured = gains @ [1.0, -2.0, 0.5] + rng.normal(size=12)
    predicted = measured + rng.normal(size=12)
    of = agreement(rows_of(measured, predicted, gains), 0.3)
    right, by_gain = [], []
    for i, j in combinations(range(12), 2):
        if abs(predicted[i] - predicted[j]) < np.log(1.3):
            continue
        others = [p for p in combinations(range(12), 2) if not {i, j} & {*p}]
        sums = [
            sum(
                np.sign((gains[a, g] - gains[b, g]) * (measured[a] - measured[b]))
                for a, b in others
            )
            for g in range(3)
        ]
        g = int(np.argmax(np.abs(sums)))
        sign = np.sign(measured[i] - measured[j])
        right.append(np.sign(predicted[i] - predicted[j]) == sign)
        by_gain.append(np.sign(sums[g] * (gains[i, g] - gains[j, g])) == sign)
    assert of.pairs == len(right)
    assert of.share.value == pytest.approx(np.mean(right))
    assert {null.name: null.share for null in of.nulls} == {
        "all equal": 0.5,
        "best single number": pytest.approx(np.mean(by_gain)),
    }


def test_the_order_in_other_conditions_is_a_rule():
    rng = np.random.default_rng(1)
    law = [*"abcdef"] * 3
    condition = [f"{c}" for c in range(3) for _ in range(6)]
    measured, predicted = rng.normal(size=(2, 18))
    of = agreement(rows_of(measured, predicted, condition=condition, law=law), 0.0)
    table, right = measured.reshape(3, 6), []
    for c, (i, j) in ((c, p) for c in range(3) for p in combinations(range(6), 2)):
        elsewhere = [table[k, i] - table[k, j] for k in range(3) if k != c]
        right.append(np.sign(sum(elsewhere)) == np.sign(table[c, i] - table[c, j]))
    assert of.nulls[-1].name == "the order in other conditions"
    assert of.nulls[-1].share == pytest.approx(np.mean(right))


@pytest.mark.ci("simulates 2000 sets of flights")
@pytest.mark.parametrize(
    ("n", "rho", "days", "size"),
    [(12, 0.8, 0, 0), (40, 0.5, 0, 0), (20, 0.95, 0, 0), (40, 0.8, 5, 1)],
)
def test_intervals_cover_the_share_in_92_to_98_of_100_sets(n, rho, days, size):
    # Of normal variables with correlation ρ, ½ + asin(ρ)/π of the pairs are concordant (Kruskal);
    # errors that a day shares lower ρ between the days
    low = rho / np.sqrt(1 + size**2) if days else rho
    within = (n / days - 1) / (n - 1) if days else 1.0
    truth = 0.5 + (within * np.arcsin(rho) + (1 - within) * np.arcsin(low)) / np.pi
    sets = [share(np.random.default_rng(k), n, rho, days, size) for k in range(500)]
    covered = np.mean([one.low <= truth <= one.high for one in sets])
    assert 0.92 <= covered <= 0.98


def test_what_flights_say_of_a_right_a_wrong_and_a_simple_model():
    rng = np.random.default_rng(2)
    gains = rng.uniform(-1, 1, size=(30, 3))
    truth = gains[:, 0] * gains[:, 1] + 0.1 * gains[:, 2]  # no gain orders it
    noise = 0.02 * rng.normal(size=30)
    right = agreement(rows_of(truth + noise, truth, gains))
    assert right.verdict is Verdict.CONFIRMED
    assert right.best.share < 0.7 < right.share.low
    assert agreement(rows_of(truth + noise, -truth, gains)).verdict is Verdict.CONTRADICTED
    simple = gains[:, 2] + noise
    knows = agreement(rows_of(simple, gains[:, 2], gains))
    assert knows.share.value > 0.9
    assert knows.verdict is Verdict.NOT_SHOWN
    again = agreement(rows_of(truth + noise, truth, gains, variants={"mass +25 %": truth}))
    assert (again.verdict, again.plant) == (Verdict.CONFIRMED, Verdict.NOT_SHOWN)


def test_levels_and_the_difference_to_trust():
    rng = np.random.default_rng(3)
    truth = rng.normal(size=40)
    of = agreement(rows_of(truth + 0.02 * rng.normal(size=40), truth + np.log(0.5)))
    assert of.level.value == pytest.approx(0.5, rel=0.02)
    assert of.level.low < 0.5 < of.level.high
    assert of.spread == pytest.approx(np.exp(0.02), rel=0.01)
    assert of.trusted < 0.1
    assert of.trusted_share > 0.95
    assert of.rank > 0.99


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        (rows_of(np.arange(4.0), np.arange(4.0)), "4 settings were flown; expected at least 5…"),
        (rows_of(np.arange(6.0), np.ones(6)), "no two settings…5 % apart…0 %…"),
        (rows_of(np.arange(6.0), np.arange(6.0), law=[*"abcdef"]), "one flight of each law…"),
        (
            rows_of(np.arange(6.0), np.arange(6.0), condition=[*"abcdef"], gains=np.ones((6, 1))),
            "no two settings were flown in one condition…",
        ),
        (rows_of([0, 1, 2, 3, -np.inf], np.ones(5)), "4.csv: measured:…above 0…"),
    ],
)
def test_rows_that_show_nothing(rows, message):
    with pytest.raises(EqtError) as refused:
        agreement(rows)
    assert says(str(refused.value), message)
