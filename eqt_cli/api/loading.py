"""Loads configurations, and opens results."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal, overload

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import point_group
from eqt_cli.results.origin import KnownResult
from eqt_cli.results.result import Result, open_result

if TYPE_CHECKING:
    import xarray

    from eqt_cli.config.experiment import Experiment
    from eqt_cli.config.source import ConfigSource
    from eqt_cli.config.study import Study
    from eqt_cli.loop.closed_loop import ClosedLoop

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
        With all problems and their places.
    EqtError
        If the file does not exist.

    Examples
    --------
    >>> eqt_cli.load_experiment("configs/paper.yaml", {"ensemble.runs": 10})
    <experiment paper on SO3: 10 runs of eqt, gt, nog, asym>
    """
    from eqt_cli.config.study import study

    if overrides is not None and not isinstance(overrides, Mapping):
        raise EqtError(
            f"overrides: expected values by key, as {{'gains.kp': 2}}, got {overrides!r}"
        )
    settings = {
        f"overrides[{k!r}]": f"{k}={yaml_source.flow(value)}"
        for k, value in (overrides or {}).items()
    }
    return study(source_from(config, settings), trust_plugins=trust_plugins)


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


def source_from(config: Configuration, overrides: Mapping[str, str]) -> ConfigSource:
    """Return a configuration with its overrides, not yet checked."""
    from eqt_cli.config.source import ConfigSource, overridden, read_config

    if not isinstance(config, Mapping):
        return read_config(path_from("config", config, "a path or a mapping"), overrides)
    # A mapping is converted to text first, so that it is checked like any other configuration.
    text = yaml_source.dump(
        json.loads(yaml_source.flow({**config, "name": config.get("name") or "experiment"}))
    )
    source = yaml_source.load(text, "config")
    return overridden(ConfigSource(source, source.data, Path.cwd()), overrides)


# Opens a result with eqt's reader or with xarray --------------------------------------------------


def open_at(path: str | os.PathLike[str], point: int | None = None) -> Result:
    """Open a result, or one point of a sweep with its own configuration; raises as `open_result`.

    Points of equal shape have it in no file: the configuration of the sweep gives it.
    """
    result = open_result(path, point, _attributes_at)
    result.loops_of = _loops_of
    return result


def _attributes_at(result: Result, point: int) -> dict[str, str]:
    from eqt_cli.config.study import attributes_at

    return attributes_at(result, point)


def _loops_of(result: KnownResult) -> Mapping[str, ClosedLoop]:
    """Build the loops of a result again, by label; its plugins are loaded before, if trusted."""
    from eqt_cli.config.experiment import build
    from eqt_cli.config.source import source_of

    return build(source_of(result)).loops


@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["xarray"], point: int | None = None
) -> xarray.Dataset: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["arrays"], point: int | None = None
) -> Result: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: None = None, point: int | None = None
) -> xarray.Dataset | Result: ...


def open_results(
    path: str | os.PathLike[str],
    kind: Literal["xarray", "arrays"] | None = None,
    point: int | None = None,
) -> xarray.Dataset | Result:
    """Open a result, after checking that its file is safe to read.

    Parameters
    ----------
    path
        The result folder, or the file in it.
    kind
        ``"xarray"`` for an `xarray.Dataset`, ``"arrays"`` for eqt's reader, which needs no other
        package. Default: ``"xarray"`` if xarray is installed, else ``"arrays"``.
    point
        Point of a sweep, counted from 0, to open as the result of a single experiment. Without a
        point, an `xarray.Dataset` of a sweep whose points differ in shape holds only the metrics
        that all points have.

    Returns
    -------
    xarray.Dataset or Result
        Both read values from the file only when you use them. Use a ``with`` block to close them.

    Raises
    ------
    ResultError
        If the result or the point does not exist, or the file is damaged or unsafe.
    EqtError
        If ``kind`` is ``"xarray"`` and the extra ``xarray`` is not installed.

    Examples
    --------
    >>> with eqt_cli.open_results("results/paper", "arrays") as result:
    ...     torque = result.read("torque_norm", controller="eqt")
    ...     print(result.labels, torque.shape[-1] == len(result.times))
    ['eqt', 'gt', 'nog', 'asym'] True
    """
    if kind not in (None, "xarray", "arrays"):
        raise EqtError(f"kind {kind!r}: expected 'xarray', 'arrays' or None")
    installed = find_spec("xarray") is not None and find_spec("h5netcdf") is not None
    if kind == "arrays" or (kind is None and not installed):
        return open_at(Path(path), point)
    if not installed:
        raise EqtError(
            "xarray is not installed (extra xarray): pip install xarray h5netcdf, or open with "
            "kind='arrays'"
        )
    import xarray

    with open_at(path) as checked:
        file, in_group = checked.path, checked.has_groups
    if point is None:
        return xarray.open_dataset(file, engine="h5netcdf")
    with open_at(path, point) as view:
        attributes = dict(view.attributes)
    group = point_group(point) if in_group else None
    whole = xarray.open_dataset(file, engine="h5netcdf", group=group)
    dataset = (whole if in_group else whole.isel(point=point)).assign_attrs(attributes)
    dataset.set_close(whole.close)
    return dataset
