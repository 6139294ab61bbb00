"""The metrics of the runs that did not fail, as figures need them; not how they are drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.plots.drawing.ensembles import Ensemble, ensembles, error
from eqt_cli.store.reader import Results

DEFAULT = (
    "effort",
    "early_torque",
    "peak_torque",
    "mean_pose_error",
    "final_pose_error",
    "settling_time",
)
"""The metrics that are shown unless told otherwise, those of them that all results hold."""

CENSORED = "settling_time"
"""What is NaN in a good run that had not settled by its end: larger than all that was seen."""


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
        known = np.ceil(places) < seen.size
        if not seen.size:
            return np.full(len(places), np.inf)
        found = np.interp(places, np.arange(seen.size), seen)
        return np.where(known, found, np.inf)


class GoodMetrics:
    """Metrics of the runs, of one or several results on one group, that did not fail.

    Parameters
    ----------
    results
        Open.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.
    metrics
        What to show, by names in the results; `DEFAULT` if empty.

    Attributes
    ----------
    metrics : list of str
        What is shown.
    ensembles : list of Ensemble
        The controllers.

    Raises
    ------
    EqtError
        If a result holds no such metric, there is no such controller, or no run is good.
    """

    def __init__(
        self,
        results: Sequence[Results],
        figure: str,
        chosen: Sequence[str] = (),
        metrics: Sequence[str] = (),
    ) -> None:
        self.results, self.figure = results, figure
        self.ensembles = ensembles(results, figure, chosen)
        self.metrics = list(dict.fromkeys(metrics)) or self._held()
        for one in results:
            known = _names(one)
            for name in self.metrics:
                if name not in known:
                    hint = suggestion(name, known) or f"; there are: {', '.join(known)}"
                    raise error(one, figure, f"finds no metric '{name}'{hint}")

    def _held(self) -> list[str]:
        held = [name for name in DEFAULT if all(name in _names(one) for one in self.results)]
        if not held:
            message = f"finds none of the metrics {', '.join(DEFAULT)}"
            raise self.error(f"{message}; choose others with the option 'metrics'")
        return held

    @property
    def shown(self) -> list[Ensemble]:
        """The controllers with at least one good run."""
        return [ensemble for ensemble in self.ensembles if ensemble.good.any()]

    @cached_property
    def samples(self) -> dict[tuple[str, str], Sample]:
        """What is shown, by metric and the controller's label; runs without a value left out."""
        return {
            (name, ensemble.label): Sample(values[~np.isnan(values)])
            for name in self.metrics
            for ensemble in self.shown
            for values in [self._values(name, ensemble)]
        }

    def _values(self, name: str, ensemble: Ensemble) -> Array:
        values = ensemble.results.read(name, controller=ensemble.controller)[ensemble.good]
        values = values.astype(float)
        return np.where(np.isnan(values), np.inf, values) if name == CENSORED else values

    def end(self, ensemble: Ensemble) -> float:
        """The last time of a controller's runs."""
        return float(ensemble.results.coordinate("time")[-1])

    def notes(self) -> list[str]:
        """What a reader must know about the runs that are not shown."""
        return list(self._notes())

    def _notes(self) -> Iterator[str]:
        for ensemble in self.ensembles:
            if ensemble.failed:
                runs = f"{ensemble.failed} of {ensemble.good.size} runs"
                yield f"{ensemble.title}: {runs} failed; left out."
        for name in self.metrics:
            for ensemble in self.shown:
                total = int(ensemble.good.sum())
                without = total - self.samples[name, ensemble.label].values.size
                if without:
                    yield f"{ensemble.title}: {without} of {total} runs have no {name}; left out."

    def error(self, message: str) -> EqtError:
        """An error of this figure about the results."""
        return error(self.results[0], self.figure, message)


def _names(results: Results) -> list[str]:
    """The numbers per run that a result holds."""
    per_run = ("controller", "run")
    return [
        name
        for name in results.names
        if results.dims(name) == per_run and name not in ("status", "message")
    ]
