"""What a search varies in a law, and the folder of a search."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from itertools import chain, combinations, count
from pathlib import Path
from typing import Any

from eqt_cli.base import errors, files, purposes
from eqt_cli.base.errors import OTHER_FOLDER, ConfigError, EqtError, InputError, Problems, Remedy
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.components.laws import gains_group
from eqt_cli.config.designs import DrawnRange, overlap
from eqt_cli.config.document import Document, entries_of, expanded, value_at, with_value
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.marks import VEHICLE
from eqt_cli.config.preflight import build
from eqt_cli.config.schema import Config, marks_of, without_search
from eqt_cli.config.study import Study
from eqt_cli.extensions.search.keys import LogRange, TunedAxis
from eqt_cli.extensions.search.record import Kind
from eqt_cli.results.metrics import METRICS
from eqt_cli.runs.folder import COPY_FOLDERS, RESULT_ENTRIES, ResultFolder, quantities
from eqt_cli.runs.part_files import MANIFEST


def refuse_runs_of_training(
    base: Experiment, problems: Problems, key: str, ensemble: Mapping[str, int]
) -> None:
    """Note laws that were trained on the runs that a search judges them by."""
    data = without_search(base.document.data) | {"ensemble": dict(ensemble)}
    for sentences in functions_for(purposes.laws_that_runs_flatter):
        for said in sentences(replace(base.document, data=data), f"those of {key}"):
            problems.add(f"{said}; take other runs, as --set {key}={ensemble['seed'] + 1000}")


# The search for one law: its experiment and the ranges of the varied keys -------------------------


@dataclass(frozen=True)
class TunedRange(DrawnRange):
    """A range of a tuned number, and what its law is without it.

    Attributes
    ----------
    off
        The value at a share of 0 in place of `low`: the law without this number. None if it cannot
        be absent.
    times
        Name of the number whose multiples the others are; empty for none.
    """

    off: float | None = None
    times: str = ""

    def at(self, share: float) -> float | int:
        """Return a number; at 0 that of a law without it."""
        return super().at(share) if self.off is None or share > 0 else self.off

    def share(self, value: float) -> float:
        """Return the share of the range at a value within the bounds, or that is `off`."""
        return 0.0 if value == self.off else super().share(value)


@dataclass(frozen=True)
class LawSearch:
    """The search for one law.

    Attributes
    ----------
    label, slug
        Label of the law in the configuration, and name of its files.
    document
        The experiment with this law only, its gains in the section `gains`.
    axes
        Ranges of the varied keys of `document`.
    written
        The same keys, in the same order, as the user's configuration writes them.
    index
        Index of the law among the user's controllers.
    start
        The user's values in the unit cube; None where one is outside its range.
    order
        The keys in the order of the coordinates of the unit cube.
    follows
        Formulas of keys of `document` that follow from the varied ones.
    """

    label: str
    slug: str
    document: Document
    axes: dict[str, TunedRange]
    written: tuple[str, ...]
    index: int
    start: tuple[float, ...] | None
    order: tuple[str, ...]
    follows: dict[str, Any] = field(default_factory=dict)

    def values(self, shares: Sequence[float]) -> dict[str, float]:
        """Return the values at a point of the unit cube, by key."""
        share_of = dict(zip(self.order, shares, strict=True))
        values = {key: axis.at(share_of[key]) for key, axis in self.axes.items()}
        for key, unit in self.units(values).items():
            values[key] *= 1 if values[key] == self.axes[key].off else unit
        return values

    def units(self, values: Mapping[str, float]) -> dict[str, float]:
        """Return the numbers whose multiples some ranges have, by the key of the range."""
        held = {key: _held(self.document.data, other) for key, other in self.factors.items()}
        return {key: float(values.get(self.factors[key], held[key])) for key in held}

    @cached_property
    def factors(self) -> dict[str, str]:
        """The keys whose ranges are multiples of a number, with the key of that number."""
        return factors_of(self.document.data, self.axes)

    @property
    def optional(self) -> tuple[int, ...]:
        """The coordinates of the unit cube at whose 0 the law is one without that number."""
        axes = [self.axes[key] for key in self.order]
        return tuple(k for k, axis in enumerate(axes) if axis.off is not None)

    @property
    def contained(self) -> int:
        """Number of the laws that are searched: this one, and those without optional numbers."""
        return 2 ** len(self.optional) - (len(self.optional) == len(self.order))

    def as_written(self, path: str) -> str:
        """Translate a path of `document` into one of the user's configuration."""
        pairs = zip(expanded(self.axes), expanded(dict.fromkeys(self.written)), strict=True)
        path = path.replace("controllers[0]", f"controllers[{self.index}]", 1)
        return dict(pairs).get(path, path)

    def at(self, values: dict[str, float]) -> Document:
        """Return the experiment with these values."""
        data, settings = self.document.data, expanded(values)
        if self.follows:
            rules = rules_of(self.follows, list(settings), Problems())
            rules.data = data
            settings = rules.settings(settings)
        for key, value in settings.items():
            data = with_value(data, errors.parse_key(key), value)
        return replace(self.document, data=data)

    @property
    def rules(self) -> list[dict[str, Any]]:
        """What a sweep over the varied keys needs beside its blocks."""
        return [{"set": self.follows}] if self.follows else []


