"""Laws of the suite: those that are shipped, and those in a file of the user."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, fields, replace
from hashlib import sha256
from pathlib import Path
from typing import Any

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError, InputError, Problems, parse_key, suggestion
from eqt_cli.base.files import content_of, refusals, text_of
from eqt_cli.base.option_types import shown, validated
from eqt_cli.base.registry import load_plugin
from eqt_cli.components.laws import controllers
from eqt_cli.config.document import Document, entries_of, remember_executed, value_at, with_value
from eqt_cli.extensions.search.keys import LogRange, TunedAxis
from eqt_cli.extensions.search.law_search import range_of
from eqt_cli.extensions.suite.tasks import Task

SHIPPED = Path(__file__).with_name("laws.yaml")
"""The laws of the archive."""

NETWORK_BYTES = 64_000_000
"""Largest size of a network's file, bytes."""

MOST_OWN = 4
"""Largest number of own numbers that a law may tune beside its gains."""

TUNES = "tunes"
"""Attribute of a class in Python, and word of a comment in C, with the ranges of own numbers."""

_SET = ("kp", "kd", "J", "period")
"""Fields of the numbers of code in C that get their values from a task."""

_COMMENT = re.compile(r"/\*\s*tunes\s*:(.*?)\*/|//\s*tunes\s*:([^\n]*)", re.DOTALL)
_FUNCTION = re.compile(r"\b(\w+)_torque\s*\(")
_FIELD = re.compile(r"(\w+)\s*(?:\[\s*(\d+)\s*\])?\s*(?=[,;])")

Ranges = dict[str, Any]
"""Ranges of a law's own numbers, in the words of `tune`."""


@dataclass(frozen=True)
class Law:
    """A law that the suite judges.

    Attributes
    ----------
    label
        Its name in tables.
    entry
        Its entry in a configuration, without gains.
    tunes
        Ranges of its own numbers.
    kind
        ``shipped``, ``Python``, ``C`` or ``network``.
    file
        The user's file; None of a shipped law.
    text
        Its source.
    fields
        Of C, the sizes of the fields of its numbers.
    only
        The tasks that it is for; empty for all that take it.
    leaves
        Gains of the tasks that are not tuned, since another number does the same.
    """

    label: str
    entry: dict[str, Any]
    tunes: Ranges = field(default_factory=dict)
    kind: str = "shipped"
    file: Path | None = None
    text: str = ""
    fields: Mapping[str, int] = field(default_factory=dict)
    only: tuple[str, ...] = ()
    leaves: tuple[str, ...] = ()

    @property
    def digest(self) -> str:
        """Hash of what it computes: of its source and options, not of its name or its file."""
        entry = {key: value for key, value in self.entry.items() if key not in ("file", "label")}
        left = list(self.leaves) or None
        text = json.dumps([self.text, entry, self.tunes, left], sort_keys=True)
        return sha256(text.encode()).hexdigest()

    def start(self, task: Task) -> dict[str, float]:
        """Return its own numbers where a search starts: in the middle of their ranges."""
        gains = task.document.data.get("gains", {})
        start = {}
        for name, written in self.tunes.items():
            middle, axis = _middle(written), parsed(written)
            if isinstance(axis, LogRange) and axis.times:
                keys = [key for key in task.ranges if key.partition("[")[0] == axis.times]
                unit = value_at(gains, parse_key(entries_of(keys[0])[0])) if keys else None
                middle *= unit if isinstance(unit, int | float) else 1.0
            start[name] = middle
        return start

    def in_task(self, task: Task) -> Document:
        """Return the configuration of a task with this law, at the starting values."""
        document, place = task.document, task.place
        entry: dict[str, Any] = dict(self.entry) | ({} if self.fields else self.start(task))
        data = document.data
        if self.fields:
            entry["numbers"] = self._numbers(task)
        if place == ("controllers", 0):
            entry["label"] = self.label
        else:
            data = with_value(data, ("controllers", 0, "label"), self.label)
        data = with_value(data, place, entry)
        if self.kind == "Python" and "file" not in self.entry:
            data = data | {"plugins": [str(self.file)]}
        origin = str(self.file or self.label)
        return replace(document, data=data, changes={place: origin, ("plugins",): origin})

    def over(self, task: Task) -> dict[str, Any]:
        """Return the keys that a search for this law varies in a task, with their ranges."""
        of_gains = {
            name: written
            for name, written in task.ranges.items()
            if ("." in name or not self.fields or name.partition("[")[0] in self.fields)
            and name.partition("[")[0] not in self.leaves
        }
        return {self.key(name, task): written for name, written in (of_gains | self.tunes).items()}

    def key(self, name: str, task: Task) -> str:
        """Return the key of a gain, or of an own number, in the configuration of a task."""
        entry = task.document.data["controllers"][0]
        of_law = "controllers[0]" + "".join(f".{key}" for key in task.place[2:])
        if "." in name:
            return name
        if self.fields:
            return f"{of_law}.numbers.{name}"
        if name in self.tunes:
            return f"{of_law}.{name}"
        has_gains = isinstance(entry, dict) and "gains" in entry
        return f"controllers[0].gains.{name}" if has_gains else f"gains.{name}"

    def tunes_key(self, key: str, task: Task) -> bool:
        """Whether a key is a gain of a task, or an own number of the law, or an entry of one."""
        tuned = {_whole(self.key(name, task)) for name in (*task.ranges, *self.tunes)}
        return _whole(key) in tuned

    def _numbers(self, task: Task) -> dict[str, Any]:
        """Return the numbers of code in C: its gains, the inertia of the model, and its own."""
        numbers: dict[str, Any] = dict(self.start(task))
        gains: dict[str, Any] = task.document.data.get("gains", {})
        for name in ("kp", "kd"):
            if name in self.fields and name in gains:
                numbers[name] = _of_size(gains[name], self.fields[name], name)
        if "J" in self.fields:
            inertia = task.document.data.get("inertia")
            numbers["J"] = _of_size(inertia, self.fields["J"], "J")
        return numbers


