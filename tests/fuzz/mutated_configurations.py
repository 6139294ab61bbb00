"""Configurations that somebody might write by mistake, or to do harm; by seed, always the same."""

from __future__ import annotations

import random
from collections.abc import Callable
from copy import deepcopy
from typing import Any

import yaml

COMMON = """\
inertia: 1.5
gains: {kp: 1.0, kd: 0.5}
ensemble: {runs: 3, seed: 1}
time: {duration: 1.0, samples: 11}
solver: {rtol: 1.0e-6, cross_check: 0}
"""

BASES = [
    COMMON + text
    for text in (
        """\
group: SO3
reference: {torque: ["cos(t)", "sin(t)", "cos(t)*sin(t)"], velocity: [0, 0, 0]}
controllers: [eqt, {kind: family, gyroscopic: 0.5, label: mine}]
initial: {pose: {kind: euler, sequence: ZYX, low: -pi, high: pi}, velocity: {kind: normal, std: 1}}
""",
        """\
group: SE3
reference: {kind: constant, pose: identity}
controllers: [eqt, lee2010]
initial: {pose: haar, velocity: normal}
plant:
  inertia: {relative: 0.1}
  forces: [{kind: constant, force: [0.1, 0, 0, 0, 0, 0]}, {kind: drag, linear: 0.1}]
actuators: [{kind: limit, limit: 0.5}, {kind: lag, time_constant: 0.2}]
control: {period: 0.1, delay: 1}
sensors: {velocity: [{kind: noise, std: 0.01}, {kind: bias, value: 0.1}]}
""",
        """\
group: SO3*R2
reference: {kind: rates, rates: ["cos(t)", "0", "0", "t", "1"]}
controllers: [eqt]
initial: {pose: [haar, {kind: exp_normal, std: 1}], velocity: normal}
sweep:
  - {grid: {gains.kd: {low: 0.1, high: 1, points: 3}}}
  - {sobol: {points: 4, axes: {gains.kp: {low: 0.1, high: 1, scale: log}}}}
  - {zip: {inertia: [1, 2], ensemble.seed: [1, 2]}}
""",
        """\
group: SE2
task: stabilise
target: {pose: identity}
controllers: [stabilising]
initial: {pose: haar, velocity: {kind: normal, std: 0.1}}
store: {trajectories: 2, decimate: 2}
""",
        """\
group: SO3
reference: {kind: slew, to: {euler: {sequence: ZYX, angles: [0.5, 0, 0]}}, duration: 1}
controllers: [quaternion, logarithmic, {kind: goodarzi2013}]
initial: {pose: haar, velocity: normal}
""",
    )
]

HOSTILE: list[Any] = [
    *(0, -1, 1, 2, 3, 1e308, -1e308, 1e-320, 1e-300, 10**12, 10**18, 2**40, 2**63, -(2**63)),
    *(10**400, float("nan"), float("inf"), float("-inf"), True, False, None, "", " ", "1", "-"),
    *([], {}, [[]], [{}], [None], {"": 1}, [1] * 50, [[1, 2], [3]], [1, "a"], {"kind": "eqt"}),
    *("\x1b[2J", "\u202eabc", "a\nb", "\x00", "日本語", "a" * 500, "../../x", "~", "!!python/x"),
    *("t**t**t**t", "1/0", "1/(t-0.5)", "sqrt(-1)", "log(0)", "exp(exp(exp(t)))", "9**9**9**9"),
    *("(" * 200, "sin(" * 60 + "t" + ")" * 60, "-" * 500 + "1", "t;t", "__import__('os')", "1e999"),
    *("sin(t", "where(t>1, 1, 2)", "step(t, 0.5)", "min(t)", "t." + "real", "kp", "pi", "-pi"),
    *("R9", "R999999999999", "*".join(["R9"] * 600), "*".join(["SO3"] * 40), "SO3*", "so3", "SE23"),
    *("identity", "haar", "euler", "eqt", "all", "none", "deg", "native", "solve_ivp", "gt", "nog"),
    *({"low": 1, "high": 1}, {"low": 2, "high": 1}, {"range": [0, 1, 10**18]}, {"uniform": [1, 0]}),
    *({"range": [0, 1e18, 1]}, {"low": 0, "high": 1, "scale": "log"}, {"normal": [0, -1]}),
    *({"points": 2**40, "axes": {"gains.kp": {"low": 1, "high": 2}}}, {"rotvec": [1, 2, 3]}),
    *({"grid": {"gains.kp": [1, 2]}}, [{"grid": {"gains.kp": {"range": [0, 1, 2**40]}}}], 5, "x"),
    *([1e300, 1e-300, 1], [[1, 1e200, 0], [1e200, 1, 0], [0, 0, 1e-200]], [-1, 1, 1], [0, 0, 0]),
    *({"relative": -2}, {"relative": 1e300}, [["t", 0, 0], [0, 1, 0], [0, 0, 1]], "missing.csv"),
    *([["1/t", 0, 0], [0, 1, 0], [0, 0, 1]], [["sin(t)", 0, 0], [0, 1, 0], [0, 0, 1]], "."),
]
"""Values for any place."""

