"""The search for the best point of one objective under bounds, by models of what was tried.

The points tried first are a grid, or a net of Sobol's. Then cubic radial basis functions through
the logarithms of the objective and of what is bounded say where the best point is. Some points are
tried about it, most of them where the bound is met, in a box that shrinks, until two batches in a
row confirm the model. Nothing is drawn: equal numbers give equal points.
"""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, fields, replace
from functools import cache
from itertools import combinations_with_replacement
from typing import Any, Literal

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.extensions.search.fronts import Constraint

GRID = 4
"""Values along each of two axes that are tried first."""

NET = 8
"""Points for each of another number of axes that are tried first."""

NEAR = 1e-4
"""Least distance of a point from those that were tried; nearer ones make the models singular."""

BOX, SMALLEST = 0.25, 0.01
"""Half the width of the box about the best point, first and at last."""

EXCHANGED = 0.06
"""Half the width of this box after the best points of other samples were tried, which lie near."""

QUIET = 1e-3
"""Relative gain of a batch below which the search was right; the models then miss the objective at
their best point by less than twice as much."""

SPENT = 2e-3
"""Distance from a bound, as a share, within which a point is on it."""

INSIDE = 5e-4
"""Share of a bound that points leave free, since the models miss it by about so much."""

SAME_ERROR = 1e-3
"""Share of the objective that a law may lose to spend what it has to spend: a tenth of what
verdicts tell apart. In a flat valley the objective does not say how much to spend."""

WORTH = 0.03
"""Share of the objective up to which a point that spends more is worth a run: models are wrong far
from the points that were tried."""

EQUAL = 0.01
"""Relative difference within which what a law spends is equal to what it has to spend."""

DIGITS, PLACES = 8, 6
"""Decimals of the numbers that models learn from, and of the points that they find best: a law in C
rounds its last digits otherwise than the same law in Python, and is to find the same points."""

NEAREST = 0.1
"""Largest share of what is to be spent that a law may spend above it, if it cannot spend less."""

FLOOR = 1e-9
"""Share of a positive bound, or of the largest objective, below which numbers count as so large."""

BOLD = 0.3
"""Share of lost runs above the allowed one at which the other points of a batch are tried, too."""

LOSS = 10.0
"""Weight of failed runs against the logarithm of the objective."""


@dataclass(frozen=True)
class Manner:
    """How a search goes on after the first points.

    Attributes
    ----------
    batch
        Points of a later batch.
    degree
        Degree of the polynomial that the models add to radial basis functions.
    hill
        Level above that of the best point from which all points count as equally bad. Models that
        follow a cliff are wrong in the valley.
    over
        Weight of an excess over a bound against the logarithm of the objective.
    grows
        Factor of this weight where the box would shrink about a point beyond a bound: there, the
        objective falls faster than the weight makes up for.
    widens
        Factor of the box where the best point is at one of its faces.
    looks
        How often the search looks at the whole range again after its models were confirmed, since
        the best point may lie elsewhere.
    """

    batch: int
    degree: int
    hill: float
    over: float
    grows: float
    widens: float
    looks: int


FEW = Manner(batch=5, degree=1, hill=np.inf, over=3.0, grows=1.0, widens=1.0, looks=0)
"""Up to three axes. Of 30 to 60 points, 5 at a time are as good as one at a time."""

MANY = Manner(batch=4, degree=2, hill=0.5, over=10.0, grows=3.0, widens=2.0, looks=1)
"""Four axes and more, where points are rare; chosen on four tasks of a satellite, an underwater
vehicle and a quadrotor that tune four gains."""


