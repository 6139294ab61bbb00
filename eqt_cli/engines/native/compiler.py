"""The C compiler of this machine, and the libraries that it builds from laws.

No shell is used, and of the user's text only numbers, and own C code, are in a source.
"""

from __future__ import annotations

import ctypes
import errno
import json
import os
import platform
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path

from eqt_cli.core.errors import Remedy, TraceError
from eqt_cli.core.files import NO_SPACE
from eqt_cli.core.reporting import reporter, subject
from eqt_cli.engines.native import contained
from eqt_cli.engines.native.cache import digest, own_cache
from eqt_cli.engines.native.contained import Limits, temporary_folder

WINDOWS = os.name == "nt"

FLAGS = ("-std=c99", "-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""No compiler may change a rounding with these. The last two concern errno and signals only."""

LIBRARY = (*FLAGS, "-w", "-shared", *(() if WINDOWS else ("-fPIC",)))
ENDING = ".dll" if WINDOWS else ".so"
MATHEMATICS = () if WINDOWS else ("-lm",)
OWN_MACHINE = "-march=native"

SECONDS = 600.0
"""Time limit of a compiler, s."""

PREPROCESSOR = Limits(seconds=10.0, memory=2**30, file=16 * 2**20)
"""Limits of a compiler that only reads a user's files; math.h and its like take 0.1 s and 1 MB."""

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
    return _installed(os.environ.get("PATH", ""))


@lru_cache(maxsize=1)
def _installed(folders: str) -> list[tuple[str, ...]]:
    """Look for compilers in the folders of a PATH once: every point of a sweep asks for them."""
    names = ("cc", "clang", "gcc")
    found = [(path,) for name in names if (path := shutil.which(name, path=folders))]
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
        "engine native needs a C compiler: install gcc or clang, or 'pip install ziglang' (extra "
        f"native), a clang in a wheel (this is {platform.system()} on {platform.machine()}); or "
        "use engine solve_ivp"
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
            return _described(command)
        except TraceError as error:
            errors.append(error)
    raise errors[0] if errors else TraceError(missing() or "there is no C compiler")


def _asked(command: tuple[str, ...]) -> Compiler:
    """Return the compiler of a command, as described by the macros that it defines."""
    said = ""
    for flags in ((OWN_MACHINE,), ()):
        answer = run([*command, *flags, "-dM", "-E", "-x", "c", "-"])
        if answer.returncode == 0 and "#define" in answer.stdout:
            return _read(command, flags, answer.stdout)
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


def _described(command: tuple[str, ...]) -> Compiler:
    """Return the compiler of a command: cached, on a processor like this, or as it says itself."""
    cache, key = own_cache(), _state(command)
    if cache is None or key is None:
        return _asked(command)
    with suppress(OSError, ValueError, TypeError):
        if found := cache.find(key, ".json"):
            entries = json.loads(found)
            tuples = {name: tuple(entries[name]) for name in ("command", "flags", "features")}
            return Compiler(**{**entries, **tuples})
    asked = _asked(command)
    with suppress(OSError):
        cache.keep(key, ".json", json.dumps(asdict(asked)).encode())
    return asked


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
        return _library(source, by)[0]


def content(source: str) -> bytes:
    """Return the file of the same library; raises as `library` does."""
    by = compiler()
    with _lock:
        return _library(source, by)[1]


@lru_cache(maxsize=64)
def _library(source: str, by: Compiler) -> tuple[ctypes.CDLL, bytes]:
    cache, key = own_cache(), digest("\0".join([source, by.words, by.identity]))
    if cache is not None and (found := cache.find(key, ENDING)):
        with suppress(OSError):
            return _loaded(found), found
    with reporter().busy(f"compiling {subject()}"):
        made = _compiled(source, by, "-shared")
    try:
        loaded = _loaded(made)
    except OSError as error:
        raise TraceError(
            f"what the C compiler {shlex.join(by.command)} makes cannot be loaded",
            Remedy("set the variable CC to a compiler for this machine, or use engine solve_ivp"),
            lines=_told(str(error)),
        ) from error
    if cache is not None:
        with suppress(OSError):
            cache.keep(key, ENDING, made)
    return loaded, made


def _loaded(made: bytes) -> ctypes.CDLL:
    with as_file(made) as path:
        return ctypes.CDLL(str(path))


@contextmanager
def as_file(made: bytes) -> Iterator[Path]:
    """Give a library a name, under which this process and others of the user can load it.

    No one can change it between its check and its use: on Linux it is in memory only.
    """
    with temporary_folder() as folder:
        path = folder / f"law{ENDING}"
        if sys.platform != "linux":
            path.write_bytes(made)
            yield path
            return
        with os.fdopen(os.memfd_create("eqt"), "wb") as memory:
            memory.write(made)
            memory.flush()
            path.symlink_to(f"/proc/{os.getpid()}/fd/{memory.fileno()}")
            yield path


def _compiled(source: str, by: Compiler, kind: str) -> bytes:
    """Return the library (``-shared``) or the object file (``-c``) of a source."""
    flags = [kind if flag == "-shared" else flag for flag in (*LIBRARY, *by.flags)]
    linked = MATHEMATICS if kind == "-shared" else ()
    with temporary_folder() as folder:
        made = folder / f"law{ENDING}"
        answer = run([*by.command, *flags, "-o", str(made), "-x", "c", "-", *linked], source)
        if answer.returncode or not made.exists():
            raise TraceError(
                f"the C compiler {shlex.join(by.command)} cannot compile a law",
                Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
                lines=_told(answer.stderr or answer.stdout),
            )
        return made.read_bytes()


def object_file(source: str) -> bytes:
    """Return what the compiler makes of a C source before it is linked.

    Raises
    ------
    TraceError
        If there is no compiler, or it fails.
    """
    return _compiled(source, compiler(), "-c")


def preprocessed(source: str = "", file: Path | None = None) -> str:
    """Return a C source after its preprocessor, with the markers of lines.

    Parameters
    ----------
    file
        The source, in place of a text. Its folder is the first in which included files are looked
        for.

    Raises
    ------
    TraceError
        If there is no compiler, or it fails.
    """
    by = compiler()
    command = [*by.command, *FLAGS, *by.flags, "-w", "-E", "-x", "c", str(file or "-")]
    answer = run(command, source, PREPROCESSOR)
    if answer.returncode:
        raise TraceError(
            f"the preprocessor of {shlex.join(by.command)} fails",
            lines=_told(answer.stderr) or [f"it ended with {answer.returncode}"],
        )
    return answer.stdout


def run(
    command: Sequence[str], text: str = "", limits: Limits | None = None
) -> subprocess.CompletedProcess[str]:
    """Run a command within limits, in an empty folder; text in, text out.

    Raises
    ------
    TraceError
        If it cannot be started, or takes too long.
    """
    limits = limits or Limits(SECONDS)
    try:
        if not shutil.which(command[0]):
            raise FileNotFoundError(errno.ENOENT, os.strerror(errno.ENOENT))
        done = contained.run(command, text.encode(), limits)
        if done.returncode and (full := contained.no_space(done.stderr, limits)):
            raise OSError(full, os.strerror(full))
    except OSError as error:
        if error.errno in NO_SPACE:
            raise TraceError(
                f"a law cannot be compiled: a temporary file in {tempfile.gettempdir()} cannot be "
                f"written: {str(error.strerror).lower()}",
                Remedy(
                    "free some space there, raise the largest file size (`ulimit -f`), or set the "
                    "variable TMPDIR to another folder"
                ),
            ) from error
        said = f"the C compiler {command[0]} cannot be started: {error.strerror}"
        raise TraceError(said, CHOOSE) from error
    except subprocess.TimeoutExpired:
        raise TraceError(
            f"the C compiler {command[0]} did not end within {limits.seconds:g} s: "
            f"{shlex.join(command)}",
            Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
        ) from None
    out, err = (told.decode("utf-8", "replace") for told in (done.stdout, done.stderr))
    return subprocess.CompletedProcess(command, done.returncode, out, err)


def _told(text: str) -> list[str]:
    """Return the lines with errors in a compiler's messages, else the last lines."""
    lines = text.strip().splitlines()
    return [line for line in lines if "error" in line][:TOLD_LINES] or lines[-TOLD_LINES:]
