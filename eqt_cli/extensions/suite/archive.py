"""Files of judged laws: the archive of the suite, and the pack of one law.

A file is a zip of `suite.json`, an array of held-out errors for each law and task, and the sources
of the laws as plain text. It is data: to read it runs nothing.
"""

from __future__ import annotations

import io
import json
import math
import re
import zipfile
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.base.files import FilePattern, refusals, remove_left_over, replace_file
from eqt_cli.base.version import __version__
from eqt_cli.extensions.suite.judging import Judged
from eqt_cli.extensions.suite.packs import members
from eqt_cli.extensions.suite.tasks import TASKS, VERSION

ARCHIVE = TASKS / "archive.zip"
"""The archive of the suite."""

ENDING = ".eqtsuite.zip"
"""Ending of the names of packs."""

_CONTENT = "suite.json"
_FORMAT = 1
_MOST_TEXT = 4_000_000
"""Largest size of `suite.json`, bytes, whose lists may take 25 times as much memory; the archive's
has 72 kB."""

_MOST_LAWS = 200
"""Largest number of laws; the archive has 12."""

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
        remove_left_over(path.parent, [FilePattern(re.escape(path.name))])
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
            "gained": _plain(judged.gained),
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
    try:
        parts = members(path)
        if _CONTENT in parts:
            return _archive(parts)
        why = f"it has no {_CONTENT}"
    except InputError as error:
        why = str(error)
    except KeyError as error:
        why = f"it lacks {error.args[0]}"
    except (ValueError, TypeError, AttributeError, OverflowError, RecursionError):
        why = f"its numbers or {_CONTENT} have another form"
    raise EqtError(f"{path}: is no file of a suite: {why}; write it anew by eqt suite pack")


def _archive(parts: dict[str, bytes]) -> Archive:
    """Return the laws in a file, and use up its parts; several errors where its form is another."""
    text = parts.pop(_CONTENT)
    if len(text) > _MOST_TEXT:
        raise InputError(f"{_CONTENT} has more than {_MOST_TEXT / 1e6:g} MB")
    data = json.loads(text)
    if data["format"] != _FORMAT:
        raise ValueError(data["format"])
    if len(data["laws"]) > _MOST_LAWS:
        raise InputError(f"it has {len(data['laws'])} laws, and at most {_MOST_LAWS} are read")
    laws = {}
    for number, record in enumerate(data["laws"]):
        tasks = dict(_judged(parts, number, record["tasks"]))
        names = [_text(name) for name in record["sources"]]
        sources = {name: _part(parts, f"laws/{number}/{name}").decode() for name in names}
        label, title, kind, digest, eqt = (
            _text(record[name]) for name in ("label", "title", "kind", "digest", "eqt")
        )
        if label in laws:
            raise InputError(f"it has two laws {label!r}")
        laws[label] = JudgedLaw(label, title, kind, digest, tasks, sources, eqt)
    digests = {_text(name): _text(digest) for name, digest in data["tasks"].items()}
    if parts:
        raise InputError(f"it has a part {next(iter(parts))!r}, which {_CONTENT} does not name")
    return Archive(digests, laws, _text(data["suite"]))


def _part(parts: dict[str, bytes], name: str) -> bytes:
    """Return a part of a file, and take it out; a `KeyError` with its name if there is none."""
    if ".." in name.replace("\\", "/").split("/"):
        raise InputError(f"it has a part {name!r}, which leads out of its folder")
    return parts.pop(name)


def _judged(
    parts: dict[str, bytes], number: int, records: Mapping[str, Any]
) -> Iterator[tuple[str, Judged]]:
    for task, record in records.items():
        values = tuple(map(_values, record["values"]))
        errors = _errors_in(_part(parts, _array_name(number, task)), len(values))
        # Files of eqt-suite-1 do not say how their searches ended.
        listed = record["spent"], record["trained"], record.get("gained", [])
        spent, trained, gained = (np.array([_number(x) for x in column]) for column in listed)
        if (
            not 0 < errors.size <= _RUNS
            or not len(spent) == len(trained) == len(errors)
            or len(gained) not in (0, len(errors))
        ):
            raise ValueError(task)
        about = _number(record["start"]), bool(record["is_stated"]), _number(record["seconds"])
        costs = spent, trained, np.array(about)
        _check_numbers(f"{_array_name(number, task)}: ", values, errors, *costs)
        yield (
            _text(task),
            Judged(values, errors, spent, trained, *about, _text(record["why"]), gained),
        )


def _check_numbers(
    place: str, values: Sequence[Mapping[str, Any] | None], errors: Array, *costs: Array
) -> None:
    """Refuse errors and costs that no judgement writes."""
    without = np.array([of is None for of in values])
    if np.isinf(errors).any() or (errors < 0).any() or any((x < 0).any() for x in costs):
        raise InputError(f"{place}expected errors and costs of at least 0")
    if not np.isnan(errors[without]).all() or not np.isnan(costs[0][without]).all():
        raise InputError(f"{place}has errors on a sample without gains")
    if (np.nan_to_num(errors, nan=1.0).max(axis=1) == 0).any():
        raise InputError(f"{place}all errors of a sample are 0")


def _values(record: Any) -> dict[str, float] | None:
    if record is None:
        return None
    return {_text(key): _value(value) for key, value in record.items()}


def _value(value: Any) -> Any:
    return [_finite(entry) for entry in value] if isinstance(value, list) else _finite(value)


def _number(value: Any) -> float:
    return math.nan if value is None else _finite(value)


def _finite(value: Any) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise TypeError(value)
    if not math.isfinite(number := float(value)):
        raise ValueError(value)
    return number


def _text(value: Any) -> str:
    if not isinstance(value, str):
        raise TypeError(value)
    return value


def shipped_archive() -> Archive:
    """Return the archive of the suite; an empty one if there is none yet."""
    return read(ARCHIVE) if ARCHIVE.exists() else Archive()
