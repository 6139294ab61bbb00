"""A recording beside a run of one controller of a result."""

from collections.abc import Sequence
from functools import partial

import numpy as np

from eqt_cli.analysis.measured.run import measured_runs
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, Remedy
from eqt_cli.groups import MatrixLieGroup
from eqt_cli.logs.recording import Recording
from eqt_cli.plots.shown.controllers import ALWAYS, TimeRange, error_of, positions
from eqt_cli.results.result import Result


class ShownMeasured:
    """A recording and a simulated run over the same time.

    Parameters
    ----------
    result, measured
        The open result, and a recording on its group.
    figure, chosen
        See `ShownControllers`; the first controller if none is chosen.
    run
        Number of the run.

    Attributes
    ----------
    pair
        The run and the recording.

    Raises
    ------
    EqtError
        If there is no recording, run or controller, or the recording does not fit the run.
    """

    def __init__(
        self,
        result: Result,
        measured: Recording | None,
        figure: str,
        chosen: Sequence[str],
        run: int,
        time: TimeRange = ALWAYS,
    ) -> None:
        if measured is None:
            text = f"figure '{figure}' shows a recording beside a run, and none is given"
            raise EqtError(text, Remedy("give one with {}", "measured"))
        (places,) = positions([result], figure, chosen)
        if chosen and len(places) > 1:
            raise error_of(result, figure, f"shows one controller, got {len(places)}")
        (self.pair,) = measured_runs(result, measured, places[:1], run, f"figure '{figure}'")
        self.unit, self._time = result.units("time"), time
        self._error = partial(error_of, result, figure)

    @property
    def group(self) -> MatrixLieGroup:
        """The group G."""
        return self.pair.recording.group

    @property
    def curves(self) -> list[tuple[str, tuple[Array, Array], tuple[Array, Array]]]:
        """Rows of panels: a name, then times and values of the recording and of the run.

        The values are poses, or coordinates of errors, velocities and wrenches.
        """
        pair, seen = self.pair, self.pair.recording
        here, wanted = pair.simulated.states, pair.reference.states
        G, t = self.group, pair.simulated.times
        errors = pair.errors
        error = G.log(G.inverse(wanted.pose) @ here.pose)
        found = [
            ("pose", (seen.times, seen.poses), (t, here.pose)),
            ("error", (seen.times, errors[0].measured), (t, error)),
            ("velocity", (seen.times, seen.velocities), (t, here.velocity)),
            ("wrench", (seen.times, seen.wrenches), (t, here.wrench)),
        ]
        found = [row for row in found if not np.isnan(row[1][1]).all()]
        seen_at = self._time.samples(seen.times, self._error)
        run_at = self._time.samples(t, self._error)

        def part(of: tuple[Array, Array], at: Array) -> tuple[Array, Array]:
            return of[0][at], of[1][at]

        return [(name, part(told, seen_at), part(run, run_at)) for name, told, run in found]

    def notes(self) -> list[str]:
        """Return notes on what is shown, how it was aligned, and what was not measured."""
        pair = self.pair
        return [
            f"Lines: {pair.title}, run {pair.run}. Tints: {pair.notes[0]}.",
            *(f"{note}." for note in pair.notes[1:]),
        ]
