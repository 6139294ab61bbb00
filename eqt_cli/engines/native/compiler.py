"""The C compiler of this machine, and the libraries that it builds from laws.

No shell is used, and of the user's text only numbers, and own C code, are in a source.
"""

from __future__ import annotations

import ctypes
import json
import os
import platform
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from eqt_cli.core.errors import Remedy, TraceError
from eqt_cli.core.reporting import reporter
from eqt_cli.engines.native.cache import digest, own_cache

WINDOWS = os.name == "nt"

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""No compiler may change a rounding with these. The last two concern errno and signals only."""

LIBRARY = (*FLAGS, "-w", "-shared", *(() if WINDOWS else ("-fPIC",)))
ENDING = ".dll" if WINDOWS else ".so"
MATHEMATICS = () if WINDOWS else ("-lm",)
OWN_MACHINE = "-march=native"

SECONDS = 600.0
"""Time limit of a compiler, s."""

TOLD_LINES = 5
"""Most lines of a compiler's messages that are shown."""

FEATURES = {
    "__AVX512F__": "AVX-512",
    "__AVX2__": "AVX2",
    "__AVX__": "AVX",
    "__FMA__": "FMA",
    "__ARM_NEON": "NEON",
    "__ARM_FEATURE_SVE": "SVE",
    "__riscv_v": "V",
}
"""Instruction sets of processors that matter for speed, by the macro that shows them."""

INEXACT = {
    "__FAST_MATH__": "1",
    "__FINITE_MATH_ONLY__": "1",
    "__RECIPROCAL_MATH__": "1",
    "__ASSOCIATIVE_MATH__": "1",
    "__NO_SIGNED_ZEROS__": "1",
    "__FLT_EVAL_METHOD__": "2",
}
"""Macros, and their values, of compilers that do not round as IEEE 754 requires."""

CHOOSE = Remedy("set the variable CC to a C compiler, or remove it")


@dataclass(frozen=True)
class Compiler:
    """A C compiler of this machine.

    Attributes
    ----------
    command
        The command that calls it.
    flags
        Flags beyond those of every compiler.
    version
        Its version as it reports it: ``gcc 12.2.0``.
    features
        Instruction sets of the processor for which it compiles.
    identity
        Digest of all its predefined macros, which describe it and the processor.
    """

    command: tuple[str, ...]
    flags: tuple[str, ...]
    version: str
    features: tuple[str, ...]
    identity: str

    @property
    def words(self) -> str:
        """The command and its flags, as typed in a shell."""
        return shlex.join([*self.command, *LIBRARY, *self.flags])

    @property
    def lanes(self) -> int:
        """The number of runs side by side, which fill a vector.

        More would be split, which gcc does badly: on AVX2, 8 lanes take 1.5 times as long for a
        sine as 4.
        """
        return 8 if "AVX-512" in self.features else 4 if "AVX" in self.features else 2

    @property
    def described(self) -> str:
        """Version, command and processor in a line."""
        known = f"; {', '.join(self.features)}" if self.features else ""
        return f"{self.version}: {self.words}{known}"


# The compiler of this machine ---------------------------------------------------------------------


def commands() -> list[tuple[str, ...]]:
    """Return the commands of the C compilers of this machine, the best first.

    The variable CC has precedence; else cc, clang, gcc, and the clang of the package ziglang.
    """
    if chosen := _words(os.environ.get("CC", "")):
        return [chosen]
    found = [(path,) for name in ("cc", "clang", "gcc") if (path := shutil.which(name))]
    zig = [(sys.executable, "-m", "ziglang", "cc")] if find_spec("ziglang") else []
    # Others on Windows may be for another system than Python's.
    return [*zig, *found] if WINDOWS else [*found, *zig]


def _words(called: str) -> tuple[str, ...]:
    try:
        words = shlex.split(called, posix=not WINDOWS)
    except ValueError as error:
        said = str(error).rstrip(".").lower()
        raise TraceError(f"the variable CC is no command: {called}: {said}", CHOOSE) from error
    return tuple(word.strip('"') for word in words) if WINDOWS else tuple(words)


