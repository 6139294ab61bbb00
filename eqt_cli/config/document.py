"""A configuration as it is written: from YAML or a result, with changes; and the files it names."""

import json
import os
import re
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from eqt_cli.base import purposes, yaml_source
from eqt_cli.base.errors import (
    ComponentError,
    ConfigError,
    EqtError,
    InputError,
    InputProblem,
    KeyPath,
    Problems,
    Remedy,
    alike,
    dotted,
    parse_key,
    suggestion,
)
from eqt_cli.base.extensions import function_for, functions_for, imported
from eqt_cli.base.files import FILE_NAME, YAML, content_of, file_name, near, refusals, text_of
from eqt_cli.base.option_types import shown
from eqt_cli.base.registry import load_plugin
from eqt_cli.base.store_reader import ResultFile, open_results
from eqt_cli.base.yaml_source import Source
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.laws import Controller
from eqt_cli.components.references import Reference
from eqt_cli.config import shipped

# Reads a configuration from a YAML file or a result, and applies overrides ------------------------


_MAX_LISTED = 5
"""Largest number of files that a message lists."""

_STORED = "[config]"
"""Suffix of the name of a result file in places within the configuration that it holds."""


EXTENDS = "extends"
"""Key of the configurations that one takes over."""

ENGINE = "EQT_ENGINE"
"""Environment variable with the engine of configurations that name none."""


@dataclass(frozen=True)
class Place:
    """Where a configuration stands: its folder, the files that it names, and whether it is trusted.

    Attributes
    ----------
    folder
        The folder to which paths are relative.
    trusted
        Whether code that is stored in a result may be executed.
    is_result
        Whether the folder is that of a result: code needs trust, and no file outside is read.
    plugins
        Texts of the code in a result, by path; None where files have it.
    files
        Texts of the data files that were read, by their names in the configuration.
    is_complete
        Whether `files` comes from a result, so that no other file is read.
    """

    folder: Path
    trusted: bool = False
    is_result: bool = False
    plugins: dict[str, str] | None = None
    files: dict[str, str] = field(default_factory=dict)
    is_complete: bool = False


@dataclass(frozen=True)
class Document:
    """The data of a configuration, and where each part of it is written.

    Attributes
    ----------
    source
        The YAML text, which knows the line and column of each key.
    data
        The data: that of the text with all changes.
    home
        The place of the whole.
    changes
        Places of the parts that were changed, such as an option of the command.
    """

    source: Source
    data: dict[str, Any]
    home: Place
    changes: dict[KeyPath, str] = field(default_factory=dict)

    @property
    def path(self) -> str:
        """The file as in commands."""
        return self.source.name.removesuffix(_STORED)

    def place(self, path: KeyPath) -> str:
        """Return ``file:line:column`` of a path, or the place of the change.

        Of a mapping in Python, it is the path itself, which messages do not repeat.
        """
        for depth in range(len(path), 0, -1):
            if path[:depth] in self.changes:
                return self.changes[path[:depth]]
        return self.source.key_place(path)

    def problem(self, path: KeyPath, message: str) -> InputProblem:
        """Return an error, or a remark, of a path with its place."""
        return InputProblem(dotted(path), message, self.place(path))


def read_config(
    path: Path, overrides: Sequence[str] | Mapping[str, str] = (), trusted: bool = False
) -> Document:
    """Read a YAML file, or the configuration inside a result file or folder, and apply overrides.

    Parameters
    ----------
    path
        The file or folder; or, where there is no such file, result, folder of files, nor
        ``PATH.yaml``, the name of a shipped configuration.
    overrides
        ``KEY=VALUE``, by the place for messages; in a sequence, the places are ``overrides[0]``, ….
    trusted
        Whether code that is stored in a result may be executed.

    Raises
    ------
    ConfigError
        If the file is not valid YAML, or an override does not parse.
    """
    is_result = (path / FILE_NAME).exists()
    files = [] if is_result else sorted(path.glob("*.yaml"))
    taken = path.is_file() or is_result or files or path.with_suffix(".yaml").exists()
    if not taken and str(path) in shipped.names():
        path = shipped.folder() / f"{path}.yaml"
    if path.is_dir() and files:
        listed = ", ".join(map(str, files[:_MAX_LISTED])) + (", …" if files[_MAX_LISTED:] else "")
        raise EqtError(f"{path}: is a folder without a result; give one of its files: {listed}")
    if path.suffix == ".h5" or path.is_dir():
        with open_results(path, oldest=1) as results:  # all formats have the same configuration
            document = document_of(results, trusted)
    else:
        source = yaml_source.load(_text(path), str(path))
        document = Document(source, source.data, Place(path.parent, trusted))
    document = overridden(document, overrides)
    if document.data.get("name") is None:
        name = {"name": file_name(path.stem, "experiment")}
        document = replace(document, data=document.data | name)
    return document


