"""Numbers of a plant by least squares: those with which it predicts windows of a recording best."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache
from pathlib import Path
from typing import NamedTuple

import numpy as np

from eqt_cli.analysis.comparison.bootstrap import FEWEST, Resampling, intervals_of_means
from eqt_cli.closed_loop import ClosedLoop
from eqt_cli.config.source import ConfigSource, changed_at
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import ConfigError, EqtError, InputError
from eqt_cli.core.problems import parse_key
from eqt_cli.core.reporting import step
from eqt_cli.core.validation import shown
from eqt_cli.experiment.build import build
from eqt_cli.experiment.config_at_point import section_of
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.fitting.prediction import WINDOWS, Window, Windows, errors
from eqt_cli.tuning.law_search import entries_of, expanded, value_at

SECTIONS = ("plant", "actuators", "inertia")
"""The sections that hold numbers of a plant."""

FURTHER = 1e-4
"""Of a number, or of 1 where it is 0: the step from which derivatives are taken."""

RESOLVED = 10.0
"""Times the error of an engine: derivatives below it are none."""

APART = 1e-3
"""The least singular value of the derivatives by numbers, each of length 1, with which these are
told apart."""

ROUNDS = 3
"""In each, the first states of all windows follow what was found."""

MOST_TRIED = 50
"""Points in a round."""

ACCURACY = 1e-6
"""Relative: steps and gains of the search that are less end it. Derivatives are hardly better."""

FOLLOWED = 0.1
"""Of the noise: a first state that moves by less stays as it is."""

SHARE = 0.1
"""Of a direction: numbers with less of it are not named."""


@dataclass(frozen=True)
class FittedNumber:
    """A number of the plant.

    Attributes
    ----------
    key
        In the configuration.
    start, value
        Before and after.
    low, high
        Its 95 % interval.
    """

    key: str
    start: float
    value: float
    low: float
    high: float


@dataclass(frozen=True)
class Residual:
    """The root mean square of errors in a part of the pose or the velocity.

    Attributes
    ----------
    part, unit
        What of.
    before, after
        With the numbers that were given, and with those that were found.
    noise
        Of the recording from row to row.
    """

    part: str
    unit: str
    before: float
    after: float
    noise: float


@dataclass(frozen=True)
class PlantFit:
    """What was found.

    Attributes
    ----------
    name
        The recording.
    numbers, residuals
        Each with what is known of it.
    singular_values
        Of the derivatives of all errors by the numbers, each scaled to length 1: 1 where numbers
        act on their own, near 0 where some act as others do.
    windows, rows, horizon
        How many windows without a common row there are, how many rows in all, and their length, s.
    source, config
        The configuration with the numbers, and where it was written.
    notes
        What a reader should know of the recording and the model.
    """

    name: str
    numbers: list[FittedNumber]
    residuals: list[Residual]
    singular_values: list[float]
    windows: int
    rows: int
    horizon: float
    source: ConfigSource
    config: Path | None = None
    notes: tuple[str, ...] = ()


def starting_values(keys: Sequence[str], base: Experiment) -> list[float]:
    """What a configuration gives for keys.

    Raises
    ------
    InputError
        For a key that is no number of the plant.
    """
    found = []
    for key in keys:
        first = entries_of(key)[0]
        held = value_at(base.resolved, parse_key(first))
        if section_of(first) not in SECTIONS:
            raise InputError(
                f"{key}: expected a number of the plant, such as plant.inertia.relative or "
                "plant.forces[0].linear"
            )
        if held is None:
            raise InputError(f"{key}: is not in the configuration; add it with a value to start at")
        if isinstance(held, bool) or not isinstance(held, int | float):
            one = f"; give an entry, such as {key}[0]" if isinstance(held, list) else ""
            raise InputError(f"{key}: expected a key that holds a number, got {shown(held)}{one}")
        found.append(float(held))
    if len(set(keys)) < len(keys) or not keys:
        raise InputError(f"expected different keys, got {', '.join(keys) or 'none'}")
    return found


class _Linear(NamedTuple):
    """A window near some numbers, in units of the noise.

    Attributes
    ----------
    residuals : (n,)
        Its errors, without what another first state takes away.
    derivatives : (n, p)
        By the numbers, likewise.
    state : (2m,)
        By how much that first state is another one.
    """

    residuals: Array
    derivatives: Array
    state: Array


@dataclass
class _Problem:
    """The errors of all windows as a function of the numbers.

    First states are measured with noise. So each window may have another one, which is solved for
    to first order (variable projection), and the numbers are not asked to explain that noise.

    Attributes
    ----------
    driven
        Makes of a configuration its plant under the recorded wrench.
    """

    base: Experiment
    keys: Sequence[str]
    start: Array
    windows: Windows
    cut: list[Window]
    driven: Callable[[Experiment], ClosedLoop]

    def at(self, numbers: Array) -> ConfigSource:
        """The configuration with some numbers."""
        source = self.base.source
        given = dict(zip(self.keys, numbers.tolist(), strict=True))
        for key, value in expanded(given).items():
            source = changed_at(source, parse_key(key), value, "over")
        return source

    @cached_property
    def first(self) -> ClosedLoop:
        """The plant of the configuration."""
        return self.driven(self.base)

    @property
    def scales(self) -> Array:
        """How large each number is, or 1 where it is 0."""
        return np.where(self.start == 0.0, 1.0, np.abs(self.start))

    def linear(self, numbers: Array) -> list[_Linear] | None:
        """All windows; None where there is no such plant, or a run fails."""
        steps = FURTHER * self.scales
        points = [numbers, *(numbers + np.diag(steps))]
        try:
            plants = [self.driven(build(self.at(point), trust_plugins=True)) for point in points]
        except ConfigError:
            return None
        with step(WINDOWS, len(self.cut)):
            return self._along([self.first, *plants], steps)

    def _along(self, loops: list[ClosedLoop], steps: Array) -> list[_Linear] | None:
        found = []
        for window in self.cut:
            one = errors(loops, steps, self.base.engine, self.windows.recording, window)
            if one is None:
                return None
            r, by_state, by_number = map(
                self._weighted, (one.values[..., None], one.by_state, one.by_number)
            )
            basis, R = np.linalg.qr(by_state)
            found.append(
                _Linear(
                    (r - basis @ (basis.T @ r))[:, 0],
                    by_number - basis @ (basis.T @ by_number),
                    -np.linalg.lstsq(R, basis.T @ r)[0][:, 0],
                )
            )
        return found

    def _weighted(self, errors: Array) -> Array:
        """Errors of what was measured in units of the noise, one behind the other."""
        noise, measured = self.windows.noise, np.isfinite(self.windows.noise)
        return (errors[:, measured] / noise[measured, None]).reshape(-1, errors.shape[-1])

    def solved(self, start: Array) -> tuple[Array, list[_Linear]]:
        """The numbers with which the sum of squares is least, and all windows there."""
        from scipy.optimize import least_squares  # slow to import

        @lru_cache(maxsize=2)
        def at(numbers: tuple[float, ...]) -> list[_Linear] | None:
            return self.linear(np.array(numbers))

        def residuals(numbers: Array) -> Array:
            found = at(tuple(numbers.tolist()))
            if found is None:
                return np.full(self._size, np.inf)  # which shortens the step
            return np.concatenate([one.residuals for one in found])

        def derivatives(numbers: Array) -> Array:
            return np.concatenate([one.derivatives for one in at(tuple(numbers.tolist())) or ()])

        found = least_squares(
            residuals,
            start,
            derivatives,
            x_scale=self.scales,
            xtol=ACCURACY,
            ftol=ACCURACY,
            max_nfev=MOST_TRIED,
        )
        return np.asarray(found.x), at(tuple(found.x.tolist())) or []

    def require_told(self, found: list[_Linear]) -> Array:
        """The singular values of the derivatives by the numbers, each scaled to length 1.

        Raises
        ------
        EqtError
            Where the recording does not tell a number, or not apart from others.
        """
        derivatives, noise = np.concatenate([one.derivatives for one in found]), self.windows.noise
        name, lengths = self.windows.recording.name, np.linalg.norm(derivatives, axis=0)
        error = self.base.engine.rtol / (FURTHER * self.scales) / np.nanmin(noise)
        resolved = lengths > RESOLVED * np.sqrt(len(derivatives)) * error
        for key in (key for key, is_so in zip(self.keys, resolved, strict=True) if not is_so):
            raise EqtError(
                f"{key}: has no influence on what is predicted of {name}; leave it out, give a "
                "recording in which it acts, or start at a value of its size"
            )
        _, values, directions = np.linalg.svd(derivatives / lengths, full_matrices=False)
        if values[-1] < APART:
            parts = zip(self.keys, directions[-1], strict=True)
            alike = " and ".join(key for key, part in parts if abs(part) > SHARE)
            raise EqtError(
                f"{alike}: {name} does not tell them apart, since a change of one acts as a change "
                f"of the others (least singular value {values[-1]:.2g}); leave one out"
            )
        return np.asarray(values)

    @property
    def _size(self) -> int:
        rows = sum(window.rows.stop - window.rows.start for window in self.cut)
        return rows * int(np.isfinite(self.windows.noise).sum())

    def follow(self, found: list[_Linear]) -> float:
        """Take the first states that were found; how far the farthest is, in units of the noise."""
        G, noise = self.windows.recording.group, self.windows.noise
        pairs = zip(self.cut, found, strict=True)
        self.cut = [window.moved(G, one.state) for window, one in pairs]
        moves = np.abs([one.state for one in found])[:, np.isfinite(noise)]
        return float((moves / noise[np.isfinite(noise)]).max())

    def sizes(self, found: list[_Linear], taken: int) -> Array:
        """The root mean square of each coordinate, where so many numbers were fitted."""
        measured = np.isfinite(self.windows.noise)
        every = np.concatenate([one.residuals for one in found])
        squares = np.full(len(measured), np.nan)
        squares[measured] = np.mean(every.reshape(-1, int(measured.sum())) ** 2, axis=0)
        taken += len(found) * len(measured)
        return self.windows.noise * np.sqrt(squares * len(every) / max(len(every) - taken, 1))


def fit(
    base: Experiment,
    keys: Sequence[str],
    windows: Windows,
    driven: Callable[[Experiment], ClosedLoop],
) -> PlantFit:
    """The numbers of a plant with which it predicts the windows of a recording best.

    Least squares of the errors over the noise, by SciPy. Intervals are those of a block bootstrap,
    of which the blocks are the windows.

    Raises
    ------
    EqtError
        If the recording does not tell a number, or has too few windows.
    """
    start, name = np.array(starting_values(keys, base)), windows.recording.name
    problem = _Problem(base, keys, start, windows, windows.apart(), driven)
    if len(problem.cut) < FEWEST:
        raise EqtError(
            f"{name}: has {len(problem.cut)} windows of {windows.horizon:g} s without a common "
            f"row; intervals need {FEWEST} at least, so give a shorter horizon"
        )
    first = problem.linear(start)
    if first is None:
        raise EqtError(
            f"{name}: with the numbers of the configuration, the run of a window fails; check the "
            "inertia and the units of the wrench, or give a shorter horizon"
        )
    problem.require_told(first)
    before, numbers, found = problem.sizes(first, 0), start, first
    for _ in range(ROUNDS):
        numbers, found = problem.solved(numbers)
        if problem.follow(found) < FOLLOWED:
            break
    singular = problem.require_told(found)
    after = problem.sizes(found, len(keys))
    low, high = intervals(found) + numbers
    columns = zip(keys, start, numbers, low, high, strict=True)
    return PlantFit(
        name,
        [FittedNumber(key, *map(float, values)) for key, *values in columns],
        list(_residuals(windows, before, after)),
        singular.tolist(),
        len(found),
        sum(window.rows.stop - window.rows.start for window in problem.cut),
        windows.horizon,
        problem.at(numbers),
    )


def intervals(found: list[_Linear]) -> Array:
    """The ends of the 95 % intervals of the numbers, relative to what was found, ``(2, p)``.

    What a window adds is told by the numbers without it, to first order, which are θ + (A − A_w)⁻¹
    b_w with A_w = J_wᵀJ_w and b_w = J_wᵀr_w (pseudo-values of the jackknife). Their mean is
    resampled.
    """
    squares = [one.derivatives.T @ one.derivatives for one in found]
    pulls = [one.derivatives.T @ one.residuals for one in found]
    others, whole = len(found) - 1, sum(squares)
    values = [
        -others * np.linalg.solve(whole - own, pull)
        for own, pull in zip(squares, pulls, strict=True)
    ]
    mean = intervals_of_means(np.array(values), Resampling())
    return np.stack([mean.low - mean.mean, mean.high - mean.mean])


def _residuals(windows: Windows, before: Array, after: Array) -> Iterator[Residual]:
    for name, unit, axes in windows.kinds:
        sizes = [
            float(np.sqrt(np.mean(each[axes] ** 2))) for each in (before, after, windows.noise)
        ]
        yield Residual(name, unit, *sizes)
