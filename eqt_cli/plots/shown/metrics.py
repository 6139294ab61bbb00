"""Numbers per run, of one or several results."""

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
"""The metrics that are shown unless told otherwise, those of them that all results hold."""


@dataclass(frozen=True)
class Sample:
    """One metric over the good runs of a controller.

    Attributes
    ----------
    values : (runs,)
        In the order of the runs; infinite where a run had not settled by its end.
    """

    values: Array

    @property
    def seen(self) -> Array:
        """The finite values, rising."""
        return np.sort(self.values[np.isfinite(self.values)])

    @property
    def censored(self) -> int:
        """How many runs had not settled."""
        return int(np.isinf(self.values).sum())

    @property
    def mean(self) -> float:
        """NaN where runs had not settled, since nobody knows when they would."""
        return float(np.mean(self.values)) if self.values.size and not self.censored else np.nan

    def quantiles(self, levels: Sequence[float]) -> Array:
        """By linear interpolation between runs; infinite where that takes one not settled."""
        seen = self.seen
        places = (self.values.size - 1) * np.asarray(levels)
        if not seen.size:
            return np.full(len(places), np.inf)
        found = np.interp(places, np.arange(seen.size), seen)
        return np.where(np.ceil(places) < seen.size, found, np.inf)


class ShownMetrics(ShownControllers):
    """Metrics of the runs, of one or several results on one group, that did not fail.

    Parameters
    ----------
    metrics
        What to show, by names in the results; `DEFAULT_METRICS` if empty.

    Attributes
    ----------
    metrics : list of str
        What is shown.

    Raises
    ------
    EqtError
        As `ShownControllers`; and if a result holds no such metric.
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
    def samples(self) -> dict[tuple[str, str], Sample]:
        """What is shown, by metric and the controller's label; runs without a value left out."""
        return {(name, e.label): _sample(name, e) for name in self.metrics for e in self.shown}

    def end(self, ensemble: Ensemble) -> float:
        """The last time of a controller's runs."""
        return float(ensemble.results.times[-1])

    def notes(self) -> list[str]:
        """As `ShownControllers.notes`, before how many runs have no value."""
        return [*super().notes(), *self._without_value()]

    def _without_value(self) -> Iterator[str]:
        for name in self.metrics:
            for ensemble in self.shown:
                if name not in ensemble.results.metrics:
                    continue  # which is known of the runs with trajectories
                total = int(ensemble.good.sum())
                without = total - self.samples[name, ensemble.label].values.size
                if without:
                    yield f"{ensemble.title}: {without} of {total} runs have no {name}; left out."


def _sample(name: str, ensemble: Ensemble) -> Sample:
    result, controller = ensemble.results, ensemble.controller
    if name in result.metrics:
        found, late = result.metric(name, controller), result.censored(name, controller)
        good = ensemble.good
    else:  # what follows from the trajectories
        of = result.per_run(result.comparable_named(name))
        found, late = of.values[controller], of.censored[controller]
        good = np.isfinite(found)
    values = np.where(late, np.inf, found)
    return Sample(values[good & ~np.isnan(values)])
