"""Fits numbers of a plant by least squares, so that it predicts windows of a recording best."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, lru_cache
from pathlib import Path

import numpy as np

from eqt_cli.analysis.intervals import FEWEST
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import OTHER_FOLDER, ConfigError, EqtError, InputError, parse_key
from eqt_cli.base.files import CONFIG_MARK, check_entries, check_targets, refusals
from eqt_cli.base.option_types import shown
from eqt_cli.base.reporting import Block, TextTable, significant, step
from eqt_cli.config.document import Document, changed_at, entries_of, expanded, value_at
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.marks import PLANT
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import marks_of
from eqt_cli.config.study import study
from eqt_cli.extensions.flights import prediction
from eqt_cli.extensions.flights.prediction import DELAY, Linear, ReplayWindow, Windows
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.runs.folder import COPY_FOLDERS, ResultFolder

STEP = 1e-4
"""Step of difference quotients, relative to a number's start value, or to 1 if that is 0."""

RESOLVED = 10.0
"""Multiple of an engine's error above which a derivative counts as different from 0."""

SMALLEST_RTOL = 1e-12
"""Smallest tolerance that a message proposes; engines take some smaller ones."""

ROUNDS = 3
"""Largest number of rounds; after each, the first states of all windows are updated."""

MAX_EVALUATIONS = 50
"""Largest number of evaluations in a round."""

ACCURACY = 1e-6
"""Relative step or gain at which the search ends; derivatives are hardly more accurate."""

SETTLED = 0.1
"""Correction of the first states, relative to the noise, below which no further round follows."""

SHARE = 0.1
"""Smallest component of a singular vector for which a message names the number."""


@dataclass(frozen=True)
class FittedNumber:
    """A number of the plant.

    Attributes
    ----------
    key
        Its key in the configuration.
    start, value
        The values before and after the fit.
    low, high
        The ends of its 95 % interval.
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
        The part and its unit.
    before, after
        The errors with the start values, and with the fitted values.
    noise
        The noise of the recording from row to row.
    """

    part: str
    unit: str
    before: float
    after: float
    noise: float


@dataclass(frozen=True)
class PlantFit:
    """The result of a fit.

    Attributes
    ----------
    name
        The recording.
    numbers, residuals
        The fitted numbers, and the errors of each part.
    singular_values
        Singular values of the derivatives of all errors, scaled to length 1 for each number: 1
        where numbers act independently, near 0 where some act as others do.
    covariance
        Covariance of the numbers, without the spread between flights.
    windows, rows, horizon
        The number of disjoint windows, that of their rows, and the length of a window, s.
    document, config
        The configuration with the fitted numbers, and its path if it was written.
    notes
        Remarks on the recording and the model.
    """

    name: str
    numbers: list[FittedNumber]
    residuals: list[Residual]
    singular_values: list[float]
    covariance: list[list[float]]
    windows: int
    rows: int
    horizon: float
    document: Document
    config: Path | None = None
    notes: tuple[str, ...] = ()


def starting_values(keys: Sequence[str], base: Experiment, delay: float) -> list[float]:
    """Return the values of keys in a configuration; the delay of the wrench is not in it.

    Raises
    ------
    InputError
        If a key is no number of the plant.
    """
    values = []
    for key in keys:
        if key == DELAY:
            values.append(delay)
            continue
        first = entries_of(key)[0]
        value = value_at(base.resolved, parse_key(first))
        if PLANT not in marks_of(first):
            raise InputError(
                f"{key}: expected a number of the plant, such as plant.inertia.relative or "
                "plant.forces[0].linear, or delay"
            )
        if value is None:
            raise InputError(f"{key}: is not in the configuration; add it with a value to start at")
        if isinstance(value, bool) or not isinstance(value, int | float):
            hint = f"; give an entry, such as {key}[0]" if isinstance(value, list) else ""
            raise InputError(f"{key}: expected a key that holds a number, got {shown(value)}{hint}")
        values.append(float(value))
    if len(set(keys)) < len(keys) or not keys:
        raise InputError(f"expected different keys, got {', '.join(keys) or 'none'}")
    return values


