"""The configuration of one point of a sweep; it computes nothing."""

import dataclasses
from collections.abc import Collection

from eqt_cli.config.source import ConfigSource, changed_at
from eqt_cli.core.errors import EqtError
from eqt_cli.core.problems import Problems, parse_key
from eqt_cli.ensemble.sweep import Sweep


def at_point(
    source: ConfigSource, sweep: Sweep | None, point: int, keys: Collection[str] | None = None
) -> ConfigSource:
    """The configuration at a point of a sweep.

    Parameters
    ----------
    keys
        What is changed of all that the point changes; None for all.

    Raises
    ------
    ConfigError
        If a swept key leads nowhere.
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
    """The section that a dotted key is in."""
    return str(parse_key(key)[0])


def without_sweep(source: ConfigSource) -> ConfigSource:
    """The same without its section `sweep`."""
    data = {key: value for key, value in source.data.items() if key != "sweep"}
    return dataclasses.replace(source, data=data)


def sweep_of(source: ConfigSource) -> Sweep:
    """The sweep that a configuration describes.

    Raises
    ------
    ConfigError
        With everything that is wrong with it.
    """
    problems = Problems(source.place)
    sweep = Sweep.read(source.data["sweep"], problems.at("sweep"))
    problems.raise_if_any()
    assert sweep is not None
    return sweep


def config_at(source: ConfigSource, point: int) -> ConfigSource:
    """The configuration at a point of the sweep that it describes.

    Raises
    ------
    EqtError
        If it sweeps nothing, or has no such point.
    """
    name = source.source.name
    if not source.data.get("sweep"):
        raise EqtError(f"{name}: defines no sweep, so it has no points; leave the point out")
    sweep = sweep_of(source)
    if not 0 <= point < len(sweep):
        raise EqtError(f"{name}: has no point {point}; choose one of 0 to {len(sweep) - 1}")
    return at_point(without_sweep(source), sweep, point)
