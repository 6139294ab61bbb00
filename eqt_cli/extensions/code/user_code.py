"""C code of the user: its files, its types, its calls."""

from __future__ import annotations

import ctypes
import math
import os
import re
import shlex
import shutil
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass, field
from functools import cached_property, lru_cache
from itertools import islice
from pathlib import Path, PurePath, PurePosixPath
from struct import iter_unpack, unpack_from
from threading import Lock
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.code_files import by_name, hashed, is_of_eqt, needed, united
from eqt_cli.base.errors import EqtWarning, InputError, Remedy, TraceError, printable, suggestion
from eqt_cli.base.files import TEXT_BYTES, text_of
from eqt_cli.base.reporting import reporter, working_for
from eqt_cli.components.laws import CodeFile
from eqt_cli.components.mechanics import LATER, NOT_IN_CODE, LawInput
from eqt_cli.components.motions import ORDER
from eqt_cli.engines import compiler
from eqt_cli.engines.compiler import Limits, temporary_folder
from eqt_cli.extensions.code import python_law
from eqt_cli.extensions.code.casadi_code import casadi_call
from eqt_cli.extensions.code.decisions import Decision, watched
from eqt_cli.extensions.code.guests import BOARD, FILLS, SKIPS, STARTS, Pool

# A user's C file with the files next to it that its preprocessor reads, as one text ---------------
#
# They are kept as one text, in which every file stands as it was written. What is compiled is what
# the preprocessor makes of that text, and of the headers of the system.


_HEAD = re.compile(r"/\* eqt: (\d+) characters of (.+) \*/\n")
_MARKER = re.compile(r'^# \d+ "((?:[^"\\\n]|\\.)*)"([ \d]*)$', re.MULTILINE)
_BEGINS, _OF_SYSTEM = "1", "3"
"""Flags of a marker: here a file begins; it is a header of the compiler or the system."""


_BRINGS = re.compile(
    r"(?:#|%:)\s*(?:embed|include_next|import)\b|\bsystem_header\b"
    r"|\b__(?:has_(?:include|embed)\w*|DATE__|TIME__|TIMESTAMP__)"
)
"""What brings bytes that a result would not keep, or hides where they come from."""


def gathered(file: Path) -> str:
    """Return the text of a C file and of all files next to it that its preprocessor reads.

    Raises
    ------
    InputError
        If one of them is not in the folder of the file, or cannot be read.
    """
    folder = Path(os.path.abspath(file)).parent  # noqa: PTH100  # as the compiler does with ".."
    preprocessed_text = _preprocessed(folder, file.name, file.name)
    texts: dict[str, str] = {}
    for name in dict.fromkeys([file.name, *_included(preprocessed_text, folder, file.name)]):
        texts[name] = text_of(folder / name, "it is included", InputError, limit=TEXT_BYTES)
        if brings := _BRINGS.search(texts[name].replace("\\\n", "")):
            raise InputError(
                f"{name}: {' '.join(brings[0].split())} is not possible; a result keeps the "
                "text of a law with what it includes by #include; write the numbers into it"
            )
        if (total := sum(map(len, texts.values()))) > TEXT_BYTES:
            raise InputError(
                f"{file.name} and what it includes: expected at most {TEXT_BYTES:,} characters, "
                f"got {total:,}"
            )
    return "".join(
        f"/* eqt: {len(text)} characters of {name} */\n{text}\n" for name, text in texts.items()
    )


def is_gathered(text: str) -> bool:
    """Return whether a text is one that `gathered` returned."""
    return _HEAD.match(text) is not None


def files_in(text: str, file: str) -> Mapping[str, str]:
    """Return the files of a text by their names, the first one first.

    Parameters
    ----------
    file
        Name of the text, for messages; and of its only file, if it is not one of `gathered`.

    Raises
    ------
    InputError
        If it is not as `gathered` writes it, or a name leads out of its folder.
    """
    if not is_gathered(text):
        return {PurePath(file).name: text}
    files, at = {}, 0
    while at < len(text):
        head = _HEAD.match(text, at)
        name = PurePosixPath(head[2]) if head else PurePosixPath("..")
        if not head or name.is_absolute() or ".." in name.parts or "\\" in head[2]:
            raise InputError(f"{file}: is not as eqt keeps C files: at character {at:,}")
        files[head[2]] = text[head.end() : head.end() + int(head[1])]
        at = head.end() + int(head[1]) + 1
    return files


_BROUGHT = re.compile(r"/usr/(include|lib\w*)/|/(gcc|clang|c\+\+|zig|Xcode.*|CommandLineTools)/")
"""Folders of headers that come with a compiler or a system, as its standard library."""


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
    by = compiler.compiler()
    begin = compiler.CPLUSPLUS if file and file.suffix in (".cpp", ".cc", ".cxx") else ""
    flags = *compiler.language_of(begin or source), *compiler.FLAGS, *by.flags, "-w", "-E"
    answer = compiler.run([*by.command, *flags, str(file or "-")], source, compiler.PREPROCESSOR)
    if answer.returncode:
        raise TraceError(
            f"the preprocessor of {shlex.join(by.command)} fails",
            lines=compiler.error_lines(answer.stderr) or [f"it ended with {answer.returncode}"],
        )
    return begin + answer.stdout


