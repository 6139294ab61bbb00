"""The fronts of a search with two objectives."""

from collections.abc import Sequence

from eqt_cli.core.arrays import Array
from eqt_cli.plots.shown.controllers import error_of, positions
from eqt_cli.results.origin import law_title
from eqt_cli.results.result import Result
from eqt_cli.tuning.folder import TUNE
from eqt_cli.tuning.fronts import Front, fronts
from eqt_cli.tuning.held_out import held_out


class ShownFronts:
    """The fronts of a search with two objectives, on its held-out runs.

    Parameters
    ----------
    results
        The open result.
    figure, chosen
        As for `ShownControllers`.

    Attributes
    ----------
    fronts : list of Front
        Of the laws.
    titles : list of str
        How the laws are written.
    positions : list of int
        Those of the laws in the search, on which their line styles depend.
    objectives : list of str
        The two metrics.

    Raises
    ------
    EqtError
        If the result is not of such a search, or there is no such law.
    """

    def __init__(self, results: Result, figure: str, chosen: Sequence[str] = ()) -> None:
        record = TUNE.beside(results)
        self.results = results = held_out(results, record) if record else results
        laws = [law["label"] for law in record["laws"]] if record else []
        positions([results], figure, [label for label in chosen if label not in laws])
        if record is None or len(record["objectives"]) < 2:
            raise error_of(
                results,
                figure,
                "shows the fronts of `eqt tune` with two `objectives`; this is none",
            )
        self.objectives = list(record["objectives"])
        found = [front for front in fronts(results, record) if not chosen or front.law in chosen]
        if not found:
            raise error_of(results, figure, "finds no front with two points")
        self.fronts, self.positions = found, [laws.index(front.law) for front in found]
        self.titles = [law_title(front.law) for front in found]
        self.starts = {law["label"]: results.labels.index(law["start"]) for law in record["laws"]}

    def values(self, front: Front) -> list[Array]:
        """Both metrics of all winners of a law, ``(winners, runs)``."""
        rows = [self.results.labels.index(label) for label in front.labels]
        return [self.results.counted(name)[rows] for name in self.objectives]

    def start(self, front: Front) -> list[float]:
        """Both means at the starting gains of a law."""
        row = self.starts[front.law]
        return [float(self.results.means(name)[row]) for name in self.objectives]

    def notes(self) -> list[str]:
        """What a reader must know about the points."""
        return [
            f"Means over {self.results.runs} held-out runs with 95 % intervals. Hollow: found by "
            "the search, but dominated on these runs. Crosses: starting gains."
        ]
