"""Loads configurations, and opens results: their numbers, and their signals over time."""

from __future__ import annotations

import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from functools import cached_property
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import FILE_NAME
from eqt_cli.base.reporting import InNotebook
from eqt_cli.results.origin import KnownResult
from eqt_cli.results.result import Result
from eqt_cli.results.summary import headline

if TYPE_CHECKING:
    import pandas
    import xarray

    from eqt_cli.base.store_reader import Selection
    from eqt_cli.config.document import Document
    from eqt_cli.config.experiment import Experiment
    from eqt_cli.config.study import Study
    from eqt_cli.loop.closed_loop import ClosedLoop
    from eqt_cli.runs.run_study import Execution

# What reads results alone imports no configuration, since that takes as long as the rest.

# Loads experiments from configurations in files, results or mappings; paths as arguments ----------


ResultPath = str | os.PathLike[str]
"""A result folder, or the file in it. A `StoredResult` is a path, too."""


def path_from(name: str, value: Any, expected: str = "a path") -> Path:
    """Convert an argument to a path."""
    try:
        return Path(value)
    except TypeError:
        raise EqtError(f"{name}: expected {expected}, got {value!r}") from None


def require_list(name: str, value: Any) -> None:
    """Raise an `EqtError` for a single text where a list of them is expected."""
    if isinstance(value, str):
        raise EqtError(f"{name}: expected a list of names, as [{value!r}], got {value!r}")


Configuration = str | os.PathLike[str] | Mapping[str, Any]
"""A YAML file, a result whose stored configuration is used, or the configuration as a mapping."""


def load_experiment(
    config: Configuration,
    overrides: Mapping[str, Any] | None = None,
    *,
    trust_plugins: bool = False,
) -> Study:
    """Read and check a configuration.

    Parameters
    ----------
    config
        A YAML file, a result folder or file (its stored configuration), or the configuration as a
        mapping.
    overrides
        Values by key, as ``{"gains.kp": 2, "ensemble.runs": 50}``. NumPy arrays count as lists.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.

    Returns
    -------
    Study
        The checked experiment, for `run` and the other functions.

    Raises
    ------
    ConfigError
        With all problems and their places; those of a mapping are its keys.
    EqtError
        If the file does not exist.

    Examples
    --------
    >>> eqt_cli.load_experiment("configs/paper.yaml", {"ensemble.runs": 10})
    <experiment paper on SO3: 10 runs of eqt, gt, nog, asym>
    """
    from eqt_cli.base import yaml_source
    from eqt_cli.config.study import study

    if overrides is not None and not isinstance(overrides, Mapping):
        raise EqtError(
            f"overrides: expected values by key, as {{'gains.kp': 2}}, got {overrides!r}"
        )
    settings = {
        f"overrides[{k!r}]": f"{k}={yaml_source.flow(value)}"
        for k, value in (overrides or {}).items()
    }
    return study(document_from(config, settings, trust_plugins=trust_plugins))


def experiment_at(
    target: Study | Configuration, point: int | None, *, trust_plugins: bool = False
) -> Experiment:
    """Return the experiment at a point of a sweep, loading a configuration. Default: the first."""
    from eqt_cli.config.study import Study

    if not isinstance(target, Study):
        target = load_experiment(target, trust_plugins=trust_plugins)
    if not 0 <= (point or 0) < len(target):
        raise EqtError(f"point: expected one of 0 to {len(target) - 1}, got {point}")
    return target.experiment(point or 0)


def document_from(
    config: Configuration, overrides: Mapping[str, str], *, trust_plugins: bool = False
) -> Document:
    """Return a configuration with its overrides, not yet checked."""
    from eqt_cli.base import yaml_source
    from eqt_cli.config.document import Document, Place, overridden, read_config

    if not isinstance(config, Mapping):
        path = path_from("config", config, "a path or a mapping")
        return read_config(path, overrides, trust_plugins)
    # A mapping is converted to text first, so that it is checked like any other configuration.
    text = yaml_source.dump(
        json.loads(yaml_source.json_of({**config, "name": config.get("name") or "experiment"}))
    )
    source = yaml_source.load(text, "config", located=False)
    return overridden(Document(source, source.data, Place(Path.cwd())), overrides)


# Opens a result with eqt's reader -----------------------------------------------------------------