def _preprocessed(folder: Path, name: str, file: str) -> str:
    if compiler.missing():
        raise InputError(
            f"{file} is C, and this machine has no C compiler; install gcc or clang, or "
            "'pip install ziglang' (extra native), a clang in a wheel"
        )
    try:
        return preprocessed(file=folder / name)
    except TraceError as error:
        raise _not_compiled(file, error, f"{folder}{os.sep}") from error


def _not_compiled(file: str, error: TraceError, folder: str = "") -> InputError:
    """Return the error of a compiler, without the name of a temporary folder."""
    reason = "; ".join(line.strip() for line in error.lines) or str(error.args[0])
    remedy = "compile it with your own compiler to see all of it"
    if "cc1plus" in reason:  # the part of gcc that a machine without g++ lacks
        remedy = "install g++, the C++ compiler of gcc"
    message = f"{file} cannot be compiled: {printable(reason.replace(folder, ''))}"
    return InputError(message, Remedy(remedy))


def _included(text: str, folder: Path, file: str) -> Iterator[str]:
    """Yield the names of the files in a folder that were read; the system's headers are left out.

    Raises
    ------
    InputError
        If another file was read, or a name cannot be kept.
    """
    for marker in _MARKER.finditer(text):
        path, flags = re.sub(r"\\(.)", r"\1", marker[1]), marker[2].split()
        if _BEGINS not in flags or path.startswith("<"):
            continue
        name = PurePath(os.path.normpath(folder / path))
        if name.is_relative_to(folder):
            inner = name.relative_to(folder).as_posix()
            if not inner.isprintable() or "*/" in inner:
                raise InputError(f"{file} includes {printable(inner)}: rename this file")
            yield inner
        elif _OF_SYSTEM not in flags:
            raise InputError(
                f"{file} includes {printable(path)}, which is not in its folder; a result keeps "
                "only files in this folder and below; copy the file there"
            )


# Python's calls of a user's own C function, and what the function keeps from call to call ---------
#
# The user's text is compiled as it is; eqt adds only names that were found in it, and numbers.


UNTYPED, OBJECT, COMMON, THREADS = 0, 1, 5, 6
"""Types of an ELF symbol that are variables; one of an assembler has none."""

IN_COMMON, RESERVED, WRITE = 0xFFF2, 0xFF00, 1
"""Numbers of sections with a special meaning, and the flag of a writable section."""

SYMBOLS = 2
"""Type of the ELF section that lists all symbols."""

SECONDS = 60.0
"""Time limit of `nm`, s."""


WITHOUT_STATE = set("memcmp memcpy memmove memset sincos sincosf _GLOBAL_OFFSET_TABLE_".split())
"""Names that compilers call by themselves, in addition to `OF_COMPILERS`."""

OF_COMPILERS = ("__", "_ZSt", "_ZNSt", "_ZNKSt", "_Zn", "_Zd", "_Unwind_")
"""What the names begin with that compilers call, and those of the standard library of C++."""


ERRNO = {"__errno_location", "__error", "_errno"}
"""What returns the address of errno."""


def static_state(binary: bytes) -> tuple[list[str], list[str]] | None:
    """Return the variables of an object file that can be written, and the functions it calls.

    Functions that keep no state are left out: those of math.h, and those of compilers. An ELF file
    is read here; of another one, the program `nm` tells, if there is one. None if neither can be
    done.
    """
    if binary.startswith(b"\x7fELF\x02\x01"):  # 64 bits, the least byte first
        symbols: list[tuple[str, bool]] | None = list(_of_elf(binary))
    else:
        symbols = _of_nm(binary)
    if symbols is None:
        return None
    variables = {_plain(name) for name, is_variable in symbols if is_variable} - {"eqt_row"}
    functions = {_plain(name) for name, is_variable in symbols if not is_variable}
    without_state = {
        name
        for name in functions - ERRNO
        if name.startswith(OF_COMPILERS) or name in WITHOUT_STATE or name in _mathematical()
    }
    return sorted(variables), sorted(functions - without_state)


@lru_cache(maxsize=1)
def _mathematical() -> set[str]:
    return set(re.findall(r"(\w+) *\(", preprocessed("#include <math.h>\n")))


def _of_elf(binary: bytes) -> Iterator[tuple[str, bool]]:
    """Yield names: of variables (True), and those that the file does not define (False)."""
    (table,) = unpack_from("<Q", binary, 40)
    size, count, _ = unpack_from("<3H", binary, 58)
    # name, type, flags, address, offset, size, link, info, alignment, size of an entry
    sections = [unpack_from("<2I4Q2I2Q", binary, table + k * size) for k in range(count)]
    at = sections[unpack_from("<H", binary, 62)[0]][4]
    names = [_text(binary, at + section[0]) for section in sections]
    for section in (header for header in sections if header[1] == SYMBOLS):
        offset, length, text = section[4], section[5], sections[section[6]][4]
        for name, info, _, where, _, _ in iter_unpack("<I2BH2Q", binary[offset : offset + length]):
            if info & 15 not in (UNTYPED, OBJECT, COMMON, THREADS) or not name:
                continue
            if where == 0:
                yield _text(binary, text + name), False
            elif where == IN_COMMON or (
                0 < where < RESERVED
                and sections[where][2] & WRITE
                and not names[where].startswith(".data.rel.ro")
            ):
                yield _text(binary, text + name), True


