"""Compiles C into a library that this process loads, and keeps it in the user's cache.

No shell is asked, and nothing of the user's text is in the source. What is in the cache is loaded
as code: only from a folder that belongs to the user and that no one else can write to.
"""

from __future__ import annotations

import ctypes
import hashlib
import os
import platform
import shlex
import shutil
import stat
import subprocess
import sys
import tempfile
import threading
from contextlib import suppress
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from eqt_cli.core.errors import EqtError, Remedy

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""They let no compiler change a rounding. The last two have to do with errno and signals only."""

LIBRARY = (*FLAGS, "-w", "-shared", "-fPIC")
OWN_MACHINE = "-march=native"
SECONDS = 600
"""After which a compiler is ended."""

KEPT = 200
"""Compiled laws in the cache, of some 50 kB each; the oldest go."""


@dataclass(frozen=True)
class Compiler:
    """A C compiler of this machine.

    Attributes
    ----------
    command
        How it is called.
    flags
        Beside those of every compiler.
    identity
        What it says of itself and of the processor for which it compiles.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...]
    identity: str

    @property
    def words(self) -> str:
        """The command and its flags, as in a shell."""
        return shlex.join([*self.command, *LIBRARY, *self.flags])


def command() -> tuple[str, ...] | None:
    """How the C compiler of this machine is called; None where there is none.

    The variable CC rules; then come cc, clang and gcc, and clang as the package ziglang has it.
    """
    if chosen := shlex.split(os.environ.get("CC", "")):
        return tuple(chosen)
    for name in ("cc", "clang", "gcc"):
        if found := shutil.which(name):
            return (found,)
    return (sys.executable, "-m", "ziglang", "cc") if find_spec("ziglang") else None


def missing() -> str | None:
    """Where there is no compiler: how to get one."""
    if command():
        return None
    return (
        "engine native needs a C compiler: install gcc or clang, or 'pip install eqt[native]' for "
        f"one in a wheel (this is {platform.system()} on {platform.machine()}); or use engine "
        "solve_ivp"
    )


@lru_cache(maxsize=4)
def compiler(called: tuple[str, ...]) -> Compiler:
    """The compiler that a command calls."""
    refused = ""
    for flags in ((OWN_MACHINE,), ()):
        try:
            # All macros that it defines: its version, and what the processor can do.
            asked = [*called, *flags, "-dM", "-E", "-x", "c", os.devnull]
            answer = _run(asked)
        except OSError as error:
            raise EqtError(
                f"the C compiler {shlex.join(called)} cannot be started: {error.strerror}",
                Remedy("set the variable CC to a C compiler, or remove it"),
            ) from error
        if answer.returncode == 0:
            return Compiler(called, flags, answer.stdout)
        refused = answer.stderr
    raise EqtError(
        f"the C compiler {shlex.join(called)} does not work:\n{_end(refused)}",
        Remedy("set the variable CC to a C compiler, or remove it"),
    )


_lock = threading.Lock()


def library(source: str) -> ctypes.CDLL:
    """The library of a C source: compiled, or from the cache."""
    found = command()
    if found is None:
        raise EqtError(missing() or "there is no C compiler")
    with _lock:  # who asks while another thread compiles it waits for that
        return _library(source, compiler(found))


@lru_cache(maxsize=64)
def _library(source: str, compiled_by: Compiler) -> ctypes.CDLL:
    key = "\0".join([source, compiled_by.words, compiled_by.identity])
    name = f"{hashlib.sha256(key.encode()).hexdigest()}.so"
    folder = _cache()
    if folder is not None:
        with suppress(OSError):
            loaded = ctypes.CDLL(str(folder / name))
            with suppress(OSError):
                os.utime(folder / name)
            return loaded
    with tempfile.TemporaryDirectory(dir=folder, prefix="making-") as own:
        text, made = Path(own, "law.c"), Path(own, name)
        text.write_text(source, encoding="utf-8")
        flags = [*LIBRARY, *compiled_by.flags]
        answer = _run([*compiled_by.command, *flags, "-o", str(made), str(text), "-lm"])
        if answer.returncode:
            raise EqtError(
                f"the C compiler {shlex.join(compiled_by.command)} refuses a law:\n"
                f"{_end(answer.stderr)}",
                Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
            )
        loaded = ctypes.CDLL(str(made))
        if folder is not None:
            made.replace(folder / name)
            _forget_the_oldest(folder)
        return loaded


def _run(command: list[str]) -> subprocess.CompletedProcess[str]:
    """A program without a shell, a terminal or an end that it does not find."""
    return subprocess.run(
        command,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        errors="replace",
        timeout=SECONDS,
        check=False,
    )


def _end(text: str) -> str:
    """The last lines of what a compiler says."""
    return "\n".join(text.strip().splitlines()[-5:])


def _cache() -> Path | None:
    """The folder of compiled laws, if one can be had that is the user's alone."""
    if os.name == "nt":
        base = os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local"
    else:
        base = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    folder = Path(base, "eqt", "native")
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError:
        return None
    if os.name == "nt":
        return folder
    private = stat.S_ISDIR(found.st_mode) and not found.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return folder if private and found.st_uid == os.getuid() else None


def _forget_the_oldest(folder: Path) -> None:
    with suppress(OSError):
        kept = sorted(folder.glob("*.so"), key=lambda path: path.stat().st_mtime)
        for path in kept[:-KEPT]:
            path.unlink()
