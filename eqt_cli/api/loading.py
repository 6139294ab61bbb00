"""Loads configurations, and opens results."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError
from eqt_cli.results.origin import KnownResult
from eqt_cli.results.result import Result, open_result

if TYPE_CHECKING:
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


# Opens a result with eqt's reader -----------------------------------------------------------------


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
