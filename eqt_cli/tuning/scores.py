"""Scores the points of a sweep: objectives, violated bounds, failed runs."""

from collections.abc import Sequence

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.results.quantity_table import QUANTITIES
from eqt_cli.results.result import Result, mean_over_runs
from eqt_cli.tuning.ranking import Scores
from eqt_cli.tuning.search import Constraint


def scores(result: Result, objectives: Sequence[str], constraints: Sequence[Constraint]) -> Scores:
    """Return the scores of all points of a sweep with one law.

    A run that failed or has no value is left out of the means, and the share of such runs is added
    to the violation. A run whose time is beyond the horizon counts with the horizon.
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
    """Return the violation of a bound at each point as a share of the bound; 0 where it holds."""
    if bound.every_run:
        reduced = np.nanmax if bound.above else np.nanmin
        found = np.array([reduced(row) if np.isfinite(row).any() else np.nan for row in values])
    else:
        found = mean_over_runs(values)
    over = (found - bound.bound) * (1 if bound.above else -1) / (abs(bound.bound) or 1.0)
    return np.where(np.isfinite(over), np.maximum(over, 0.0), 1.0)
