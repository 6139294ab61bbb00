"""Checks of loops that are not ideal: the plant's momentum, the noise, and the estimates."""

from abc import abstractmethod
from collections.abc import Iterator
from typing import ClassVar

import numpy as np

from eqt_cli.analysis.certificates.base import Row, TrajectoryCheck
from eqt_cli.analysis.evidence.runs import ENERGY_PER_RTOL, Runs, VehicleRuns
from eqt_cli.core.arrays import Array

DEVIATIONS = 5.0
"""Allowed deviation of a mean in standard errors; one mean in a million exceeds it."""

RARE = 3e-7
"""Probability that a normal number exceeds this on one side."""

WINDOWS = 10
"""Number of windows of every run over which the momentum is balanced."""

ORDERS = 4, 8, 16
"""Clenshaw-Curtis rules of a window, from coarse to fine; each has the nodes of the one before."""

MARGIN = 0.05
"""Share of a window at each end that is left out, because the vector field may jump there."""

Excess = tuple[float, float, str]
"""A measured number, its bound, and a remark."""


class LargestExcess(TrajectoryCheck):
    """A statement of several numbers, of which the one with the largest ratio to its bound counts.

    Attributes
    ----------
    nothing
        Reason why there may be no number.
    """

    nothing: ClassVar[str] = ""

    def check(self, runs: Runs) -> Row:
        """Judge that number."""
        excesses = list(self.excesses(runs))
        if not excesses:
            return self.undecided(runs, runs.remark or self.nothing)
        measured, bound, remark = max(excesses, key=_ratio)
        return self.compared(float(measured), float(bound), remark or runs.remark, runs.label)

    @abstractmethod
    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield numbers with the bounds that they must not exceed."""


def _ratio(excess: Excess) -> float:
    measured, bound, _ = excess
    return measured / bound if np.isfinite(measured) else np.inf


class MomentumBalance(LargestExcess):
    """The momentum 𝕀V changes over a window by ∫(ad*_V 𝕀V + τ + Σ f) dt, with the plant's 𝕀.

    The momentum is that of the runs. The integral is taken over their states at the nodes of
    Clenshaw-Curtis rules. Its error is estimated by coarser rules.
    """

    name: ClassVar[str] = "momentum balance"
    statement: ClassVar[str] = "d(𝕀V)/dt − ad*_V 𝕀V = τ + forces"
    section: ClassVar[float] = 9.02

    def applies(self, runs: Runs) -> bool:
        """Whether there are parts between the law and the motion."""
        return runs.vehicle is not None

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield the largest residual of every window; none without good runs."""
        windows = runs.vehicle and runs.vehicle.windows
        if windows is None:
            return
        loop, times = windows.loop, windows.problem.times
        s = loop.tracking(times, windows.states)
        G, vehicle = s.G, loop.vehicle
        inertia = s.inertia if vehicle.inertia is None else vehicle.inertia.at(s.inertia, s.t)
        momentum = inertia.momentum(s.V)
        force = G.ad_star(s.V, momentum) + loop.torque(s)
        for each in vehicle.forces:
            force = force + each.in_body(G, s.t, s.Q, s.V)
        fine = ORDERS[-1]
        for start in range(1, len(times) - 1, fine + 1):  # without the ends of the horizon
            inside = slice(start, start + fine + 1)
            P, f, duration = momentum[:, inside], force[:, inside], np.ptp(times[inside])
            rules = [
                duration / 2 * np.einsum("i,rij->rj", weights, f[:, :: fine // order])
                for order, (_, weights) in CLENSHAW_CURTIS.items()
            ]
            lost = np.abs(np.diff(rules, axis=0)).sum(axis=0)
            residual = np.abs(P[:, -1] - P[:, 0] - rules[-1])
            size = max(1.0, float(np.abs(P).max()), duration * float(np.abs(f).max()))
            place = f"at t = {times[start]:.3g} s"
            yield residual.max(), ENERGY_PER_RTOL * runs.rtol * size + lost.max(), place


def _clenshaw_curtis(order: int) -> tuple[Array, Array]:
    """Return the nodes in [−1, 1] and the weights that integrate polynomials of this degree."""
    nodes = -np.cos(np.pi * np.arange(order + 1) / order)
    integrals = np.append(2.0, np.zeros(order))  # of the Legendre polynomials
    return nodes, np.linalg.solve(np.polynomial.legendre.legvander(nodes, order).T, integrals)


CLENSHAW_CURTIS = {order: _clenshaw_curtis(order) for order in ORDERS}


def window_times(runs: VehicleRuns) -> Array:
    """Return the nodes of `WINDOWS` windows between instants, and the ends of the horizon."""
    edges = np.unique(np.concatenate([span.grid for span in runs.problem.spans]))
    chosen = np.unique(np.linspace(0, len(edges) - 2, WINDOWS, dtype=int))
    nodes, _ = CLENSHAW_CURTIS[ORDERS[-1]]
    middle, half = (edges[1:] + edges[:-1])[chosen] / 2, np.diff(edges)[chosen] / 2
    inside = middle[:, None] + (1 - 2 * MARGIN) * np.multiply.outer(half, nodes)
    return np.concatenate([edges[:1], inside.ravel(), edges[-1:]])


class NoiseCovariance(LargestExcess):
    """White noise of sensors has the configured covariance."""

    name: ClassVar[str] = "noise has its covariance"
    statement: ClassVar[str] = "mean of n nᵀ over runs and instants"
    section: ClassVar[float] = 9.3

    def applies(self, runs: Runs) -> bool:
        """Whether the law is sampled and a sensor has white noise."""
        if runs.vehicle is None or runs.vehicle.problem.loop.vehicle.control is None:
            return False
        return any(True for _ in runs.vehicle.white_noise())

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Yield the entries of covariance − I for noise divided by its configured deviation."""
        if runs.vehicle is not None and len(runs.vehicle.states):
            for values in runs.vehicle.white_noise():
                yield from _off_identity(values.reshape(-1, values.shape[-1]))


def rare_mean_squares(n: float) -> tuple[float, float]:
    """Between which the mean of n squares of normals lies, but for one time in a million."""
    from scipy.special import gammaincinv  # slow to import

    low, high = (float(2 * gammaincinv(n / 2, p) / n) for p in (RARE, 1 - RARE))
    return low, high


def _off_identity(z: Array) -> Iterator[Excess]:
    """Yield the deviations of the covariance of rows from I, with their bounds.

    A variance is distributed as χ²/n, whose quantiles are positive. So noise of 0 always exceeds
    the lower bound, however few rows there are.
    """
    n, axes = z.shape
    low, high = rare_mean_squares(n)
    covariance = z.T @ z / n
    for variance in np.diag(covariance).tolist():
        yield abs(variance - 1), 1 - low if variance < 1 else high - 1, ""
    for off in covariance[np.triu_indices(axes, 1)].tolist():
        yield abs(off), DEVIATIONS * np.sqrt(2 / n), ""  # products of normals have long tails


class EstimateCheck(LargestExcess):
    """A statement about a filter that has a covariance."""

    nothing: ClassVar[str] = "no trajectories are kept"

    def applies(self, runs: Runs) -> bool:
        """To runs whose law reads the estimate of one."""
        return runs.estimate is not None


class Consistent(EstimateCheck):
    """The mean of NEES over runs and times is its degrees of freedom.

    Errors at two times of a run depend on each other, however much; runs do not. So the mean over
    n runs spreads no more than that of χ² with n times the degrees of freedom.
    """

    name: ClassVar[str] = "estimate errs as its covariance says"
    statement: ClassVar[str] = "NEES within the limits of χ²"
    section: ClassVar[float] = 9.51

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """The mean over the degrees of freedom, less 1."""
        if not runs.estimate or not runs.estimate["nees"].size:
            return
        nees, degrees = runs.estimate["nees"], runs.estimate["nees_dof"]
        mean = float((nees / degrees).mean())
        low, high = rare_mean_squares(float(degrees[:, 0].sum()))
        yield abs(mean - 1), 1 - low if mean < 1 else high - 1, f"NEES is {mean:.3g} times its mean"


class WhiteInnovations(EstimateCheck):
    """Innovations over their own deviations have the mean square 1 and do not foretell the next."""

    name: ClassVar[str] = "innovations are white"
    statement: ClassVar[str] = "mean square 1, correlation 0"
    section: ClassVar[float] = 9.52

    def excesses(self, runs: Runs) -> Iterator[Excess]:
        """Their mean square less 1, and the correlation of successive ones, over all runs."""
        if not runs.estimate:
            return
        count, square, correlation = (
            runs.estimate[name][:, -1]
            for name in ("innovations", "innovation_square", "innovation_correlation")
        )
        total = float(count.sum())
        if not total:
            return
        squares = np.where(count > 0, count * square, 0.0)
        mean = float(squares.sum() / total)
        low, high = rare_mean_squares(total)
        words = f"mean square {mean:.3g} of {total:.0f} innovations"
        yield abs(mean - 1), 1 - low if mean < 1 else high - 1, words
        if squares.sum() > 0:
            products = np.where(squares > 0, squares * correlation, 0.0).sum()
            relation = float(products / squares.sum())
            yield abs(relation), DEVIATIONS / np.sqrt(total), f"correlation {relation:.3g}"
