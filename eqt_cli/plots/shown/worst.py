"""Costs along each key through the worst case that a search found."""

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.drawing.style import Look
from eqt_cli.plots.shown.controllers import ALL, Chosen, error_of, looks, positions
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey
from eqt_cli.tuning.folder import WORST
from eqt_cli.tuning.law_search import coordinate_of
from eqt_cli.tuning.worst import costs_of_runs


@dataclass(frozen=True)
class Along:
    """Costs of a law along one key through its worst case.

    Attributes
    ----------
    key
        Configuration key.
    look
        Look of the law, which determines its line style.
    title
        Title of the law.
    values : (points,)
        Values of the key.
    worst : (points,)
        Worst objective over all runs; NaN where a run failed, or none has a value.
    failed : (points,)
        Whether a run failed.
    found
        Index of the point at the worst case.
    """

    key: str
    look: Look
    title: str
    values: Array
    worst: Array
    failed: Array
    found: int


class ShownWorst:
    """Results of a search for the worst run, along each key.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    lines : list of Along
        Lines of all laws, with keys in the order of the configuration.
    objective : str
        The metric that is searched.

    Raises
    ------
    EqtError
        If the result is not of such a search, or there is no such controller.
    """

    def __init__(self, results: Result, figure: str, chosen: Chosen = ALL) -> None:
        self.results = results
        record = WORST.beside(results)
        if record is None:
            raise error_of(results, figure, "shows what `eqt worst` found; this is none")
        shown = positions([results], figure, chosen.controllers)[0]
        look_of = dict(zip(shown, looks([results], [shown], figure, chosen.focus), strict=True))
        self.objective: str = record["objective"]
        costs = costs_of_runs(results, self.objective).max(axis=-1)
        quantity = results.quantity(self.objective)
        self._log = {key for law in record["laws"] for key in law["log"]}
        self.lines = []
        for law in record["laws"]:
            position = results.labels.index(law["label"])
            for line in law["lines"] if position in shown else ():
                points = slice(*line["points"])
                key = line["key"]
                values = results.coordinate(coordinate_of(key))[points]
                cost = costs[points, position]
                self.lines.append(
                    Along(
                        key,
                        look_of[position],
                        results.titled[law["label"]],
                        values.astype(float),
                        quantity.cost(np.where(np.isfinite(cost), cost, np.nan)),
                        np.isposinf(cost),
                        int(np.argmin(np.abs(values - law["values"][key]))),
                    )
                )

    @property
    def keys(self) -> list[str]:
        """The varied keys, each once."""
        return list(dict.fromkeys(line.key for line in self.lines))

    def swept(self, key: str) -> SweptKey:
        """Return a key with all values of its lines, as a swept key."""
        values = np.concatenate([line.values for line in self.lines if line.key == key])
        return SweptKey(key, values, {}, key in self._log)

    def notes(self) -> list[str]:
        """Return the notes for the reader about the curves."""
        return list(self._notes())

    def _notes(self) -> Iterator[str]:
        runs = self.results.runs
        of = f"the worst of {runs} runs" if runs > 1 else "one run"
        yield (
            f"Each point: {of}; the other keys as found for the law (filled marker). "
            "Found by search: worse runs may exist."
        )
        if any(line.failed.any() for line in self.lines):
            yield "Crosses at the top: a run failed."
