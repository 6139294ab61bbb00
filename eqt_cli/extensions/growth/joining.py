"""Results that differ in points, laws or seeds, joined to one: `eqt pack A B --out C`."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import OTHER_FOLDER, EqtError, parse_key
from eqt_cli.base.option_types import shown
from eqt_cli.base.store_reader import open_results
from eqt_cli.config.designs import overlap
from eqt_cli.config.document import Document, document_of, value_at
from eqt_cli.config.experiment import hashes, renamed
from eqt_cli.config.study import study, sweep_of
from eqt_cli.extensions.growth.growth import Growth, is_shared, require_same_code, source_of
from eqt_cli.runs.compute_part import PartTask
from eqt_cli.runs.executors import Serial
from eqt_cli.runs.folder import RERUN, ResultFolder
from eqt_cli.runs.lock import locked
from eqt_cli.runs.part_files import PartFiles
from eqt_cli.runs.preflight import check_resources
from eqt_cli.runs.provenance import now
from eqt_cli.runs.run_study import Execution, Session, pack, timed

FILTERS = ("where", "points")

SEED = "ensemble.seed"

LEFT_ASIDE = ("name", "sweep", "controllers", "store", "tune", "worst")
"""Sections that are joined, or that do not decide numbers."""


@purposes.pack_out
def join(paths: Sequence[Path], out: Path, *, trusted: bool = False) -> Execution:
    """Write the result of all points, laws and seeds of several results.

    Runs that are cross-checked are computed again; all others are copied.

    Raises
    ------
    EqtError
        If the results differ in anything else, or lack runs of the whole.
    """
    folder = ResultFolder(out)
    folder.check()
    if folder.manifest or folder.results.exists():
        raise EqtError(f"{out}: holds a result already", OTHER_FOLDER)
    with ExitStack() as stack:
        opened = [stack.enter_context(open_results(path)) for path in paths]
        documents = [document_of(result, trusted) for result in opened]
        whole = documents[0]
        for path, other in zip(paths[1:], documents[1:], strict=True):
            whole = _union(whole, other, paths[0], path)
        wanted = study(whole)
        growth = Growth(wanted, [source_of(result) for result in opened])
        for source in growth.sources:
            require_same_code(wanted, source)
        if lacking := _lacking(growth):
            raise EqtError(
                f"{out}: together these results lack {', '.join(lacking)}; compute them first, or "
                "let one of the results grow by --grow"
            )
        check_resources(wanted, out)
        stack.enter_context(locked(out))
        return _joined(Session(wanted, folder, Serial()), growth, opened)


def _joined(session: Session, growth: Growth, opened: Sequence[Any]) -> Execution:
    folder, wanted = session.folder, session.study
    manifest = session.manifest_of({}, afresh=True)
    folder.claim(wanted, manifest, False)
    place = folder.path.resolve() / RERUN
    place.mkdir(exist_ok=True)
    task = PartTask(wanted, PartFiles(place), tuple(growth.chosen()))
    for result in opened:
        session.note_earlier({"provenance": json.loads(str(result.attributes["provenance"]))})
    with timed(session.seconds, "simulation"):
        session.compute(task)
    growth.compare(task, session.origin)
    last = not is_shared(wanted.base.engine)
    with timed(session.seconds, "writing", without="cross-check"):
        pack(task, folder, session.origin, session.seconds, growth.put_into, taken_last=last)
    with open_results(folder.results) as result:
        failed = int(np.count_nonzero(result["status"]))
    ending = {"finished": now(), "seconds": session.seconds, "failed": failed}
    folder.finish(manifest | ending | {"provenance": session.origin})
    folder.remove(RERUN)
    total = session.plan.total
    return Execution(folder, False, [], total, failed, 0, True, session.seconds, total)


def _lacking(growth: Growth) -> list[str]:
    """Return what no source holds of the whole, in words."""
    runs, lacking = growth.study.base.config.ensemble.runs, list[str]()
    for point in range(len(growth.study)):
        for label in growth.study.base.loops:
            taken = growth.taken.get((point, label))
            if taken is None:
                lacking.append(f"{label} at point {point}")
            elif taken.runs < runs:
                lacking.append(f"runs {taken.runs} to {runs - 1} of {label} at point {point}")
    return lacking if len(lacking) <= 3 else [*lacking[:3], f"and {len(lacking) - 3} more"]


def _union(one: Document, other: Document, first: Path, second: Path) -> Document:
    """Return the configuration of the points, laws and seeds of both.

    Raises
    ------
    EqtError
        With the differences that no result can hold.
    """
    swept = {
        key for document in (one, other) if _section(document) for key in sweep_of(document).sets
    }
    seeds = [value_at(document.data, parse_key(SEED)) for document in (one, other)]
    differing = [
        f"{key}: {shown(a)} there, {shown(b)} here"
        for key, a, b in _differences(_compared(one), _compared(other))
        if key != SEED and not any(overlap(key, name) for name in swept)
    ]
    laws = list(one.data["controllers"])
    labels = {law["label"]: law for law in laws}
    if not any(key.startswith("controllers") for key in swept):
        for law in other.data["controllers"]:
            if law["label"] not in labels:
                laws.append(law)
            elif law != labels[law["label"]]:
                there = shown(labels[law["label"]])
                differing.append(f"controllers: {there} there, {shown(law)} here")
    sweeps = [sweep_of(document) for document in (one, other) if _section(document)]
    axes = [[key for key in sweep.keys if key != SEED] for sweep in sweeps]
    if len(axes) > 1 and {*axes[0]} != {*axes[1]}:
        names = (", ".join(keys) or "none" for keys in axes)
        differing.append("swept keys: {} there, {} here".format(*names))
    section: list[Any] | None = None if differing else _joined_sweep(one, other)
    if section is None and bool(_section(one)) != bool(_section(other)):
        differing.append("sweep: one of them has points, and the other is a single experiment")
    if differing:
        raise EqtError(
            f"{second}: cannot be joined with {first}, since it differs in more than points, laws "
            "and seeds",
            lines=[f"  {line}" for line in differing],
        )
    if seeds[0] != seeds[1] and SEED not in swept:
        block = {"grid": {SEED: seeds}}
        section = [block, *(section or [])]
    data = one.data | {"controllers": laws} | ({"sweep": section} if section else {})
    home = replace(one.home, files=other.home.files | one.home.files)
    return replace(one, data=data, home=home)


def _section(document: Document) -> list[Any]:
    return document.data.get("sweep") or []


def _compared(document: Document) -> dict[str, Any]:
    """Return what must be equal, with hashes for the names of files."""
    names = hashes(document.home.files | (document.home.plugins or {}))
    data = {key: x for key, x in document.data.items() if key not in LEFT_ASIDE}
    return dict(renamed(data, names))


def _differences(one: Any, other: Any, key: str = "") -> Iterator[tuple[str, Any, Any]]:
    if isinstance(one, dict) and isinstance(other, dict):
        for name in {**one, **other}:
            inner = f"{key}.{name}" if key else str(name)
            yield from _differences(one.get(name), other.get(name), inner)
    elif one != other:
        yield key, one, other


def _joined_sweep(one: Document, other: Document) -> list[Any] | None:
    """Return the section of the points of both sweeps; None where one is none."""
    sections = _section(one), _section(other)
    if not all(sections):
        return None
    if sections[0] == sections[1]:
        return list(sections[0])
    sweeps = [sweep_of(document) for document in (one, other)]
    plain = [[x for x in section if not set(x) & set(FILTERS)] for section in sections]
    if plain[0] == plain[1]:
        blocks, offset = plain[0], 0
        raw = sweep_of(replace(one, data=one.data | {"sweep": blocks}))
    else:
        rules = [[x for x in section if "set" in x] for section in plain]
        parts = [[x for x in section if "set" not in x] for section in plain]
        blocks = [{"concat": parts}, *rules[0], *(x for x in rules[1] if x not in rules[0])]
        raw = sweep_of(replace(one, data=one.data | {"sweep": blocks}))
        offset = len(sweep_of(replace(one, data=one.data | {"sweep": plain[0]})))
    numbers: dict[str, int] = {}
    for sweep, start in zip(sweeps, (0, offset), strict=True):
        count = sweep.rules.combinations if sweep.rules else None
        for k in range(len(sweep)) if count is None else count:
            settings = json.dumps(raw.settings(start + k), sort_keys=True)
            numbers.setdefault(settings, start + k)
    chosen = sorted(numbers.values())
    return blocks if len(chosen) == len(raw) else [*blocks, {"points": chosen}]
