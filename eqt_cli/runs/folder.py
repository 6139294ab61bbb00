"""The folder of a result: its files, the experiment it belongs to, and the rules for removal."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import OTHER_FOLDER, EqtError, FullDiskError, KeyPath, Remedy, dotted
from eqt_cli.base.files import (
    FIGURES,
    FILE_NAME,
    NO_SPACE,
    REPORT,
    Entry,
    FilePattern,
    FolderPattern,
    check_entries,
    kind_of,
    read_record,
    refusals,
    remove_left_over,
    remove_written,
    replace_file,
    write_record,
)
from eqt_cli.base.option_types import shown
from eqt_cli.base.yaml_source import dump
from eqt_cli.config.experiment import renamed
from eqt_cli.config.study import Study
from eqt_cli.runs.lock import LOCK, MANIFEST, PART_ENTRIES, PARTS, PartFiles

CONFIG, PLUGINS, FILES = "config.yaml", "stored_plugins", "stored_files"
RERUN = "reruns"
"""Folder for the parts of failed runs that are computed again."""

_PICTURES = (FilePattern(r".+\.(pdf|svg|png|json|gif|html)", marked=True),)
COPY_FOLDERS = tuple(FolderPattern(name, (FilePattern(r"\d+-.+"),)) for name in (PLUGINS, FILES))
"""Copies of the files that a configuration refers to."""

_ENTRIES: dict[str, Entry] = {
    FILE_NAME: FilePattern(re.escape(FILE_NAME)),
    PARTS: FolderPattern(PARTS, PART_ENTRIES),
    RERUN: FolderPattern(RERUN, PART_ENTRIES),
    FIGURES: FolderPattern(FIGURES, (FolderPattern(r"point(_\d+)+", _PICTURES), *_PICTURES)),
    **{one.name: one for one in COPY_FOLDERS},
    REPORT: FilePattern(re.escape(REPORT), marked=True),
    CONFIG: FilePattern(re.escape(CONFIG)),
    MANIFEST: FilePattern(re.escape(MANIFEST)),
}
"""Entries that eqt writes in a result folder, in the order of their removal."""

RESULT_ENTRIES: tuple[Entry, ...] = (*_ENTRIES.values(), FilePattern(re.escape(LOCK) + "(-.+)?"))
"""The same entries, and the locks."""

MOST_NAMES = 3
"""Largest number of other results that a message names."""


@dataclass(frozen=True)
class ResultFolder:
    """The folder to which one experiment writes."""

    path: Path

    @property
    def results(self) -> Path:
        """The result file."""
        return self.path / FILE_NAME

    @property
    def parts(self) -> PartFiles:
        """The finished parts."""
        return PartFiles(self.path.resolve() / PARTS)  # workers may have another working directory

    @property
    def manifest(self) -> dict[str, Any] | None:
        """Record of the folder's last experiment; None if there is none."""
        with self._refusals():
            return read_record(self.path / MANIFEST, "digest")

    def is_complete(self, study: Study) -> bool:
        """Whether the folder holds the complete result of this study."""
        return (self.manifest or {}).get("digest") == study.digest and self.results.exists()

    def finished_runs(self, study: Study) -> int:
        """Return the number of a study's runs in finished parts."""
        if (self.manifest or {}).get("digest") != study.digest:
            return 0
        return sum(study.plans.runs_of(n) for n in self.parts.listed() if n < len(study.plans))

    @contextmanager
    def reporting_finished_runs(self, study: Study) -> Iterator[None]:
        """Add to an error of a full disk how many runs are saved, and how to continue."""
        try:
            yield
        except EqtError as error:
            cause = error.__cause__
            full = isinstance(cause, OSError) and cause.errno in NO_SPACE
            if not full and not isinstance(error, FullDiskError):
                raise
            finished, total = self.finished_runs(study), study.plans.total
            if not finished:
                raise
            again = Remedy("free some space and run the same command again")
            elsewhere = Remedy("move the folder to another disk and name it with {}", "out")
            if finished == total:
                again = Remedy(f"free some space and run `eqt pack {self.path}`")
                elsewhere = Remedy("move the folder to another disk and run `eqt pack` there")
            message = f"{error.args[0]}; {finished} of {total} runs are kept in {self.path}"
            raise FullDiskError(message, again, elsewhere) from error

    @property
    def is_tidy(self) -> bool:
        """Whether the process that packed the result also finished."""
        left = self.parts.listed() or kind_of(self.path / LOCK)
        return "finished" in (self.manifest or {}) and not left

    def check(self) -> None:
        """Check the folder before anything in it changes.

        Raises
        ------
        EqtError
            If an entry that eqt would write or remove is a link, or was not written by eqt.
        """
        with self._refusals():
            check_entries(self.path, RESULT_ENTRIES)

    def claim(self, study: Study, manifest: dict[str, Any], force: bool) -> list[str]:
        """Claim the folder for this study; return the names of removed entries.

        Raises
        ------
        EqtError
            If it holds results of another experiment and `force` is false, or files that eqt did
            not write. An experiment that was begun and has no results yet is replaced.
        """
        with self._refusals():
            removed = self._clear(study, force)
            self.path.mkdir(parents=True, exist_ok=True)
            # The manifest comes first: it marks the folder as eqt's if this process dies.
            write_record(self.path / MANIFEST, manifest)
            self.write_config(study)
            self.parts.folder.mkdir(exist_ok=True)
        return removed

    def write_config(self, study: Study, name: str = CONFIG, mark: bytes = b"") -> None:
        """Write the complete configuration below a mark, and copies of the files it refers to."""
        plugins = self._copied(PLUGINS, study.base.plugins)
        files = self._copied(FILES, study.files, ".csv")
        data = renamed(study.resolved, files | plugins)
        replace_file(self.path / name, mark + dump(data).encode())

    def tidy(self) -> None:
        """Remove unfinished files of killed processes."""
        remove_left_over(self.path, RESULT_ENTRIES)
        self.parts.tidy()

    def remove(self, name: str) -> list[Path]:
        """Remove what eqt wrote under a name, and nothing else; return the removed paths."""
        return remove_written(self.path / name, _ENTRIES[name])

    def finish(self, manifest: dict[str, Any]) -> None:
        """Write the final manifest, and remove the parts, which the result file now holds."""
        with self._refusals():
            write_record(self.path / MANIFEST, manifest)
            with suppress(OSError):  # the result is complete even if parts remain
                self.remove(PARTS)

    def _refusals(self) -> AbstractContextManager[None]:
        return refusals(self.path, "used", OTHER_FOLDER)

    def _clear(self, study: Study, force: bool) -> list[str]:
        existing = [name for name in _ENTRIES if kind_of(self.path / name)]
        manifest = self.manifest
        if existing and manifest is None:
            raise EqtError(f"{self.path}: holds {existing[0]} that eqt did not write", OTHER_FOLDER)
        if not existing and (others := _results_in(self.path)):
            hint = f"give this one a folder of its own with {{}}, such as {self.path / study.name}"
            raise EqtError(
                f"{self.path}: is the folder of other results: {', '.join(others)}",
                Remedy(hint, "out"),
            )
        other = manifest if manifest and manifest["digest"] != study.digest else None
        begun = bool(self.parts.listed())
        precious = begun or self.results.exists() or (self.path / FIGURES).exists()
        if other is not None and precious and not force:
            # Parts are not to be computed twice, so nobody is told how to remove them.
            ways = () if begun else (Remedy("replace it with {}", "force"),)
            raise self.of_another(study, OTHER_FOLDER, *ways)
        if begun and not force and (manifest or {}).get("plan") != study.plans.data:
            raise EqtError(
                f"{self.path}: was begun by a version of eqt that divides the runs differently",
                Remedy("finish with that version"),
                OTHER_FOLDER,
            )
        if other is None and not force:
            return []
        removed = [path for name in existing for path in self.remove(name)]
        return [str(path) for path in removed] if force else []

    def of_another(self, study: Study, *remedies: Remedy) -> EqtError:
        """Return the error that the folder holds another experiment, with the differences."""
        keys = _differences((self.manifest or {}).get("config", {}), study.numeric_config)
        message = f"{self.path}: holds another experiment, which differs in"
        return EqtError(message, *remedies, lines=[f"  {key}" for key in keys])

    def _copied(self, folder: str, texts: Mapping[str, str], suffix: str = "") -> dict[str, str]:
        """Copy the files that a configuration refers to, so that the folder can be moved.

        Returns the new paths by the old ones.
        """
        copies = {}
        for index, (path, text) in enumerate(texts.items()):
            name = Path(path).stem + suffix if suffix else Path(path).name
            copies[path] = f"{folder}/{index}-{name}"
            (self.path / folder).mkdir(exist_ok=True)
            replace_file(self.path / copies[path], text.encode())
        return copies


def _results_in(folder: Path) -> list[str]:
    """Return the names of the first few results in subfolders of a folder."""
    names = sorted(path.parent.name for path in folder.glob(f"*/{MANIFEST}"))
    return [*names[:MOST_NAMES], "…"] if len(names) > MOST_NAMES else names


_ABSENT = object()


def _differences(old: Any, new: Any, path: KeyPath = ()) -> list[str]:
    """Return lines with the keys in which two configurations differ, and both values."""
    pairs: dict[str | int, tuple[Any, Any]] = {}
    if isinstance(old, dict) and isinstance(new, dict):
        pairs = {key: (old.get(key, _ABSENT), new.get(key, _ABSENT)) for key in {**new, **old}}
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = dict(enumerate(zip(old, new, strict=True)))
    elif old != new:
        return [f"{dotted(path)}: {_value_text(old)} there, {_value_text(new)} here"]
    return [line for key, pair in pairs.items() for line in _differences(*pair, (*path, key))]


def _value_text(value: Any) -> str:
    return "not given" if value is _ABSENT else shown(value)