def overridden(document: Document, overrides: Sequence[str] | Mapping[str, str]) -> Document:
    """Return a configuration with overrides as those of `read_config`.

    Raises
    ------
    ConfigError
        If overrides do not parse, a path does not exist, or a key is given two values.
    """
    problems: list[InputProblem] = []
    if EXTENDS in document.data:
        document = function_for(purposes.extends)(document)
    if not isinstance(overrides, Mapping):
        overrides = {f"overrides[{index}]": text for index, text in enumerate(overrides)}
    first_of = dict[str, str]()
    for place, override in overrides.items():
        key = override.partition("=")[0].strip()
        try:
            document = _overridden(document, override, place)
            if (first := first_of.setdefault(dotted(parse_key(key)), override)) != override:
                both = f"is given twice, as '{first}' and '{override}'; leave one of them out"
                problems.append(InputProblem(key, both, place))
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    solver = document.data.get("solver") or {}
    if (usual := os.environ.get(ENGINE)) and isinstance(solver, dict) and "engine" not in solver:
        document = _overridden(document, f"solver.engine={usual}", ENGINE)
    return document


def _text(path: Path) -> bytes:
    with refusals(path, "read", "check the path and its permissions"):
        try:
            return content_of(path, yaml_source.MAX_BYTES)
        except FileNotFoundError:
            hint = near(path, lambda entry: entry.suffix in YAML or (entry / FILE_NAME).is_file())
            hint = hint or suggestion(str(path), shipped.names())
            hint = hint or ". Create one with `eqt config new`"
            raise EqtError(f"{path}: not found{hint}") from None


def document_of(results: ResultFile, trusted: bool = False) -> Document:
    """Return the configuration inside an open result, with the plugins of its run."""
    text = str(results.attributes["config"])
    plugins = yaml_source.load(str(results.attributes["plugins"]), "plugins").data
    files: Any = None
    with suppress(ValueError, RecursionError):
        files = json.loads(str(results.attributes.get("files", "{}")))
    for name, texts in (("plugins", plugins), ("files", files)):
        if not isinstance(texts, dict) or not all(isinstance(t, str) for t in texts.values()):
            raise results.refusal(f"its attribute '{name}' does not hold texts by their names")
    source = yaml_source.load(text, f"{results.path}{_STORED}")
    home = Place(results.path.parent, trusted, plugins=plugins, files=files, is_complete=True)
    return Document(source, source.data, home)


def _overridden(document: Document, override: str, place: str) -> Document:
    """Return a configuration with one ``key.path[0]=value``."""
    problems = Problems(lambda path: place)
    with problems.catching():
        key, equals, text = override.partition("=")
        if not equals or not key.strip():
            raise InputError(f"expected KEY=VALUE, got '{override}'")
        path = parse_key(key.strip())
        if path[0] == EXTENDS:
            raise InputError("files are merged before options are set; write it into a file")
    problems.raise_if_any()
    return changed_at(document, path, yaml_source.parse_value(text, place, path), place)