def _text(binary: bytes, at: int) -> str:
    return binary[at : binary.index(b"\0", at)].decode(errors="replace")


def _of_nm(binary: bytes) -> list[tuple[str, bool]] | None:
    nm = shutil.which("nm") or shutil.which("llvm-nm")
    if nm is None:
        return None
    with temporary_folder() as folder:
        path = folder / "law.o"
        path.write_bytes(binary)
        answer = compiler.run_contained([nm, str(path)], b"", Limits(SECONDS))
    if answer.returncode:
        return None
    listing = answer.stdout.decode("utf-8", "replace")
    symbols = re.findall(r"^[0-9a-fA-F]* *([bBdDCU]) (\S+)$", listing, re.MULTILINE)
    return [(name.removeprefix("_"), kind != "U") for kind, name in symbols]


def _plain(name: str) -> str:
    """Return a name as it is in C: gcc writes ``count.0``, and clang ``law.count``."""
    parts = [part for part in name.split(".") if part and not part.isdigit()]
    return parts[-1] if parts else name


# What a user's code may not call, as its assembly language says ---------------------------------

_REFUSED = re.compile(
    r"""(?mx) ^ (?! \s* \. (?: string | ascii | asciz | file | ident ) \b )
    (?: \s* (\.incbin | \.include) \b | .*? [^\w.$"] _? (?: _sysv_ | bsd_ )? (
    v?ldmxcsr | fldcw | fldenv | fpcr
    | fesetround | fesetenv | fesetmode | feupdateenv | feholdexcept | fe(?:en|dis)ableexcept
    | f?chdir | chroot | umask | signal | sigaction | sigprocmask | pthread_sigmask
    | raise | kill | alarm | setitimer | setrlimit | setlocale | uselocale | (?:un)?setenv | putenv
    | clearenv | exit | _exit | _Exit | quick_exit | abort | atexit | fork | vfork | exec[lv]p?e?
    | system | popen | dlopen | dup2 | close | longjmp | siglongjmp | pthread_create
    | (?:f|fre)?open (?:at)? (?:64)? | creat (?:64)? | f?truncate (?:64)? | unlink (?:at)? | remove
    | rename (?:at2?)? | (?:mk|rm)dir (?:at)? | (?:sym)?link (?:at)? | f?ch(?:mod|own) (?:at)?
    | socket | connect | sendto ) \b )"""
)
"""Assembly that changes the process or files, and so the bits of other laws, or ends it.

The process in which code is called may not do most of it, but a law that tries to is told so early,
and not each system can take these rights away.
"""


SHIM = Path(__file__).parent / "user_code.h"

REALS = {"double": 8, "float": 4}
"""The types of numbers, and their sizes in bytes."""

_COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*|\"(?:\\.|[^\"\\\n])*\"", re.DOTALL)


CAN_FAIL = "if (call) for (eqt_k = 0; eqt_k < EQT_CODE_AXES; eqt_k++) torque[eqt_k] = EQT_NAN"
"""Text of a call that may fail; then the torque is not finite."""


