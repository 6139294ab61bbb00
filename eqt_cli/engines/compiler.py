"""Compiles C on this machine in contained processes, and keeps the libraries."""

import ctypes
import errno
import hashlib
import json
import os
import platform
import re
import shlex
import shutil
import signal
import stat
import subprocess
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass, replace
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtWarning, Remedy, TraceError
from eqt_cli.base.files import NO_SPACE, open_regular, replace_file
from eqt_cli.base.reporting import reporter, subject

# Runs a program with limits, in an empty folder; it ends with this process, however that ends -----
#
# The text may be hostile, and so may the compiled code: neither may take all memory, fill the
# disk, or go on for ever.


WINDOWS = os.name == "nt"
if not WINDOWS:
    import resource


@dataclass(frozen=True)
class Limits:
    """What a program and each that it starts may take.

    Attributes
    ----------
    seconds
        Time by the clock, s, of all together, and of the processor, s, of each.
    memory
        Address space, bytes. The largest traced law took gcc 0.4 GB, and clang of ziglang 1.1 GB.
    file
        Largest file that is written, bytes; also what is written to stdout, and to stderr.
    """

    seconds: float
    memory: int = 4 * 2**30
    file: int = 2**28


_GUARD = """
import ctypes, os, resource, signal, sys
def end(*_):
    os.killpg(0, signal.SIGKILL)
parent, seconds, memory, file = map(int, sys.argv[1:5])
signal.signal(signal.SIGTERM, end)
if sys.platform == "linux":
    ctypes.CDLL(None).prctl(1, signal.SIGTERM, 0, 0, 0)  # when the parent ends
if os.getppid() != parent:
    end()
for kind, most in (("CPU", seconds), ("AS", memory), ("FSIZE", file), ("CORE", 0)):
    number = getattr(resource, "RLIMIT_" + kind)
    soft, hard = (least if least >= 0 else most for least in resource.getrlimit(number))
    try:
        resource.setrlimit(number, (min(soft, hard, most),) * 2)
    except (OSError, ValueError):
        pass  # macOS has no limit of the address space
try:
    child = os.posix_spawnp(sys.argv[5], sys.argv[5:], os.environ,
                            setsigdef=[signal.SIGPIPE, signal.SIGXFSZ, signal.SIGTERM])
except OSError as error:
    sys.exit("cannot be started: " + error.strerror)
code = os.waitstatus_to_exitcode(os.waitpid(child, 0)[1])
if code < 0:
    signal.signal(-code, signal.SIG_DFL) if -code not in (signal.SIGKILL, signal.SIGSTOP) else None
    os.kill(os.getpid(), -code)
sys.exit(code)
"""
"""The program between this process and the other one. It takes the limits, which the other one and
all that it starts inherit, and ends them all when this process has ended."""


_BRINGING = ("-I", "-isystem", "-iquote", "-idirafter", "-include", "-imacros")
"""Options of a compiler that lead to headers which no result names."""

_PATHS = "CPATH C_INCLUDE_PATH CPLUS_INCLUDE_PATH LIBRARY_PATH GCC_EXEC_PREFIX".split()
_PATHS += "COMPILER_PATH LD_RUN_PATH".split()
_PATHS += "DEPENDENCIES_OUTPUT SUNPRO_DEPENDENCIES CCC_OVERRIDE_OPTIONS CCC_ADD_ARGS".split()
"""Variables by which a compiler reads or writes other files, which no result would name."""


def started(
    command: Sequence[str], limits: Limits, streams: tuple[Any, Any, Any], folder: Path | None
) -> subprocess.Popen[bytes]:
    """Start a command within limits with stdin, stdout and stderr; it ends with this process."""
    words = list(command)
    if not WINDOWS:
        numbers = os.getpid(), max(1, round(limits.seconds)), limits.memory, limits.file
        words = [sys.executable, "-I", "-S", "-c", _GUARD, *map(str, numbers), *command]
    env = {name: text for name, text in os.environ.items() if name not in _PATHS}
    return subprocess.Popen(words, -1, None, *streams, cwd=folder, env=env, start_new_session=True)


