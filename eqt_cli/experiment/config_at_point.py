"""Derives the configuration of one point of a sweep."""

import dataclasses
from collections.abc import Collection

from eqt_cli.config.source import ConfigSource, changed_at
from eqt_cli.core.errors import EqtError, Problems, parse_key
from eqt_cli.ensemble.sweep import Sweep


def at_point(
    source: ConfigSource, sweep: Sweep | None, point: int, keys: Collection[str] | None = None
) -> ConfigSource:
    """Return the configuration at a point of a sweep.

    Parameters
    ----------
    keys
        The swept keys to set; None for all.

    Raises
    ------
    ConfigError
        If a swept key does not exist.
    """
    if sweep is None:
        return source
    found = source
    for key, value in sweep.settings(point).items():
        if keys is not None and key not in keys:
            continue
        place = source.place(("sweep", *sweep.place(point, key)))
        found = changed_at(found, parse_key(key), value, place)
    return found


def section_of(key: str) -> str:
    """Return the section of a dotted key."""
    return str(parse_key(key)[0])


def without_sweep(source: ConfigSource) -> ConfigSource:
    """Return the configuration without its section `sweep`."""
    data = {key: value for key, value in source.data.items() if key != "sweep"}
    return dataclasses.replace(source, data=data)


def sweep_of(source: ConfigSource) -> Sweep:
    """Return the sweep that a configuration defines.

    Raises
    ------
    ConfigError
        With all problems of the sweep.
    """
    problems = Problems(source.place)
    sweep = Sweep.read(source.data["sweep"], problems.at("sweep"))
    problems.raise_if_any()
    assert sweep is not None
    return sweep


def config_at(source: ConfigSource, point: int) -> ConfigSource:
    """Return the configuration at a point of the sweep that it defines.

    Raises
    ------
    EqtError
        If it defines no sweep, or has no such point.
    """
    name = source.source.name
    if not source.data.get("sweep"):
        raise EqtError(f"{name}: defines no sweep, so it has no points; leave the point out")
    sweep = sweep_of(source)
    if not 0 <= point < len(sweep):
        raise EqtError(f"{name}: has no point {point}; choose one of 0 to {len(sweep) - 1}")
    return at_point(without_sweep(source), sweep, point)
