"""The first calls of a user's function, in a process that may crash or never end."""

from __future__ import annotations

import os
import signal
import struct
import subprocess
import sys
from contextlib import suppress
from pathlib import Path

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import InputError
from eqt_cli.engines.native import compiler, contained
from eqt_cli.engines.native.contained import Limits
from eqt_cli.engines.native.own_code import CodeFunction

SECONDS = 10.0
"""Time limit of the process, s; a healthy function needs a thousandth of it."""

MOST_WRITTEN = 2**20
"""Largest file that it writes, bytes."""

_CHILD = """
import ctypes, struct, sys
library = ctypes.CDLL(sys.argv[1])
runs, numbers, memory, row, axes, period = struct.unpack("5qd", sys.stdin.buffer.read(48))
def doubles(count):
    return (ctypes.c_double * max(count, 1)).from_buffer_copy(
        sys.stdin.buffer.read(8 * count).ljust(8, b"0"))
given, kept = doubles(numbers), doubles(memory)
torque = (ctypes.c_double * axes)()
for run in range(runs):
    inputs = doubles(row)
    for begins in (1, 0):
        sys.stdout.buffer.write(bytes([begins]))
        sys.stdout.buffer.flush()
        library.eqt_code(ctypes.c_long(1), ctypes.c_int(begins), ctypes.c_double(period),
                         given, kept, inputs, torque, None, None)
sys.stdout.buffer.write(b"done")
"""
"""The program of the process. It writes a byte before every call: 1 for the start, 0 for the
torque."""


def try_out(function: CodeFunction, numbers: Array, period: float, inputs: Array) -> None:
    """Call a function at some inputs, one after the other.

    Raises
    ------
    InputError
        If it crashes, or does not end; it names the function and the input.
    """
    memory = sum(function.lengths.values())
    sent = struct.pack(
        "5qd", len(inputs), numbers.size, memory, *inputs.shape[1:], function.code.axes, period
    )
    sent += np.ascontiguousarray(numbers, dtype=float).tobytes() + bytes(8 * memory)
    sent += np.ascontiguousarray(inputs, dtype=float).tobytes()
    with compiler.as_file(compiler.content(function.code.source)) as library:
        command = [sys.executable, "-I", "-S", "-c", _CHILD, str(library)]
        limits = Limits(SECONDS, file=MOST_WRITTEN)
        try:
            done = contained.run(command, sent, limits, Path(os.curdir))
            told, how = done.stdout, _ended(done.returncode)
        except subprocess.TimeoutExpired as late:
            told, how = late.stdout or b"", f"did not return within {SECONDS:g} s"
    if told.endswith(b"done"):
        return
    if not told:
        raise InputError(f"{function.code.file} cannot be tried out: the process {how}")
    begins, run = told[-1], (len(told) - 1) // 2
    called = f"{function.code.prefix}_start" if begins else function.code.function
    raise InputError(
        f"{called} in {function.code.file} {how} at {described(function, inputs[run])}; call it "
        "with this input in a debugger"
    )


def _ended(code: int) -> str:
    with suppress(ValueError):
        return f"crashed ({signal.Signals(-code).name})"
    return f"ended the process with code {code}"


def described(function: CodeFunction, row: Array) -> str:
    """Return an input in words, with numbers that can be copied."""
    inputs = function.code.inputs
    parts = np.split(row, np.cumsum([*inputs.values()])[:-1])
    return ", ".join(
        f"{name} = {', '.join(f'{x:.9g}' for x in part)}"
        if len(part) == 1
        else f"{name} = {{{', '.join(f'{x:.9g}' for x in part)}}}"
        for name, part in zip(inputs, parts, strict=True)
    )
