"""The folder of a result: what it holds, whose it is, and that nothing in it is lost."""

import shutil
from collections.abc import Mapping
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.config.yaml_source import dump
from eqt_cli.core.errors import OTHER_FOLDER, START_OVER, EqtError, Remedy
from eqt_cli.core.files import read_record, refusals, replace_file, write_record
from eqt_cli.core.own_files import is_eqts
from eqt_cli.core.problems import KeyPath, dotted
from eqt_cli.core.validation import shown
from eqt_cli.execution.lock import LOCK
from eqt_cli.execution.part_files import MANIFEST, PARTS, PartFiles
from eqt_cli.experiment.study import Study
from eqt_cli.store.reserved_names import FILE_NAME

CONFIG, FIGURES, PLUGINS, REPORT = "config.yaml", "figures", "stored_plugins", "report.html"
FILES = "stored_files"
_OURS = (FILE_NAME, PARTS, FIGURES, PLUGINS, FILES, REPORT, CONFIG, MANIFEST)

MOST_NAMES = 3
"""Of other results in a folder, in a message."""


@dataclass(frozen=True)
class ResultFolder:
    """The folder that one experiment writes to."""

    path: Path

    @property
    def results(self) -> Path:
        """The result file."""
        return self.path / FILE_NAME

    @property
    def parts(self) -> PartFiles:
        """The finished parts."""
        return PartFiles(self.path.resolve() / PARTS)  # workers may be elsewhere

    @property
    def manifest(self) -> dict[str, Any] | None:
        """What the folder's last experiment was; None if it holds none."""
        with self._refusals():
            return read_record(self.path / MANIFEST, "digest")

    def is_complete(self, study: Study) -> bool:
        """Whether the folder already holds the finished results of this very experiment."""
        return (self.manifest or {}).get("digest") == study.digest and self.results.exists()

    @property
    def is_tidy(self) -> bool:
        """Whether the process that packed the result came to its end."""
        left = (self.parts.folder, self.path / LOCK)
        return "finished" in (self.manifest or {}) and not any(path.exists() for path in left)

    def claim(self, study: Study, manifest: dict[str, Any], force: bool) -> list[str]:
        """Make the folder this experiment's own; returns what was removed from it.

        Raises
        ------
        EqtError
            If it holds results of another experiment and `force` is not given, or files that are
            not eqt's. What was begun and left without results is replaced.
        """
        with self._refusals():
            removed = self._clear(study, force)
            self.path.mkdir(parents=True, exist_ok=True)
            # First, so that what follows is known as eqt's own, whenever this process may die.
            write_record(self.path / MANIFEST, manifest)
            self.write_config(study)
            self.parts.folder.mkdir(exist_ok=True)
        return removed

    def write_config(self, study: Study, name: str = CONFIG) -> None:
        """Write the complete configuration, with what it refers to beside it."""
        plugins = self._copied(PLUGINS, study.base.plugins)
        files = self._copied(FILES, study.files, ".csv")
        data = _renamed(study.resolved, files) | {"plugins": list(plugins.values())}
        replace_file(self.path / name, dump(data).encode())

    def tidy(self) -> None:
        """Remove what killed processes left unfinished."""
        for path in self.path.glob("*.tmp"):
            path.unlink(missing_ok=True)
        self.parts.tidy()

    def finish(self, manifest: dict[str, Any]) -> None:
        """Write down how the run went, and remove the parts, which the result file holds."""
        with self._refusals():
            write_record(self.path / MANIFEST, manifest)
            shutil.rmtree(self.parts.folder, ignore_errors=True)

    def _refusals(self) -> AbstractContextManager[None]:
        return refusals(self.path, "used", OTHER_FOLDER)

    def _clear(self, study: Study, force: bool) -> list[str]:
        ours = [self.path / name for name in _OURS]
        there = [entry for entry in ours if entry.exists()]
        manifest = self.manifest
        if there and manifest is None:
            raise EqtError(
                f"{self.path}: holds {there[0].name} that eqt did not write", OTHER_FOLDER
            )
        if not there and (others := _results_in(self.path)):
            own = f"give this one a folder of its own with {{}}, such as {self.path / study.name}"
            raise EqtError(
                f"{self.path}: is the folder of other results: {', '.join(others)}",
                Remedy(own, "out"),
            )
        other = manifest if manifest and manifest["digest"] != study.digest else None
        begun = bool(self.parts.listed())
        precious = begun or self.results.exists() or (self.path / FIGURES).exists()
        if other is not None and precious and not force:
            keys = _differences(other.get("config", {}), study.numeric_config)
            raise EqtError(
                f"{self.path}: holds another experiment, which differs in",
                OTHER_FOLDER,
                Remedy("replace it with {}", "force"),
                lines=[f"  {line}" for line in keys],
            )
        if begun and not force and (manifest or {}).get("plan") != study.plans.data:
            raise EqtError(
                f"{self.path}: was begun by another version of eqt, which cuts runs differently",
                Remedy("finish with that version"),
                START_OVER,
            )
        if other is None and not force:
            return []
        removed = [path for entry in there for path in _removed(entry)]
        return [str(path) for path in removed] if force else []

    def _copied(self, folder: str, texts: Mapping[str, str], suffix: str = "") -> dict[str, str]:
        """Keep what a configuration refers to, so that the folder runs again wherever it is.

        Returns the new paths by the old ones.
        """
        copies = {}
        for index, (path, text) in enumerate(texts.items()):
            name = Path(path).stem + suffix if suffix else Path(path).name
            copies[path] = f"{folder}/{index}-{name}"
            (self.path / folder).mkdir(exist_ok=True)
            replace_file(self.path / copies[path], text.encode())
        return copies


