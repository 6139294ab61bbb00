"""Thrusters written a second time, in floats and for one run."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries
from eqt_cli.core.arrays import Array


@dataclass(frozen=True)
class SecondThrusters:
    """Thrusters of one run: u becomes thrusts f within limits, T ẋ + x = f, and B x comes out.

    Attributes
    ----------
    given
        Their options.
    """

    given: Options

    @cached_property
    def B(self) -> Array:
        """As given, or each place times its force."""
        if self.given["matrix"] is not None:
            return np.array(self.given["matrix"], dtype=float)
        found = []
        for each in self.given["thrusters"]:
            a = np.array(each.along) / np.sqrt(np.square(each.along).sum())
            if len(a) == 2:
                found.append([each.at[0] * a[1] - each.at[1] * a[0], *a])
            else:
                found.append([*(np.cross(each.at, a) + each.turns * a), *a])
        return np.array(found).T

    @property
    def bounded(self) -> bool:
        """Whether thrusts are solved for."""
        return bool(self.given["allocation"] == "bounded")

    @property
    def lags(self) -> bool:
        """Whether thrusts lag."""
        return self.given["time_constant"] is not None

    @property
    def states(self) -> int:
        """How many there are."""
        return (self.bounded + self.lags) * self.B.shape[1]

    def of_each(self, name: str) -> Array:
        """An option of every thruster."""
        return entries(self.given[name], self.B.shape[1])

    @cached_property
    def scale(self) -> Array:
        """1/√w."""
        given = self.given["weights"]
        return np.ones(self.B.shape[1]) if given is None else self.of_each("weights") ** -0.5

    def free(self, u: Array) -> Array:
        """The least Σ w f² with B f = u or nearest to it: f = S z, z the least of norm."""
        S = self.scale
        z = np.linalg.lstsq(self.B * S, u.reshape(-1, len(self.B)).T, rcond=1e-10)[0]
        return (S * z.T).reshape(*u.shape[:-1], -1)

    def nearest(self, u: Array) -> Array:
        """Within the limits, by SciPy."""
        from scipy.optimize import lsq_linear

        least, most, f = self.of_each("low"), self.of_each("high"), self.free(u)
        S = self.scale
        for run in zip(*np.nonzero(((f < least) | (f > most)).any(axis=-1)), strict=True):
            z = lsq_linear(
                self.B * S, u[run], (least / S, most / S), method="bvls", tol=1e-14, max_iter=1000
            ).x
            f[run] = S * z
        return f

    def __call__(self, u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        """The states after an instant, or their rates where there is none, and the torque."""
        k = self.B.shape[1]
        if self.bounded and period is not None:
            f = self.nearest(u)
            later = np.concatenate([f, x[..., k:]], axis=-1)
        elif self.bounded:
            f, later = x[..., :k], 0 * x
        else:
            f, later = self.free(u), 0 * x
            if self.given["low"] is not None:
                f = np.maximum(np.minimum(f, self.of_each("high")), self.of_each("low"))
        if not self.lags:
            return later, f @ self.B.T
        lagging = x[..., -k:]
        if period is None:
            rate = (f - lagging) / self.of_each("time_constant")
            later = np.concatenate([later[..., :-k], rate], axis=-1)
        return later, lagging @ self.B.T

    def at_limit(self, u: Array, x: Array, passed: Array) -> Array:
        """Where a thruster is asked for more than its limit; or for its limit, where solved for."""
        if self.given["low"] is None:
            return np.zeros(u.shape[:-1], dtype=bool)
        least, most = self.of_each("low"), self.of_each("high")
        f = x[..., : self.B.shape[1]] if self.bounded else self.free(u)
        inside = (least < f) & (f < most) if self.bounded else (least <= f) & (f <= most)
        return np.array(~inside.all(axis=-1))