def rules_of(formulas: dict[str, Any], keys: Sequence[str], problems: Problems) -> Any:
    """Return what follows by formulas from some keys, after noting their errors."""
    return function_for(purposes.rules_of_a_sweep)({(): {"set": formulas}}, keys, problems)


def range_of(
    listed: TunedAxis, problems: Problems, *, has_absent: bool = True
) -> TunedRange | None:
    """Return the range of a key, or None after noting its problems.

    Parameters
    ----------
    has_absent
        Whether the number may be absent, or a multiple of another one.
    """
    if isinstance(listed, list):
        axis = TunedRange(low=listed[0], high=listed[1])
    elif isinstance(listed, LogRange):
        low, high = listed.log
        if not has_absent and (listed.off is not None or listed.times):
            problems.add(
                "off and times are for gains that eqt tune finds by runs, for one objective; leave "
                "them out"
            )
        axis = TunedRange(listed.off, listed.times or "", low=low, high=high, scale="log")
    else:
        axis = TunedRange(**vars(listed))
    faults = Problems()
    axis.check(faults)
    for problem in faults:
        problems.add(problem.message)
    return None if problems else axis


def require_metric(name: str, base: Experiment) -> None:
    """Raise an `InputError` unless every run stores a metric of this name."""
    stored = [quantity.name for quantity in quantities(base)]
    names = [q.name for q in METRICS if q.name in stored or q.implied_by in stored]
    # Those of one part of the group, such as ``effort_rotation``.
    in_parts = tuple(f"{q.name}_" for q in METRICS if q.stored_by_part)
    starts = tuple(f"{metric.name}_" for metric in base.metrics)
    names += [part for part in stored if part.startswith(in_parts) or f"{part}_".startswith(starts)]
    if name not in names:
        hint = errors.suggestion(name, names) or f"; there are: {', '.join(names)}"
        raise InputError(f"no metric '{name}' is stored of every run{hint}")
    for metric in base.metrics:
        if not f"{name}_".startswith(f"{metric.name}_"):  # neither it nor one of its parts
            continue
        for label, loop in base.loops.items():
            if lacks := metric.lacking(loop):
                raise InputError(
                    f"{name} reads {', '.join(lacks)}, which the law '{label}' has not; leave this "
                    "law out"
                )


def laws_of(
    base: Experiment, ranges: dict[str, TunedRange], formulas: dict[str, Any]
) -> tuple[LawSearch, ...]:
    """Return one search for each law, over its own keys and the shared keys.

    Parameters
    ----------
    formulas
        Formulas of the keys that follow from names in `ranges`.
    """
    laws: list[LawSearch] = []
    shared = base.resolved.get("gains", {})
    ranges = dict(sorted(ranges.items(), key=lambda item: item[0].startswith("controllers[")))
    for index, entry in enumerate(base.resolved["controllers"]):
        law = base.loops[str(entry["label"])].controller
        keeps = gains_group(law, base.group) is not base.group or not law.reads_gains
        data = without_search(base.document.data) | {"controllers": [entry]}
        if isinstance(listed := data.get("metrics"), list):
            loop, pairs = base.loops[str(entry["label"])], zip(listed, base.metrics, strict=True)
            data["metrics"] = [written for written, metric in pairs if not metric.lacking(loop)]
        if not keeps:
            of_law = {key: value for key, value in entry.items() if key != "gains"}
            gains = shared | entry.get("gains", {})
            data |= {"controllers": [of_law], "gains": gains}
        moved = {name: x for key, x in formulas.items() if (name := _key_in_law(key, index, keeps))}
        follows = _used(moved)
        keys = {name: key for key in ranges if (name := _key_in_law(key, index, keeps))}
        unused = {key for key in keys if key not in Config.model_fields and key.isidentifier()}
        unused -= {name for text in follows.values() for name in _names(text)}
        keys = {name: key for name, key in keys.items() if name not in unused}
        axes = {name: ranges[key] for name, key in keys.items()}
        label = str(entry["label"])
        slug = _slug(label, [other.slug for other in laws])
        data["name"] = f"{base.name}-{slug}"
        document = replace(base.document, data=data)
        written = tuple(keys.values())
        order = sorted(axes, key=lambda key: _order(key, axes[key], data))
        start = _start(data, {key: axes[key] for key in order})
        laws.append(
            LawSearch(label, slug, document, axes, written, index, start, tuple(order), follows)
        )
    return tuple(laws)