def _renamed(data: Any, names: dict[str, str]) -> Any:
    """The same with files under other names."""
    if isinstance(data, dict):
        return {key: _renamed(value, names) for key, value in data.items()}
    if isinstance(data, list):
        return [_renamed(value, names) for value in data]
    return names.get(data, data) if isinstance(data, str) else data


def _results_in(folder: Path) -> list[str]:
    """The names of the results that a folder holds in folders of their own; the first few."""
    found = sorted(path.parent.name for path in folder.glob(f"*/{MANIFEST}"))
    return [*found[:MOST_NAMES], "…"] if len(found) > MOST_NAMES else found


def _removed(entry: Path) -> list[Path]:
    """Remove one of eqt's own entries, but nothing that others put there; returns what is gone.

    People keep drawings of their own among the figures, and may have replaced the report. All other
    entries are eqt's as a whole.
    """
    if entry.name not in (FIGURES, REPORT):
        shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        return [entry]
    within = sorted(entry.rglob("*"), reverse=True) if entry.is_dir() else []
    files = [path for path in [*within, entry] if path.is_symlink() or not path.is_dir()]
    ours = [path for path in files if not path.is_symlink() and is_eqts(path)]
    for path in ours:
        path.unlink()
    for folder in [path for path in [*within, entry] if path.is_dir() and not path.is_symlink()]:
        if not any(folder.iterdir()):
            folder.rmdir()
    return ours[::-1] if entry.exists() else [entry]


_ABSENT = object()


def _differences(old: Any, new: Any, path: KeyPath = ()) -> list[str]:
    """The keys in which two configurations differ, with both values."""
    pairs: dict[str | int, tuple[Any, Any]] = {}
    if isinstance(old, dict) and isinstance(new, dict):
        pairs = {key: (old.get(key, _ABSENT), new.get(key, _ABSENT)) for key in {**new, **old}}
    elif isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        pairs = dict(enumerate(zip(old, new, strict=True)))
    elif old != new:
        return [f"{dotted(path)}: {_given(old)} there, {_given(new)} here"]
    return [line for key, pair in pairs.items() for line in _differences(*pair, (*path, key))]


def _given(value: Any) -> str:
    return "not given" if value is _ABSENT else shown(value)