def run_contained(
    command: Sequence[str], text: bytes, limits: Limits
) -> subprocess.CompletedProcess[bytes]:
    """Run a command in an empty folder, without shell; whatever it has started ends with it.

    Parameters
    ----------
    text
        What it reads from stdin.

    Raises
    ------
    OSError
        If it cannot be started.
    subprocess.TimeoutExpired
        If it takes longer; with what it has written so far.
    """
    with (
        temporary_folder() as empty,
        tempfile.TemporaryFile() as stdin,
        tempfile.TemporaryFile() as out,
        tempfile.TemporaryFile() as err,
    ):
        stdin.write(text)
        stdin.seek(0)
        process = started(command, limits, (stdin, out, err), Path(empty))
        late = False
        try:
            process.wait(timeout=limits.seconds)
        except subprocess.TimeoutExpired:
            late = True
        finally:
            end(process)
            process.wait()
        said = []
        for stream in (out, err):
            stream.seek(0)
            size = os.fstat(stream.fileno()).st_size  # memory is taken for what is asked for
            said.append(stream.read(min(limits.file, size)))
    if late:
        raise subprocess.TimeoutExpired(command, limits.seconds, *said)
    return subprocess.CompletedProcess(command, process.returncode, *said)


LEAST_FREE = 2**18
"""Room for temporary files, with which a compiler that fails may have had too little, bytes."""


def no_space(said: bytes, limits: Limits) -> int | None:
    """Return the error number of a full disk or of the user's limit of file size, if it is that."""
    limit = -1 if WINDOWS else resource.getrlimit(resource.RLIMIT_FSIZE)[0]
    if 0 <= limit < limits.file and re.search(rb"File size limit exceeded|File too large", said):
        return errno.EFBIG
    # A compiler that finds no room for its own message says nothing.
    full = shutil.disk_usage(_temporary()).free < LEAST_FREE
    return errno.ENOSPC if full or b"No space left on device" in said else None


def _temporary() -> str:
    """Return the folder where compilers write, also if it is full; Python would take another."""
    return os.environ.get("TMPDIR") or tempfile.gettempdir()


def end(process: subprocess.Popen[bytes]) -> None:
    """End a process, and all others of its group."""
    with suppress(OSError):
        if WINDOWS:
            process.kill()
        else:
            os.killpg(process.pid, signal.SIGKILL)


@contextmanager
def temporary_folder() -> Iterator[Path]:
    """Make a folder of this user that is removed after the block.

    Raises
    ------
    TraceError
        If there is no place for it.
    """
    try:
        # A loaded library cannot be removed on Windows.
        folder = tempfile.TemporaryDirectory(prefix="eqt-", ignore_cleanup_errors=True)
    except OSError as error:
        raise TraceError(
            f"a law cannot be compiled: there is no folder for temporary files: {error.strerror}",
            Remedy("set the variable TMPDIR to a folder that you can write to"),
        ) from error
    with folder:
        yield Path(folder.name)


# The cache of compiled laws of a user, in a folder to which only the user can write ---------------
#
# They are loaded as code. A file has the digest of its content in its name, so that a damaged one
# is not used.


MOST_BYTES = 2**28
"""Largest file of a law, bytes."""

MOST_FILES = 200
"""Most files, of some 50 kB each; the least recently used are removed."""


@dataclass(frozen=True)
class Cache:
    """The files of a folder, each under a key."""

    folder: Path

    def find(self, key: str, ending: str) -> bytes | None:
        """Return an intact file of this key, if there is one; anything else is removed.

        The returned bytes are those that were checked: the file is not read a second time.
        """
        for path in list(self.folder.iterdir()):
            if path.suffix != ending or not path.name.startswith(f"{key}-"):
                continue
            with suppress(OSError):
                content = _private_content(path)
                if content is not None and path.name == _name(key, content, ending):
                    return content
                path.unlink()
        return None

    def keep(self, key: str, ending: str, content: bytes) -> None:
        """Keep a file; the least recently used others are removed.

        Raises
        ------
        OSError
            If it cannot be written.
        """
        path = self.folder / _name(key, content, ending)
        replace_file(path, content)
        path.chmod(0o600)  # whatever the umask lets others write to
        used = []
        for path in self.folder.iterdir():  # also unfinished ones of killed processes
            with suppress(OSError):  # another process has removed it
                used.append((path.lstat().st_mtime, path))
        for _, path in sorted(used)[:-MOST_FILES]:
            with suppress(OSError):
                path.unlink()


def _private_content(path: Path) -> bytes | None:
    """Return the content of a file that only this user can write to, and mark it as used."""
    with suppress(OSError), open_regular(path, follow=False) as stream:
        status = os.fstat(stream.fileno())
        if (os.name == "nt" or _is_private(status)) and status.st_size <= MOST_BYTES:
            os.utime(path)
            return stream.read(status.st_size)
    return None


