"""Reads and checks recordings."""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from typing import Any

from eqt_cli.api.loading import path_from
from eqt_cli.config import yaml_source
from eqt_cli.core.errors import EqtError, Problems
from eqt_cli.core.files import text_of
from eqt_cli.core.option_types import validated
from eqt_cli.groups import MatrixLieGroup, group_named
from eqt_cli.logs.check import LogCheck, check_text
from eqt_cli.logs.mapping import LogMapping, MappingError, TrajectoryFormat, literal
from eqt_cli.logs.recording import Recording, read_recording
from eqt_cli.logs.ulog import recording_text

LOG_BYTES = 400_000_000
"""Largest size of a recording, bytes: a million rows of 20 numbers."""


def check_log(
    path: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    *,
    format: str = "csv",
    group: str | None = None,
) -> LogCheck:
    r"""Read a recording and report its columns, units, times and irregularities.

    Parameters
    ----------
    path
        The recording; a file name that ends in ``.ulg`` is a PX4 flight log.
    mapping
        Information that the file does not contain (columns, units, frames, times), as a YAML file
        or a mapping with the keys of ``reference.mapping``.
    format
        ``csv`` with a header that names the columns, ``tum`` or ``euroc``.
    group
        Group of the poses. Default: the group that fits the columns.

    Returns
    -------
    LogCheck
        The report. Its ``problems`` are empty if the recording can be used as waypoints.

    Raises
    ------
    EqtError
        If the file does not exist or holds no poses.
    ConfigError
        If the mapping is wrong or does not fit the file, with the place of each problem.

    Examples
    --------
    >>> from pathlib import Path
    >>> rows = "stamp,yaw (deg),pitch,roll\n0,0,0,0\n10,1,0,0\n20,2,0,0\n"
    >>> _ = Path("flight.csv").write_text(rows)
    >>> found = eqt_cli.check_log("flight.csv", {"columns": {"t": "stamp"}, "units": {"t": "ms"}})
    >>> found.group, found.rate, found.notes
    ('SO3', 100.0, [])
    """
    G = None if group is None else group_named(group)
    with _read(path, mapping, format) as given:
        return check_text(*given, G)


def read_measured(
    path: str | os.PathLike[str],
    G: MatrixLieGroup,
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None = None,
    format: str = "csv",
) -> Recording:
    """Read a recording as a motion on a group; arguments and errors as for `check_log`."""
    with _read(path, mapping, format) as (text, name, kind, columns):
        return read_recording(text, name, kind, G, columns)


@contextmanager
def _read(
    path: str | os.PathLike[str],
    mapping: str | os.PathLike[str] | Mapping[str, Any] | None,
    format: str,
) -> Iterator[tuple[str, str, TrajectoryFormat, LogMapping]]:
    """Yield text, name, format and mapping; note a problem of the mapping at its place."""
    kind, file = literal(TrajectoryFormat, "format", format), path_from("path", path)
    parsed, problems = _mapping(mapping)
    problems.raise_if_any()
    smaller = "cut it into parts, leave out columns, or keep every tenth row"
    text = recording_text(file, "check the path", EqtError, LOG_BYTES, smaller)
    try:
        yield text, str(file), kind, parsed
    except MappingError as error:
        problems.at(*error.path).add(str(error))
        problems.raise_if_any()
        raise


def _mapping(
    given: str | os.PathLike[str] | Mapping[str, Any] | None,
) -> tuple[LogMapping, Problems]:
    """Parse a mapping; return it with its problems."""
    if given is None:
        return LogMapping(), Problems()
    if isinstance(given, Mapping):
        source = yaml_source.load(yaml_source.flow(given), "mapping")
    else:
        path = path_from("mapping", given, "a path or a mapping")
        source = yaml_source.load(text_of(path, "check the path"), str(path))
    problems = Problems(source.key_place)
    parsed = validated(LogMapping, source.data, problems)
    if parsed is not None:
        parsed.check(problems)
    return parsed or LogMapping(), problems
