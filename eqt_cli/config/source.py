"""A configuration as a user gives it: a YAML file, or a result, with overrides."""

import json
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from eqt_cli.config import yaml_source
from eqt_cli.config.yaml_source import Source
from eqt_cli.core.errors import ConfigError, EqtError, InputError, InputProblem
from eqt_cli.core.file_names import file_name
from eqt_cli.core.files import YAML, near, refusals
from eqt_cli.core.problems import KeyPath, Problems, dotted, parse_key
from eqt_cli.core.regular_files import content_of
from eqt_cli.core.validation import shown
from eqt_cli.store.reader import ResultFile, open_results
from eqt_cli.store.reserved_names import FILE_NAME

_MOST_FILES = 5
"""Named in a message."""

_STORED = "[config]"
"""Behind the name of a result file: the place is in the configuration that it holds."""


@dataclass
class ConfigSource:
    """Plain data, where each part of it was written, and what plugin paths are relative to."""

    source: Source
    data: dict[str, Any]
    folder: Path
    overrides: dict[KeyPath, str] = field(default_factory=dict)
    stored_plugins: dict[str, str] | None = None
    files: dict[str, str] = field(default_factory=dict)
    """Contents of files with data, by their names in the configuration, as they are read."""
    holds_files: bool = False
    """Whether they come from a result, so that no other is read."""
    of_folder: bool = False
    """Whether a result folder was given that holds it: its plugins are not the user's own, and no
    file outside is read."""

    @property
    def path(self) -> str:
        """The file, as a command takes it."""
        return self.source.name.removesuffix(_STORED)

    def place(self, path: KeyPath) -> str:
        """``file:line:column``, or where an override was given."""
        for depth in range(len(path), 0, -1):
            if path[:depth] in self.overrides:
                return self.overrides[path[:depth]]
        return self.source.key_place(path)


def read_config(path: Path, overrides: Sequence[str] | Mapping[str, str] = ()) -> ConfigSource:
    """Read a YAML file, or the configuration inside a result file or folder, and apply overrides.

    Parameters
    ----------
    overrides
        ``KEY=VALUE``; by the place that messages name, which is ``overrides[0]`` of a sequence.

    Raises
    ------
    ConfigError
        For what cannot be read as YAML, and for overrides that do not parse.
    """
    if path.is_dir() and not (path / FILE_NAME).exists() and (there := sorted(path.glob("*.yaml"))):
        listed = ", ".join(map(str, there[:_MOST_FILES])) + (", …" if there[_MOST_FILES:] else "")
        raise EqtError(f"{path}: is a folder without a result; give one of its files: {listed}")
    if path.suffix == ".h5" or path.is_dir():
        with open_results(path) as results:
            config = source_of(results)
    else:
        source = yaml_source.load(_text(path), str(path))
        config = ConfigSource(source, source.data, path.parent)
    overridden(config, overrides)
    if config.data.get("name") is None:
        config.data = config.data | {"name": _name(path)}
    return config


def config_in(folder: Path, name: str) -> ConfigSource:
    """The configuration that a result folder holds beside its parts; raises as `read_config`."""
    source = read_config(folder / name)
    source.of_folder = True
    return source


def overridden(config: ConfigSource, overrides: Sequence[str] | Mapping[str, str]) -> ConfigSource:
    """The configuration itself, after overrides as of `read_config` have been applied.

    Raises
    ------
    ConfigError
        For overrides that do not parse.
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


def _name(path: Path) -> str:
    """The file's stem as a name: what a name must not have becomes a hyphen."""
    return file_name(path.stem, "experiment")


def source_of(results: ResultFile) -> ConfigSource:
    """The configuration inside an open result, with the plugins that it was run with."""
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
    """What a text in JSON says; None where it is none."""
    with suppress(ValueError, RecursionError):
        return json.loads(text)
    return None


def _apply(config: ConfigSource, override: str, place: str) -> None:
    """Set one ``key.path[0]=value``.

    Raises
    ------
    ConfigError
        If it does not parse, or leads nowhere.
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
    """The same with a value that was given elsewhere; with it, what had to be made to hold it.

    Raises
    ------
    ConfigError
        If it leads nowhere.
    """
    data = with_value(config.data, path, value, place)
    kept = {at: it for at, it in config.overrides.items() if at[: len(path)] != path}
    held: Any = config.data
    for depth, step in enumerate(path, start=1):
        held = held[step] if isinstance(step, int) else (held or {}).get(step)
        if held is None or depth == len(path):
            kept[path[:depth]] = place
    return replace(config, data=data, overrides=kept)


def _unfit(container: Any, path: KeyPath, step: str | int) -> str | None:
    """Why the value at `path` has no place for `step`, if it has none."""
    name = dotted(path)
    if isinstance(step, str):
        if isinstance(container, dict):
            return None
        return f"{name} is {_kind(container)}, not a mapping; set all of {name} instead"
    if not isinstance(container, list):
        return f"{name} is {_kind(container)}, not a list; set all of {name} instead"
    if step < len(container):
        return None
    return f"no entry {step}; {name} has {len(container)} entries, counted from 0"


def _kind(value: Any) -> str:
    if isinstance(value, dict | list):
        return "a mapping" if isinstance(value, dict) else "a list"
    return shown(value)


def with_value(data: Any, path: KeyPath, value: Any, place: str = "") -> Any:
    """A copy of `data` with the value at `path` replaced; what did not change is shared.

    Mappings on the way that do not exist yet are made.

    Raises
    ------
    ConfigError
        If the path leads through something that is no mapping, or beyond the end of a list.
    """
    problems = Problems(lambda path: place)
    with problems.catching(*path):
        data = _replaced(data, path, value)
    problems.raise_if_any()
    return data


def _replaced(data: Any, path: KeyPath, value: Any, depth: int = 0) -> Any:
    if depth == len(path):
        return value
    step = path[depth]
    wrong = None if data is None and isinstance(step, str) else _unfit(data, path[:depth], step)
    if wrong:
        raise InputError(wrong)
    if isinstance(step, int):
        return [*data[:step], _replaced(data[step], path, value, depth + 1), *data[step + 1 :]]
    known = data or {}
    return known | {step: _replaced(known.get(step), path, value, depth + 1)}
