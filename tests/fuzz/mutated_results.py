"""Result files as a bad disk, another program or a stranger may leave them; by seed."""

from __future__ import annotations

import random
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np

HOSTILE_NUMBERS = [0, -1, 1, 2**31 - 1, 1e308, -1e308, 1e-320, np.nan, np.inf, -np.inf]
HOSTILE_ATTRIBUTES: list[Any] = [
    *("", "x", "\x1b[2J", "{}", "[]", "null", "{", "a: [", "a" * 10_000, "{'a': 1}", "5"),
    "[" * 500,
    *(0, -1, 2**62, 1.5, np.nan, np.inf, np.int8(3), np.array([1, 2]), np.bytes_(b"\xff\xfe")),
    *('{"eqt": 1}', '{"started": []}', '["a"]', "controllers: 5", "group: SO3", "sweep: 5"),
]
NAMES = [
    *("cross_check_bound", "cross_check_difference", "cross_check_method", "cross_check_runs"),
    *("config", "plugins", "files", "provenance", "title", "experiment", "group"),
    "digest",
]

COMMANDS = [
    *(["show"], ["show", "--json"], ["show", "--failed"], ["show", "--variables"], ["compare"]),
    *(["show", "--table"], ["compare", "--json"], ["compare", "--list"], ["config", "check"]),
    *(["show", "--config"], ["compare", "--table", "pairs"], ["compare", "--window", "0:0.5"]),
    *(["show", "--table", "metrics", "--format", "jsonl"], ["show", "--plugins"]),
]
SLOW = [
    *(["verify"], ["report"], ["animate", "--seconds", "0.2"], ["run"]),
    *(
        ["plot", "--format", "json", "--figure", name]
        for name in "paper path torque runs path pareto sweep distributions".split()
    ),
]
"""Of which one in twelve is tried."""


def fixed(value: Any) -> Any:
    """Return text as a string of fixed length, which strings in results have."""
    return np.bytes_(value.encode()) if isinstance(value, str) else value


def result(seed: int, bases: list[Path], path: Path) -> list[str]:
    """Write a result with one to three faults; returns the command that is to read it."""
    rng = random.Random(seed)
    shutil.copyfile(rng.choice(bases), path)
    if rng.random() < 0.2:
        _damage(path, rng)
    else:
        with h5py.File(path, "a") as file:
            for _ in range(rng.randint(1, 3)):
                rng.choice([_attribute, _attribute, _values, _values, _dataset, _inner])(file, rng)
    command = rng.choice(SLOW) if rng.random() < 1 / 12 else rng.choice(COMMANDS)
    words = 2 if command[0] == "config" else 1
    out = {"report": "page.html", "run": "again", "plot": "figures", "animate": "figures"}
    more = ["--out", out[command[0]]] if command[0] in out else []
    return [*command[:words], str(path), *command[words:], *more]


def _damage(path: Path, rng: random.Random) -> None:
    """Bytes that are not as they were written."""
    data = bytearray(path.read_bytes())
    for _ in range(rng.randint(1, 8)):
        start = rng.randrange(len(data))
        if rng.random() < 0.8:
            data[start] = rng.randrange(256)
        else:
            del data[start : start + rng.choice([1, 100, len(data)])]
        data = data or bytearray(b"\0")
    path.write_bytes(bytes(data))


def _attribute(file: Any, rng: random.Random) -> None:
    """An attribute that is missing, or of another type."""
    names = [name for name in {*NAMES, *file.attrs} if name[0] != "_"]
    name = rng.choice(sorted(names))
    if name in file.attrs and rng.random() < 0.3:
        del file.attrs[name]
    elif rng.random() < 0.6 or name not in file.attrs:
        file.attrs[name] = _hostile(rng)
    else:  # part of what was there
        value = file.attrs[name]
        text = value.decode(errors="replace") if isinstance(value, bytes) else str(value)
        start = rng.randrange(len(text) + 1)
        file.attrs[name] = fixed(text[:start] + text[start + rng.randint(1, 30) :])


def _hostile(rng: random.Random) -> Any:
    """A value, whose text has a variable length once in ten."""
    value = rng.choice(HOSTILE_ATTRIBUTES)
    return value if rng.random() < 0.1 else fixed(value)


def _numeric(file: Any, rng: random.Random) -> str:
    return rng.choice(sorted(n for n in file if isinstance(file[n], h5py.Dataset)))


def _values(file: Any, rng: random.Random) -> None:
    """Numbers that no run gives."""
    name = rng.choice(
        ["time", "status", "desired_pose", "run", _numeric(file, rng), _numeric(file, rng)]
    )
    if name not in file or not isinstance(file[name], h5py.Dataset) or not file[name].size:
        return
    dataset = file[name]
    if dataset.dtype.kind == "S":
        dataset[...] = rng.choice([b"", "\u202e".encode(), b"\xff", b"x" * 1000])
        return
    value = rng.choice(HOSTILE_NUMBERS)
    if dataset.dtype.kind in "iu":
        value = int(value) if np.isfinite(value) and abs(value) < 2**31 else -1
    values = dataset[...]
    if rng.random() < 0.5:
        values[...] = value
    else:
        values.reshape(-1)[rng.randrange(values.size)] = value
    dataset[...] = values


def _dataset(file: Any, rng: random.Random) -> None:
    """A variable that is missing."""
    del file[_numeric(file, rng)]


def _inner(file: Any, rng: random.Random) -> None:
    """An attribute of a variable."""
    dataset = file[_numeric(file, rng)]
    names = sorted(n for n in dataset.attrs if n in ("units", "long_name", "coordinates"))
    if names:
        dataset.attrs[rng.choice(names)] = _hostile(rng)
