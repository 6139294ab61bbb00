"""Reads data files that a configuration names, once, and keeps their texts with it."""

from pathlib import Path
from typing import TypeVar

import numpy as np

from eqt_cli.config.source import ConfigSource
from eqt_cli.core.errors import EqtError, InputError
from eqt_cli.core.files import refusals
from eqt_cli.core.problems import Problems
from eqt_cli.logs.ulog import recording_text
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.store.reader import open_results
from eqt_cli.store.reserved_names import FILE_NAME

P = TypeVar("P", bound=GivenOverTime)

DATA_BYTES = 64_000_000
"""Largest size of a file, bytes, because it is kept in memory and in every result."""


def data_file(source: ConfigSource, name: str) -> str:
    """Return the text of a file, whose name is relative to the configuration.

    A result file or folder gives a table of the initial states of its runs.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    if name not in source.files:
        if source.holds_files:
            raise InputError(f"the result does not contain the file {name}")
        path = source.folder / name
        with refusals(path, "read", kind=InputError):
            if source.of_folder and not path.resolve().is_relative_to(source.folder.resolve()):
                raise InputError(f"{path}: is outside the result folder {source.folder}")
            is_result = path.suffix == ".h5" or (path / FILE_NAME).exists()
        source.files[name] = _starts_of(path) if is_result else _text(path)
    return source.files[name]


def with_data(part: P, source: ConfigSource, problems: Problems) -> tuple[P, dict[str, str]]:
    """Return a component with the contents of its files, and the contents; note read errors."""
    texts = {}
    for option, name in part.files.items():
        with problems.catching(option):
            texts[name] = data_file(source, name)
    return part.with_files(texts), texts


def _text(path: Path) -> str:
    relative = "paths are relative to the configuration's folder"
    smaller = "keep the rows and columns that the configuration needs"
    return recording_text(path, relative, InputError, DATA_BYTES, smaller)


def _starts_of(path: Path) -> str:
    try:
        with open_results(path) as results:
            results.single("its runs are where these start")
            poses, velocities = results["initial_pose"], results["initial_velocity"]
    except EqtError as error:
        raise InputError(str(error)) from error
    d, m = poses.shape[-1], velocities.shape[-1]
    header = [f"Q{row}{column}" for row in range(1, d + 1) for column in range(1, d + 1)]
    header += [f"V{k}" for k in range(1, m + 1)]
    rows = np.concatenate([poses.reshape(len(poses), -1), velocities], axis=1)
    lines = [",".join(header), *(",".join(map(repr, row)) for row in rows.tolist())]
    return "\n".join(lines) + "\n"
