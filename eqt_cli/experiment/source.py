"""A configuration as a user gives it: a YAML file, or a result, with `--set` overrides."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import ConfigError, EqtError, Problem
from eqt_cli.experiment import yaml_source
from eqt_cli.experiment.yaml_source import Source, dotted
from eqt_cli.store.reader import open_results

KeyPath = tuple[str | int, ...]


@dataclass
class ConfigSource:
    """Plain data, where each part of it was written, and what plugin paths are relative to."""

    source: Source
    data: dict[str, Any]
    folder: Path
    overrides: dict[KeyPath, str] = field(default_factory=dict)
    stored_plugins: dict[str, str] | None = None

    def place(self, path: KeyPath) -> str:
        """``file:line:column``, or ``--set[0]`` for what an override gave."""
        for depth in range(len(path), 0, -1):
            if path[:depth] in self.overrides:
                return self.overrides[path[:depth]]
        return self.source.key_place(path)


def read_config(path: Path, overrides: Sequence[str] = ()) -> ConfigSource:
    """Read a YAML file, or the configuration inside a result file or folder, and apply overrides.

    Raises
    ------
    ConfigError
        For what cannot be read as YAML, and for overrides that do not parse.
    """
    if path.suffix == ".h5" or path.is_dir():
        config = _from_result(path)
    else:
        try:
            text = path.read_bytes()
        except OSError as error:
            reason = error.strerror or str(error)
            raise EqtError(f"{path}: cannot be read: {reason.lower()}") from error
        source = yaml_source.load(text, str(path))
        config = ConfigSource(source, source.data, path.parent)
    if "name" not in config.data:
        config.data = {"name": path.stem, **config.data}
    for index, override in enumerate(overrides):
        _apply(config, override, f"--set[{index}]")
    return config


def _from_result(path: Path) -> ConfigSource:
    with open_results(path) as results:
        text = str(results.attributes["config"])
        plugins = yaml_source.load(str(results.attributes["plugins"]), "plugins").data
        source = yaml_source.load(text, f"{results.path}[config]")
        folder = results.path.parent
    return ConfigSource(source, source.data, folder, stored_plugins=plugins)


def _apply(config: ConfigSource, override: str, place: str) -> None:
    """Set one ``key.path[0]=value``."""
    key, equals, text = override.partition("=")
    if not equals or not key.strip():
        raise ConfigError([Problem("", f"expected KEY=VALUE, got '{override}'", place)])
    path = parse_key(key.strip(), place)
    value = yaml_source.parse_value(text, place)
    container: Any = config.data
    for depth, step in enumerate(path):
        last = depth == len(path) - 1
        if isinstance(step, int):
            if not isinstance(container, list) or step >= len(container):
                length = len(container) if isinstance(container, list) else 0
                message = f"no entry {step}: {dotted(path[:depth])} has {length}"
                raise ConfigError([Problem(dotted(path), message, place)])
        elif not isinstance(container, dict):
            message = f"{dotted(path[:depth])} is not a mapping, so it has no key '{step}'"
            raise ConfigError([Problem(dotted(path), message, place)])
        if last:
            container[step] = value
        else:
            if isinstance(step, str):
                container.setdefault(step, {})
            container = container[step]
    config.overrides[path] = place


def parse_key(text: str, place: str) -> KeyPath:
    """``controllers[0].label`` as ``("controllers", 0, "label")``."""
    steps: list[str | int] = []
    for part in text.split("."):
        name, *indices = part.split("[")
        numbers = [index[:-1] for index in indices if index.endswith("]") and index[:-1].isdigit()]
        if not name or len(numbers) != len(indices):
            message = f"expected a key such as gains.kp or controllers[0].label, got '{text}'"
            raise ConfigError([Problem("", message, place)])
        steps += [name, *map(int, numbers)]
    return tuple(steps)