def _names(formula: Any) -> set[str]:
    return set(re.findall(r"[A-Za-z_]\w*", str(formula)))


def _used(formulas: dict[str, Any]) -> dict[str, Any]:
    """Return the formulas of keys, and of names that these need."""
    used = dict(formulas)
    while True:
        read = {name for text in used.values() for name in _names(text)}
        needed = {
            key: text
            for key, text in used.items()
            if key in read or key in Config.model_fields or not key.isidentifier()
        }
        if len(needed) == len(used):
            return needed
        used = needed


def _key_in_law(key: str, index: int, keeps: bool) -> str:
    """Return a key in the configuration of one law; empty if it belongs to another law.

    A law that `keeps` its gains does not read the section `gains`.
    """
    path = errors.parse_key(entries_of(key)[0])
    if path[0] != "controllers":
        return "" if keeps and path[0] == "gains" else key
    if path[1] != index:
        return ""
    law = errors.dotted(path[:2])
    moved = path[2] == "gains" and not keeps
    return key.removeprefix(f"{law}.") if moved else f"controllers[0]{key[len(law) :]}"


def _order(key: str, axis: TunedRange, data: Mapping[str, Any]) -> tuple[Any, ...]:
    """Return the place of a key among those of a law.

    Stiffness and damping come first. Others are in the order of their ranges and starting values,
    so that a search does not depend on what they are called, where they can be told apart.
    """
    name = entries_of(key)[0].rpartition(".")[2].partition("[")[0]
    role = {"kp": 0, "kd": 1}.get(name, 2)
    share = _share(data, key, axis)
    return role, axis.low, axis.high, axis.scale, -1.0 if share is None else share, key


def _slug(label: str, taken: Sequence[str]) -> str:
    """Return a file name for a label that differs from the names already taken."""
    slug = files.file_name(label, "law")
    numbered = (f"{slug}-{number}" for number in count(2))
    return next(
        candidate for candidate in chain([slug], numbered) if not errors.alike(candidate, taken)
    )


def _start(data: Mapping[str, Any], axes: dict[str, TunedRange]) -> tuple[float, ...] | None:
    """Return the starting values in the unit cube; None if one is outside its range."""
    factors = factors_of(data, axes)
    units = {key: _held(data, factors[key]) if key in factors else 1.0 for key in axes}
    listed = [_share(data, key, axis, units[key]) for key, axis in axes.items()]
    shares = [share for share in listed if share is not None]
    return tuple(shares) if len(shares) == len(axes) else None


def _share(data: Mapping[str, Any], key: str, axis: TunedRange, unit: float = 1) -> float | None:
    """Return the value of a key as a share of its range; None if it has not one value in it."""
    held, *others = (value_at(data, errors.parse_key(entry)) for entry in entries_of(key))
    if not _is_number(held) or any(one != held for one in others):
        return None
    value = float(held) / unit
    is_off = value == axis.off
    return axis.share(value) if is_off or axis.low <= value <= axis.high else None


def factors_of(data: Mapping[str, Any], axes: Mapping[str, TunedRange]) -> dict[str, str]:
    """Return the keys whose ranges are multiples of a number, with the key of that number.

    It is a varied key, or one of `gains`, or one beside the varied key.

    Raises
    ------
    InputError
        If there is no such number, or its range is itself one of multiples.
    """
    factors = {}
    for key, axis in axes.items():
        if not (name := axis.times):
            continue
        within = key.rpartition(".")[0]
        beside = [f"{within}.{name}", f"gains.{name}", f"{within}.gains.{name}"]
        listed = [other for other in axes if name in (other, _last(other)) and other != key]
        held = [other for other in beside if _is_number(_held(data, other))]
        other = next(iter([*listed, *held]), None)
        if other is None or (other in axes and axes[other].times):
            raise InputError(
                f"times: expected another number of this law, such as kp, got '{name}'"
            )
        factors[key] = other
    return factors