@dataclass
class _FitProblem:
    """The errors of all windows as a function of the numbers.

    Measured first states are noisy. So each window gets a correction of its first state, by
    variable projection to first order, and this noise does not bias the numbers.

    Attributes
    ----------
    keys, start
        The numbers and their start values; the delay of the wrench, if it is one, is the last.
    driven
        Returns the plant of an experiment under the recorded wrench.
    delay
        The delay of the wrench if it is no number, s.
    """

    base: Experiment
    keys: Sequence[str]
    start: Array
    windows: Windows
    cut: list[ReplayWindow]
    driven: Callable[[Experiment], ClosedLoop]
    delay: float

    @property
    def finds_delay(self) -> bool:
        """Whether the delay of the wrench is a number to find."""
        return self.keys[-1] == DELAY

    def at(self, numbers: Array) -> Document:
        """Return the configuration with other numbers."""
        document = self.base.document
        values = dict(zip(self.keys, numbers.tolist(), strict=True))
        values.pop(DELAY, None)
        for key, value in expanded(values).items():
            document = changed_at(document, parse_key(key), value, "over")
        return document

    @cached_property
    def first(self) -> ClosedLoop:
        """The plant of the configuration."""
        return self.driven(self.base)

    @property
    def scales(self) -> Array:
        """The magnitude of each start value, or 1 where it is 0; of a delay, a few rows."""
        scales = np.where(self.start == 0.0, 1.0, np.abs(self.start))
        if self.finds_delay:
            scales[-1] = 10.0 * self.windows.delay_step
        return scales

    def linearised(self, numbers: Array, *, by_delay: bool = False) -> list[Linear] | None:
        """Return all windows near some numbers; None for an invalid plant or a failed run.

        Parameters
        ----------
        by_delay
            Whether the last derivative is that by the delay of the wrench, even if that is fixed.
        """
        steps = (STEP * self.scales)[: len(numbers) - self.finds_delay]
        points = [numbers, *(numbers + np.eye(len(steps), len(numbers)) * steps[:, None])]
        try:
            plants = [self.driven(build(self.at(point))) for point in points]
        except ConfigError:
            return None
        with step(prediction.WINDOWS, len(self.cut)):
            fits, recording = [], self.windows.recording
            delay = float(numbers[-1]) if self.finds_delay else self.delay
            delay_step = self.windows.delay_step if by_delay or self.finds_delay else 0.0
            loops, engine = [self.first, *plants], self.base.engine
            before = [prediction.commanded(loop) for loop in loops]
            for window in self.cut:
                predicted = prediction.prediction_errors(
                    loops, before, steps, engine, recording, window, delay, delay_step
                )
                if predicted is None:
                    return None
                fits.append(prediction.linear(predicted, self.windows.noise))
            return fits

    def find_actuators(self, numbers: Array) -> bool:
        """Let windows find the states of actuators that no commands tell; whether more do so."""
        before = prediction.commanded(self.driven(build(self.at(numbers))))
        cut, recording = list(self.cut), self.windows.recording
        for k, window in enumerate(cut):
            if not (len(window.actuators) or before.are_told(recording, window.rows.start)):
                self.cut[k] = replace(window, actuators=np.zeros(before.count))
        return any(new is not old for new, old in zip(self.cut, cut, strict=True))

    def solved(self, start: Array) -> tuple[Array, list[Linear]]:
        """Return the numbers of the smallest sum of squares, and all windows near them."""
        from scipy.optimize import least_squares  # slow to import

        @lru_cache(maxsize=2)
        def at(numbers: tuple[float, ...]) -> list[Linear] | None:
            return self.linearised(np.array(numbers))

        def residuals(numbers: Array) -> Array:
            fits = at(tuple(numbers.tolist()))
            if fits is None:  # least_squares then shortens the step
                return np.full(self.rows * int(np.isfinite(self.windows.noise).sum()), np.inf)
            return np.concatenate([one.residuals for one in fits])

        def derivatives(numbers: Array) -> Array:
            return np.concatenate([one.derivatives for one in at(tuple(numbers.tolist())) or ()])

        limits = {"xtol": ACCURACY, "ftol": ACCURACY, "max_nfev": MAX_EVALUATIONS}
        solution = least_squares(residuals, start, derivatives, x_scale=self.scales, **limits)
        return np.asarray(solution.x), at(tuple(solution.x.tolist())) or []

    def require_distinct(self, fits: list[Linear]) -> Array:
        """Return the singular values of the derivatives, scaled to length 1 for each number.

        Raises
        ------
        EqtError
            If the recording does not determine a number, or does not distinguish it from others.
        """
        derivatives, noise = np.concatenate([one.derivatives for one in fits]), self.windows.noise
        name, lengths = self.windows.recording.name, np.linalg.norm(derivatives, axis=0)
        error = self.base.engine.rtol / (STEP * self.scales) / np.nanmin(noise)
        resolved = lengths > RESOLVED * np.sqrt(len(derivatives)) * error
        for key in (key for key, acts in zip(self.keys, resolved, strict=True) if not acts):
            why = (
                "leave it out, give a recording in which it acts, or start at a value of its "
                "magnitude"
            )
            place = self.keys.index(key)
            short = lengths[place] / (RESOLVED * np.sqrt(len(derivatives)) * error[place])
            rtol = self.base.engine.rtol * short / 2
            if rtol > SMALLEST_RTOL:
                raise EqtError(
                    f"{key}: its influence on the prediction of {name} is below the error of the "
                    f"solver, not of the recording; add --set solver.rtol={float(f'{rtol:.1g}'):g}"
                )
            if prediction.is_before_speeds(parse_key(key), self.base, self.windows.recording):
                why = (
                    "its rotor speeds were measured behind this actuator; record the commanded "
                    "wrench in place of them to fit it"
                )
            raise EqtError(f"{key}: has no influence on the prediction of {name}; {why}")
        _, values, directions = np.linalg.svd(derivatives / lengths, full_matrices=False)
        if values[-1] < prediction.DISTINCT:
            parts = zip(self.keys, directions[-1], strict=True)
            alike = " and ".join(key for key, part in parts if abs(part) > SHARE)
            raise EqtError(
                f"{alike}: {name} cannot distinguish them, because a change of one acts like a "
                f"change of the others (smallest singular value {values[-1]:.2g}); leave one out"
            )
        return np.asarray(values)

    @property
    def rows(self) -> int:
        """The number of rows of all windows."""
        return sum(window.rows.stop - window.rows.start for window in self.cut)

    def sizes(self, fits: list[Linear], fitted: int) -> Array:
        """Return the root mean square of each coordinate, if `fitted` numbers were fitted."""
        measured = np.isfinite(self.windows.noise)
        residuals = np.concatenate([one.residuals for one in fits])
        squares = np.full(len(measured), np.nan)
        squares[measured] = np.mean(residuals.reshape(-1, int(measured.sum())) ** 2, axis=0)
        fitted += sum(len(one.state) for one in fits)
        freedom = max(len(residuals) - fitted, 1)
        return self.windows.noise * np.sqrt(squares * len(residuals) / freedom)


