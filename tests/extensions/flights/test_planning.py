"""Planned numbers of flights, against simulated comparisons and plain regressions."""

import math
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml, refusal
from said import says
from scipy import stats

from eqt_cli.extend import EqtError
from eqt_cli.extensions.flights.api import plan_flights
from eqt_cli.extensions.flights.every_look import p_value, pairs
from eqt_cli.extensions.flights.one_look import difference

RNG = np.random.default_rng(0)


def needed(plan):
    return {row.design: (row.needed, row.low, row.high) for row in plan.rows}


def test_planned_flights_find_the_effect_in_four_of_five_comparisons():
    spread, rows = 0.15, needed(plan_flights(0.2, spread=0.15))
    n, looks = (rows[name][0] for name in ("flights, planned", "flights, a look after each"))
    x, y = spread * RNG.normal(size=(2, 4_000, looks)) + np.array([math.log(1.2), 0])[:, None, None]
    ends, _ = difference(x[..., :n], y[..., :n], False, 0.95)
    assert np.mean(ends.low > 0) == pytest.approx(0.8, abs=0.06)
    assert np.mean(p_value(pairs(x - y)) <= 0.05) == pytest.approx(0.8, abs=0.06)


def listed(fly, a, b, columns="file,law,pair"):
    of_a, of_b = fly(a, b)
    rows = [f"{x},new,{k}\n{y},old,{k}" for k, (x, y) in enumerate(zip(of_a, of_b, strict=True))]
    Path("pilot.csv").write_text("\n".join([columns, *rows]))
    return [*of_a, *of_b]


def test_pilot_flights_give_the_spreads(fly):
    a, b = np.exp(0.2 * RNG.normal(size=(2, 8)))
    listed(fly, a, b)
    plan = plan_flights(0.1, "pilot.csv")
    x, y = np.log(a), np.log(b)
    pooled = math.sqrt((x.var(ddof=1) + y.var(ddof=1)) / 2)
    low, high = (pooled * math.sqrt(14 / stats.chi2.ppf(q, 14)) for q in (0.975, 0.025))
    assert plan.spread == pytest.approx((pooled, low, high))
    assert plan.of_pairs.value == pytest.approx(np.std(x - y, ddof=1))
    assert plan.rows[0].needed == plan_flights(0.1, spread=pooled).rows[0].needed
    assert "pairs, a look after each" in needed(plan)


def test_a_model_of_pilot_flights_saves_flights(fly):
    a, b = np.exp(0.2 * RNG.normal(size=(2, 10)))
    files, known = listed(fly, a, b), np.r_[a, b] ** 0.9 * np.exp(0.03 * RNG.normal(size=20))
    rows = [f"{file},{x}" for file, x in zip(files, known, strict=True)]
    Path("model.csv").write_text("\n".join(["file,predicted", *rows]))
    plan = plan_flights(0.1, "pilot.csv", model="model.csv")
    rows = needed(plan)
    assert rows["flights, planned, with the model"][0] < rows["flights, planned"][0] / 4
    side, both = np.repeat([0, 1], 10), np.log(np.r_[a, b])
    columns = np.c_[side == 0, side == 1, np.log(known)]
    rest = np.linalg.lstsq(columns, both, rcond=None)[1][0]
    assert plan.by_model.value == pytest.approx(math.sqrt(rest / 17), rel=1e-4)


def test_a_drift_of_pilot_flights_is_told(fly):
    drift = 0.2 * np.exp(0.05 * np.arange(16) + 0.01 * RNG.normal(size=16))
    listed(fly, drift[::2], drift[1::2])
    assert says(plan_flights(0.1, "pilot.csv").notes[0], "drift: errors change by +5…%…in turns…")


@from_yaml
def test_slips_of_a_plan(fly, arguments, said):
    listed(fly, [0.2], [0.3])
    assert says(refusal(EqtError, plan_flights, **arguments), said)