def user_cache() -> Cache | None:
    """Return the cache of this user; None if there is none that only the user can write to."""
    with suppress(OSError, RuntimeError):  # RuntimeError: there is no home
        folder = caches_of_user() / "eqt" / "native"
        folder.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        folder.mkdir(mode=0o700, exist_ok=True)
        if os.name == "nt":
            return Cache(folder)
        status, place = folder.lstat(), folder.resolve()
        if stat.S_ISDIR(status.st_mode) and _is_private(status):
            for parent in place.parents:
                if not _is_safe(parent.stat()):
                    _tell(parent)
                    return None
            return Cache(place)
    return None


@lru_cache(maxsize=8)
def _tell(folder: Path) -> None:
    reporter().remark(
        EqtWarning(
            f"compiled laws are not kept: other users can replace the files in {folder}",
            Remedy("remove their permission to write to it, or set XDG_CACHE_HOME to another one"),
        )
    )


def caches_of_user() -> Path:
    """Return the folder of the user's caches."""
    if os.name == "nt":
        return Path(os.environ.get("LOCALAPPDATA") or Path.home() / "AppData" / "Local")
    chosen = Path(os.environ.get("XDG_CACHE_HOME", ""))
    return chosen if chosen.is_absolute() else Path.home() / ".cache"


def _is_private(status: os.stat_result) -> bool:
    """Return whether it is this user's, and no one else can write to it."""
    return status.st_uid == os.getuid() and not status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)


def _is_safe(status: os.stat_result) -> bool:
    """Return whether only this user and the system can replace the files in a folder.

    As ssh asks of the folders above a key. With its sticky bit, as /tmp, a folder lets others
    replace only what is theirs.
    """
    shared = status.st_mode & (stat.S_IWGRP | stat.S_IWOTH)
    return status.st_uid in (0, os.getuid()) and (not shared or bool(status.st_mode & stat.S_ISVTX))


def digest(text: str) -> str:
    """Return the key of a text."""
    return hashlib.sha256(text.encode()).hexdigest()[:32]


def _name(key: str, content: bytes, ending: str) -> str:
    return f"{key}-{hashlib.sha256(content).hexdigest()}{ending}"


# The C compiler of this machine, and the libraries that it builds from laws -----------------------
#
# No shell is used, and of the user's text only numbers, and own C code, are in a source.


FLAGS = ("-O2", "-ffp-contract=off", "-fno-math-errno", "-fno-trapping-math")
"""No compiler may change a rounding with these. The last two concern errno and signals only."""

QUICK = "-Og"
"""Takes half of the time of -O2 to compile, and gives code that takes 1.6 times as long."""

LIBRARY = (*FLAGS, "-w", "-shared", *(() if WINDOWS else ("-fPIC",)))
ENDING = ".dll" if WINDOWS else ".so"
MATHEMATICS = () if WINDOWS else ("-lm",)
THIS_MACHINE = "-march=native"

SECONDS = 600.0
"""Time limit of a compiler, s."""

PREPROCESSOR = Limits(seconds=10.0, memory=2**30, file=16 * 2**20)
"""Limits of a compiler that only reads a user's files; math.h and its like take 0.1 s and 1 MB."""

MESSAGE_LINES = 5
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

NARROW = "-fsingle-precision-constant"

CPLUSPLUS = "#pragma eqt C++\n"
"""A line of each source in C++, which preprocessors keep."""

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
        return shlex.join([*self.command, "-std=c99", *LIBRARY, *self.flags])

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
        features = f"; {', '.join(self.features)}" if self.features else ""
        return f"{self.version}: {self.words}{features}"


# The compiler of this machine ---------------------------------------------------------------------


def commands() -> list[tuple[str, ...]]:
    """Return the commands of the C compilers of this machine, the best first.

    The variable CC has precedence; else cc, clang, gcc, and the clang of the package ziglang.
    """
    called = os.environ.get("CC", "")
    try:
        words = shlex.split(called, posix=not WINDOWS)
    except ValueError as error:
        said = str(error).rstrip(".").lower()
        raise TraceError(f"the variable CC is not a command: {called}: {said}", CHOOSE) from error
    if words:
        return [tuple(word.strip('"') for word in words) if WINDOWS else tuple(words)]
    return _installed(os.environ.get("PATH", ""))