def missing() -> str | None:
    """Return how to get a compiler; None if there is one."""
    if os.environ.get("CC", "").strip() or commands():
        return None
    return (
        "engine native needs a C compiler: install gcc or clang, or 'pip install ziglang', a clang "
        f"in a wheel (this is {platform.system()} on {platform.machine()}); or use engine solve_ivp"
    )


_lock = threading.Lock()


def compiler() -> Compiler:
    """Return the first compiler of this machine that works.

    Raises
    ------
    TraceError
        If there is none.
    """
    with _lock:
        return _first(tuple(commands()))


@lru_cache(maxsize=8)
def _first(called: tuple[tuple[str, ...], ...]) -> Compiler:
    errors: list[TraceError] = []
    for command in called:
        try:
            return _known(command) or _asked(command)
        except TraceError as error:
            errors.append(error)
    raise errors[0] if errors else TraceError(missing() or "there is no C compiler")


def _asked(command: tuple[str, ...]) -> Compiler:
    """Return the compiler of a command, as described by the macros that it defines."""
    said = ""
    for flags in ((OWN_MACHINE,), ()):
        answer = run([*command, *flags, "-dM", "-E", "-x", "c", "-"])
        if answer.returncode == 0 and "#define" in answer.stdout:
            return _remembered(_read(command, flags, answer.stdout))
        said = answer.stderr or answer.stdout
    raise TraceError(
        f"the C compiler {shlex.join(command)} does not work", CHOOSE, lines=_told(said)
    )


def _read(command: tuple[str, ...], flags: tuple[str, ...], told: str) -> Compiler:
    macros = dict(re.findall(r"^#define (\w+) (.*)$", told, re.MULTILINE))
    if wrong := [name for name, value in INEXACT.items() if macros.get(name) == value]:
        raise TraceError(
            f"the C compiler {shlex.join(command)} does not round as IEEE 754 says "
            f"({wrong[0]} is {macros[wrong[0]]})",
            Remedy("remove options such as -ffast-math from the variable CC"),
        )
    name = "clang" if "__clang__" in macros else "gcc" if "__GNUC__" in macros else "C compiler"
    said = (macros.get("__clang_version__") or macros.get("__VERSION__", "")).strip('"').split()
    return Compiler(
        command,
        flags,
        " ".join([name, *said[:1]]),
        tuple(words for macro, words in FEATURES.items() if macro in macros),
        digest(told),
    )


# To query a compiler takes 50 to 200 ms, longer than to load a library from the cache.


def _known(command: tuple[str, ...]) -> Compiler | None:
    """Return the cached description of a compiler, on a processor like this."""
    cache, key = own_cache(), _state(command)
    if cache is None or key is None:
        return None
    with suppress(OSError, ValueError, TypeError):
        if path := cache.find(key, ".json"):
            entries = json.loads(path.read_bytes())
            tuples = {name: tuple(entries[name]) for name in ("command", "flags", "features")}
            return Compiler(**{**entries, **tuples})
    return None


def _remembered(found: Compiler) -> Compiler:
    cache, key = own_cache(), _state(found.command)
    if cache is not None and key is not None:
        with suppress(OSError):
            cache.keep(key, ".json", json.dumps(asdict(found)).encode())
    return found


def _state(command: tuple[str, ...]) -> str | None:
    """Return a digest that changes with compiler and processor; None if the latter is unknown."""
    processor = _processor()
    if not processor:
        return None
    files = [
        (str(path), found.st_mtime_ns, found.st_size)
        for path in _files(command)
        for found in [path.stat()]
    ]
    return digest(repr((command, files, processor)))


def _files(command: Sequence[str]) -> Iterator[Path]:
    """Yield the files that a command names, links followed."""
    for word in command:
        if path := shutil.which(word):
            yield Path(path).resolve()
        elif word == "ziglang" and (package := find_spec(word)) and package.origin:
            yield from sorted(Path(package.origin).parent.glob("zig*"))