@dataclass(frozen=True)
class Tried:
    """Points that were tried, with their means over runs.

    Attributes
    ----------
    shares : (points, axes)
        Coordinates in the unit cube.
    costs : (points,)
        Objective, lower is better, over the runs with all numbers; NaN without such a run.
    measured : (points, bounds)
        What is bounded, over the same runs.
    lost : (points,)
        Share of the runs that failed or lack a number.
    unsettled : (points,)
        Number of runs that did not settle.
    """

    shares: Array
    costs: Array
    measured: Array
    lost: Array
    unsettled: Array

    def __len__(self) -> int:
        return len(self.costs)

    def joined(self, more: Tried) -> Tried:
        """Return these points and more of them."""
        names = (part.name for part in fields(self))
        return Tried(*(np.concatenate([getattr(x, name) for x in (self, more)]) for name in names))

    def excess(self, bounds: Sequence[Constraint]) -> Array:
        """Return by how much each bound is exceeded, ``(points, bounds)``; below 0 where it holds.

        It is the logarithm of the ratio, or, of a bound that is not positive, the difference as a
        share.
        """
        columns = [np.empty((len(self), 0))]
        for bound, values in zip(bounds, self.measured.T, strict=True):
            with np.errstate(invalid="ignore"):
                if bound.bound > 0:
                    over = np.log(np.maximum(values, FLOOR * bound.bound) / bound.bound)
                else:
                    over = (values - bound.bound) / (abs(bound.bound) or 1.0)
            columns.append((over if bound.above else -over)[:, None])
        return np.concatenate(columns, axis=1)


@dataclass(frozen=True)
class Best:
    """What a search found.

    Attributes
    ----------
    tried
        All points.
    point
        Index of the best one; None if no point keeps the bounds.
    ended
        Why the search ended: it was sure, or its points were used.
    gained
        By what share the last exchange with other samples lowered the objective: 1 where it brought
        the first point that keeps the bounds. None without an exchange.
    """

    tried: Tried
    point: int | None
    ended: Literal["sure", "budget"]
    gained: float | None = None


