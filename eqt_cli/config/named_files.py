"""Reads the files that a configuration names, plugins, data and C, and keeps their texts with it.

The plugins of a YAML configuration are the user's own. Those of a result file or folder may be
those of a stranger, and are executed only on request.
"""

from pathlib import Path
from typing import TypeVar

import numpy as np

from eqt_cli.config.source import ConfigSource, source_of
from eqt_cli.core.errors import ComponentError, EqtError, InputError, Problems, Remedy
from eqt_cli.core.files import refusals, text_of
from eqt_cli.core.option_types import shown
from eqt_cli.core.registry import load_plugin
from eqt_cli.logs.ulog import recording_text
from eqt_cli.mechanics.over_time import GivenOverTime
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.reserved_names import FILE_NAME


def load_plugins(source: ConfigSource, trusted: bool, problems: Problems) -> dict[str, str]:
    """Load every plugin, and return the sources by their paths in the configuration.

    Plugins of a result file or folder are executed only if they are `trusted`.
    """
    paths = source.data.get("plugins", [])
    if not isinstance(paths, list):
        problems.at("plugins").add(f"expected a list of paths to Python files, got {shown(paths)}")
        return {}
    sources: dict[str, str] = {}
    owners: dict[str, str] = {}
    for index, path in enumerate(paths):
        with problems.catching("plugins", index):
            text = trusted_text(source, path, trusted)
            added = load_plugin(source.folder / path, text)
            sources[path] = text
            for component in added:
                if component in owners:
                    message = f"{owners[component]} already defines {component}; rename one of them"
                    problems.at("plugins", index).add(message)
                owners[component] = path
    return sources


def load_stored_plugins(results: ResultFile) -> None:
    """Execute the plugins in a trusted result.

    Raises
    ------
    ConfigError
        If a plugin cannot be loaded.
    """
    source = source_of(results)
    problems = Problems(source.place)
    load_plugins(source, trusted=True, problems=problems)
    problems.raise_if_any()


def trusted_text(source: ConfigSource, path: object, trusted: bool, subject: str = "plugin") -> str:
    """Return the text of a plugin, or of other code that is executed.

    Raises
    ------
    ComponentError
        If the file cannot be read, or may not be executed.
    """
    if not isinstance(path, str):
        raise ComponentError(f"expected the path of a Python file, got {shown(path)}")
    if source.stored_plugins is None:
        relative = f"{subject} paths are relative to the configuration's folder"
        file = source.folder / path
        if source.of_folder and not trusted:
            raise ComponentError(
                f"the result folder contains {file}, which eqt executes only on request",
                Remedy("read this file, then add {}", "trust_plugins"),
            )
        return text_of(file, relative, ComponentError, f"{subject} {file}")
    if not trusted:
        raise ComponentError(
            f"the result contains the source of {path}, which eqt executes only on request",
            Remedy("read it with `eqt show --plugins`, then add {}", "trust_plugins"),
        )
    if path not in source.stored_plugins:
        raise ComponentError(f"the result does not contain the source of {path}")
    return source.stored_plugins[path]


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


def code_text(source: ConfigSource, name: str, trusted: bool) -> str:
    """Return the text of a C file, with the files beside it that its preprocessor reads.

    Raises
    ------
    InputError
        If it cannot be read or preprocessed, or may not be executed.
    """
    text = trusted_text(source, name, trusted, "C file")
    from eqt_cli.engines.native.c_files import gathered, is_gathered  # with all of native

    if source.stored_plugins is not None or is_gathered(text):
        return text
    return gathered(source.folder / name)