@lru_cache(maxsize=1)
def _installed(folders: str) -> list[tuple[str, ...]]:
    """Look for compilers in the folders of a PATH once: every point of a sweep asks for them."""
    names = ("cc", "clang", "gcc")
    compilers = [(path,) for name in names if (path := shutil.which(name, path=folders))]
    zig = [(sys.executable, "-m", "ziglang", "cc")] if find_spec("ziglang") else []
    # Others on Windows may be for another system than Python's.
    return [*zig, *compilers] if WINDOWS else [*compilers, *zig]


_OWN_FILES = Path("/proc/self")
"""Where Linux names the files of a process that have no name."""


def missing() -> str | None:
    """Return how to get a compiler, or what else is missing; None if nothing is."""
    if sys.platform == "linux" and not _OWN_FILES.exists():
        return (
            f"engine native loads compiled laws from {_OWN_FILES}, which is missing: mount /proc, "
            "or use engine solve_ivp"
        )
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


def _queried(command: tuple[str, ...]) -> Compiler:
    """Return the compiler of a command, as described by the macros that it defines."""
    if added := [word for word in command[1:] if word.startswith(_BRINGING)]:
        raise TraceError(
            f"the C compiler {shlex.join(command)} reads headers that no result names",
            Remedy(f"remove {added[0]} from the variable CC"),
        )
    if NARROW in command:  # which no macro shows
        raise TraceError(
            f"the C compiler {shlex.join(command)} reads 0.1 as a float",
            Remedy(f"remove {NARROW} from the variable CC"),
        )
    said = ""
    for flags in ((THIS_MACHINE,), ()):
        answer = run([*command, *flags, "-dM", "-E", "-x", "c", "-"])
        if answer.returncode == 0 and "#define" in answer.stdout:
            return _read(command, flags, answer.stdout)
        said = answer.stderr or answer.stdout
    raise TraceError(
        f"the C compiler {shlex.join(command)} does not work", CHOOSE, lines=error_lines(said)
    )


def _read(command: tuple[str, ...], flags: tuple[str, ...], text: str) -> Compiler:
    macros = dict(re.findall(r"^#define (\w+) (.*)$", text, re.MULTILINE))
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
        digest(text),
    )


# To query a compiler takes 50 to 200 ms, longer than to load a library from the cache.


def _described(command: tuple[str, ...]) -> Compiler:
    """Return the compiler of a command: cached, on a processor like this, or as it says itself."""
    cache, key = user_cache(), _state(command)
    if cache is None or key is None:
        return _queried(command)
    with suppress(OSError, ValueError, TypeError):
        if cached := cache.find(key, ".json"):
            entries = json.loads(cached)
            tuples = {name: tuple(entries[name]) for name in ("command", "flags", "features")}
            return Compiler(**{**entries, **tuples})
    described = _queried(command)
    with suppress(OSError):
        cache.keep(key, ".json", json.dumps(asdict(described)).encode())
    return described


def _state(command: tuple[str, ...]) -> str | None:
    """Return a digest that changes with compiler and processor; None if the latter is unknown."""
    processor = _processor()
    if not processor:
        return None
    status = [(str(path), path.stat()) for path in _files(command)]
    files = [(path, file.st_mtime_ns, file.st_size) for path, file in status]
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


def library(
    source: str, check: Callable[[str], object] | None = None, *, quick: bool = False
) -> ctypes.CDLL:
    """Return the library of a C source, compiled or from the cache.

    Parameters
    ----------
    check
        Is called with its assembly language before a library is made of that, once for a source.
    quick
        Whether it is compiled as `QUICK` says, if there is none of it yet.

    Raises
    ------
    TraceError
        If there is no compiler, or it fails.
    """
    by = compiler()
    with _turn(source):
        return _library(source, by, check, quick)[0]


def content(source: str, check: Callable[[str], object] | None = None) -> bytes:
    """Return the file of the same library; raises as `library` does."""
    by = compiler()
    with _turn(source):
        return _library(source, by, check)[1]


@lru_cache(maxsize=64)
def _turn(source: str) -> threading.Lock:
    """Return the lock by which a thread waits while another one compiles the same source."""
    return threading.Lock()