def changed_at(document: Document, path: KeyPath, value: Any, place: str) -> Document:
    """Return the configuration with a new value, whose place is that of the change.

    Raises
    ------
    ConfigError
        If the path does not exist.
    """
    data = with_value(document.data, path, value, place)
    changes = {at: it for at, it in document.changes.items() if at[: len(path)] != path}
    old: Any = document.data
    for depth, step in enumerate(path, start=1):
        old = old[step] if isinstance(step, int) else (old or {}).get(step)
        if old is None or depth == len(path):  # sections that the change creates, too
            changes[path[:depth]] = place
    return replace(document, data=data, changes=changes)


def with_value(data: Any, path: KeyPath, value: Any, place: str = "") -> Any:
    """Return a copy of `data` with the value at `path` replaced; unchanged parts are shared.

    Missing mappings on the path are created.

    Raises
    ------
    ConfigError
        If the path leads through a value that is no mapping, or beyond the end of a list.
    """
    problems = Problems(lambda path: place)
    with problems.catching(*path):
        data = _replaced(data, path, value)
    problems.raise_if_any()
    return data


MOST_ENTRIES = 100
"""Largest number of list entries that one number of a search or a fit sets."""

_SLICE = re.compile(r"(.+)\[(\d+):(\d+)\]")


def entries_of(key: str) -> list[str]:
    """Return the keys that a key of several entries sets: ``kp[0]`` and ``kp[1]`` for ``kp[0:2]``.

    Raises
    ------
    InputError
        If the range is empty.
    """
    matched = _SLICE.fullmatch(key)
    if matched is None:
        return [key]
    first, end = int(matched[2]), int(matched[3])
    if not first < end <= first + MOST_ENTRIES:
        raise InputError(
            f"expected a range of 1 to {MOST_ENTRIES} entries, such as {matched[1]}[0:3] for the "
            f"first three, got '{key}'"
        )
    return [f"{matched[1]}[{index}]" for index in range(first, end)]


def expanded(values: Mapping[str, Any]) -> dict[str, Any]:
    """Repeat each value for every key of the configuration that it sets."""
    return {entry: value for key, value in values.items() for entry in entries_of(key)}


def value_at(data: Any, path: KeyPath) -> Any:
    """Return the value at a path of a configuration; None if there is none."""
    for step in path:
        inside = isinstance(data, dict) and step in data
        inside |= isinstance(data, list) and isinstance(step, int) and step < len(data)
        data = data[step] if inside else None
    return data


def _replaced(data: Any, path: KeyPath, value: Any, depth: int = 0) -> Any:
    if depth == len(path):
        return value
    step, name = path[depth], dotted(path[:depth])
    if isinstance(step, str) and (data is None or isinstance(data, dict)):
        mapping = data or {}
        return mapping | {step: _replaced(mapping.get(step), path, value, depth + 1)}
    if isinstance(step, int) and isinstance(data, list):
        if step >= len(data):
            raise InputError(f"no entry {step}; {name} has {len(data)} entries, counted from 0")
        return [*data[:step], _replaced(data[step], path, value, depth + 1), *data[step + 1 :]]
    if isinstance(step, str) and isinstance(data, list):
        entry = dotted((*path[:depth], int(step) if step.isdecimal() else 0))
        raise InputError(f"{name} is a list; write {entry} for an entry of it")
    expected = "a mapping" if isinstance(step, str) else "a list"
    kind = "a mapping" if isinstance(data, dict) else shown(data)
    raise InputError(f"{name} is {kind}, not {expected}; set all of {name} instead")


# Reads the files that a configuration names, plugins, data and C, and keeps their texts with it ---
#
# The plugins of a YAML configuration are the user's own. Those of a result file or folder may be
# those of a stranger, and are executed only on request.


def load_plugins(document: Document, problems: Problems) -> dict[str, str]:
    """Load every plugin, and return the sources by their paths in the configuration.

    Plugins of a result file or folder are executed only if they are trusted.
    """
    paths = document.data.get("plugins", [])
    if not isinstance(paths, list):
        problems.at("plugins").add(f"expected a list of paths to Python files, got {shown(paths)}")
        return {}
    sources: dict[str, str] = {}
    owners: dict[str, str] = {}
    for index, path in enumerate(paths):
        with problems.catching("plugins", index):
            text = trusted_text(document.home, path)
            added = load_plugin(document.home.folder / path, text)
            sources[path] = text
            for component in added:
                if same := alike(component, owners):
                    but = f", and {component} differs in capitals only" if same != component else ""
                    message = f"{owners[same]} already defines {same}{but}; rename one of them"
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
    document = document_of(results, trusted=True)
    problems = Problems(document.place)
    load_plugins(document, problems)
    problems.raise_if_any()


