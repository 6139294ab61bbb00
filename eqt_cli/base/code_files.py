"""The files that decide what code of somebody else computes: modules, and data that it opens.

The standard library, eqt, and the distributions that eqt requires are left out: a result records
their versions.
"""

from __future__ import annotations

import os
import re
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from functools import lru_cache, partial
from hashlib import sha256
from pathlib import Path
from typing import Any

DIGITS = 16
"""Length of the hash of a file, in hexadecimal digits."""

_LINE = re.compile(
    r"(?m)^([ \t]*)(?:(?:async[ \t]+)?(def)\b|from[ \t]+([.\w]+)[ \t]+import[ \t]*"
    r"(\([^)]*\)|[^\n;#]*)|import[ \t]+([^\n;#]+)|[^\s#)\]}])"
)
"""What says which modules a module imports when it is executed, and where functions begin."""

_OF_SYSTEM = ("/proc/", "/sys/", "/dev/", "/etc/", "/usr/share/")
"""Folders whose files say nothing of a law."""

_hashes: dict[str, str] = {}
"""Hashes of the files of modules, as they were when they were first looked at."""

_opened: dict[str, str] | None = None
"""Receives the files that are opened now, by path."""


def hashed(content: bytes) -> str:
    """Return the hash by which a file is known."""
    return sha256(content).hexdigest()[:DIGITS]


def modules_of(
    name: str,
    text: str | None = None,
    loaded: Mapping[str, str] | None = None,
    *,
    in_functions: bool = False,
) -> dict[str, str]:
    """Return the hashes of the files of a module, and of those that it imports, by their names.

    Parameters
    ----------
    text
        Its text, if it has no file of its own.
    loaded
        Files of modules by name, where another process has loaded them.
    in_functions
        Whether imports within functions count, too, but for what is installed.
    """
    imports = partial(_imports, in_functions=in_functions)
    there, waiting = dict[str, str](), [name] if text is None else [*imports(text, "")]
    while waiting:
        name = waiting.pop()
        imported = getattr(sys.modules.get(name), "__file__", None)
        file = imported if loaded is None else loaded.get(name)
        if name in there or not file or is_of_eqt(file):
            continue
        if in_functions and file.startswith(_installed()):
            continue
        content = b""
        with suppress(OSError):
            content = Path(file).read_bytes()
        there[name] = _hashes.setdefault(file, hashed(content))
        waiting.append(name.rpartition(".")[0])
        if file.endswith(".py"):
            is_package = Path(file).stem == "__init__"
            package = name if is_package else name.rpartition(".")[0]
            waiting += imports(content.decode("utf-8", "replace"), package)
    return there


def _imports(text: str, package: str, *, in_functions: bool = False) -> Iterator[str]:
    """Yield the names that the text of a module imports, within functions only where asked for."""
    function: int | None = None
    for line in _LINE.finditer(text):
        indent, begins, source, names, modules = line.groups()
        if function is not None and len(indent) > function:
            continue
        function = len(indent) if begins and not in_functions else None
        if modules:
            yield from (entry.split()[0] for entry in modules.split(",") if entry.strip())
        elif source:
            dots = len(source) - len(source.lstrip("."))
            above = package.split(".")[: len(package.split(".")) - dots + 1] if dots else []
            base = ".".join([*above, *filter(None, [source.lstrip(".")])])
            yield base
            yield from (f"{base}.{name}" for name in re.findall(r"\w+", names))


def is_of_eqt(file: str) -> bool:
    """Whether a file is of the standard library, of eqt, or of a distribution that eqt requires."""
    paths = _folders()
    for folder in (paths["purelib"], paths["platlib"]):
        if file.startswith(folder + os.sep):
            top = file[len(folder) + 1 :].partition(os.sep)[0]
            return top.partition(".")[0] in _required()
    of_eqt = str(Path(__file__).parents[1])
    folders = (paths["stdlib"], paths["platstdlib"], of_eqt)
    return file.startswith((*(folder + os.sep for folder in folders), *_OF_SYSTEM))


@lru_cache(maxsize=1)
def _folders() -> dict[str, str]:
    import sysconfig  # slow to import

    return sysconfig.get_paths()


def _installed() -> tuple[str, ...]:
    return tuple(_folders()[name] + os.sep for name in ("purelib", "platlib"))