def _of_size(value: Any, size: int, name: str) -> Any:
    """Return a gain or an inertia as so many numbers."""
    if isinstance(value, int | float):
        return value if size == 1 else [value] * size
    rows = value if isinstance(value[0], list) else None
    entries = [x for row in value for x in row] if rows else list(value)
    if len(entries) == size:
        return entries
    if rows is None and len(entries) ** 2 == size:
        return [x if i == k else 0 for i, x in enumerate(entries) for k in range(len(entries))]
    raise InputError(
        f"numbers.{name}: the task has {len(entries)} numbers, and {name} has room for {size}"
    )


def _middle(written: Any) -> float:
    axis = range_of(parsed(written), Problems())
    if axis is None:
        raise InputError(f"expected {{log: [low, high]}} or [low, high], low < high, got {written}")
    both = math.sqrt(axis.low * axis.high) if axis.scale == "log" else (axis.low + axis.high) / 2
    return float(f"{both:.6g}")


def parsed(written: Any) -> Any:
    """Return a range as `tune.over` takes it."""
    problems = Problems()
    axis = validated(TunedAxis, written, problems)
    problems.raise_if_any()
    return axis


def shipped_laws() -> dict[str, Law]:
    """Return the laws of the archive by label."""
    source = yaml_source.load(text_of(SHIPPED, "the laws of the suite").encode(), SHIPPED.name)
    laws = {}
    for label, written in source.data.items():
        options = written or {}
        entry = {"kind": label, **options.get("options", {})}
        only = tuple(options.get("tasks", ()))
        leaves = tuple(options.get("leaves", ()))
        law = Law(label, entry, options.get(TUNES, {}), only=only, leaves=leaves)
        if file := options.get("file"):
            law = replace(read_law(str(SHIPPED.parent / file)), label=label, only=only)
        laws[label] = law
    return laws


def law_of(text: str) -> Law:
    """Return the law of the archive with this label, or the law in this file of the user.

    Raises
    ------
    EqtError
        If there is neither.
    """
    shipped = shipped_laws()
    if text in shipped and not Path(text).exists():
        return shipped[text]
    if not Path(text).suffix and not Path(text).exists():
        near = suggestion(text, shipped) or f"; the archive has {', '.join(shipped)}"
        raise EqtError(f"{text}: is neither a file nor a law of the archive{near}")
    return read_law(text)