@dataclass(frozen=True)
class UserCode(CodeFile):
    """A user's text in C and the names that it has to define.

    Attributes
    ----------
    text
        The text, with the files beside it that it includes, as `c_files.gathered` writes them.
    entries, axes
        The number of entries of a pose, and of a velocity.
    returns
        The number of entries that it returns.
    space
        The number of coordinates of a position; 0 on groups other than SE2 and SE3.
    steps
        The number of later times of the reference that it is given.
    adapted
        The inputs with their shapes, as an adapter names them; empty without one.
    casadi
        Whether X is a function that CasADi generated (its signature is not X_torque's).
    """

    text: str = field(repr=False)
    entries: int
    axes: int
    returns: int
    space: int = 0
    steps: int = 0
    adapted: tuple[tuple[str, tuple[int, ...]], ...] = ()
    casadi: bool = False

    @cached_property
    def inputs(self) -> dict[str, int]:
        """The fields of ``X_input`` with their lengths, in the order of `LawInput`.

        A text with a field ``position`` names all of its fields; any other one has those of a law
        that reads none. Of a preview it has those that it names.
        """
        if self.adapted:
            return {name: math.prod(shape) for name, shape in self.adapted}
        n, length_of = self.space, self._lengths
        members = self.fields(f"{self.prefix}_input") or ()
        read = members if n and "position" in members else LawInput._fields[:6]
        later = [name for name in LATER if name in members and length_of[name]]
        fields = {*read, *later} - {"flux"}  # which only laws of eqt read
        return {name: length for name, length in length_of.items() if name in fields}

    @property
    def _lengths(self) -> dict[str, int]:
        """The length of each signal, 0 where there is none."""
        q, m, n = self.entries, self.axes, self.space
        p, k = (ORDER + 1) * n, self.steps
        lengths = (1, q, m, q, m, m, p, 3, 3, q * k, m * k, m * k, p * k)
        return dict(zip(LawInput._fields[: -len(NOT_IN_CODE)], lengths, strict=True))

    @cached_property
    def preprocessed(self) -> str:
        """What the preprocessor makes of the text, with markers of the lines.

        Raises
        ------
        InputError
            If it fails, or reads a file that is not in the text.
        """
        texts = files_in(self.text, self.file)
        with temporary_folder() as folder:
            for name, content in texts.items():
                path = folder / name
                path.parent.mkdir(parents=True, exist_ok=True)
                path.write_text(content, encoding="utf-8")
            text = _preprocessed(folder, next(iter(texts)), self.file)
            if missing := {*_included(text, folder, self.file)} - {*texts}:
                raise InputError(f"{self.file} includes {min(missing)}, which eqt has not kept")
        text = text.replace(f'"{folder}{os.sep}', '"')
        if not self.casadi:
            return text
        numbers, inputs = dict(self.numbers), self.adapted
        return text + casadi_call(text, self.file, self.prefix, inputs, numbers, self.returns)

    @property
    def headers(self) -> list[str]:
        """Headers of the system that no compiler brings, such as those of a library in C++."""
        files = dict.fromkeys(marker[1] for marker in _MARKER.finditer(self.preprocessed))
        return [x for x in files if Path(x).is_absolute() and not _BROUGHT.search(x)]

    @cached_property
    def _plain(self) -> str:
        """The compiled text, without strings."""
        return _COMMENT.sub(" ", self.preprocessed)

    def defines(self, function: str) -> bool:
        """Return whether the text has the body of a function."""
        return re.search(rf"\b{function}\s*\([^;{{}}]*\)\s*\{{", self._plain) is not None

    def fields(self, name: str) -> list[str] | None:
        """Return the fields of ``typedef struct {…} name``; None if it is written otherwise."""
        body = re.search(rf"\bstruct\s*\w*\s*\{{([^{{}}]*)\}}\s*{name}\s*;", self._plain)
        if body is None:
            return None
        return re.findall(r"([A-Za-z_]\w*)\s*(?:\[[^\]]*\]\s*)*(?=[,;])", body[1])

    @property
    def starts(self) -> bool:
        """Whether the text has a function that sets the memory at the start of a run."""
        return self.defines(f"{self.prefix}_start")

    @cached_property
    def fails(self) -> bool:
        """Whether it can say that it failed: in Python always, in C as an int that is not 0."""
        return self.is_python or bool(re.search(rf"\bint\s+{self.function}\s*\(", self._plain))

    def check(self) -> None:
        """Raise an `InputError` where a name is not in the text."""
        if not self.defines(self.function):
            others = re.findall(r"\b(\w+_torque)\s*\([^;{}]*\)\s*\{", self._plain)
            names = ", ".join(dict.fromkeys(others))
            there = f"it defines {names}" if names else "it defines no function X_torque"
            raise InputError(
                f"{self.file} does not define the function {self.function}; {there}; name the "
                "function with the key `function`"
            )
        needed = {"numbers": dict(self.numbers), "memory": self.memory, "input": self.inputs}
        for key, fields in needed.items():
            members = self.fields(struct := f"{self.prefix}_{key}")
            if members is None:
                continue
            for name in (named for named in fields if named not in members):
                hint = suggestion(name, members) or f"; it has {', '.join(members) or 'none'}"
                raise InputError(f"{key}: {struct} in {self.file} has no field {name}{hint}")
            for name in (x for x in members if key == "input" and x not in fields):
                raise InputError(f"input: {struct} in {self.file} has a field {self._stray(name)}")

    def _stray(self, name: str) -> str:
        """Return a field of the input that eqt cannot fill, and what it can."""
        if self.adapted:
            there = ", ".join(self.inputs)
            return f"{name}, which the adapter does not name{suggestion(name, there.split(', '))}"
        if name in LATER:
            return f"{name}, which needs the key `preview`"
        signals = [*LawInput._fields[:6], *(["position", "heading"] if self.space else [])]
        hint = suggestion(name, signals) or f"; signals are {', '.join(signals)}"
        return f"{name}, which is no signal and would be 0 in every call{hint}"

    @property
    def source(self) -> str:
        """The source to compile: the preprocessed text, and eqt's calls of it."""
        # Another pattern is another source, whose library is not in the cache.
        return f"{self.preprocessed}\n/* {compiler.digest(_REFUSED.pattern)} */\n{self._calls}"

    def refuse(self, assembly: str) -> None:
        """Raise an `InputError` for assembly language that changes the process."""
        defined = set(re.findall(r"(?m)^(?:\s+\.l?comm\s+)?_?(\w+)(?:[:,])", assembly))
        for directive, name in _REFUSED.findall(assembly):
            if (name or directive) not in defined:
                raise InputError(
                    f"{self.file} uses {directive or name}, which would change eqt's process for "
                    "all laws or reads a file that a result does not keep; leave it out of the law"
                )

    @property
    def _calls(self) -> str:
        X, numbers, memory = self.prefix, [name for name, _ in self.numbers], self.memory
        has_defaults = re.search(rf"\b{X}_defaults\s*=", self._plain)

        def sizes(kind: str, fields: Iterable[str]) -> str:
            return "".join(f"(long)sizeof(((EQT_{kind}_TYPE *)0)->{name}), " for name in fields)

        definitions = {
            "EQT_NUMBER_TYPE": f"{X}_numbers",
            "EQT_MEMORY_TYPE": f"{X}_memory",
            "EQT_INPUT_TYPE": f"{X}_input",
            "EQT_TORQUE": self.function,
            "EQT_RETURN": "int" if self.fails else "void",
            "EQT_FAILED(call)": CAN_FAIL if self.fails else "call",
            "EQT_CODE_REAL": self.real,
            "EQT_CODE_AXES": str(self.returns),
            "EQT_INPUTS": str(sum(self.inputs.values())),
            "EQT_DEFAULT_NUMBERS": f"{X}_defaults" if has_defaults else "{0}",
            "EQT_SET_INPUT": "".join(f"EQT_IN(input.{name}, inputs); " for name in self.inputs),
            "EQT_LIST_INPUT": sizes("INPUT", self.inputs),
            "EQT_SET_NUMBERS": "".join(f"EQT_IN(numbers.{name}, options); " for name in numbers),
            "EQT_READ_MEMORY": "".join(f"EQT_IN(memory.{name}, before); " for name in memory),
            "EQT_WRITE_MEMORY": "".join(f"EQT_OUT(states, memory.{name}); " for name in memory),
            "EQT_LIST_NUMBERS": sizes("NUMBER", numbers),
            "EQT_LIST_MEMORY": sizes("MEMORY", memory),
        }
        if self.starts:
            definitions["EQT_CODE_START"] = f"{X}_start"
        if "period" not in numbers and "period" in (self.fields(f"{X}_numbers") or ()):
            definitions["EQT_SET_PERIOD"] = "1"
        defined = "".join(f"#define {name} {text}\n" for name, text in definitions.items())
        return f"{defined}\n{SHIM.read_text(encoding='utf-8')}"

    @cached_property
    def decisions(self) -> tuple[str, tuple[Decision, ...]]:
        """The source that also keeps the outcomes of its decisions, and these.

        Raises
        ------
        TraceError
            If the preprocessor fails.
        """
        marked = f'{self.preprocessed}\n#line 1 "eqt"\n#define EQT_DECISIONS eqt_decisions\n'
        files = set(files_in(self.text, self.file))
        text, decisions = watched(preprocessed(marked + self._calls), files)
        return f"enum {{ eqt_decisions = {len(decisions)} }};\n{text}", decisions


