"""The text of a configuration: from YAML, from a result, with changes; and the files it names."""

import json
import os
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from operator import is_
from pathlib import Path
from typing import Any, TypeVar

import numpy as np

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import (
    OTHER_FOLDER,
    ComponentError,
    ConfigError,
    EqtError,
    EqtWarning,
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
from eqt_cli.base.files import FILE_NAME, YAML, content_of, file_name, near, refusals, text_of
from eqt_cli.base.option_types import shown
from eqt_cli.base.registry import load_plugin, of_extension
from eqt_cli.base.reporting import reporter
from eqt_cli.base.store_reader import ResultFile, open_results
from eqt_cli.base.yaml_source import Source
from eqt_cli.components.log_table import recording_text
from eqt_cli.components.mechanics import TimeVarying
from eqt_cli.config import shipped
from eqt_cli.engines.engine import engines

# Describes the parts of a loop, as a signal path and as a sentence --------------------------------


def description(config: Mapping[str, Any], departures: str) -> dict[str, Any]:
    """Return what readers of a result show of its experiment, as `results.origin.Experiment`.

    Parameters
    ----------
    config
        The resolved configuration.
    departures
        Departures of its vehicle from the theorems.
    """
    (path, words), rtol = loop_in_words(config), config["solver"].get("rtol")
    rows = [entry["thrusters"] for entry in config.get("actuators") or () if "thrusters" in entry]
    sections = [config.get(section) or {} for section in ("model", "plant")]
    forces = [force for section in sections for force in section.get("forces") or ()]
    ups = [force.get("up") for force in forces if force["kind"] == "restoring"]
    return {
        "down": any(map(_is_down, ups)),
        "kinds": {entry["label"]: entry["kind"] for entry in config["controllers"]},
        "rtol": rtol if isinstance(rtol, float) else None,
        "seed": config["ensemble"]["seed"],
        "signal_path": path,
        "loop": words,
        "departures": (departures or words) if words else "",
        "thrusters": [
            [[*map(float, thruster[key]), 0.0][:3] for key in ("at", "along")]
            for thruster in next(filter(None, rows), ())
        ],
    }


def _is_down(up: Any) -> bool:
    """Whether a direction is against the last axis, mostly; None is along it."""
    if not isinstance(up, list) or not all(isinstance(x, int | float) for x in up):
        return False
    return up[-1] == -max(map(abs, up)) < 0


def loop_in_words(config: Mapping[str, Any]) -> tuple[str, str]:
    """Describe how a loop departs from the paper's, as a path and as a sentence; else "" each.

    ``reference → law → hold 0.1 s → limit → plant (drag) → velocity (noise every 0.2 s) → law``,
    where an estimate stands between sensors and law; and
    ``Loop: sampled every 0.1 s; actuators: limit; forces: drag; measured velocity (…).``
    """
    stages, departures = ["reference", "law"], list[str]()
    if control := config.get("control"):
        stages.append(f"hold {control['period']:g} s")
        departures.append(f"sampled every {control['period']:g} s")
        if delay := control.get("delay"):
            stages[-1] += f", delay {delay}"
            departures[-1] += f", {_late(delay)}"
    if actuators := _kinds(config.get("actuators")):
        stages += actuators
        departures.append(f"actuators: {', '.join(actuators)}")
    plant = config.get("plant") or {}
    inside = forces = _kinds(plant.get("forces"))
    if plant.get("inertia") is not None:
        inside = ["true inertia", *forces]
        departures.append("inertia error")
    if forces:
        departures.append(f"forces: {', '.join(forces)}")
    stages.append(f"plant ({', '.join(inside)})" if inside else "plant")
    sensors = (config.get("sensors") or {}).items()
    if measured := [f"{name} ({_measured(entries)})" for name, entries in sensors if entries]:
        stages.append(", ".join(measured))
        departures += [f"measured {words}" for words in measured]
    for kind in _kinds([config.get("estimator")]):
        stages.append(f"estimate ({kind})")
        departures.append(f"estimate: {kind}")
    if not departures:
        return "", ""
    return " → ".join([*stages, "law"]), f"Loop: {'; '.join(departures)}."


def _measured(entries: Any) -> str:
    """Describe sensors part by part, with the times of their measurements.

    ``translation: noise, bias every 1 s, 1 period late, 10 % lost; rotation: noise``
    """
    parts: dict[str, list[Any]] = {}
    for entry in entries:
        parts.setdefault("" if isinstance(entry, str) else entry.get("of") or "", []).append(entry)
    descriptions = []
    for part, sensors in parts.items():
        options: dict[str, Any] = {}
        for entry in sensors:
            options |= {} if isinstance(entry, str) else entry
        when = []
        if period := options.get("period"):
            when.append(f"every {period:g} s")
        if delay := options.get("delay"):
            when.append(_late(delay))
        if lost := options.get("dropout"):
            when.append(f"{100 * lost:g} % lost")
        text = " ".join(filter(None, [", ".join(_kinds(sensors)), ", ".join(when)]))
        descriptions.append(f"{part}: {text}" if part else text)
    return "; ".join(descriptions)


def _late(delay: int | str) -> str:
    """Describe a delay of whole periods, or of a time."""
    return f"{delay} late" if isinstance(delay, str) else f"{delay} period{'s' * (delay > 1)} late"


def _kinds(entries: Any) -> list[str]:
    present = (entry for entry in entries or () if entry is not None)
    return [entry if isinstance(entry, str) else str(entry["kind"]) for entry in present]


# Reads a configuration from a YAML file or a result, and applies overrides ------------------------


_MAX_LISTED = 5
"""Largest number of files that a message lists."""

_STORED = "[config]"
"""Suffix of the name of a result file in places within the configuration that it holds."""


ENGINE = "EQT_ENGINE"
"""Environment variable with the engine of configurations that name none."""

AUTO = "auto"
"""The engine of other configurations: native where it can be used, else solve_ivp."""


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
    chosen: bool = False
    """Whether the engine that it names was chosen, as `AUTO` asks for."""
    known: dict[str, tuple[Any, ...]] = field(default_factory=dict, repr=False, compare=False)
    """What was made of parts of the configuration at the last point of a sweep, behind them."""

    def made(self, name: str, problems: Problems, make: Callable[[], Any], *parts: Any) -> Any:
        """Return what is made of some parts; known where the last point had the same ones."""
        *last, known = self.known.get(name, (None,))
        if len(last) == len(parts) and all(map(is_, last, parts)):
            return known
        value = make()
        if not problems:
            self.known[name] = *parts, value
        return value

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

    @property
    def engine(self) -> Any:
        """The engine that it names, or `AUTO`; None if its section is no mapping."""
        section = self.data.get("solver") or {}
        return section.get("engine", AUTO) if isinstance(section, dict) else None

    def by_engine(self, engine: str, place: str = AUTO) -> "ConfigSource":
        """Return the configuration that names a chosen engine."""
        return replace(changed_at(self, ("solver", "engine"), engine, place), chosen=True)

    def begun_by(self, engine: object, folder: Path) -> "ConfigSource | None":
        """Return the configuration by the engine that began a folder, if another was chosen.

        Raises
        ------
        EqtError
            If that engine cannot be used here.
        """
        if not self.chosen or engine == self.engine or engine not in engines.names():
            return None
        if why := engines.get(str(engine)).unavailable():
            needs = why.partition("; or use")[0]
            raise EqtError(f"{folder}: was begun by engine {engine}; {needs}", OTHER_FOLDER)
        reporter().remark(EqtWarning(f"{folder}: goes on by engine {engine}, which began it"))
        return self.by_engine(str(engine), str(folder))


def read_config(path: Path, overrides: Sequence[str] | Mapping[str, str] = ()) -> ConfigSource:
    """Read a YAML file, or the configuration inside a result file or folder, and apply overrides.

    Parameters
    ----------
    path
        The file or folder; or, where neither it nor ``PATH.yaml`` exists, the name of a shipped
        configuration.
    overrides
        ``KEY=VALUE``, by the place for messages; in a sequence, the places are ``overrides[0]``, ….

    Raises
    ------
    ConfigError
        If the file is not valid YAML, or an override does not parse.
    """
    if str(path) in shipped.names() and not (path.exists() or path.with_suffix(".yaml").exists()):
        path = shipped.folder() / f"{path}.yaml"
    if path.is_dir() and not (path / FILE_NAME).exists() and (files := sorted(path.glob("*.yaml"))):
        listed = ", ".join(map(str, files[:_MAX_LISTED])) + (", …" if files[_MAX_LISTED:] else "")
        raise EqtError(f"{path}: is a folder without a result; give one of its files: {listed}")
    if path.suffix == ".h5" or path.is_dir():
        with open_results(path, oldest=1) as results:  # all formats have the same configuration
            config = source_of(results)
    else:
        source = yaml_source.load(_text(path), str(path))
        config = ConfigSource(source, source.data, path.parent)
    overridden(config, overrides)
    if config.data.get("name") is None:
        config.data = config.data | {"name": file_name(path.stem, "experiment")}
    return config


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
    usual = os.environ.get(ENGINE)
    if usual and config.engine and "engine" not in (config.data.get("solver") or {}):
        _apply(config, f"solver.engine={usual}", ENGINE)
    return config


def _text(path: Path) -> bytes:
    with refusals(path, "read", "check the path and its permissions"):
        try:
            return content_of(path, yaml_source.MAX_BYTES)
        except FileNotFoundError:
            hint = near(path, lambda entry: entry.suffix in YAML or (entry / FILE_NAME).is_file())
            hint = hint or suggestion(str(path), shipped.names())
            hint = hint or ". Create one with `eqt config new`"
            raise EqtError(f"{path}: not found{hint}") from None


def source_of(results: ResultFile) -> ConfigSource:
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
    return ConfigSource(
        source,
        source.data,
        results.path.parent,
        stored_plugins=plugins,
        files=files,
        holds_files=True,
    )


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
                if same := alike(component, owners):
                    but = f", and {component} differs in capitals only" * (same != component)
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
        text = text_of(file, relative, ComponentError, f"{subject} {file}")
        if not source.of_folder:
            _remember(text)
        elif not (trusted or _is_known(text)):
            raise ComponentError(
                f"the result folder contains {file}, which eqt executes only on request",
                Remedy("read this file, then add {}", "trust_plugins"),
            )
        return text
    if not (trusted or _is_known(source.stored_plugins.get(path, ""))):
        raise ComponentError(
            f"the result contains the source of {path}, which eqt executes only on request",
            Remedy("read it with `eqt show --plugins`, then add {}", "trust_plugins"),
        )
    if path not in source.stored_plugins:
        raise ComponentError(f"the result does not contain the source of {path}")
    return source.stored_plugins[path]


def _remember(text: str) -> None:
    """Keep in the user's own cache that a configuration of theirs has executed this code."""
    from eqt_cli.engines.compiler import digest, user_cache  # slow to import

    cache = user_cache()
    with suppress(OSError):
        if cache is not None and not cache.find(digest(text), EXECUTED):
            cache.keep(digest(text), EXECUTED, b"executed")


def _is_known(text: str) -> bool:
    """Return whether this user has executed this code before; nothing near a result says so."""
    from eqt_cli.engines.compiler import digest, user_cache

    cache = user_cache()
    return cache is not None and cache.find(digest(text), EXECUTED) is not None


EXECUTED = ".executed"  # no other kind of file in the cache ends so
"""Ending of the files in the cache that stand for executed code."""

P = TypeVar("P", bound=TimeVarying)

DATA_BYTES = 64_000_000
"""Largest size of a file, bytes, because it is kept in memory and in every result."""


def data_file(source: ConfigSource, name: str, reader: str = "") -> str:
    """Return the text of a file, whose name is relative to the configuration.

    A result file or folder gives a table of the initial states of its runs. The function `reader`
    of an extension, if one is named, makes the text of other files.

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
        if reader:
            text = of_extension(reader)(path)
        elif is_result:
            text = _starts_of(path)
        else:
            relative = "paths are relative to the configuration's folder"
            smaller = "keep the rows and columns that the configuration needs"
            text = recording_text(path, relative, InputError, DATA_BYTES, smaller)
        source.files[name] = text
    return source.files[name]


def with_data(part: P, source: ConfigSource, problems: Problems) -> tuple[P, dict[str, str]]:
    """Return a component with the contents of its files, and the contents; note read errors."""
    texts = {}
    for option, name in part.files.items():
        with problems.catching(option):
            texts[name] = data_file(source, name, part.reader)
    return part.with_files(texts), texts


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
