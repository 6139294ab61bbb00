"""Windows of time over which quantities are taken."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError


@dataclass(frozen=True)
class Window:
    """A window of time relative to the start of the runs.

    Attributes
    ----------
    start, stop
        Ends of the window, s; an infinite `stop` means the end of the horizon.
    """

    start: float = 0.0
    stop: float = math.inf

    @classmethod
    def parse(cls, text: str) -> Window:
        """Parse ``0:5``, ``5:`` or ``:5``; ``:`` is the whole horizon.

        Raises
        ------
        EqtError
            If the text has another form, or the window is empty.
        """
        start, colon, stop = text.partition(":")
        try:
            window = cls(float(start or 0), float(stop or math.inf))
        except ValueError:
            colon = ""
        if not colon or math.isnan(window.start) or math.isnan(window.stop):
            raise EqtError(
                f"window '{text}': expected START:STOP in seconds, as 0:5, 5: or : for all of it"
            )
        if not 0 <= window.start < window.stop or math.isinf(window.start):
            raise EqtError(f"window '{text}': expected 0 <= START < STOP")
        return window

    def within(self, times: Array) -> Window:
        """Return the window, cut at the last sample.

        Raises
        ------
        EqtError
            If it begins only after the last sample.
        """
        horizon = float(times[-1] - times[0])
        if self.start >= horizon:
            raise EqtError(
                f"window '{self}' begins after the end of the runs; they last {horizon:g} s"
            )
        return Window(self.start, min(self.stop, horizon))

    def cut(self, times: Array, values: Array) -> tuple[Array, Array]:
        """Return the samples within the window, with linearly interpolated values at its ends.

        A window that ends after the last sample is cut there.

        Parameters
        ----------
        times : (samples,)
        values : (runs, samples, ...)

        Raises
        ------
        EqtError
            If the window begins only after the last sample.
        """
        window = self.within(times)
        start, stop = times[0] + window.start, times[0] + window.stop
        tolerance = 1e-9 * (times[-1] - times[0])
        inside = np.flatnonzero((times >= start - tolerance) & (times <= stop + tolerance))
        if not inside.size:
            ends = np.array([start, stop])
            return ends, np.stack([_at(times, values, t) for t in ends], axis=1)
        cut_times, cut = times[inside], values[:, inside]
        if cut_times[0] > start + tolerance:
            cut_times = np.concatenate([[start], cut_times])
            cut = np.concatenate([_at(times, values, start)[:, None], cut], axis=1)
        if cut_times[-1] < stop - tolerance:
            cut_times = np.concatenate([cut_times, [stop]])
            cut = np.concatenate([cut, _at(times, values, stop)[:, None]], axis=1)
        return cut_times, cut

    def __str__(self) -> str:
        stop = "" if math.isinf(self.stop) else f"{self.stop:g}"
        return f"{self.start:g}:{stop}"


WHOLE = Window()
"""The whole horizon."""


def _at(times: Array, values: Array, t: float) -> Array:
    """Interpolate values at one time between two samples."""
    right = int(np.clip(np.searchsorted(times, t), 1, len(times) - 1))
    fraction = (t - times[right - 1]) / (times[right] - times[right - 1])
    return (1 - fraction) * values[:, right - 1] + fraction * values[:, right]