@lru_cache(maxsize=64)
def _library(
    source: str, by: Compiler, check: Callable[[str], object] | None, quick: bool = False
) -> tuple[ctypes.CDLL, bytes]:
    cache = user_cache()
    ways = [by, replace(by, flags=(*by.flags, QUICK))] if quick else [by]
    for way in ways:
        key = digest("\0".join([source, way.words, way.identity]))
        if cache is not None and (cached := cache.find(key, ENDING)):
            with suppress(OSError):
                return _loaded(cached), cached
    by = way
    with reporter().busy(f"compiling {subject()}"):
        written = assembly(source, by) if check else ""
        if check:
            check(written)
        binary = _compiled(source, by, "-shared", written)
    try:
        loaded = _loaded(binary)
    except OSError as error:
        raise TraceError(
            f"what the C compiler {shlex.join(by.command)} makes cannot be loaded",
            Remedy("set the variable CC to a compiler for this machine, or use engine solve_ivp"),
            lines=error_lines(str(error)),
        ) from error
    if cache is not None:
        with suppress(OSError):
            cache.keep(key, ENDING, binary)
    return loaded, binary


def _loaded(binary: bytes) -> ctypes.CDLL:
    with as_file(binary) as path:
        return ctypes.CDLL(str(path))


@contextmanager
def as_file(binary: bytes) -> Iterator[Path]:
    """Give a library a name, under which this process and others of the user can load it.

    No one can change it between its check and its use: on Linux it is in memory only.
    """
    with temporary_folder() as folder:
        path = folder / f"law{ENDING}"
        if sys.platform != "linux":
            path.write_bytes(binary)
            yield path
            return
        with os.fdopen(os.memfd_create("eqt"), "wb") as memory:
            memory.write(binary)
            memory.flush()
            path.symlink_to(_OWN_FILES.parent / f"{os.getpid()}" / "fd" / f"{memory.fileno()}")
            yield path


def _compiled(source: str, by: Compiler, kind: str, written: str = "") -> bytes:
    """Return the library (``-shared``), object file (``-c``) or assembly (``-S``) of a source.

    It is made of the source's assembly language where that is `written`, which takes little time.
    """
    language = language_of(source)
    flags = [kind if flag == "-shared" else flag for flag in (*LIBRARY, *by.flags)]
    flags.append("-fno-verbose-asm")  # comments of clang, such as "# kill: def $eax", say nothing
    if "c++" not in language:  # eqt says it with its remedy; gcc 14 and clang 16 end with an error
        flags.append("-Wno-incompatible-pointer-types")
    linked = (
        [*MATHEMATICS, *(["-lstdc++"] if "c++" in language else [])] if kind == "-shared" else []
    )
    form = ("-x", "assembler") if written else language
    with temporary_folder() as folder:
        target = folder / f"law{ENDING}"
        words = [*by.command, *flags, "-o", str(target), *form, "-", *linked]
        answer = run(words, written or source)
        if answer.returncode or not target.exists():
            raise TraceError(
                f"the C compiler {shlex.join(by.command)} cannot compile a law",
                Remedy("set the variable CC to another C compiler, or use engine solve_ivp"),
                lines=error_lines(answer.stderr or answer.stdout),
            )
        return target.read_bytes()


def language_of(source: str) -> tuple[str, ...]:
    """Return the flags of the language of a source, C or C++."""
    return ("-x", "c++", "-std=c++17") if CPLUSPLUS in source else ("-x", "c", "-std=c99")


@lru_cache(maxsize=2)
def assembly(source: str, by: Compiler) -> str:
    """Return the assembly language of a C source; raises as `object_file` does."""
    return _compiled(source, by, "-S").decode("utf-8", "replace")


def object_file(source: str) -> bytes:
    """Return what the compiler makes of a C source before it is linked.

    Raises
    ------
    TraceError
        If there is no compiler, or it fails.
    """
    by = compiler()
    return _compiled(source, by, "-c", assembly(source, by))


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
        done = run_contained(command, text.encode(), limits)
        if done.returncode and (full := no_space(done.stderr, limits)):
            raise OSError(full, os.strerror(full))
    except OSError as error:
        if error.errno in NO_SPACE:
            raise TraceError(
                f"a law cannot be compiled: a temporary file in {_temporary()} cannot be "
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
    out, err = (stream.decode("utf-8", "replace") for stream in (done.stdout, done.stderr))
    return subprocess.CompletedProcess(command, done.returncode, out, err)


def error_lines(text: str) -> list[str]:
    """Return the lines with errors in a compiler's messages, else the last lines."""
    lines = text.strip().splitlines()
    return [line for line in lines if "error" in line][:MESSAGE_LINES] or lines[-MESSAGE_LINES:]
