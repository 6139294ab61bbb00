"""Who computes in a result folder, with which versions, and which parts it has finished."""

from __future__ import annotations

import errno
import json
import os
import platform
import re
import stat
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib import import_module
from pathlib import Path
from typing import Any

from eqt_cli.base import files
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, HarmWarning, Remedy
from eqt_cli.base.reporting import reporter
from eqt_cli.base.version import OTHERS, __version__, numeric
from eqt_cli.config.parts import Plans

if sys.platform != "win32":
    import fcntl

# Records the origin of a result: versions, machine, commit. Nothing here affects numbers ----------


@contextmanager
def timed(seconds: dict[str, float], name: str) -> Iterator[None]:
    """Record the wall time of the block under a name, s."""
    started = time.perf_counter()
    yield
    seconds[name] = round(time.perf_counter() - started, 3)


_HASH = re.compile(rb"([0-9a-f]{40}(?:[0-9a-f]{24})?)\n")

_PATIENCE = 3.0
"""Time limit for git, s: a hostile repository can have it wait for a pipe, or read without end."""


def commit_of(folder: Path) -> str | None:
    """Return the commit checked out in the repository of a folder; None if git tells none.

    This command starts nothing that a repository names (hooks, filters, the monitor of files,
    helpers of remotes), as its system calls show; git refuses repositories of other users.
    """
    null = subprocess.DEVNULL
    # Such variables name another repository, as where a hook of git starts eqt.
    env = {name: text for name, text in os.environ.items() if not name.startswith("GIT_")}

    def rev_parse(*words: str) -> bytes:
        command = ["git", "-C", str(folder), "rev-parse", *words]
        return subprocess.check_output(command, stdin=null, stderr=null, env=env, timeout=_PATIENCE)

    with suppress(OSError, ValueError, subprocess.SubprocessError):
        match = _HASH.fullmatch(rev_parse("--verify", "HEAD"))
        name = rev_parse("--symbolic-full-name", "HEAD").decode().rstrip("\n")
        path = folder / rev_parse("--git-path", name).decode().rstrip("\n")
        # A link may lead to any file with a hash in it, and results are shared.
        links = any(each.is_symlink() for each in [path, *path.parents][: name.count("/") + 1])
        return match[1].decode() if match and not links else None
    return None


PACKAGES = ("numpy", "scipy", "h5py")


def provenance(folder: Path, tools: Mapping[str, str]) -> dict[str, Any]:
    """Describe this machine, the tools of the engine, and the session of a configuration."""
    return {
        "eqt": __version__,
        "python": platform.python_version(),
        **{name: import_module(name).__version__ for name in PACKAGES},
        "platform": platform.platform(),
        "machine": platform.machine(),
        **tools,
        "cpu_count": os.cpu_count(),
        "command": " ".join(["eqt", *sys.argv[1:]]),
        "started": now(),
        "git": commit_of(folder),
    }


def now() -> str:
    """Return the current time, ISO 8601."""
    return datetime.now(UTC).isoformat(timespec="seconds")


def together(origin: dict[str, Any], other: dict[str, Any]) -> dict[str, Any]:
    """Return `origin` with the sessions of both that differ from it in `NUMERIC`."""
    known = {numeric(origin): origin}
    for entry in [*origin.get(OTHERS, ()), *other.get(OTHERS, ()), other]:
        known.setdefault(numeric(entry), {k: v for k, v in entry.items() if k != OTHERS})
    _, *differing = known.values()
    plain = {key: value for key, value in origin.items() if key != OTHERS}
    return plain | ({OTHERS: differing} if differing else {})


# Locks a result folder for one writer; the lock ends with its process -----------------------------


LOCK = ".lock"

_BEGINNING = b'{"pid": '
"""First bytes of a lock file; a killed process may have written fewer."""

_MOST_READ = 4096
"""Largest number of bytes read from a lock file."""

_CAREFULLY = sum(getattr(os, name, 0) for name in ("O_NOFOLLOW", "O_NONBLOCK", "O_CLOEXEC"))
"""Flags for opening a file without following links or waiting for pipes."""


def _flock(handle: int, *, shared: bool) -> None:
    """Lock an open file, or raise at once."""
    if sys.platform == "win32":
        raise OSError(errno.ENOLCK, "no locks")
    fcntl.flock(handle, (fcntl.LOCK_SH if shared else fcntl.LOCK_EX) | fcntl.LOCK_NB)