def read_law(text: str) -> Law:
    """Return the law in a file of the user, ``mylaw.py``, ``mylaw.c:function`` or ``net.yaml``.

    Raises
    ------
    EqtError
        If there is no such file, or no law in it.
    """
    name, function = _file_and_function(text)
    path = Path(name)
    is_network = path.suffix in (".onnx", ".h5")
    if is_network and path.exists():
        raise EqtError(
            f"{text}: does not say what it observes and commands; write {path.stem}.yaml, "
            f"{{file: {path.name}, observes: […], commands: {{…}}}}, and name that"
        )
    source = text_of(path, "it has the law: .py, .c, .cpp, or .yaml of a network")
    if path.suffix == ".py":
        law = _in_python(path, source, function)
    elif path.suffix in (".c", ".cpp", ".cc", ".cxx"):
        law = _in_c(path, source, function)
    elif path.suffix in (".yaml", ".yml"):
        law = _of_network(path, source)
    else:
        raise EqtError(
            f"{text}: expected a law in .py, .c or .cpp, or the .yaml of a network: "
            "{file: net.onnx, observes: […], commands: {…}}"
        )
    if len(law.tunes) > MOST_OWN:
        raise EqtError(
            f"{path}: {TUNES} has {len(law.tunes)} numbers; a law tunes at most {MOST_OWN} beside "
            "kp and kd, so that all laws have searches of like size"
        )
    for number, written in law.tunes.items():
        try:
            _middle(written)
        except EqtError as error:
            raise EqtError(f"{path}: {TUNES}.{number}: {error}") from None
    return law


def _file_and_function(text: str) -> tuple[str, str]:
    if Path(text).exists():
        return text, ""
    name, colon, function = text.rpartition(":")
    return (name, function) if colon and Path(name).exists() else (text, "")


def _in_python(path: Path, source: str, wanted: str) -> Law:
    remember_executed(source)
    added = load_plugin(path, source)
    names = [
        text_of_law.split("'")[1] for text_of_law in added if text_of_law.startswith("controller ")
    ]
    if wanted and wanted not in names:
        raise EqtError(f"{path}: has no law '{wanted}'; there are: {', '.join(names) or 'none'}")
    if len(names) != 1 and not wanted:
        raise EqtError(
            f"{path}: has {len(names)} laws; "
            + (f"name one: {path}:{names[0]}" if names else "derive a class from Controller")
        )
    kind = wanted or names[0]
    law = controllers.get(kind)
    tunes = _ranges(getattr(law, TUNES, {}), path)
    options = [option.name for option in fields(law) if option.init]
    for name in tunes:
        if name not in options:
            raise EqtError(
                f"{path}: {TUNES}.{name}: is no option of {kind}{suggestion(name, options)}"
            )
    return Law(path.stem, {"kind": kind}, tunes, "Python", path.resolve(), source)


def _in_c(path: Path, source: str, wanted: str) -> Law:
    prefixes = list(dict.fromkeys(_FUNCTION.findall(source)))
    wanted = wanted.removesuffix("_torque")
    if not prefixes:
        raise EqtError(f"{path}: has no law; expected a function whose name ends in _torque")
    if wanted and wanted not in prefixes:
        there = ", ".join(f"{prefix}_torque" for prefix in prefixes)
        raise EqtError(f"{path}: has no function {wanted}_torque; there are: {there}")
    if included := re.search(r'^\s*#\s*include\s*"([^"]+)"', source, re.MULTILINE):
        raise EqtError(
            f"{path}: a law is one file, since its hash and its pack have no other; put the text "
            f"of {included[1]} in the place of its #include"
        )
    prefix = wanted or prefixes[0]
    if len(prefixes) > 1 and not wanted:
        raise EqtError(f"{path}: has several laws; name one: {path}:{prefix}_torque")
    sizes, memory = (_fields(source, f"{prefix}_{part}") for part in ("numbers", "memory"))
    comment = _COMMENT.search(source)
    tunes: Ranges = {}
    if comment:
        written = (comment[1] or comment[2] or "").strip()
        tunes = _ranges(yaml_source.parse_value(written, f"{path}: {TUNES}"), path)
    for name in tunes:
        if name not in sizes:
            raise EqtError(
                f"{path}: {TUNES}.{name}: is no field of {prefix}_numbers{suggestion(name, sizes)}"
            )
    lacking = [name for name in sizes if name not in (*_SET, *tunes)]
    if lacking and not re.search(rf"\b{prefix}_defaults\s*=", source):
        raise EqtError(
            f"{path}: {prefix}_numbers.{lacking[0]}: has no value; give its range in a comment, "
            f"/* {TUNES}: {{{lacking[0]}: {{log: [low, high]}}}} */, or its value in "
            f"`const {prefix}_numbers {prefix}_defaults = {{…}}`. eqt sets {', '.join(_SET)}."
        )
    entry: dict[str, Any] = {"kind": "code", "file": str(path.resolve())}
    entry["function"] = f"{prefix}_torque"
    if any(re.search(rf"->\s*{name}\b", source) for name in memory):  # else it is the unused one
        entry["memory"] = list(memory)
    return Law(path.stem, entry, tunes, "C", path.resolve(), source, sizes)