def trusted_text(home: Place, path: object, subject: str = "plugin") -> str:
    """Return the text of a plugin, or of other code that is executed.

    Raises
    ------
    ComponentError
        If the file cannot be read, or may not be executed.
    """
    if not isinstance(path, str):
        raise ComponentError(f"expected the path of a Python file, got {shown(path)}")
    if home.plugins is None:
        relative = f"{subject} paths are relative to the configuration's folder"
        file = home.folder / path
        text = text_of(file, relative, ComponentError, f"{subject} {file}")
        if not home.is_result:
            remember_executed(text)
        elif not (home.trusted or _is_known(text)):
            raise ComponentError(
                f"the result folder contains {file}, which eqt executes only on request",
                Remedy("read this file, then add {}", "trust_plugins"),
            )
        return text
    if not (home.trusted or _is_known(home.plugins.get(path, ""))):
        raise ComponentError(
            f"the result contains the source of {path}, which eqt executes only on request",
            Remedy("read it with `eqt show --plugins`, then add {}", "trust_plugins"),
        )
    if path not in home.plugins:
        raise ComponentError(f"the result does not contain the source of {path}")
    return home.plugins[path]


def remember_executed(text: str) -> None:
    """Keep in the user's own cache that a configuration of this user has executed this code."""
    from eqt_cli.engines.compiler import digest, user_cache  # slow to import

    cache, key = user_cache(), digest(text)
    with suppress(OSError):
        if cache is not None and not cache.find(key, EXECUTED):
            cache.keep(key, EXECUTED, b"executed")


def _is_known(text: str) -> bool:
    """Return whether this user has executed this code before; nothing near a result says so."""
    from eqt_cli.engines.compiler import digest, user_cache

    cache = user_cache()
    return cache is not None and cache.find(digest(text), EXECUTED) is not None


EXECUTED = ".executed"  # no other kind of file in the cache ends so
"""Ending of the files in the cache that stand for executed code."""

P = TypeVar("P", Controller, Reference)

DATA_BYTES = 64_000_000
"""Largest size of a file, bytes, because it is kept in memory and in every result."""


def data_file(home: Place, name: str, reader: str = "") -> str:
    """Return the text of a file, whose name is relative to the configuration.

    A result file or folder gives a table of the initial states of its runs. The function `reader`
    of an extension, if one is named, makes the text of other files.

    Raises
    ------
    InputError
        If the file cannot be read.
    """
    if name not in home.files:
        if home.is_complete:
            raise InputError(f"the result does not contain the file {name}")
        path = home.folder / name
        with refusals(path, "read", kind=InputError):
            if home.is_result and not path.resolve().is_relative_to(home.folder.resolve()):
                raise InputError(f"{path}: is outside the result folder {home.folder}")
            is_result = path.suffix == ".h5" or (path / FILE_NAME).exists()
        if reader:
            text = imported(reader)(path)
        elif is_result:
            text = _starts_of(path)
        else:
            relative = "paths are relative to the configuration's folder"
            smaller = "keep the rows and columns that the configuration needs"
            read = next(functions_for(purposes.text_of_a_recording), text_of)
            text = read(path, relative, InputError, limit=DATA_BYTES, smaller=smaller)
        home.files[name] = text
    return home.files[name]


def with_data(
    part: P, home: Place, G: MatrixLieGroup, problems: Problems
) -> tuple[P, dict[str, str]]:
    """Return a component with the contents of its files, checked, and the contents."""
    texts = {}
    for option, name in part.files.items():
        with problems.catching(option):
            texts[name] = data_file(home, name, part.reader)
    part = part.with_files(texts)
    if part.files:
        part.check(G, problems)
    return part, texts


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
