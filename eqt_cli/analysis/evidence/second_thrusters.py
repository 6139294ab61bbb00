"""Second, independent form of thrusters, in floats and for one run."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from eqt_cli.analysis.evidence.redrawn import Options, entries
from eqt_cli.core.arrays import Array


@dataclass(frozen=True)
class SecondThrusters:
    """Thrusters of one run: thrusts f within limits for u, T ẋ + x = f, and the output B x.

    Attributes
    ----------
    given
        Options of the thrusters.
    """

    given: Options

    @cached_property
    def B(self) -> Array:
        """The given matrix, or torque and force of each thruster from its place."""
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
        """Whether an optimisation with limits allocates the thrusts."""
        return bool(self.given["allocation"] == "bounded")

    @property
    def lags(self) -> bool:
        """Whether thrusts lag."""
        return self.given["time_constant"] is not None

    @property
    def states(self) -> int:
        """Number of states."""
        return (self.bounded + self.lags) * self.B.shape[1]

    def of_each(self, name: str) -> Array:
        """Return an option of every thruster."""
        return entries(self.given[name], self.B.shape[1])

    @cached_property
    def scale(self) -> Array:
        """1/√w."""
        given = self.given["weights"]
        return np.ones(self.B.shape[1]) if given is None else self.of_each("weights") ** -0.5

    def free(self, u: Array) -> Array:
        """Minimise Σ w f² with B f = u or nearest to it: f = S z with z of least norm."""
        S = self.scale
        z = np.linalg.lstsq(self.B * S, u.reshape(-1, len(self.B)).T, rcond=1e-10)[0]
        return (S * z.T).reshape(*u.shape[:-1], -1)

    def nearest(self, u: Array) -> Array:
        """Solve the same within the limits, by SciPy."""
        from scipy.optimize import lsq_linear

        low, high, f = self.of_each("low"), self.of_each("high"), self.free(u)
        S = self.scale
        for run in zip(*np.nonzero(((f < low) | (f > high)).any(axis=-1)), strict=True):
            z = lsq_linear(
                self.B * S, u[run], (low / S, high / S), method="bvls", tol=1e-14, max_iter=1000
            ).x
            f[run] = S * z
        return f

    def __call__(self, u: Array, x: Array, period: float | None) -> tuple[Array, Array]:
        """Return the states after an instant, or their rates without one, and the torque."""
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
        """Return where a thrust is beyond its limit or, after an optimisation, at its limit."""
        if self.given["low"] is None:
            return np.zeros(u.shape[:-1], dtype=bool)
        low, high = self.of_each("low"), self.of_each("high")
        f = x[..., : self.B.shape[1]] if self.bounded else self.free(u)
        inside = (low < f) & (f < high) if self.bounded else (low <= f) & (f <= high)
        return np.array(~inside.all(axis=-1))