def _last(key: str) -> str:
    return key.rpartition(".")[2].partition("[")[0]


def _held(data: Mapping[str, Any], key: str) -> Any:
    """Return the value of a key, the first of its entries; None without one."""
    return value_at(data, errors.parse_key(entries_of(key)[0]))


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool)


def check_overlaps(laws: Sequence[LawSearch], problems: Problems) -> None:
    """Note pairs of keys of a law that vary the same entry."""
    for law in laws:
        for (one, key), (other, others) in combinations(zip(law.written, law.axes, strict=True), 2):
            if any(overlap(a, b) for a in entries_of(key) for b in entries_of(others)):
                problems.at(other).add(f"{other} overlaps with {one}; remove one of them")


ENDS = (0.0, "lower"), (1.0, "upper")


def ends(law: LawSearch) -> Iterator[tuple[str, Experiment]]:
    """Yield the experiments of a law alone at the ends of its ranges, each with where that is.

    These are the ends of all ranges together, and of each range of the vehicle, with all others in
    their middle: what a weight and a mass have at their ends together may fit.
    """
    n = len(law.order)
    shares = {
        f"at the {end} ends of all ranges of {law.label}": [share] * n
        for share, end in ENDS
        if law.axes
    }
    for k, key in enumerate(law.order if n > 1 else ()):
        if VEHICLE in marks_of(entries_of(key)[0]):
            for share, end in ENDS:
                one = [0.5] * k + [share] + [0.5] * (n - k - 1)
                shares[f"at the {end} end of {key}, in the middle of the other ranges"] = one
    for where, point in shares.items():
        try:
            experiment = build(law.at(law.values(point)))
        except ConfigError:  # the search tells what it cannot build
            continue
        yield where, experiment


def check_ends(law: LawSearch, problems: Problems, where: str = "") -> None:
    """Build a law, without the others, at both ends of all ranges; note the problems there."""
    ends: dict[tuple[str, str], tuple[list[str], tuple[Any, ...]]] = {}
    for share, end in ((0.0, "lower"), (1.0, "upper")):
        try:
            build(law.at(law.values([share] * len(law.axes))))
        except ConfigError as error:
            for problem in error.problems:
                said = law.as_written(problem.path), problem.message
                ends.setdefault(said, ([], problem.remedies))[0].append(end)
    for (path, message), (at, remedies) in ends.items():
        which = f"at the {' and '.join(at)} ends, controller '{law.label}' alone"
        problems.add(f"{where}{which}: {path}: {message}", *remedies)


# The folder of a search ---------------------------------------------------------------------------


GENERATIONS = "generations"


_SEEDS = re.compile(r"seeds-(\d+)-(\d+)")

_NUMBERED = files.FilePattern(r"\d+\.yaml", marked=True)


def _entries(kind: Kind, slug: str, *, marked: bool) -> dict[str, files.Entry]:
    """Return the entries that eqt writes in the folder of a search, beside those of the result.

    Parameters
    ----------
    slug
        Regular expression for the slugs of the laws.
    marked
        Whether only a configuration with eqt's mark counts, because a user's file may match the
        name.
    """
    generation = files.FilePattern(r"\d{3,}\.json")
    of_seeds = files.FolderPattern(_SEEDS.pattern, (generation,))
    winners = files.FolderPattern(slug, (*COPY_FOLDERS, files.FilePattern(_NUMBERED.name, marked)))
    run = files.FolderPattern(slug, RESULT_ENTRIES, MANIFEST)
    single = files.FilePattern(rf"({slug})\.yaml", marked)
    entries: tuple[files.Entry, ...] = (*COPY_FOLDERS, single, run if kind.runs else winners)
    return {
        kind.record: files.FilePattern(re.escape(kind.record)),
        GENERATIONS: files.FolderPattern(
            GENERATIONS, (files.FolderPattern(slug, (of_seeds,)), generation)
        ),
        kind.configs: files.FolderPattern(kind.configs, entries),
    }