@contextmanager
def locked(
    folder: Path, *, shared: bool = False, name: str = LOCK, warns: bool = True
) -> Iterator[None]:
    """Lock the folder for this process until the block ends.

    The operating system holds the lock, so that a killed process leaves none behind. If the disk
    does not support locks, the folder is not locked.

    Parameters
    ----------
    shared
        Whether others may also take a shared lock, as the shards of a job array do.
    name
        Name of the locked file.
    warns
        Whether to remark that the disk does not support locks.

    Raises
    ------
    EqtError
        If another process holds the lock, the folder is not writable, or the file is not eqt's.
    """
    path = folder / name
    with files.refusals(folder, "used", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        handle, is_locked = _opened(path, shared)
    try:
        if warns and not is_locked:
            reporter().remark(
                HarmWarning(
                    f"{folder}: its disk does not support file locks, so a second eqt could write "
                    "to it at the same time",
                    Remedy("run one at a time there"),
                    Remedy("choose another disk with {}", "out"),
                )
            )
        if not shared:
            with files.refusals(folder, "used", OTHER_FOLDER):
                _sign(handle)
        yield
    finally:
        with suppress(OSError):  # the next process reuses a file that remains
            if not shared and os.path.samestat(os.fstat(handle), path.lstat()):
                path.unlink()
        with suppress(OSError):
            os.close(handle)


def _sign(handle: int) -> None:
    """Write into the locked file which process holds it."""
    os.ftruncate(handle, 0)
    os.lseek(handle, 0, os.SEEK_SET)
    owner = {"pid": os.getpid(), "host": platform.node(), "since": now()}
    os.write(handle, json.dumps(owner).encode())


def _opened(path: Path, shared: bool) -> tuple[int, bool]:
    """Open the file; return its handle, and whether it could be locked.

    This is repeated if the previous owner removed the file before it was locked.
    """
    while True:
        files.check_kind(path, files.FILE)
        handle = os.open(path, os.O_RDWR | os.O_CREAT | _CAREFULLY, 0o666)
        try:
            is_locked = _lock(handle, path, shared)
            if os.path.samestat(os.fstat(handle), path.lstat()):
                _check_content(handle, path)
                return handle, is_locked
        except FileNotFoundError:
            pass
        except BaseException:
            os.close(handle)
            raise
        os.close(handle)


def _check_content(handle: int, path: Path) -> None:
    """Refuse a file that eqt did not write: one with several hard links or with other content."""
    status = os.fstat(handle)
    if status.st_nlink > 1:
        raise files.foreign(path, f"a file with {status.st_nlink} hard links", files.FILE)
    if not _BEGINNING.startswith(_text(handle)[: len(_BEGINNING)]):
        raise files.foreign(path, "a file with another content", "a lock")


def holder(folder: Path) -> dict[str, Any] | None:
    """Return the process, host and start time of the folder's writer; None if there is none."""
    for path in [folder / LOCK, *folder.glob(f"{LOCK}-*")]:
        try:
            handle = os.open(path, os.O_RDONLY | _CAREFULLY)
        except OSError:
            continue
        try:
            if stat.S_ISREG(os.fstat(handle).st_mode):
                _flock(handle, shared=True)
        except OSError as error:
            if error.errno in (errno.EAGAIN, errno.EACCES):
                return _read(handle) or {}
        finally:
            os.close(handle)
    return None


def _lock(handle: int, path: Path, shared: bool) -> bool:
    """Lock a file; return whether the disk supports it; `EqtError` if another process holds it."""
    try:
        _flock(handle, shared=shared)
    except OSError as error:
        if error.errno not in (errno.EAGAIN, errno.EACCES):
            return False
        other = _read(handle)
        who = f" (process {other['pid']} on {other['host']})" if other else ""
        raise EqtError(
            f"{path.parent}: another eqt{who} is writing to it",
            Remedy("wait for its end"),
            OTHER_FOLDER,
        ) from error
    return True


def _read(handle: int) -> dict[str, Any] | None:
    """Return the content of a lock file; None if it names no process."""
    with suppress(OSError, ValueError):
        content = json.loads(_text(handle))
        return content if isinstance(content, dict) and {"pid", "host"} <= set(content) else None
    return None


def _text(handle: int) -> bytes:
    os.lseek(handle, 0, os.SEEK_SET)
    return os.read(handle, _MOST_READ)


# The files of finished parts, and the progress of an unfinished result ----------------------------
#
# Does not know the content of parts, and imports no heavy library.


MANIFEST, PARTS = "manifest.json", "parts"
"""Names in a result folder: the record of the experiment, and the folder of finished parts."""

_NAME = re.compile(r"(\d{6,})(?:\.f(\d+))?\.h5")

_PART = files.FilePattern(_NAME.pattern)
PART_ENTRIES = (_PART, files.FilePattern(r"reference(-\d+)?\.h5"))
"""Entries that eqt writes in the folder of the parts."""


@dataclass(frozen=True)
class FinishedPart:
    """The file of a finished part, and the number of its failed runs."""

    path: Path
    failed: int


@dataclass(frozen=True)
class PartFiles:
    """The folder of the parts."""

    folder: Path

    def reference(self, piece: int) -> Path:
        """Return the file of the reference that all runs of a piece share."""
        return self.folder / (f"reference-{piece}.h5" if piece else "reference.h5")

    def listed(self) -> dict[int, FinishedPart]:
        """Return the finished parts, by number."""
        parts: dict[int, FinishedPart] = {}
        try:
            names = sorted(os.listdir(self.folder))  # noqa: PTH208  # thousands, quickly
        except FileNotFoundError:
            return parts
        for name in names:
            if match := _NAME.fullmatch(name):
                number, failed = int(match[1]), int(match[2] or 0)
                # During a rerun a part can have two files; the one with fewer failures counts.
                if number not in parts or failed < parts[number].failed:
                    parts[number] = FinishedPart(self.folder / name, failed)
        return parts

    def part(self, number: int, failed: int) -> Path:
        """Return the file of a finished part with so many failed runs."""
        return self.folder / (f"{number:06d}.f{failed}.h5" if failed else f"{number:06d}.h5")

    def tidy(self) -> None:
        """Remove parts of which another file has fewer failed runs."""
        best = {part.path.name for part in self.listed().values()}
        for path in self.folder.iterdir() if self.folder.exists() else ():
            if _NAME.fullmatch(path.name) and path.name not in best:
                files.remove_written(path, _PART)


RECENT = 200
"""Number of latest parts from which the rate is computed."""


@dataclass(frozen=True)
class Unfinished:
    """A result folder that holds parts, but no result yet.

    Attributes
    ----------
    name
        Name of the experiment.
    runs, done, failed
        Numbers of runs over all controllers and points: all, finished, failed.
    begun
        Start of the first session, ISO 8601.
    writer
        The process that computes now (`holder`); None if there is none.
    rate
        Recent rate in runs per second; None before two parts are finished.
    """

    name: str
    runs: int
    done: int
    failed: int
    begun: str
    writer: dict[str, Any] | None
    rate: float | None

    @property
    def remaining(self) -> float | None:
        """Expected remaining time, s; None if unknown."""
        return (
            (self.runs - self.done) / self.rate if self.rate and self.writer is not None else None
        )


def unfinished(path: Path) -> Unfinished | None:
    """Return the progress of a folder without a result file; None for any other path."""
    if not path.is_dir() or (path / files.FILE_NAME).exists():
        return None
    manifest: dict[str, Any] = {}
    with suppress(OSError):  # an unreadable folder counts as no result
        manifest = files.read_record(path / MANIFEST, "plan", "name", "begun") or {}
    # A manifest of another program may hold anything.
    with suppress(ValueError, TypeError, LookupError, AttributeError, ArithmeticError):
        plan = Plans.of_data(manifest["plan"])
        listed = PartFiles(path / PARTS).listed()
        done = sum(plan.runs_of(number) for number in listed if number < len(plan))
        failed = sum(part.failed for part in listed.values())
        writer = holder(path)
        since = None if writer is None else writer.get("since")
        name, begun, rate = manifest["name"], manifest["begun"], _rate(plan, listed, since)
        return Unfinished(str(name), plan.total, done, failed, str(begun), writer, rate)
    return None


def _rate(plan: Plans, parts: dict[int, FinishedPart], since: str | None) -> float | None:
    """Return the runs per second of the latest parts (of the current session if there is one)."""
    start = datetime.fromisoformat(since).timestamp() if since else 0.0
    times = []
    for number, part in parts.items():
        with suppress(FileNotFoundError):
            finished = os.stat(part.path).st_mtime  # noqa: PTH116  # thousands, quickly
            if finished >= start:
                times.append((finished, number))
    times = sorted(times)[-RECENT:]
    if len(times) < 2:
        return None
    end = time.time() if since else times[-1][0]
    first = times[0][0]
    runs = sum(plan.runs_of(number) for _, number in times[1:])
    return runs / max(end - first, 1e-3)
