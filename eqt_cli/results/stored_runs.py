"""The runs of a result: outcomes, points of a sweep, and trajectories."""

from collections.abc import Sequence
from contextlib import suppress
from functools import cached_property

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.printable import printable
from eqt_cli.engines import Status
from eqt_cli.ensemble.designs.base import CASE
from eqt_cli.experiment.law_names import LAW
from eqt_cli.results.contract import check_status
from eqt_cli.results.origin import KnownResult, law_title
from eqt_cli.results.swept_key import SweptKey, constant_of, degrees_of, log_keys
from eqt_cli.store.reserved_names import POINT


class StoredRuns(KnownResult):
    """An open result with its runs. A run is good if its status is 0."""

    # Runs.

    @property
    def is_sweep(self) -> bool:
        """Whether the result has points, each of which is an experiment."""
        return POINT in self.dimensions

    @property
    def points(self) -> int:
        """Number of points; 1 for a single experiment."""
        return self.dimensions.get(POINT, 1)

    @property
    def runs(self) -> int:
        """Number of runs per controller and point."""
        return self.dimensions["run"]

    @cached_property
    def times(self) -> Array:
        """Sample times of trajectories, s."""
        return _fixed(self.coordinate("time"))

    @property
    def horizon(self) -> float | None:
        """Duration of the runs, s; None if it differs between points."""
        if not self.has("time"):
            return None
        times = self.times
        return float(times[-1] - times[0])

    @cached_property
    def status(self) -> Array:
        """Status of every run, ``(controllers, runs)``; a sweep has a leading axis of points."""
        found = self["status"]
        check_status(self, found)
        return _fixed(found)

    @property
    def good(self) -> Array:
        """Whether each run is good, in the shape of `status`."""
        return self.status == 0

    @property
    def failed(self) -> dict[str, int]:
        """Number of failed runs of each controller, by label."""
        counts = np.count_nonzero(self.status, axis=-1)
        totals = counts.sum(axis=0) if self.is_sweep else counts
        return {label: int(total) for label, total in zip(self.labels, totals, strict=True)}

    @property
    def failures(self) -> Array:
        """Indices (point,) controller and run of the failed runs, one per row."""
        return np.argwhere(self.status)

    @property
    def endings(self) -> dict[str, int]:
        """Number of failed runs by kind of failure, the most frequent first."""
        codes, counts = np.unique(self.status[self.status != 0], return_counts=True)
        order = np.argsort(-counts, kind="stable")
        return {meaning_of(int(codes[i])): int(counts[i]) for i in order}

    def messages(self, where: Array) -> list[str]:
        """Return the messages of failed runs, given rows of `failures`."""
        # Reading all messages of a million runs takes seconds, so only these rows are read.
        axes = [np.unique(where[:, axis], return_inverse=True) for axis in range(where.shape[1])]
        chosen = {dim: k for dim, (k, _) in zip(self.dims("status"), axes, strict=True)}
        found = self.read("message", **chosen)[tuple(position for _, position in axes)]
        return [printable(str(message)) for message in found]

    def place(self, where: Sequence[int]) -> str:
        """Describe a run given a row of `failures`: ``point 3 eqt run 17``."""
        *point, controller, run = where
        return f"{f'point {point[0]} ' if point else ''}{self.labels[controller]} run {run}"

    # Sweeps.

    @cached_property
    def swept_keys(self) -> list[SweptKey]:
        """Swept keys with more than one value; keys that change together appear once."""
        found: list[SweptKey] = []
        for name in self.coordinates:
            if name != POINT and self.dims(name) == (POINT,):
                key = self._swept_key(name)
                if max(key.levels) > 0 and key.levels not in [other.levels for other in found]:
                    found.append(key)
        return found

    def _swept_key(self, name: str) -> SweptKey:
        values = self.coordinate(name)
        key = self.long_name(name).removesuffix(", swept")
        if values.dtype != object:
            return SweptKey(key, values.astype(float), {}, key in self._on_log_scales)
        written = [printable(str(value)) for value in values]
        degrees = [angle for text in written if (angle := degrees_of(text)) is not None]
        if len(degrees) == len(written):
            return SweptKey(key, np.array(degrees), {}, unit="deg")
        constants = [found for text in written if (found := constant_of(text)) is not None]
        if len(constants) == len(written):
            return SweptKey(key, np.array([value for value, _ in constants]), dict(constants))
        numbers: dict[str, float] = {}  # in the order of the points
        places = [numbers.setdefault(text, float(len(numbers))) for text in written]
        texts = {place: text for text, place in numbers.items()}
        return SweptKey(key, np.array(places), texts, is_number=False)

    @cached_property
    def _on_log_scales(self) -> set[str]:
        """Keys with a logarithmic range in the sweep."""
        with suppress(KeyError, TypeError, RecursionError):
            return set(log_keys(self.config["sweep"]))
        return set()

    def point_name(self, point: int) -> str:
        """Describe a point of a sweep: ``kp 2, kd 0.5``; a case by its name only."""
        keys = [swept.key.rpartition(".")[2] for swept in self.swept_keys]
        if len(set(keys)) < len(keys):
            keys = [swept.key for swept in self.swept_keys]
        pairs = zip(keys, self.swept_keys, strict=True)
        return ", ".join(
            swept.at(point) if key == CASE else f"{key} {swept.at(point)}" for key, swept in pairs
        )

    def laws(self, controller: int) -> dict[int, str]:
        """Return the titles of the registered laws that a controller equals, by point.

        Empty if the sweep does not vary the controllers' options.
        """
        if not self.has(LAW):
            return {}
        names = self.read(LAW, controller=controller)
        return {int(point): law_title(str(names[point])) for point in np.flatnonzero(names != "")}

    # Trajectories.

    @property
    def run_dimension(self) -> str:
        """Dimension of the runs with trajectories: ``run`` or ``stored_run``."""
        return next(dim for dim in self.dims("lyapunov") if dim.endswith("run"))

    @cached_property
    def stored_runs(self) -> Array:
        """Numbers of the runs with stored trajectories; empty if there are none."""
        if not self.is_over_time("lyapunov"):
            return np.array([], dtype=int)
        return _fixed(self.coordinate(self.run_dimension))

    def is_over_time(self, name: str) -> bool:
        """Whether the file holds this variable over time."""
        return self.has(name) and "time" in self.dims(name)

    def check_stored(self, *signals: str, who: str) -> None:
        """Check that signals are stored over time.

        Parameters
        ----------
        who
            Name of the caller with the verb: ``figure 'paper' needs``.

        Raises
        ------
        EqtError
            If the file lacks a signal; the message says how to store it.
        """
        for name in signals:
            if not self.is_over_time(name):
                raise self.error(f"{who} {lacks([name])}")

    def good_stored(self, controller: int) -> Array:
        """Whether each run with a trajectory is good, ``(stored runs,)``."""
        return self.good[controller][self.stored_runs]

    def trajectories(self, signal: str, controller: int, most: int | None = None) -> Array:
        """Return a signal of the good runs of a controller, ``(runs, samples, …)``.

        Parameters
        ----------
        most
            Largest number of runs to read, from the first on; all if None.
        """
        good = self.good_stored(controller)
        if most is None:
            return self.read(signal, controller=controller)[good]
        first = np.flatnonzero(good)[:most]
        return self.read(signal, controller=controller, **{self.run_dimension: first})

    def trajectory(self, signal: str, run: int) -> Array:
        """Return a signal of one run of every controller, ``(controllers, samples, …)``.

        Raises
        ------
        EqtError
            If the trajectory of that run is not stored.
        """
        stored = self.stored_runs.tolist()
        if run not in stored:
            has = f"; stored are runs {stored[0]} to {stored[-1]}" if stored else ""
            raise self.error(f"the trajectory of run {run} is not stored{has}")
        return self.read(signal, **{self.run_dimension: stored.index(run)})

    def parts(self, norm: str) -> list[str]:
        """Return the parts of a norm that are stored separately, such as ``rotation``."""
        return [
            name.removeprefix(f"{norm}_")
            for name in self.names
            if name.startswith(f"{norm}_") and self.is_over_time(name)
        ]

    @cached_property
    def attitude_errors(self) -> list[str]:
        """Stored norms that are distances ‖I − R‖_F of rotations, from which angles follow.

        Empty for a group of a plugin that is not loaded.
        """
        parts = () if self.group is None else self.group.parts
        turns = [f"_{part.name}" if len(parts) > 1 else "" for part in parts if part.turns]
        return [name for end in turns if self.is_over_time(name := f"pose_error{end}")]

    def split(self, norm: str) -> list[str]:
        """Return the names of the stored parts of a norm, or else its own name."""
        return [f"{norm}_{part}" for part in self.parts(norm)] or [norm]


def meaning_of(status: int) -> str:
    """Describe a status in words."""
    try:
        return Status(status).name.lower().replace("_", " ")
    except ValueError:
        return f"status {status}"


def _fixed(values: Array) -> Array:
    """Make an array read-only, because it is cached."""
    values.setflags(write=False)
    return values


def lacks(signals: Sequence[str]) -> str:
    """Return the words about missing signals over time, for messages."""
    needed = " and ".join(f"'{name}'" for name in signals)
    return (
        f"the trajectories of {needed}, which the result does not hold; set store.trajectories to "
        "all and run the experiment again"
    )