def _ranges(written: Any, path: Path) -> Ranges:
    """Return the ranges of own numbers."""
    if not isinstance(written, Mapping) or not all(isinstance(name, str) for name in written):
        raise EqtError(f"{path}: {TUNES}: expected {{name: {{log: [low, high]}}}}, got {written}")
    return dict(written)


def _of_network(path: Path, source: str) -> Law:
    """Return the network that a file describes, as an entry of `controllers` does."""
    written = yaml_source.load(source.encode(), str(path)).data
    entry = {"kind": "network"} | written
    if not isinstance(entry.get("file"), str):
        raise EqtError(f"{path}: file: missing; it names the network, as net.onnx")
    weights = path.parent.resolve() / entry["file"]
    with refusals(weights, "read", "it has the network"):
        digest = sha256(content_of(weights, NETWORK_BYTES)).hexdigest()
    entry["file"] = str(weights)
    text = f"{source}\n# {weights.name}: sha256 {digest}\n"
    return Law(path.stem, entry, {}, "network", path.resolve(), text)


def _fields(source: str, name: str) -> dict[str, int]:
    """Return the sizes of the fields of a type in C, such as the numbers of a law."""
    plain = re.sub(r"/\*.*?\*/|//[^\n]*", "", source, flags=re.DOTALL)
    body = re.search(r"struct\s*\w*\s*\{([^{}]*)\}\s*" + re.escape(name) + r"\b", plain)
    fields: dict[str, int] = {}
    for statement in (body[1] if body else "").split(";"):
        _, _, names = statement.strip().partition(" ")
        for member, size in _FIELD.findall(names + ";"):
            fields[member] = int(size or 1)
    return fields


def starting(document: Document, keys: Iterable[str]) -> dict[str, Any]:
    """Return the values of keys in a configuration."""
    return {key: value_at(document.data, parse_key(entries_of(key)[0])) for key in keys}


def _whole(key: str) -> str:
    """Return a key without the index of an entry."""
    return re.sub(r"\[\d+\]$", "", key)


def stated_gains(law: Law, path: Path, tasks: Mapping[str, Task]) -> dict[str, dict[str, Any]]:
    """Return the values that a file states for a law, by task: ``{quad_att: {kp: 2.0, kd: 0.4}}``.

    Raises
    ------
    ConfigError
        If a task or a number is unknown or missing.
    """
    source = yaml_source.load(text_of(path, "it has gains by task").encode(), str(path))
    problems, values = Problems(source.key_place), dict[str, dict[str, Any]]()
    for name, written in source.data.items():
        here = problems.at(name)
        if name not in tasks:
            here.add(f"no such task{suggestion(name, tasks)}")
            continue
        task = tasks[name]
        numbers = [*task.ranges, *law.tunes]
        if not isinstance(written, dict):
            here.add(f"expected {{{numbers[0]}: …}}, got {shown(written)}")
            continue
        for number, value in written.items():
            if number not in numbers and number not in {one.partition("[")[0] for one in numbers}:
                here.at(number).add(f"no number of this law{suggestion(number, numbers)}")
            elif not isinstance(value, int | float | list) or isinstance(value, bool):
                here.at(number).add(f"expected a number, got {shown(value)}")
        values[name] = {law.key(number, task): value for number, value in written.items()}
    problems.raise_if_any()
    return values