KEYS = [
    *("plugins", "sweep", "store", "task", "target", "plant", "actuators", "control", "sensors"),
    *("rtol", "kp", "", "\x1b[2J", "a.b", "[0]", "kind", "label", "engine", "max_steps", "block"),
    *("runs", "file", "scale", "period", "delay", "limit", "max_error", "cross_check", "pose"),
]

Path = tuple[str | int, ...]


def configuration(seed: int) -> bytes:
    """A configuration with one to three mistakes."""
    rng = random.Random(seed)
    data = yaml.safe_load(rng.choice(BASES))
    if rng.random() < 0.2:
        return _as_text(data, rng)
    for _ in range(rng.randint(1, 3)):
        data = rng.choice(CHANGES)(data, rng)
    return _dumped(data)


def _dumped(data: Any) -> bytes:
    return str(yaml.safe_dump(data, sort_keys=False, allow_unicode=True)).encode("utf-8", "replace")


def _places(data: Any, path: Path = ()) -> list[Path]:
    entries = data.items() if isinstance(data, dict) else enumerate(data)
    found = []
    for key, value in entries:
        found.append((*path, key))
        if isinstance(value, dict | list):
            found += _places(value, (*path, key))
    return found


def _replace(data: Any, rng: random.Random) -> Any:
    if path := _any_place(data, rng):
        _at(data, path[:-1])[path[-1]] = deepcopy(rng.choice(HOSTILE))
    return data


def _scale(data: Any, rng: random.Random) -> Any:
    """A number that is off by orders of magnitude, or by its sign."""
    values = {path: _at(data, path) for path in _places(data)}
    numbers = [p for p, x in values.items() if isinstance(x, int | float) and abs(x) < 1e300]
    if numbers:
        path = rng.choice(numbers)
        scale = rng.choice([-1, 0, 1e-12, 1e12, 1e-200, 1e200, 0.5, 1000])
        _at(data, path[:-1])[path[-1]] = float(values[path]) * scale
    return data


def _remove(data: Any, rng: random.Random) -> Any:
    if path := _any_place(data, rng):
        del _at(data, path[:-1])[path[-1]]
    return data


def _move(data: Any, rng: random.Random) -> Any:
    """What belongs elsewhere."""
    source, target = _any_place(data, rng), _any_place(data, rng)
    if source and target:
        _at(data, target[:-1])[target[-1]] = deepcopy(_at(data, source))
    return data


def _add(data: Any, rng: random.Random) -> Any:
    mappings = [(), *_places(data)]
    owners = [_at(data, path) for path in mappings if isinstance(_at(data, path), dict)]
    rng.choice(owners)[rng.choice(KEYS)] = deepcopy(rng.choice(HOSTILE))
    return data


def _repeat(data: Any, rng: random.Random) -> Any:
    lists = [_at(data, path) for path in _places(data) if isinstance(_at(data, path), list)]
    if lists:
        chosen = rng.choice(lists)
        chosen += deepcopy(chosen) * rng.choice([1, 10, 300])
    return data


def _at(data: Any, path: Path) -> Any:
    for step in path:
        data = data[step]
    return data


def _any_place(data: Any, rng: random.Random) -> Path | None:
    places = _places(data)
    return rng.choice(places) if places else None


CHANGES: list[Callable[[Any, random.Random], Any]] = [
    *(_replace, _replace, _replace, _scale, _scale, _remove, _move, _add, _add, _repeat)
]


SLIPS = [*(b"\t", b"\x00", b"\xff", b"*a", b"&a ", b"[", b"}", b": ", b"- ", b"!!x ", b"'", b"%")]


def _as_text(data: Any, rng: random.Random) -> bytes:
    """Slips of the keyboard, and of a disk."""
    text = bytearray(_dumped(data))
    for _ in range(rng.randint(1, 4)):
        start = rng.randrange(len(text) + 1)
        choice = rng.random()
        if choice < 0.3:
            text[start : start + rng.randint(1, 20)] = b""
        elif choice < 0.6:
            text[start:start] = rng.choice(SLIPS)
        elif choice < 0.8:
            text[start : start + 1] = rng.randbytes(1)
        else:
            del text[start:]
    return bytes(text)