def _processor() -> list[str]:
    """Return Linux's description of the first processor, without varying numbers; else nothing."""
    varies = ("processor", "cpu MHz", "bogomips", "BogoMIPS", "core id", "apicid", "initial apicid")
    try:
        with Path("/proc/cpuinfo").open(encoding="utf-8", errors="replace") as stream:
            text = stream.read(2**14).split("\n\n")[0]
    except OSError:
        return []
    return [line for line in text.splitlines() if line.partition("\t")[0].strip() not in varies]


# Libraries ----------------------------------------------------------------------------------------


def library(source: str) -> ctypes.CDLL:
    """Return the library of a C source, compiled or from the cache.

    Raises
    ------
    TraceError
        If there is no compiler, or it fails.
    """
    by = compiler()
    with _lock:  # a thread waits while another one compiles the same source
        return _library(source, by)


@lru_cache(maxsize=64)
def _library(source: str, by: Compiler) -> ctypes.CDLL:
    cache, key = own_cache(), digest("\0".join([source, by.words, by.identity]))
    if cache is not None and (found := cache.find(key, ENDING)):
        with suppress(OSError):
            return ctypes.CDLL(str(found))
    try:
        # A loaded library cannot be removed on Windows.
        folder = tempfile.TemporaryDirectory(prefix="eqt-", ignore_cleanup_errors=True)
    except OSError as error:
        raise TraceError(
            f"a law cannot be compiled: there is no folder for temporary files: {error.strerror}",
            Remedy("set the variable TMPDIR to a folder that you can write to"),
        ) from error
    with folder, reporter().busy("compiling the laws"):
        made = Path(folder.name, f"law{ENDING}")
        _compile(source, by, made)
        if cache is not None:
            with suppress(OSError):
                return ctypes.CDLL(str(cache.keep(key, ENDING, made.read_bytes())))
        return _loaded(made, by)


def _compile(source: str, by: Compiler, made: Path) -> None:
    flags = [*LIBRARY, *by.flags]
    answer = run([*by.command, *flags, "-o", str(made), "-x", "c", "-", *MATHEMATICS], source)
    if answer.returncode or not made.exists():
        raise TraceError(
            f"the C compiler {shlex.join(by.command)} cannot compile a law",
            Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
            lines=_told(answer.stderr or answer.stdout),
        )


def _loaded(made: Path, by: Compiler) -> ctypes.CDLL:
    try:
        return ctypes.CDLL(str(made))
    except OSError as error:
        raise TraceError(
            f"what the C compiler {shlex.join(by.command)} makes cannot be loaded",
            Remedy("set the variable CC to a compiler for this machine, or use engine solve_ivp"),
            lines=_told(str(error)),
        ) from error


def run(command: Sequence[str], text: str = "") -> subprocess.CompletedProcess[str]:
    """Run a command without shell or terminal; a timeout kills it and all that it has started."""
    called = shlex.join(command)
    try:
        process = subprocess.Popen(
            command,
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            encoding="utf-8",
            errors="replace",
            start_new_session=True,
        )
    except OSError as error:
        said = f"the C compiler {command[0]} cannot be started: {error.strerror}"
        raise TraceError(said, CHOOSE) from error
    with process:
        try:
            out, err = process.communicate(text, timeout=SECONDS)
        except subprocess.TimeoutExpired:
            _end(process)
            raise TraceError(
                f"the C compiler {command[0]} did not end within {SECONDS:g} s: {called}",
                Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
            ) from None
        except BaseException:
            _end(process)
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def _end(process: subprocess.Popen[str]) -> None:
    with suppress(OSError):
        if WINDOWS:
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)


def _told(text: str) -> list[str]:
    """Return the lines with errors in a compiler's messages, else the last lines."""
    lines = text.strip().splitlines()
    return [line for line in lines if "error" in line][:TOLD_LINES] or lines[-TOLD_LINES:]