@lru_cache(maxsize=1)
def _required() -> frozenset[str]:
    """Return the names of the modules of all distributions that eqt requires."""
    from importlib import metadata  # slow to import

    names, waiting, seen = {"eqt_cli"}, ["eqt-cli"], set[str]()
    while waiting:
        name = waiting.pop()
        if name in seen:
            continue
        seen.add(name)
        with suppress(metadata.PackageNotFoundError):
            of = metadata.distribution(name)
            names |= {file.parts[0].partition(".")[0] for file in of.files or ()}
            lines = (line for line in of.requires or () if "extra ==" not in line)
            waiting += (re.split(r"[^\w.-]", line)[0] for line in lines)
    return frozenset(names)


@contextmanager
def noted(
    name: str, is_foreign: Callable[[str], bool], text: str | None = None
) -> Iterator[dict[str, str]]:
    """Receive the hashes of all files that a module needs which is imported in the block."""
    files, before = dict[str, str](), set(sys.modules)
    _listen(is_foreign)
    with opened_files() as opened:
        yield files
    loaded = {
        new: str(getattr(module, "__file__", "") or "") for new, module in [*sys.modules.items()]
    }
    files |= needed(name, text, loaded, set(loaded) - before - {name}) | opened


def needed(
    name: str, text: str | None, loaded: Mapping[str, str], new: Iterable[str]
) -> dict[str, str]:
    """Return the hashes of the files of a module, and of all that its import has loaded, by name.

    Parameters
    ----------
    loaded, new
        Files of modules, and which of these the import has loaded.
    """
    # What a package installed beside loads by itself is its own affair, which may change.
    elsewhere = [x for x in new if loaded[x] and not loaded[x].startswith(_installed())]
    return united(
        [modules_of(name, text, loaded), *(modules_of(x, None, loaded) for x in elsewhere)]
    )


@contextmanager
def opened_files() -> Iterator[dict[str, str]]:
    """Receive the hashes of the files that code of somebody else opens in the block, by name."""
    global _opened
    earlier, here = _opened, dict[str, str]()
    _opened = here
    names = dict[str, str]()
    try:
        yield names
    finally:
        _opened = earlier
        modules = [*sys.modules.values()] if here else []
        of_modules = {getattr(module, "__file__", None) for module in modules}
        names |= by_name({path: x for path, x in here.items() if path not in of_modules})


def by_name(contents: Mapping[str, str]) -> dict[str, str]:
    """Return the hashes of files by their names without folders, which other machines have not."""
    names = dict[str, str]()
    for path, content in contents.items():
        name = Path(path).name
        names[name if name not in names else f"{name} ({len(names)})"] = content
    return names


@lru_cache(maxsize=1)
def _listen(is_foreign: Callable[[str], bool]) -> None:
    """Note what is opened to be read, from now on, whenever somebody asks for it."""

    def note(event: str, about: tuple[Any, ...]) -> None:
        global _opened
        if (into := _opened) is None or event not in ("open", "ctypes.dlopen"):
            return
        _opened = None  # what is opened here is no affair of that code
        try:
            if file := _file_of(event, about, is_foreign):
                into.setdefault(str(file), hashed(file.read_bytes()))
        except OSError:
            pass  # which that code meets, too
        finally:
            _opened = into

    sys.addaudithook(note)


def _file_of(event: str, about: tuple[Any, ...], is_foreign: Callable[[str], bool]) -> Path | None:
    """Return the file that code of somebody else is about to read; None for all others."""
    name, writes = about[0], event == "open" and "r" not in str(about[1] or "r")
    if writes or not isinstance(name, str | bytes | os.PathLike):
        return None
    frame: Any = sys._getframe(2)
    while frame and not is_foreign(str(frame.f_globals.get("__name__", ""))):
        frame = frame.f_back
    path = Path(os.path.abspath(os.fsdecode(name)))  # noqa: PTH100  # a link leads elsewhere
    is_other = (
        not frame or "__pycache__" in path.parts or not path.is_file() or is_of_eqt(str(path))
    )
    return None if is_other else path


def united(parts: Iterable[Mapping[str, str]]) -> dict[str, str]:
    """Return the files of several parts, sorted by name."""
    whole = {name: content for part in parts for name, content in part.items()}
    return dict(sorted(whole.items()))