def first_points(axes: int, budget: int, number: int) -> Array:
    """Return the points tried first, ``(points, axes)``; each sample, by number, has others.

    They are the centres of a grid of two axes, else Sobol's sequence without its first point, which
    is the corner. For later samples, all are moved by a point of a Kronecker sequence: those of the
    grid within their cells, the others round the torus.
    """
    root = np.roots([1.0, *(axes - 1) * [0.0], -1.0, -1.0]).real.max()  # the golden ratio of 1 axis
    moved = (0.5 + number * root ** -np.arange(1.0, axes + 1)) % 1 - 0.5
    if axes == 2 and budget >= 2 * GRID**2:
        centres = (np.arange(GRID) + 0.5) / GRID
        grid = np.stack(np.meshgrid(centres, centres, indexing="ij"), axis=-1)
        return np.asarray(grid.reshape(-1, 2) + moved * (1 - 1 / GRID) / GRID)[:budget]
    count = min(NET * axes, max(budget // 2, min(axes + 2, budget)))  # the others search
    return np.asarray((_net(axes)[1 : count + 1] + moved) % 1)


@cache
def _candidates(axes: int) -> Array:
    """Return points of the unit cube, those on its faces included, that models are asked about."""
    if axes <= 2:
        along = np.linspace(0, 1, 401 if axes == 1 else 61)
        return np.stack(np.meshgrid(*axes * [along], indexing="ij"), axis=-1).reshape(-1, axes)
    return np.clip(1.06 * _net(axes) - 0.03, 0, 1)


def _net(axes: int) -> Array:
    """Return the first points of Sobol's sequence, ``(4096, axes)``."""
    from scipy.stats import qmc  # slow to import, and not needed for two axes

    return np.asarray(qmc.Sobol(axes, scramble=False).random_base2(12))


@dataclass
class ModelSearch:
    """A search in the unit cube.

    Parameters
    ----------
    axes, budget
        Number of axes, and of points.
    bounds
        What each column of `Tried.measured` is bounded by.
    allowed
        Largest share of lost runs.
    number
        Number of the training sample.
    start
        A point to try among the first; None without one.
    snapped
        Returns the nearest points that can be tried, where some axes have whole numbers only.
    also
        Further points to try first.
    tried
        What was tried before, which does not count: the points of a law that this one contains.
    """

    axes: int
    budget: int
    bounds: Sequence[Constraint]
    allowed: float = 0.0
    number: int = 0
    start: Sequence[float] | None = None
    snapped: Callable[[Array], Array] = lambda shares: shares
    also: Sequence[Sequence[float]] = ()
    tried: Tried | None = None

    def __post_init__(self) -> None:
        self.budget += 0 if self.tried is None else len(self.tried)
        self.equal = np.array([bound.equal for bound in self.bounds], dtype=bool)
        self.aims = np.where(self.equal, 0.0, -INSIDE)
        self.most = np.where(self.equal, QUIET, 0.0)
        self.manner = FEW if self.axes == 1 else MANY
        self.over = self.manner.over

    @property
    def left(self) -> int:
        """Number of points that may still be tried."""
        return self.budget - (0 if self.tried is None else len(self.tried))

    def points(self) -> Generator[Array, Tried, Best]:
        """Yield batches of points ``(points, axes)``; what is sent back says how good they are."""
        first = first_points(self.axes, self.left, self.number)
        if self.start is not None:  # another point as near to it gives its place
            away = np.abs(first - self.start).max(axis=1)
            first = np.concatenate([[self.start], np.delete(first, away.argmin(), axis=0)])
        first = np.concatenate([np.reshape(self.also, (-1, self.axes)), first])
        if len(first := self._distinct(first, [])[: self.left]):
            self._add((yield first))
        return (yield from self._searched(BOX, self.manner.looks))

    def exchanged(self, points: Array, more: int) -> Generator[Array, Tried, Best]:
        """Go on from the best points of other samples, with so many more points.

        What this gains says how far from the best the search had ended.
        """
        assert self.tried is not None
        self.budget = len(self.tried) + more
        before = self.best()
        if len(batch := self._distinct(points, [])[: self.left]):
            self._add((yield batch))
        reached = yield from self._searched(EXCHANGED, 0)
        now, levels = self.best(), _levels(self.tried.costs)
        gained = 0.0 if now is None else 1.0
        if before is not None and now is not None:
            gained = max(0.0, float(-np.expm1(levels[now] - levels[before])))
        return replace(reached, gained=gained)

    def _add(self, more: Tried) -> None:
        self.tried = more if self.tried is None else self.tried.joined(more)

    def _searched(self, half: float, looks: int) -> Generator[Array, Tried, Best]:
        """Try points in a box of half a width about the best one until two batches confirm it."""
        assert self.tried is not None
        quiet, self.over = 0, self.manner.over
        low, high = np.zeros(self.axes), np.ones(self.axes)
        if half < BOX:
            centre = self.tried.shares[self._merit().argmin()]
            low, high = np.maximum(centre - half, 0), np.minimum(centre + half, 1)
        # Points to spend what is to be spent.
        reserved = min(3, self.budget // 10) if self.equal.any() else 0
        ended: Literal["sure", "budget"] = "budget"
        while self.left > reserved:
            models = self._models()
            if models is None:  # nothing to learn from: no point has numbers
                more = self._distinct(_candidates(self.axes)[len(self.tried) :: 97], [])
                if not len(more):
                    break
                more = more[: min(self.manner.batch, self.left - reserved)]
                self._add((yield more))
                continue
            batch, promised = self._proposed(models, low, high, half)
            batch = batch[: self.left - reserved]
            before = self.best()
            if len(batch):
                self._add((yield batch))
            now = self.best()
            low, high, half = self._next_box(low, high, half, narrows=not len(batch))
            confirmed = now is not None and self._confirms(before, now, promised)
            quiet = quiet + 1 if confirmed or not len(batch) else 0
            if quiet == 2 and looks:
                half, quiet, looks = BOX, 0, looks - 1
                low, high = np.zeros(self.axes), np.ones(self.axes)
            elif quiet == 2:
                ended = "sure"
                break
        best = self.best()
        if best is not None and self.equal.any():
            best = yield from self._spending(best)
        return Best(self.tried, self._nearest() if best is None else best, ended)

    def _next_box(
        self, low: Array, high: Array, half: float, *, narrows: bool
    ) -> tuple[Array, Array, float]:
        """Return the box about the best point, and half its width.

        It is narrower where the best point is inside of the box, or where it `narrows` in any case.
        """
        assert self.tried is not None
        at = self._merit().argmin()
        centre, width = self.tried.shares[at], 0.1 * (high - low)
        inside = ((centre > low + width) | (low <= 0)) & ((centre < high - width) | (high >= 1))
        beyond = (self.tried.excess(self.bounds)[at] > self.most).any()
        if inside.all() and beyond and self.manner.grows > 1:
            self.over *= self.manner.grows
        elif inside.all() or narrows:
            half = max(half / 2, SMALLEST)
        else:
            half = min(half * self.manner.widens, BOX)
        return np.maximum(centre - half, 0), np.minimum(centre + half, 1), half

    def best(self) -> int | None:
        """Return the best point that keeps the bounds, the first of equal ones; None without."""
        assert self.tried is not None
        over = self.tried.excess(self.bounds)
        good = (over <= self.most).all(axis=1) & (self.tried.lost <= self.allowed)
        good &= np.isfinite(self.tried.costs)
        if not good.any():
            return None
        return int(np.where(good, self.tried.costs, np.inf).argmin())

    def _nearest(self) -> int | None:
        """Return the point that comes nearest to what is to be spent, where none spends so little.

        None where it is not within `NEAREST`, or another bound does not hold.
        """
        assert self.tried is not None
        over = self.tried.excess(self.bounds)
        good = (over <= np.where(self.equal, NEAREST, 0.0)).all(axis=1) & self.equal.any()
        good &= (self.tried.lost <= self.allowed) & np.isfinite(self.tried.costs)
        if not good.any():
            return None
        return int(np.where(good, over.max(axis=1, initial=0.0), np.inf).argmin())

    def _merit(self) -> Array:
        """Return how far points are from the best, also those beyond the bounds."""
        assert self.tried is not None
        over = np.maximum(self.tried.excess(self.bounds), 0).sum(axis=1)
        lost = np.maximum(self.tried.lost - self.allowed, 0)
        merit = _levels(self.tried.costs) + self.over * over + LOSS * lost
        return np.where(np.isfinite(merit), merit, np.inf)

    def _models(self) -> _Models | None:
        """Return models of what was tried; None if it is too little."""
        assert self.tried is not None
        columns = np.column_stack([_levels(self.tried.costs), self.tried.excess(self.bounds)])
        if np.isfinite(top := columns[self._merit().argmin(), 0] + self.manner.hill):
            columns[:, 0] = np.minimum(columns[:, 0], top)
        return _Models.of(self.tried, columns, self.allowed, self.manner.degree)

    def _confirms(self, before: int | None, now: int, promised: tuple[float, Array]) -> bool:
        """Whether a batch gained nothing, and the models were right about their best point."""
        assert self.tried is not None
        levels, over = _levels(self.tried.costs), self.tried.excess(self.bounds)[now]
        if before is None or levels[before] - levels[now] >= QUIET:
            return False
        level, expected = promised
        # A bound that the models find on their way has to be met; a slack one has not.
        met = (over > -SPENT) | (expected < -2 * SPENT)
        return bool(abs(level - levels[now]) < 2 * QUIET and met.all())

    def _distinct(self, points: Array, taken: Sequence[Array], apart: float = NEAR) -> Array:
        """Return those points, as they can be tried, that are apart from all others."""
        others = [] if self.tried is None else [*self.tried.shares]
        chosen: list[Array] = []
        for point in self.snapped(np.clip(points, 0, 1)):
            rest = np.array([*others, *taken, *chosen]).reshape(-1, self.axes)
            if not len(rest) or np.linalg.norm(rest - point, axis=1).min() >= apart:
                chosen.append(point)
        return np.array(chosen).reshape(-1, self.axes)

    def _proposed(
        self, models: _Models, low: Array, high: Array, half: float
    ) -> tuple[Array, tuple[float, Array]]:
        """Return the next batch, and the level and the excesses that the models promise of it."""
        assert self.tried is not None
        inside = ((self.tried.shares >= low) & (self.tried.shares <= high)).all(axis=1)
        grid = low + (high - low) * _candidates(self.axes)
        grid = np.concatenate([grid, self.tried.shares[inside & (self.axes > 2)]])
        levels, over, lost = models(grid)
        keeps = ((over - self.aims) <= 2e-4).all(axis=1)
        good = keeps & (lost <= self.allowed + 1e-3)
        beyond = np.maximum(over - self.aims, 0).sum(axis=1) + np.maximum(lost - self.allowed, 0)
        order = np.lexsort((levels, np.where(good, 0.0, beyond)))
        best = grid[order[0]]
        if good.any():
            starts = grid[order[: 1 if self.axes <= 2 else 60 : 20]]
            polished = models.polished(starts, low, high, self.aims)
            if models(polished[None])[2] <= self.allowed + 1e-3:
                best = polished
        level, excess, _ = models(best[None])
        batch = list(self._distinct(best[None], []))
        far = np.ones(len(grid), dtype=bool)
        for point in self.tried.shares:
            far &= np.linalg.norm(grid - point, axis=1) >= half / 4
        if good.any():  # runs fail behind an edge that the models see too early
            far &= keeps & (lost <= self.allowed + BOLD)
            order = np.lexsort((levels, ~far))
        far &= np.linalg.norm(grid - best, axis=1) >= half / 2
        while len(batch) < self.manner.batch and far[order].any():
            point = grid[order[far[order].argmax()]]
            batch += list(self._distinct(point[None], batch))
            far &= np.linalg.norm(grid - point, axis=1) >= half / 2
        return np.array(batch).reshape(-1, self.axes), (float(level[0]), excess[0])

    def _spending(self, best: int) -> Generator[Array, Tried, int]:
        """Try points that spend what is to be spent, where the best point spends less."""
        assert self.tried is not None

        def spends() -> Array:
            assert self.tried is not None
            over = self.tried.excess(self.bounds)
            good = (over <= self.most).all(axis=1) & (over[:, self.equal] >= -EQUAL).all(axis=1)
            return good & (self.tried.lost <= self.allowed) & np.isfinite(self.tried.costs)

        while self.left and not spends()[best]:
            models = self._models()
            if models is None:
                break
            grid = _candidates(self.axes)
            levels, over, _ = models(grid)
            beyond = np.abs(over[:, self.equal]).max(axis=1)
            near = beyond <= 3 * EQUAL
            order = np.lexsort((np.where(near, levels, beyond), ~near))
            starts = grid[order[:3]]
            zeros, ones = np.zeros(self.axes), np.ones(self.axes)
            point = models.polished(starts, zeros, ones, self.aims, self.equal)
            level, excess, _ = models(point[None])
            now = _levels(self.tried.costs)[best]
            reachable = (np.abs(excess[0][self.equal]) < EQUAL).all()
            if not reachable or level[0] > now + WORTH:
                break
            batch = self._distinct(point[None], [])
            if not len(batch):
                break
            self._add((yield batch))
        levels, spending = _levels(self.tried.costs), spends()
        if spending.any() and not spending[best]:
            nearest = int(np.where(spending, self.tried.costs, np.inf).argmin())
            if levels[nearest] <= levels[best] + SAME_ERROR:
                return nearest
        return best


def _levels(costs: Array) -> Array:
    """Return the logarithms of costs, or costs as shares of the largest where some are below 0."""
    largest = np.nanmax(np.abs(costs), initial=0.0) or 1.0
    if np.nanmin(costs, initial=np.inf) < 0:
        return np.asarray(np.round(costs / largest, DIGITS))
    return np.asarray(np.round(np.log(np.maximum(costs, FLOOR * largest)), DIGITS))


def _determined(shares: Array, degree: int) -> bool:
    """Whether points ``(points, axes)`` determine a polynomial, and one of them is left over."""
    axes = shares.shape[1]
    pairs = [*combinations_with_replacement(range(axes), 2)] if degree == 2 else []
    terms = [np.ones(len(shares)), *shares.T, *(shares[:, i] * shares[:, j] for i, j in pairs)]
    return bool(len(shares) > len(terms) and np.linalg.matrix_rank(np.array(terms)) == len(terms))


@dataclass(frozen=True)
class _Models:
    """Models of the level of the objective, of the excesses over bounds, and of lost runs."""

    numbers: Any
    lost: Any

    @classmethod
    def of(cls, tried: Tried, columns: Array, allowed: float, degree: int) -> _Models | None:
        """Return models through all points with numbers; None if they are too few.

        Parameters
        ----------
        columns : (points, 1 + bounds)
            Level of the objective, and excesses.
        degree
            Degree of the polynomials, if the points determine them.
        """
        from scipy.interpolate import RBFInterpolator

        # A point where only some runs failed still says what the others do.
        usable = np.isfinite(columns).all(axis=1) & (tried.lost < 1)
        shares, columns = tried.shares[usable], np.round(columns[usable], DIGITS)
        while not _determined(shares, degree):
            if degree == 1:
                return None
            degree -= 1
        numbers = RBFInterpolator(shares, columns, kernel="cubic", degree=degree)
        lost = None
        if (tried.lost > allowed).any():  # linear, which overshoots no step
            lost = RBFInterpolator(tried.shares, tried.lost, kernel="linear")
        return cls(numbers, lost)

    def __call__(self, points: Array) -> tuple[Array, Array, Array]:
        """Return the level, the excesses ``(points, bounds)``, and the share of lost runs."""
        columns = self.numbers(points)
        lost = np.zeros(len(points)) if self.lost is None else self.lost(points)
        return columns[:, 0], columns[:, 1:], lost

    def polished(
        self, starts: Array, low: Array, high: Array, aims: Array, equal: Array | None = None
    ) -> Array:
        """Return the best point of the models in a box, from several starts; the bounds hold there.

        Parameters
        ----------
        equal
            Which bounds have to be met exactly; None for none.
        """
        from scipy.optimize import minimize

        axes, step = len(low), 1e-6
        offsets = step * np.concatenate([np.zeros((1, axes)), np.eye(axes), -np.eye(axes)])
        memory: dict[bytes, tuple[Array, Array]] = {}

        def at(point: Array) -> tuple[Array, Array]:
            """Return all columns at a point, and their slopes ``(axes, columns)``."""
            if (key := point.tobytes()) not in memory:
                columns = self.numbers(point + offsets)
                slopes = (columns[1 : axes + 1] - columns[axes + 1 :]) / (2 * step)
                memory[key] = columns[0], slopes
            return memory[key]

        met = np.zeros(len(aims), dtype=bool) if equal is None else equal
        kinds = [("eq", np.flatnonzero(met)), ("ineq", np.flatnonzero(~met))]
        constraints = [
            {
                "type": kind,
                "fun": lambda x, which=which: aims[which] - at(x)[0][1 + which],
                "jac": lambda x, which=which: -at(x)[1][:, 1 + which].T,
            }
            for kind, which in kinds
            if len(which)
        ]
        points = [*starts]
        for start in starts:
            done = minimize(
                lambda x: at(x)[0][0],
                start,
                jac=lambda x: at(x)[1][:, 0].copy(),
                method="SLSQP",
                bounds=list(zip(low, high, strict=True)),
                constraints=constraints,
                options={"maxiter": 40, "ftol": 1e-9},
            )
            if np.isfinite(done.x).all():
                points.append(np.clip(done.x, low, high))
        grid = np.array(points)
        levels, over, _ = self(grid)
        off = np.maximum(over - aims, 0)
        off[:, met] = np.abs(over - aims)[:, met]
        good = off.max(axis=1, initial=0.0) <= 2e-4
        best = grid[np.lexsort((levels, np.where(good, 0.0, off.sum(axis=1))))[0]]
        return np.asarray(np.clip(np.round(best, PLACES), low, high))