@dataclass(frozen=True)
class SearchFolder:
    """The folder in which a search keeps its generations and its outcome, with its remarks."""

    path: Path
    kind: Kind
    remarks: tuple[str, ...] = ()

    def write_record(self, record: dict[str, Any]) -> None:
        """Write the record atomically."""
        with files.refusals(self.path, "used", OTHER_FOLDER):
            files.write_record(self.path / self.kind.record, record)

    def groups(self, law: LawSearch, seeds: range) -> list[range]:
        """Return the seeds in groups that share generations: those in the folder, and new ones."""
        groups, first = [], seeds.start
        paths = (self.path / GENERATIONS / law.slug).glob("*")
        matches = filter(None, (_SEEDS.fullmatch(path.name) for path in paths))
        for start, last in sorted((int(match[1]), int(match[2])) for match in matches):
            if start == first and last < seeds.stop:
                groups.append(range(start, first := last + 1))
        return groups + ([range(first, seeds.stop)] if first < seeds.stop else [])

    def generation(self, law: LawSearch, seeds: range, number: int) -> Path:
        """Return the file of one generation of a law."""
        of_search = self.path / GENERATIONS / law.slug / f"seeds-{seeds[0]}-{seeds[-1]}"
        return of_search / f"{number:03d}.json"

    def batch(self, number: int) -> Path:
        """Return the file of a batch of points of all laws and samples."""
        return self.path / GENERATIONS / f"{number:03d}.json"

    def run_of(self, law: LawSearch) -> Path:
        """Return the result folder of the configuration that was found for a law."""
        return self.path / self.kind.configs / law.slug

    def write_configs(
        self, law: LawSearch, studies: Sequence[Study], numbered: bool = False, comment: str = ""
    ) -> None:
        """Write the complete configurations that were found for a law, and remove earlier ones.

        Parameters
        ----------
        numbered
            Whether there may be several.
        comment
            Lines to write above each configuration; each begins with ``#``.
        """
        names = config_files(self.kind, law, len(studies), numbered)
        mark = files.CONFIG_MARK.format(self.kind.command) + comment
        with files.refusals(self.path, "used", OTHER_FOLDER):
            for name, study in zip(names, studies, strict=True):
                path = self.path / name
                path.parent.mkdir(parents=True, exist_ok=True)
                ResultFolder(path.parent).write_config(study, path.name, mark.encode())
            if numbered:
                for path in self.run_of(law).glob("*.yaml"):
                    if path.relative_to(self.path).as_posix() not in names:
                        files.remove_written(path, _NUMBERED)

    def check(self, laws: Sequence[LawSearch]) -> None:
        """Check the folder of a search for these laws before anything in it changes.

        Raises
        ------
        EqtError
            If an entry that eqt would write or remove is a link, or was not written by eqt.
        """
        slugs = "|".join(re.escape(law.slug) for law in laws)
        with files.refusals(self.path, "used", OTHER_FOLDER):
            files.check_entries(
                self.path, (*RESULT_ENTRIES, *_entries(self.kind, slugs, marked=False).values())
            )

    def claim(self, settings: Mapping[str, Any], force: bool) -> None:
        """Claim the folder for the search with these settings.

        Raises
        ------
        EqtError
            If it holds another search or another result, and `force` is false.
        """
        record = self.kind.record_in(self.path)
        entries = _entries(self.kind, r"[A-Za-z0-9._-]+", marked=True)  # those of any law
        there = [name for name in entries if files.kind_of(self.path / name)]
        if there and record is None:
            raise EqtError(f"{self.path}: holds {there[0]} that eqt did not write", OTHER_FOLDER)
        other = record is not None and record["digest"] != settings["digest"]
        result = record is None and bool(ResultFolder(self.path).manifest)
        if (other or result) and not force:
            foreign = f"a result that eqt {self.kind.command} did not write"
            holds = f"another {self.kind.title}" if other else foreign
            # Generations are not to be computed twice, so nobody is told how to remove them.
            force_too = [] if other else [Remedy("replace it with {}", "force")]
            raise EqtError(f"{self.path}: holds {holds}", OTHER_FOLDER, *force_too)
        with files.refusals(self.path, "used", OTHER_FOLDER):
            if force:
                for entry in (GENERATIONS, self.kind.configs):
                    files.remove_written(self.path / entry, entries[entry])
            files.remove_left_over(self.path, list(entries.values()))
        if force or record is None:
            self.write_record({key: settings[key] for key in ("name", "digest", "engine")})


def config_files(kind: Kind, law: LawSearch, count: int, numbered: bool = False) -> list[str]:
    """Return the names of the configurations that were found for a law."""
    if not numbered:
        return [f"{kind.configs}/{law.slug}.yaml"] * count
    return [f"{kind.configs}/{law.slug}/{k + 1}.yaml" for k in range(count)]