def fit(
    base: Experiment,
    keys: Sequence[str],
    windows: Windows,
    driven: Callable[[Experiment], ClosedLoop],
    delay: float = 0.0,
) -> PlantFit:
    """Fit the numbers of a plant, so that it predicts the windows of a recording best.

    The sum of squared errors, in units of the noise, is minimised by SciPy. Intervals
    let the errors of a window be correlated.

    Raises
    ------
    EqtError
        If the recording does not determine a number, or has too few windows.
    """
    keys = sorted(keys, key=DELAY.__eq__)
    start, name = np.array(starting_values(keys, base, delay)), windows.recording.name
    problem = _FitProblem(base, keys, start, windows, windows.disjoint(), driven, delay)
    if len(problem.cut) < FEWEST:
        raise EqtError(
            f"{name}: has {len(problem.cut)} windows of {windows.horizon:g} s that share no row; "
            f"intervals need at least {FEWEST}, so give a shorter horizon"
        )
    problem.find_actuators(start)
    first = problem.linearised(start)
    if first is None:
        raise EqtError(
            f"{name}: with the numbers of the configuration, the run of a window fails; check the "
            "inertia and the units of the wrench, or give a shorter horizon"
        )
    problem.require_distinct(first)
    before, numbers, fits = problem.sizes(first, 0), start, first
    G, is_noisy = windows.recording.group, np.isfinite(windows.noise)
    for _ in range(ROUNDS):
        numbers, fits = problem.solved(numbers)
        # Corrects the first states, by less than a part of the noise in the end
        pairs = zip(problem.cut, fits, strict=True)
        problem.cut = [window.moved(G, one.state) for window, one in pairs]
        corrections = np.abs([one.state[: len(is_noisy)] for one in fits])[:, is_noisy]
        is_settled = (corrections / windows.noise[is_noisy]).max() < SETTLED
        if not problem.find_actuators(numbers) and is_settled:
            break
    singular = problem.require_distinct(fits)
    after = problem.sizes(fits, len(keys))
    notes = list(prediction.correlated(fits, windows))
    if not problem.finds_delay:
        notes += prediction.delayed(problem.linearised(numbers, by_delay=True) or [], fitted=True)
    low, high = prediction.intervals(fits) + numbers
    covariance = prediction.covariance(fits)
    notes += _correlations(keys, covariance)
    columns = zip(keys, start, numbers, low, high, strict=True)
    residuals = []
    for part, unit, axes in windows.parts:
        squares = [np.mean(sizes[axes] ** 2) for sizes in (before, after, windows.noise)]
        residuals.append(Residual(part, unit, *map(float, np.sqrt(squares))))
    return PlantFit(
        name,
        [FittedNumber(key, *map(float, values)) for key, *values in columns],
        residuals,
        singular.tolist(),
        covariance.tolist(),
        len(fits),
        problem.rows,
        windows.horizon,
        problem.at(numbers),
        notes=tuple(notes),
    )


