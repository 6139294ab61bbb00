"""What the runs of a result say of its points: objectives, violated bounds, failed runs."""

from collections.abc import Sequence

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, mean_over_runs
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.search import Constraint


def scores(result: Result, objectives: Sequence[str], constraints: Sequence[Constraint]) -> Scores:
    """The scores of all points of a sweep with one law.

    A run that failed, or has no value, is no part of a mean; its share of all runs violates the
    point. A run whose value lies beyond the horizon counts with the horizon.
    """
    good = result.good[:, 0]
    values = {
        name: result.counted(name)[:, 0]
        for name in {*objectives, *(bound.metric for bound in constraints)}
    }
    missing = ~good
    for each in values.values():
        missing = missing | ~np.isfinite(each)
    violation = missing.mean(axis=1)
    for bound in constraints:
        violation = violation + excess(bound, values[bound.metric])
    means = [QUANTITIES[name].cost(mean_over_runs(values[name])) for name in objectives]
    found = np.stack(means, axis=1)
    settling = result.metric("settling_time")[:, 0]
    return Scores(found, violation, (~good).sum(axis=1), (good & np.isnan(settling)).sum(axis=1))


def excess(bound: Constraint, values: Array) -> Array:
    """By how much a bound is violated at each point, in shares of it; 0 where it is kept."""
    if bound.every_run:
        reduced = np.nanmax if bound.above else np.nanmin
        found = np.array([reduced(row) if np.isfinite(row).any() else np.nan for row in values])
    else:
        found = mean_over_runs(values)
    over = (found - bound.bound) * (1 if bound.above else -1) / (abs(bound.bound) or 1.0)
    return np.where(np.isfinite(over), np.maximum(over, 0.0), 1.0)
