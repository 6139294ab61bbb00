"""Reads a configuration from a YAML file or a result, and applies overrides."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from eqt_cli.config import yaml_source
from eqt_cli.config.yaml_source import Source
from eqt_cli.core.errors import (
    ConfigError,
    EqtError,
    InputError,
    InputProblem,
    KeyPath,
    Problems,
    dotted,
    parse_key,
)
from eqt_cli.core.files import YAML, content_of, file_name, near, refusals
from eqt_cli.core.option_types import shown
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.reserved_names import FILE_NAME

_MAX_LISTED = 5
"""Largest number of files that a message lists."""

_STORED = "[config]"
"""Suffix of the name of a result file in places within the configuration that it holds."""


@dataclass
class ConfigSource:
    """Plain data, the place of each part, and the folder to which paths are relative."""

    source: Source
    data: dict[str, Any]
    folder: Path
    overrides: dict[KeyPath, str] = field(default_factory=dict)
    stored_plugins: dict[str, str] | None = None
    files: dict[str, str] = field(default_factory=dict)
    """Contents of data files that were read, by their names in the configuration."""
    holds_files: bool = False
    """Whether `files` comes from a result, so that no other file is read."""
    of_folder: bool = False
    """Whether it is in a result folder: plugins need trust, and no file outside is read."""

    @property
    def path(self) -> str:
        """The file as in commands."""
        return self.source.name.removesuffix(_STORED)

    def place(self, path: KeyPath) -> str:
        """Return ``file:line:column`` of a path, or the place of the override."""
        for depth in range(len(path), 0, -1):
            if path[:depth] in self.overrides:
                return self.overrides[path[:depth]]
        return self.source.key_place(path)


def read_config(path: Path, overrides: Sequence[str] | Mapping[str, str] = ()) -> ConfigSource:
    """Read a YAML file, or the configuration inside a result file or folder, and apply overrides.

    Parameters
    ----------
    overrides
        ``KEY=VALUE``, by the place for messages; in a sequence, the places are ``overrides[0]``, ….

    Raises
    ------
    ConfigError
        If the file is not valid YAML, or an override does not parse.
    """
    if path.is_dir() and not (path / FILE_NAME).exists() and (files := sorted(path.glob("*.yaml"))):
        listed = ", ".join(map(str, files[:_MAX_LISTED])) + (", …" if files[_MAX_LISTED:] else "")
        raise EqtError(f"{path}: is a folder without a result; give one of its files: {listed}")
    if path.suffix == ".h5" or path.is_dir():
        with open_results(path) as results:
            config = source_of(results)
    else:
        source = yaml_source.load(_text(path), str(path))
        config = ConfigSource(source, source.data, path.parent)
    overridden(config, overrides)
    if config.data.get("name") is None:
        config.data = config.data | {"name": file_name(path.stem, "experiment")}
    return config


def config_in(folder: Path, name: str) -> ConfigSource:
    """Return the configuration in a result folder with parts; raises as `read_config` does."""
    source = read_config(folder / name)
    source.of_folder = True
    return source


def overridden(config: ConfigSource, overrides: Sequence[str] | Mapping[str, str]) -> ConfigSource:
    """Apply overrides as in `read_config`, and return the configuration itself.

    Raises
    ------
    ConfigError
        If overrides do not parse.
    """
    problems: list[InputProblem] = []
    if not isinstance(overrides, Mapping):
        overrides = {f"overrides[{index}]": text for index, text in enumerate(overrides)}
    for place, override in overrides.items():
        try:
            _apply(config, override, place)
        except ConfigError as error:
            problems += error.problems
    if problems:
        raise ConfigError(problems)
    return config


def _text(path: Path) -> bytes:
    with refusals(path, "read", "check the path and its permissions"):
        try:
            return content_of(path, yaml_source.MAX_BYTES)
        except FileNotFoundError:
            hint = near(path, lambda entry: entry.suffix in YAML or (entry / FILE_NAME).is_file())
            hint = hint or ". Create one with `eqt config new`"
            raise EqtError(f"{path}: not found{hint}") from None


def source_of(results: ResultFile) -> ConfigSource:
    """Return the configuration inside an open result, with the plugins of its run."""
    text = str(results.attributes["config"])
    plugins = yaml_source.load(str(results.attributes["plugins"]), "plugins").data
    files = _json(str(results.attributes.get("files", "{}")))
    for name, texts in (("plugins", plugins), ("files", files)):
        if not isinstance(texts, dict) or not all(isinstance(t, str) for t in texts.values()):
            raise results.refusal(f"its attribute '{name}' does not hold texts by their names")
    source = yaml_source.load(text, f"{results.path}{_STORED}")
    return ConfigSource(
        source,
        source.data,
        results.path.parent,
        stored_plugins=plugins,
        files=files,
        holds_files=True,
    )


def _json(text: str) -> Any:
    """Return the data of a text in JSON; None if it is invalid."""
    with suppress(ValueError, RecursionError):
        return json.loads(text)
    return None


def _apply(config: ConfigSource, override: str, place: str) -> None:
    """Set one ``key.path[0]=value``.

    Raises
    ------
    ConfigError
        If it does not parse, or its path does not exist.
    """
    problems = Problems(lambda path: place)
    with problems.catching():
        key, equals, text = override.partition("=")
        if not equals or not key.strip():
            raise InputError(f"expected KEY=VALUE, got '{override}'")
        path = parse_key(key.strip())
    problems.raise_if_any()
    value = yaml_source.parse_value(text, place, path)
    changed = changed_at(config, path, value, place)
    config.data, config.overrides = changed.data, changed.overrides


def changed_at(config: ConfigSource, path: KeyPath, value: Any, place: str) -> ConfigSource:
    """Return the configuration with a new value, whose place is that of the override.

    Raises
    ------
    ConfigError
        If the path does not exist.
    """
    data = with_value(config.data, path, value, place)
    overrides = {at: it for at, it in config.overrides.items() if at[: len(path)] != path}
    old: Any = config.data
    for depth, step in enumerate(path, start=1):
        old = old[step] if isinstance(step, int) else (old or {}).get(step)
        if old is None or depth == len(path):  # sections that the override creates, too
            overrides[path[:depth]] = place
    return replace(config, data=data, overrides=overrides)


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


def _replaced(data: Any, path: KeyPath, value: Any, depth: int = 0) -> Any:
    if depth == len(path):
        return value
    step, name = path[depth], dotted(path[:depth])
    if isinstance(step, str) and (data is None or isinstance(data, dict)):
        known = data or {}
        return known | {step: _replaced(known.get(step), path, value, depth + 1)}
    if isinstance(step, int) and isinstance(data, list):
        if step >= len(data):
            raise InputError(f"no entry {step}; {name} has {len(data)} entries, counted from 0")
        return [*data[:step], _replaced(data[step], path, value, depth + 1), *data[step + 1 :]]
    expected = "a mapping" if isinstance(step, str) else "a list"
    kinds: dict[type, str] = {dict: "a mapping", list: "a list"}
    kind = kinds.get(type(data)) or shown(data)
    raise InputError(f"{name} is {kind}, not {expected}; set all of {name} instead")
