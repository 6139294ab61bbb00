"""Tables of programs that print messages: `ros2 topic echo`, and cfclient or cflib."""

import re
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np

from eqt_cli.base.errors import EqtWarning, InputError
from eqt_cli.base.reporting import reporter
from eqt_cli.extensions.logs.log_table import CONVERTED

DEEPEST = 20
"""Most keys within keys of a message."""

STAMPS = {
    "header.stamp.sec": "header.stamp.nanosec",
    "stamp.sec": "stamp.nanosec",
    "header.stamp.secs": "header.stamp.nsecs",
}
"""Names of the seconds of a message, and of the ns."""

SECONDS = 1.0
"""Least median step of times in ms; those in s have many rows per second."""


def echo_as_table(text: str, path: Path) -> str:
    """Read what `ros2 topic echo` prints: a document of YAML for a message, with --- between.

    Raises
    ------
    InputError
        If a message has other numbers than the first.
    """
    rows = list[tuple[int, dict[str, str]]]()
    for line, message in _messages(text):
        rows.append((line, message))
    if not rows:
        raise ValueError
    names = [name for name, value in rows[0][1].items() if _is_number(value)]
    if len(rows) > 1 and {*names} - {*rows[-1][1]}:  # the last one was cut
        rows.pop()
    head, times = _times(names, [message for _, message in rows])
    if head == "message":
        advice = "add `columns: {t: message}, time: {scale: S}` to the mapping, S s between them"
        reporter().remark(EqtWarning(f"{path}: its messages have no times; {advice}"))
    columns = [name for name in names if name not in {"timestamp", *sum(STAMPS.items(), ())}]
    lines = [CONVERTED, ",".join([head, *columns])]
    for time, (line, message) in zip(times, rows, strict=True):
        if lacking := [name for name in names if not _is_number(message.get(name, ""))]:
            expected = f"expected a number {lacking[0]}, as in the first message"
            raise InputError(f"{path}:{line}: {expected}")
        lines.append(",".join([time, *(message[name] for name in columns)]))
    return "\n".join([*lines, ""])


def _times(names: list[str], messages: list[dict[str, str]]) -> tuple[str, list[str]]:
    """Return the heading and the times of messages; without any, their numbers."""
    for seconds, rest in STAMPS.items():
        if {seconds, rest} <= {*names}:
            pairs = [(x.get(seconds, ""), x.get(rest, "")) for x in messages]
            whole = [[int(x) if x.isdecimal() else 0 for x in pair] for pair in pairs]
            return "t (ns)", [f"{10**9 * a + b}" for a, b in whole]
    if "timestamp" in names:  # of PX4
        return "t (us)", [x.get("timestamp", "") for x in messages]
    return "message", [f"{k}" for k in range(len(messages))]


def _messages(text: str) -> Iterator[tuple[int, dict[str, str]]]:
    """Yield the line of a message, and its values by name: ``pose.position.x``, ``data[3]``."""
    message, begin = _Message(), 1
    for number, line in enumerate(text.splitlines(), 1):
        if line.strip() != "---":
            message.take(line)
        else:
            if message.values:
                yield begin, message.values
            message, begin = _Message(), number + 1
    if message.values:
        yield begin, message.values


class _Message:
    """Values of a message by name, and the keys above the next line, with their indents."""

    def __init__(self) -> None:
        self.values, self.counts = dict[str, str](), dict[str, int]()
        self.above = list[tuple[int, str]]()

    def take(self, line: str) -> None:
        """Read a line: a key, with or without a value, or an item of a list."""
        rest, indent = line.strip(), len(line) - len(line.lstrip())
        while rest.startswith("- "):
            self._close(indent + 1)
            name = self._top
            k = self.counts[name] = self.counts.get(name, -1) + 1
            self._open(indent + 1, f"{name}[{k}]")
            rest, indent = rest[1:].strip(), indent + 2
        key, colon, value = rest.partition(":")
        if not colon or not re.fullmatch(r"\w+", key):
            if self.above and rest:
                self.values[self._top] = rest
            return
        self._close(indent)
        name, value = f"{self._top}.{key}" if self.above else key, value.strip()
        if not value:
            self._open(indent, name)
        elif value.startswith("["):
            inner = (x.strip() for x in value.strip("[]").split(",") if x.strip())
            self.values |= {f"{name}[{k}]": x for k, x in enumerate(inner)}
        else:
            self.values[name] = value

    @property
    def _top(self) -> str:
        return self.above[-1][1] if self.above else ""

    def _open(self, indent: int, name: str) -> None:
        if len(self.above) >= DEEPEST:
            raise ValueError
        self.above.append((indent, name))

    def _close(self, indent: int) -> None:
        while self.above and self.above[-1][0] >= indent:
            self.above.pop()


def _is_number(value: str) -> bool:
    return bool(
        re.fullmatch(r"[-+]?(\d+\.?\d*|\.\d+)([eE][-+]?\d+)?|[-+]?\.?(nan|inf)", value, re.I)
    )


def crazyflie_as_table(text: str, path: Path) -> str:
    """Read a log of cfclient or cflib: Timestamp in ms, angles in deg, pitch with the nose down.

    https://github.com/bitcraze/crazyflie-clients-python, logdatawriter.py.
    """
    head, *rows = text.removeprefix("\ufeff").splitlines()
    names = [name.strip().strip('"') for name in head.split(",")]
    place = next(k for k, name in enumerate(names) if name.lower() == "timestamp")
    times = [float(row.split(",")[place]) for row in rows[:50] if row.strip()]
    if np.median([b - a for a, b in pairwise(times)]) >= SECONDS:
        names[place] = "t (ms)"
    plain = {f"gyro.{axis}": f"w{axis} (deg/s)" for axis in "xyz"}
    turn = next((x for x in ("stateEstimate", "stabilizer") if f"{x}.roll" in names), "")
    if turn and "stateEstimate.qx" not in names:
        plain |= {f"{turn}.{name}": f"{name} (deg)" for name in ("roll", "yaw")}
        if (nose := f"{turn}.pitch") in names:
            k = names.index(nose)
            names.append("pitch (deg)")
            cells = [row.split(",") for row in rows]
            rows = [",".join([*x, _negative(x[k])]) if any(x) else "" for x in cells]
    return "\n".join([",".join(plain.get(name, name) for name in names), *rows, ""])


def _negative(cell: str) -> str:
    return repr(-float(cell)) if cell.strip() else ""