@dataclass(frozen=True)
class CodeFunction:
    """A user's function, which is called in processes of its own.

    Attributes
    ----------
    code
        Its source.
    lengths
        The length of each part of the memory, by name.
    pool
        Its processes; None to share those of equal code in C.
    fills
        Whether fields of the memory that are not named differ from 0 before a call.
    is_watched
        Whether a call keeps the outcomes of the decisions, too.
    """

    code: UserCode
    lengths: dict[str, int] = field(compare=False)
    pool: Pool | None = field(default=None, repr=False, compare=False)
    fills: bool = False
    is_watched: bool = False

    def in_words(self, row: Array) -> str:
        """Return an input in words, with numbers that can be copied."""
        words, numbers = [], iter(row)
        for name, length in self.code.inputs.items():
            listed = ", ".join(f"{x:.9g}" for x in islice(numbers, length))
            words.append(f"{name} = {listed}" if length == 1 else f"{name} = {{{listed}}}")
        return ", ".join(words)

    @cached_property
    def sources(self) -> dict[str, str]:
        """Hashes of the files beside its text that decide what it computes, by their names."""
        if not self.code.is_python:
            return read_files(self.code.headers, ())
        files = self.processes.guests[0].files
        loaded, read = files["loaded"], files["read"]
        modules = needed("", self.code.text, loaded, loaded)
        return united([modules, read_files(read, loaded.values())])

    @property
    def processes(self) -> Pool:
        """The processes in which it is called."""
        if self.pool is not None:
            return self.pool
        with _starting:
            return _processes(self.code, self.is_watched)

    @cached_property
    def watching(self) -> CodeFunction | None:
        """The function that also keeps its outcomes; None if it cannot be compiled like that."""
        with suppress(TraceError):
            compiler.library(self.code.decisions[0])
            return CodeFunction(self.code, self.lengths, is_watched=True)
        return None

    def outcomes(
        self, numbers: Array, period: float, memory: Array, inputs: Array
    ) -> tuple[Array, Array, Array]:
        """Return the torques of runs, the outcomes of the decisions, and how far these are away.

        Returns
        -------
        torques
            As of `call`.
        outcomes : (runs, decisions)
            1: it was true; 2: it was false; 3: both; 0: it was not reached.
        apart : (runs, decisions)
            Left − right of a comparison, where that was nearest to 0.
        """
        shape = len(inputs), len(self.code.decisions[1])
        results = np.zeros(shape, dtype=np.uint8), np.zeros(shape)
        if self.code.starts:
            self.call(STARTS, numbers, period, np.zeros_like(memory), inputs, *results)
        torques, _ = self.call(0, numbers, period, memory, inputs, *results)
        return torques, *results

    @cached_property
    def static_state(self) -> tuple[list[str], list[str]] | None:
        """Its variables that a call can leave changed, and the functions that may keep a state.

        None where they cannot be read.
        """
        return static_state(compiler.object_file(self.code.source))

    def call(
        self, begins: int, numbers: Array, period: float, memory: Array, inputs: Array, *more: Array
    ) -> tuple[Array, Array]:
        """Return the torques of runs, and their memory afterwards, ``(runs, …)`` each.

        Parameters
        ----------
        begins
            1: at the start of runs, where the memory is 0; 0: a period later.
        more
            Arrays for the outcomes of decisions.

        Raises
        ------
        InputError
            If a call crashes, or does not return; with its input.
        """
        later, torques = np.array(memory, dtype=float), np.empty((len(inputs), self.code.returns))
        lost = self._answer(begins, period, [numbers, later, inputs, torques, *more])
        for row, words in lost.items():
            if begins and not self.code.is_python:
                words = words.replace(self.code.function, f"{self.code.prefix}_start", 1)
            raise InputError(f"{words or GONE} at {self.in_words(inputs[row])}; {CALL_IT}")
        return torques, later

    def time_of(self, numbers: Array, period: float, memory: Array, inputs: Array) -> float:
        """Return the CPU time of calls of C in its process, s; raises as `call` does."""
        most, spent = self._most(numbers, memory, inputs), 0.0
        for start in range(0, len(inputs), most):
            some = slice(start, start + most)
            self.call(0, numbers[some], period, memory[some], inputs[some])
            spent += self.processes.spent
        return spent

    def call_in_runs(
        self, begins: int, numbers: Array, period: float, memory: Array, inputs: Array
    ) -> tuple[Array, Array, Array]:
        """Return the same, and which calls were lost, ``(runs,)``: their torque is NaN.

        What became of them is noted in the processes. A run that has ended, whose inputs are not
        finite, is not called. At the start of a run, its memory is NaN if the call was lost.
        """
        later, torques = np.array(memory, dtype=float), np.empty((len(inputs), self.code.returns))
        lost = self._answer(begins | SKIPS, period, [numbers, later, inputs, torques])
        self._tell(lost, inputs)
        self.processes.note({} if begins else lost)
        is_lost = np.zeros(len(torques), dtype=bool)
        is_lost[[*lost]] = True
        if begins:
            later[is_lost] = np.nan
        return torques, later, is_lost

    def _answer(self, begins: int, period: float, arrays: Sequence[Array]) -> dict[int, str]:
        """Call it for rows, whose arrays behind the numbers are those of ``eqt_code``.

        Memory and torques are written, but of calls that were lost. What became of these is
        returned, by their rows.
        """
        most = self._most(*arrays)
        lost = dict[int, str]()
        for start in range(0, len(arrays[0]), most):
            some = [array[start : start + most] for array in arrays]
            there = self.processes.call_c(begins | FILLS * self.fills, period, some)
            lost |= {start + row: words for row, words in there.items()}
        return lost

    def _tell(self, lost: Mapping[int, str], inputs: Array) -> None:
        """Say once at which input a call was lost in a run."""
        for row, words in lost.items():
            if words and self.processes.is_first_loss():
                at = self.in_words(inputs[row])
                remark = f"{words} at {at}: its run ends there, and the others go on"
                reporter().remark(EqtWarning(remark, Remedy(CALL_IT)))

    def _most(self, *arrays: Array) -> int:
        """Return the most rows for which there is room; those of torques are counted, too."""
        width = sum(array.shape[1] for array in arrays) + self.code.returns
        return (BOARD // 8 - python_law.FIRST) // width

    @cached_property
    def eqt_code(self) -> Any:
        """A function as of user_code.h, which C can call in place of the user's."""
        kind = ctypes.CFUNCTYPE(
            None, ctypes.c_long, ctypes.c_int, ctypes.c_double, *6 * [ctypes.c_void_p]
        )
        numbers, inputs = (sum(n for _, n in self.code.numbers), sum(self.code.inputs.values()))
        widths = numbers, sum(self.lengths.values()), inputs, self.code.returns

        def call(runs: int, begins: int, period: float, *addresses: int) -> None:
            arrays = [*map(_rows_at, addresses, [runs] * 4, widths)]
            try:
                lost = self._answer(begins | SKIPS, period, arrays)
                self.processes.note(lost)
            except BaseException:  # the engine calls again where errors can be raised
                arrays[3][...] = np.nan

        return kind(call)


GONE = "the object of a run has ended with the call of another one"
CALL_IT = "call it with this input in a debugger"


@lru_cache(maxsize=64)
def _rows_at(address: int | None, rows: int, width: int) -> Array:
    """Return the rows at an address as an array."""
    if not address or not width:
        return np.empty((rows, 0))
    return np.ctypeslib.as_array(
        ctypes.cast(address, ctypes.POINTER(ctypes.c_double)), (rows, width)
    )


_starting = Lock()
"""Held while processes are started, so that equal code has the same ones."""


@lru_cache(maxsize=16)
def _processes(code: UserCode, is_watched: bool) -> Pool:
    """Return the processes of code in C; those of the last ones are kept."""
    if is_watched:
        content = compiler.content(code.decisions[0])
        more = [-(-len(code.decisions[1]) // 8), len(code.decisions[1])]
    else:
        content, more = compiler.content(code.source, code.refuse), [0, 0]
    lengths = compiled(code).lengths
    widths = sum(n for _, n in code.numbers), sum(lengths.values()), sum(code.inputs.values())
    law = {"function": code.function, "file": code.file, "widths": [*widths, code.returns, *more]}
    return Pool(law, Limits(LIFE, file=0), content)


LIFE = 36_000
"""Most time of the processor that a process takes with all calls, s."""


@lru_cache(maxsize=64)
def compiled(code: UserCode) -> CodeFunction:
    """Compile a user's function; the last ones are kept.

    Raises
    ------
    InputError
        If its names, types or sizes are not the expected ones, or it cannot be compiled.
    """
    code.check()
    lines = code.source.count("\n")
    try:
        with working_for(f"{code.file}: {lines:,} lines with its headers"):
            library = compiler.library(code.source, code.refuse)
    except TraceError as error:
        raise _not_compiled(code.file, error) from error
    count = 3 + len(code.inputs) + len(code.numbers) + len(code.memory)
    sizes = list((ctypes.c_long * count).in_dll(library, "eqt_code_sizes"))
    return CodeFunction(code, _checked(code, sizes))


def _checked(code: UserCode, sizes: Sequence[int]) -> dict[str, int]:
    """Check all sizes, and return the length of each part of the memory."""
    X, size = code.prefix, REALS[code.real]
    whole_input, *parts = sizes[: len(code.inputs) + 1]
    sizes = sizes[len(code.inputs) + 1 :]
    one = parts[0] // next(iter(code.inputs.values()))
    if one != size:
        other = next((name for name, length in REALS.items() if length == one), f"{one} bytes")
        raise InputError(
            f"real: the numbers of {X}_input in {code.file} are {other}, not {code.real}; set "
            f"`real: {other}`"
        )
    for (name, length), count in zip(code.inputs.items(), parts, strict=True):
        if count != length * size:
            raise InputError(
                f"{X}_input in {code.file} has {count // size} numbers in {name}; expected {length}"
            )
    if whole_input != sum(parts):
        raise InputError(
            f"{X}_input in {code.file} has {whole_input // size} numbers, and {sum(parts) // size} "
            f"are those of {', '.join(code.inputs)}; any others would be 0 in every call"
        )
    if not sizes[0]:
        raise InputError(
            f"{code.function} in {code.file} has other arguments; expected void {code.function}"
            f"(const {X}_numbers *, {X}_memory *, const {X}_input *, {code.real} *)"
        )
    whole, rest = sizes[1], sizes[2:]
    for (name, length), count in zip(code.numbers, rest, strict=False):
        if count != length * size:
            raise InputError(
                f"numbers.{name}: {X}_numbers in {code.file} has {count // size} of it, got "
                f"{length}"
            )
    counts = [count // size for count in rest[len(code.numbers) :]]
    lengths = dict(zip(code.memory, counts, strict=True))
    total = sum(lengths.values())
    if whole != total * size and (lengths or whole > size):
        named = ", ".join(f"{name} ({length})" for name, length in lengths.items()) or "none"
        raise InputError(
            f"memory: {X}_memory in {code.file} has {whole // size} numbers, and the fields that "
            f"are named have {total}: {named}; name all of its fields"
        )
    return lengths


# The first calls, and those of a law in Python ----------------------------------------------------


def try_out(function: CodeFunction, numbers: Array, period: float, inputs: Array) -> None:
    """Call a function at some inputs, one after the other.

    Raises
    ------
    InputError
        If it crashes, or does not end; it names the function and the input.
    """
    answers, values = list[Any](), np.broadcast_to(numbers, (1, len(numbers)))
    for row in [*inputs, *inputs[::-1]]:
        memory = np.zeros((1, sum(function.lengths.values())))
        _, memory = function.call(STARTS, values, period, memory, row[None])
        answers.append(np.concatenate(function.call(0, values, period, memory, row[None]), axis=1))
    outputs = np.concatenate([answer[:, : function.code.returns] for answer in answers])
    lacks = np.flatnonzero(np.isnan(outputs).all(axis=0))
    if len(lacks) == function.code.returns and not function.code.fails:
        raise InputError(
            f"{function.processes.name} gives no number at any state that was tried; write "
            f"{function.code.returns} of them, and give what it divides by as `numbers`"
        )
    if 0 < len(lacks) < function.code.returns:
        raise InputError(
            f"{function.processes.name} writes {function.code.returns - len(lacks)} of "
            f"{function.code.returns} numbers: its output {lacks[0]} is none at any state that was "
            "tried; write them all, or name those that it returns by `adapter: {output: {order}}`"
        )
    if words := python_law.hidden_state(answers[: len(inputs)], answers[len(inputs) :][::-1]):
        raise InputError(f"{function.processes.name}: {words.partition(', or write')[0]}")


class PythonFunction(CodeFunction):
    """A function in Python of the user's, which counts no lines."""

    watching, static_state = None, ([], [])

    def _answer(self, begins: int, period: float, arrays: Sequence[Array]) -> dict[int, str]:
        numbers, memory, inputs, torques = arrays
        rows, pool = np.hstack([numbers, memory, inputs]), self.processes
        how = {"starts": bool(begins & STARTS), "period": period, "keeps": len(rows)}
        are_called = np.ones(len(rows), dtype=bool)
        if begins & SKIPS:
            are_called = np.isfinite(rows).all(axis=1)
            torques[~are_called] = np.nan
        answers, lost = pool.call_python(rows, memory, np.flatnonzero(are_called), how)
        for place, answer in answers.items():
            torques[place], memory[place] = np.split(np.array(answer), [self.code.returns])
        torques[[*lost]] = np.nan
        return lost


_tried: set[object] = set()
"""Code in C that was already tried out successfully, whatever its numbers."""


def called(
    code: UserCode, numbers: Array, period: float, rows: Array, how: Mapping[str, Any]
) -> CodeFunction:
    """Return the function of code after its first calls in a separate process.

    Parameters
    ----------
    how
        Of Python, `call` and `torque`, expressions; `per_run`, whether each run has an object; and
            `repeats`, whether equal calls must have equal answers.

    Raises
    ------
    InputError
        If it cannot be called: with the place, or the functions that there are.
    """
    if not code.is_python:
        function = compiled(code)
        if code not in _tried:
            try_out(function, numbers, period, rows)
            _tried.add(code)
        function.processes.forget()
        return function
    there = re.findall(r"(?m)^(?:def|class) +(\w+)", code.text)
    if re.split(r"\W", code.function)[0] not in re.findall(r"\w+", code.text):
        raise InputError(
            f"{code.file} is Python: name its function or method, as {code.file}:FUNCTION or "
            f"{code.file}:CLASS(…).METHOD; it defines {', '.join(there) or 'none'}"
        )
    first = {"values": numbers.tolist(), "trial": rows.tolist(), "rows": [], "period": period}
    law = {**asdict(code), **how, **first}
    law["function"] = re.sub(rf"^({'|'.join(there)})\.(\w+)$", r"\1().\2", code.function)
    law["numbers"] = [(name, [length] if length > 1 else []) for name, length in code.numbers]
    # Each object may reserve much more memory than it uses: 37 MB that of CasADi with IPOPT.
    memory = 3 * 2 ** (32 if how["per_run"] else 29)
    pool = Pool(law, Limits(LIFE, memory, file=0))
    lengths = {name: math.prod(shape) for name, shape in pool.memory.items()}
    return PythonFunction(code, lengths, pool)


@purposes.function_in_python
def function_in_python(
    file: str,
    function: str,
    text: str,
    arguments: Mapping[str, Array],
    *,
    call: str,
    result: str,
    returns: int,
    period: float,
) -> CodeFunction:
    """Return a function of a text in Python after its first call, without numbers and memory.

    Parameters
    ----------
    file, function
        Names, for messages.
    arguments
        What the call may name, of the first call: rows with their shapes.
    call, result
        Expressions in Python: of the arguments, and of what the call returns, as `result`.
    returns
        Number of numbers in the result.
    period
        Seconds between two calls.
    """
    code = UserCode(
        file=file,
        prefix=function,
        numbers=(),
        memory=(),
        real="double",
        text=text,
        entries=0,
        axes=returns,
        returns=returns,
        adapted=tuple((name, value.shape[1:]) for name, value in arguments.items()),
    )
    rows = np.hstack([value.reshape(len(value), -1) for value in arguments.values()])
    how = {"call": call, "torque": result, "per_run": False, "repeats": False}
    return called(code, np.empty(0), period, rows, how)


def read_files(paths: Iterable[str], modules: Iterable[str]) -> dict[str, str]:
    """Return the hashes of the files that another process has read, by name.

    Parameters
    ----------
    modules
        Files of the modules that were loaded there, which are left out.
    """
    contents, of_modules = dict[str, str](), {*modules}
    for path in paths:
        other = path.endswith(".pyc") or path in of_modules or is_of_eqt(path)
        if not other and Path(path).is_file():
            with suppress(OSError):
                contents[path] = hashed(Path(path).read_bytes())
    return by_name(contents)