def open_at(path: str | os.PathLike[str], point: int | None = None) -> Result:
    """Open a result, or one point of a sweep with its own configuration; raises as `open_result`.

    No file has it: the configuration of the sweep gives it.
    """
    result = Result(Path(path))
    result.loops_of = loops_of
    if point is None:
        return result
    try:
        result.at(point)  # refuses what is no sweep or has no such point
        of_shape, row = result.source(point)
        from eqt_cli.runs.description import attributes_at

        return result.point(point, attributes_at(of_shape, row))
    except BaseException:
        result.close()
        raise


def loops_of(result: KnownResult, trust_plugins: bool = False) -> Mapping[str, ClosedLoop]:
    """Build the loops of a result again, by label."""
    from eqt_cli.config.document import document_of
    from eqt_cli.config.preflight import build

    return build(document_of(result, trust_plugins)).loops


# A result as one object ---------------------------------------------------------------------------


class StoredResult(InNotebook, os.PathLike[str]):
    """A result, which reads its file when you ask for numbers. It is a path, too.

    `eqt_cli.run` returns one, and `eqt_cli.open_result` opens one.

    Attributes
    ----------
    path : Path
        The result folder, or the file that was opened.
    point : int or None
        Point of a sweep that it is; None for the whole result.
    """

    def __init__(self, path: Path, point: int | None = None, outcome: Execution | None = None):
        self.path, self.point, self._outcome = path, point, outcome

    def __fspath__(self) -> str:
        if self.point is not None:
            raise EqtError(
                f"{self.path}: a point of a sweep is not a path; give the path and point"
            )
        return str(self.path)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def __del__(self) -> None:
        self.close()

    def close(self) -> None:
        """Close the file; it is opened again where numbers are asked for."""
        if (opened := vars(self).pop("opened", None)) is not None:
            opened.close()

    @property
    def file(self) -> Path:
        """The result file."""
        return self.path / FILE_NAME if self.path.is_dir() else self.path

    @cached_property
    def opened(self) -> Result:
        """eqt's own reader of the file, open as long as this object is there."""
        return open_at(self.path, self.point)

    @property
    def outcome(self) -> Execution:
        """What `run` did: ``was_complete``, ``resumed``, ``removed``, ``packed``, ``seconds``."""
        if self._outcome is None:
            raise EqtError(
                f"{self.path}: was opened from a file; only a result that `run` returns has an "
                "outcome"
            )
        return self._outcome

    @property
    def runs(self) -> int:
        """Number of runs over all laws and points."""
        return self._outcome.runs if self._outcome else self.opened.status.size

    @property
    def failed(self) -> int:
        """Number of runs with a status other than 0."""
        return self._outcome.failed if self._outcome else sum(self.opened.failed.values())

    @property
    def labels(self) -> list[str]:
        """Labels of the laws."""
        return self.opened.labels

    @property
    def times(self) -> Array:
        """Sample times of trajectories, s."""
        return self.opened.times

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the stored variables."""
        return self.opened.names

    @property
    def attributes(self) -> Mapping[str, Any]:
        """Attributes of the file: ``config``, ``provenance``, ``title`` and others, as text."""
        return self.opened.attributes

    def dims(self, name: str) -> tuple[str, ...]:
        """Return the dimensions of a variable."""
        return self.opened.dims(name)

    def coordinate(self, dimension: str) -> Any:
        """Return the labels or numbers along a dimension."""
        return self.opened.coordinate(dimension)

    def units(self, name: str) -> str:
        """Return the unit of a variable or a metric; 1 for a pure number."""
        return self.opened.units(name)

    def __iter__(self) -> Iterator[str]:
        return iter(self.names)

    def __contains__(self, name: object) -> bool:
        return isinstance(name, str) and self.opened.has(name)

    def __getitem__(self, name: str) -> Any:
        return self.opened[name]

    def read(self, name: str, /, **selection: Selection) -> Any:
        """Return a stored variable as an array, for the chosen labels, numbers or slices.

        Examples
        --------
        >>> eqt_cli.open_result("results/paper").read("torque_norm", controller="eqt", run=3).shape
        (401,)
        """
        return self.opened.read(name, **selection)

    def metric(self, name: str) -> Array:
        """Return a number of every run, ``(laws, runs)``; a sweep has a leading axis of points.

        Parameters
        ----------
        name
            A name that `metrics` has as a column. `eqt compare --list` explains them.

        Returns
        -------
        array
            Stored or computed from trajectories. NaN if a run failed or has no such number.

        Raises
        ------
        EqtError
            If there is no such number, or the trajectories for it are not stored.
        """
        return self.opened.metric(name)

    def metrics(self, names: Sequence[str] | None = None) -> pandas.DataFrame:
        """Return a table with one row per run: (point, swept keys,) controller, run, status, ….

        Parameters
        ----------
        names
            Names of metrics. Default: all that the result holds or that follow from it.

        Returns
        -------
        pandas.DataFrame
            A metric is NaN if the run failed or has no such number. ``attrs["units"]`` has units.

        Raises
        ------
        EqtError
            If there is no such metric, or pandas is not installed (extra xarray).

        Examples
        --------
        >>> table = eqt_cli.open_result("results/paper").metrics()
        >>> list(table.groupby("controller").mean_torque.mean().index)
        ['asym', 'eqt', 'gt', 'nog']
        """
        from eqt_cli.results.dataset import frame

        require_list("names", names)
        return frame(self.opened, names)

    def to_xarray(self, angles: str = "") -> xarray.Dataset:
        r"""Return all variables with labels, units and frames; values are read when they are used.

        Added to what the file holds, of the motion and, as ``desired_…``, of the reference:
        ``position``, ``linear_velocity`` (its rate, in space), ``quaternion`` (w, x, y, z, without
        jumps) or, in the plane, ``heading``, ``angular_velocity`` (in the body) and
        ``angular_velocity_in_space``.

        Parameters
        ----------
        angles
            Axes of Euler angles as SciPy names them, such as ``"ZYX"`` for yaw, pitch and roll;
            they add ``euler_angles``.

        Returns
        -------
        xarray.Dataset
            Use a ``with`` block to close it. Of a sweep whose points differ in shape it holds only
            the metrics that all points have; open one point.

        Raises
        ------
        EqtError
            If xarray is not installed (extra xarray), or the axes are none.

        Examples
        --------
        >>> with eqt_cli.open_result("results/paper").to_xarray() as data:
        ...     print(data.quaternion.sel(controller="eqt", run=0).dims)
        ('time', 'axis_wxyz')
        """
        if angles and not re.fullmatch(r"(?=[xyz]{3}|[XYZ]{3})(?!.?(.)\1)...", angles):
            raise EqtError(f"angles: expected three axes, such as ZYX or xyz, got '{angles}'")
        if find_spec("xarray") is None or find_spec("h5netcdf") is None:
            raise EqtError("xarray is not installed (extra xarray): pip install xarray h5netcdf")
        import xarray

        from eqt_cli.components.derived import with_derived
        from eqt_cli.components.groups import known_group

        result, point = self.opened, self.point
        file, row = result.path, point
        if point is not None:
            with open_at(self.path) as swept:
                of_shape, row = swept.source(point)
                file = of_shape.path
        whole = xarray.open_dataset(
            file,
            engine="h5netcdf",
            driver_kwds={"locking": False},  # as eqt's reader opens it: result files never change
        )
        dataset = whole
        if row is not None:
            dataset = whole.isel(point=row).assign_attrs(dict(result.attributes))
        if result.is_over_time("pose") and (group := known_group(result.group_name)) is not None:
            dataset = with_derived(dataset, group, angles)
        if dataset is not whole:
            dataset.set_close(whole.close)
        return dataset

    def answer(self) -> list[str]:
        """Return the path and the number of runs: ``<result results/paper: 800 runs>``."""
        at = "" if self.point is None else f", point {self.point}"
        failed = f", {self.failed} failed" if self.failed else ""
        return [f"<result {self.path}{at}: {self.runs} runs{failed}>"]

    def records(self) -> list[dict[str, Any]]:
        """Return the summary of each law; none of a shard whose result is not packed yet."""
        return headline(self.opened) if self.file.exists() else []


def open_result(path: str | os.PathLike[str], point: int | None = None) -> StoredResult:
    """Open a result, after checking that its file is safe to read.

    Parameters
    ----------
    path
        The result folder, or the file in it.
    point
        Point of a sweep, counted from 0, to open as the result of a single experiment.

    Returns
    -------
    StoredResult
        Use a ``with`` block, or `StoredResult.close`, to close the file.

    Raises
    ------
    ResultError
        If the result or the point does not exist, or the file is damaged or unsafe.

    Examples
    --------
    >>> with eqt_cli.open_result("results/paper") as result:
    ...     print(result.labels, result.metric("mean_torque").shape[0])
    ['eqt', 'gt', 'nog', 'asym'] 4
    """
    stored = StoredResult(path_from("path", path), point)
    stored.opened  # noqa: B018 - raises where the file cannot be read
    return stored