TOLD = 0.5
"""Correlation of the errors of two numbers from which it is told."""


def _correlations(keys: Sequence[str], covariance: Array) -> list[str]:
    """Say which numbers have errors that are correlated."""
    sizes = np.sqrt(np.diag(covariance))
    pairs = [(a, b) for a in range(len(keys)) for b in range(a) if sizes[a] and sizes[b]]
    shares = {(a, b): float(covariance[a, b] / (sizes[a] * sizes[b])) for a, b in pairs}
    return [
        f"The errors of {keys[b]} and {keys[a]} are correlated by {share:.2f}: draw both together."
        for (a, b), share in shares.items()
        if abs(share) >= TOLD
    ]


FITTED = "fitted.yaml"


def check_folder(folder: Path) -> None:
    """Refuse a folder in which the configuration cannot be written, before any work.

    Raises
    ------
    EqtError
        If an entry is a link, or a file of this name that eqt did not write.
    """
    with refusals(folder / FITTED, "written", OTHER_FOLDER):
        check_entries(folder, COPY_FOLDERS)
    check_targets([folder / FITTED], folder)


def write_fitted(result: PlantFit, folder: Path) -> Path:
    """Write the complete configuration, and beside it the files it refers to; return its path."""
    path, mark = folder / FITTED, CONFIG_MARK.format("fit")
    with refusals(path, "written", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        ResultFolder(folder).write_config(study(result.document), path.name, mark.encode())
    return path


def fit_tables(result: PlantFit) -> list[TextTable]:
    """Return the numbers with their intervals, and the errors before and after the fit."""
    numbers = []
    for n in result.numbers:
        start, value, low, high = (significant(x, 5) for x in (n.start, n.value, n.low, n.high))
        numbers.append([n.key, start, value, f"[{low}, {high}]"])
    errors = [
        [f"{r.part}, {r.unit}", *(significant(x, 3) for x in (r.before, r.after, r.noise))]
        for r in result.residuals
    ]
    values = ", ".join(f"{value:.3g}" for value in result.singular_values)
    title = f"Fitted to {result.windows} windows of {result.horizon:.4g} s of {result.name}"
    note = (
        f"Singular values of the scaled Jacobian: {values}. Near 0, the recording cannot "
        "distinguish the numbers."
    )
    header = ["key", "start", "found", "95 % interval"]
    columns = ["error", "before", "after", "noise"]
    return [
        TextTable("numbers", title, header, [Block("", numbers)], [note, *result.notes]),
        TextTable("residuals", "Root mean square of the errors", columns, [Block("", errors)]),
    ]
