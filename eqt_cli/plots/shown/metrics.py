"""Metrics per run, of one or several results."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.shown.controllers import ALL, Chosen, Ensemble, ShownControllers
from eqt_cli.results.result import Result

DEFAULT_METRICS = (
    "effort",
    "early_torque",
    "peak_torque",
    "mean_pose_error",
    "final_pose_error",
    "settling_time",
)
"""Metrics shown by default, as far as all results hold them."""


@dataclass(frozen=True)
class MetricValues:
    """One metric over the good runs of a controller.

    Attributes
    ----------
    values : (runs,)
        Values in the order of the runs; infinite where a run had not settled by its end.
    """

    values: Array

    @property
    def seen(self) -> Array:
        """The finite values in ascending order."""
        return np.sort(self.values[np.isfinite(self.values)])

    @property
    def censored(self) -> int:
        """Number of runs that had not settled."""
        return int(np.isinf(self.values).sum())

    @property
    def mean(self) -> float:
        """The mean; NaN if some runs had not settled, since their settling times are unknown."""
        return float(np.mean(self.values)) if self.values.size and not self.censored else np.nan

    def quantiles(self, levels: Sequence[float]) -> Array:
        """Return quantiles, interpolated linearly; infinite where this needs an unsettled run."""
        seen = self.seen
        places = (self.values.size - 1) * np.asarray(levels)
        if not seen.size:
            return np.full(len(places), np.inf)
        values = np.interp(places, np.arange(seen.size), seen)
        return np.where(np.ceil(places) < seen.size, values, np.inf)


class ShownMetrics(ShownControllers):
    """Metrics of the runs that did not fail, of one or several results on one group.

    Parameters
    ----------
    metrics
        Metrics to show, by their names in the results; `DEFAULT_METRICS` if empty.

    Attributes
    ----------
    metrics : list of str
        The metrics that are shown.

    Raises
    ------
    EqtError
        In the cases of `ShownControllers`, or if a result holds no such metric.
    """

    def __init__(
        self,
        results: Sequence[Result],
        figure: str,
        chosen: Chosen = ALL,
        metrics: Sequence[str] = (),
    ) -> None:
        super().__init__(results, figure, chosen)
        parts = [part for name in DEFAULT_METRICS for part in results[0].in_parts(name)]
        held = [name for name in parts if all(name in one.metrics for one in results)]
        self.metrics = list(dict.fromkeys(metrics)) or held
        if not self.metrics:
            message = f"finds none of the metrics {', '.join(DEFAULT_METRICS)}"
            raise self.error(f"{message}; choose others with the option 'metrics'")
        for one in results:
            unknown = [name for name in self.metrics if name not in one.comparable]
            one.check_metrics(unknown, who=f"figure '{figure}'")

    @cached_property
    def samples(self) -> dict[tuple[str, str], MetricValues]:
        """Samples by metric and controller label, without the runs that have no value."""
        return {(name, e.label): _sample(name, e) for name in self.metrics for e in self.shown}

    def end(self, ensemble: Ensemble) -> float:
        """Return the final time of a controller's runs."""
        return float(ensemble.results.times[-1])

    def notes(self) -> list[str]:
        """Return `ShownControllers.notes`, then how many runs have no value."""
        return [*super().notes(), *self._without_value()]

    def _without_value(self) -> Iterator[str]:
        for name in self.metrics:
            for ensemble in self.shown:
                if name not in ensemble.results.metrics:
                    continue  # known only for runs with stored trajectories
                total = int(ensemble.good.sum())
                without = total - self.samples[name, ensemble.label].values.size
                if without:
                    yield f"{ensemble.title}: {without} of {total} runs have no {name}; left out."


def _sample(name: str, ensemble: Ensemble) -> MetricValues:
    result, controller = ensemble.results, ensemble.controller
    if name in result.metrics:
        measured, late = result.metric(name, controller), result.censored(name, controller)
        good = ensemble.good
    else:  # computed from the trajectories
        of = result.per_run(result.comparable_named(name))
        measured, late = of.values[controller], of.censored[controller]
        good = np.isfinite(measured)
    values = np.where(late, np.inf, measured)
    return MetricValues(values[good & ~np.isnan(values)])
