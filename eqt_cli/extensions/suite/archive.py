"""Files of judged laws: the archive of the suite, and the pack of one law.

A file is a zip of `suite.json`, an array of held-out errors for each law and task, and the sources
of the laws as plain text. It is data: to read it runs nothing.
"""

from __future__ import annotations

import io
import json
import math
import zipfile
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import content_of, refusals, replace_file
from eqt_cli.base.version import __version__
from eqt_cli.extensions.suite.judging import Judged
from eqt_cli.extensions.suite.tasks import TASKS, VERSION

ARCHIVE = TASKS / "archive.zip"
"""The archive of the suite."""

ENDING = ".eqtsuite.zip"
"""Ending of the names of packs."""

_CONTENT = "suite.json"
_FORMAT = 1
_BYTES = 16_000_000
"""Largest size of a file, and of what it holds, bytes."""

_RUNS = 100_000
"""Largest number of errors of a law on a task."""


@dataclass(frozen=True)
class JudgedLaw:
    """What is stored of a law.

    Attributes
    ----------
    label, title
        Its name for users to type, and in tables.
    kind
        ``shipped``, ``Python``, ``C`` or ``network``.
    digest
        Hash of what it computes.
    tasks
        What it did on each task, by name.
    sources
        Its source, by the name of the file.
    eqt
        The version of eqt that judged it.
    """

    label: str
    title: str
    kind: str
    digest: str
    tasks: dict[str, Judged]
    sources: dict[str, str] = field(default_factory=dict)
    eqt: str = __version__


@dataclass(frozen=True)
class Archive:
    """Judged laws by label, and the digests of the tasks on which they were judged."""

    tasks: dict[str, str] = field(default_factory=dict)
    laws: dict[str, JudgedLaw] = field(default_factory=dict)
    suite: str = VERSION


def write(path: Path, archive: Archive) -> None:
    """Write judged laws into a file, whole or not at all; equal laws give equal bytes."""
    content = {
        "format": _FORMAT,
        "suite": archive.suite,
        "tasks": archive.tasks,
        "laws": [_record(law) for law in archive.laws.values()],
    }
    stream = io.BytesIO()
    with zipfile.ZipFile(stream, "w", zipfile.ZIP_DEFLATED, compresslevel=9) as packed:
        _add(packed, _CONTENT, json.dumps(content, indent=1, allow_nan=False).encode())
        for number, law in enumerate(archive.laws.values()):
            for task, judged in law.tasks.items():
                _add(packed, _array_name(number, task), _bytes_of(judged.errors))
            for name, text in law.sources.items():
                _add(packed, f"laws/{number}/{name}", text.encode())
    with refusals(path, "written"):
        path.parent.mkdir(parents=True, exist_ok=True)
        replace_file(path, stream.getvalue())


def _add(packed: zipfile.ZipFile, name: str, content: bytes) -> None:
    info = zipfile.ZipInfo(name)  # with a fixed time
    info.compress_type = zipfile.ZIP_DEFLATED
    info.external_attr = 0o644 << 16
    packed.writestr(info, content)


def _array_name(number: int, task: str) -> str:
    return f"errors/{number}/{task}"


def _bytes_of(errors: Array) -> bytes:
    """Return errors as float32, first all bytes with the exponents: they compress better so."""
    raw = np.ascontiguousarray(errors, dtype="<f4").reshape(-1).view(np.uint8).reshape(-1, 4)
    return raw.T.tobytes()


def _errors_in(content: bytes, samples: int) -> Array:
    raw = np.frombuffer(content, dtype=np.uint8).reshape(4, -1).T
    return np.ascontiguousarray(raw).view("<f4").reshape(samples, -1).astype(float)


def _record(law: JudgedLaw) -> dict[str, Any]:
    names = ("label", "title", "kind", "digest", "eqt")
    tasks = {
        task: {
            "values": judged.values,
            "spent": _plain(judged.spent),
            "trained": _plain(judged.trained),
            "start": _plain(judged.start),
            "is_stated": judged.is_stated,
            "seconds": round(judged.seconds, 2),
            "why": judged.why,
        }
        for task, judged in law.tasks.items()
    }
    return {name: getattr(law, name) for name in names} | {
        "tasks": tasks,
        "sources": sorted(law.sources),
    }


def _plain(numbers: Any) -> Any:
    """Return numbers as JSON has them, null for NaN."""
    if isinstance(numbers, np.ndarray):
        return [_plain(float(number)) for number in numbers]
    return number if math.isfinite(number := float(numbers)) else None


def read(path: Path) -> Archive:
    """Read a file of judged laws.

    Raises
    ------
    EqtError
        If it is no such file, or damaged.
    """
    with refusals(path, "read", "give the archive or a pack of a suite"):
        content = content_of(path, _BYTES)
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            if _CONTENT not in packed.namelist():
                why = f"it has no {_CONTENT}"
            elif sum(info.file_size for info in packed.infolist()) > _BYTES:
                why = f"it holds more than {_BYTES / 1e6:g} MB"
            else:
                return _archive(packed)
    except zipfile.BadZipFile:
        why = "it is no zip, or its end is missing"
    except KeyError as error:
        why = f"it lacks {error.args[0]}"
    except (ValueError, TypeError, AttributeError, RecursionError):
        why = f"its numbers or {_CONTENT} have another form"
    raise EqtError(f"{path}: is no file of a suite: {why}; write it anew by eqt suite pack")


def _archive(packed: zipfile.ZipFile) -> Archive:
    """Return the laws in a file; several kinds of error where it has another form."""
    data = json.loads(packed.read(_CONTENT))
    if data["format"] != _FORMAT:
        raise ValueError(data["format"])
    laws = {}
    for number, record in enumerate(data["laws"]):
        tasks = dict(_judged(packed, number, record["tasks"]))
        names = [_text(name) for name in record["sources"]]
        sources = {name: _part(packed, f"laws/{number}/{name}").decode() for name in names}
        label, title, kind, digest, eqt = (
            _text(record[name]) for name in ("label", "title", "kind", "digest", "eqt")
        )
        laws[label] = JudgedLaw(label, title, kind, digest, tasks, sources, eqt)
    digests = {_text(name): _text(digest) for name, digest in data["tasks"].items()}
    return Archive(digests, laws, _text(data["suite"]))


def _part(packed: zipfile.ZipFile, name: str) -> bytes:
    """Return a part of a file; a `KeyError` with its name if there is none."""
    if name not in packed.namelist():
        raise KeyError(name)
    return packed.read(name)


def _judged(
    packed: zipfile.ZipFile, number: int, records: Mapping[str, Any]
) -> Iterator[tuple[str, Judged]]:
    for task, record in records.items():
        values = tuple(map(_values, record["values"]))
        errors = _errors_in(_part(packed, _array_name(number, task)), len(values))
        numbers = [[_number(x) for x in record[name]] for name in ("spent", "trained")]
        spent, trained = map(np.array, numbers)
        if not 0 < errors.size <= _RUNS or not len(spent) == len(trained) == len(errors):
            raise ValueError(task)
        about = _number(record["start"]), bool(record["is_stated"]), _number(record["seconds"])
        yield _text(task), Judged(values, errors, spent, trained, *about, _text(record["why"]))


def _values(record: Any) -> dict[str, float] | None:
    if record is None:
        return None
    return {_text(key): _value(value) for key, value in record.items()}


def _value(value: Any) -> Any:
    return [_number(entry) for entry in value] if isinstance(value, list) else _number(value)


def _number(value: Any) -> float:
    if value is None:
        return math.nan
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(value)
    return float(value)


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def shipped_archive() -> Archive:
    """Return the archive of the suite; an empty one if there is none yet."""
    return read(ARCHIVE) if ARCHIVE.exists() else Archive()
