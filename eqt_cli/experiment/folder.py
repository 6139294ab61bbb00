"""The folder of a result: what it holds, whose it is, and that nothing in it is lost."""

from __future__ import annotations

import json
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.translate import Path as Steps
from eqt_cli.experiment.translate import shown
from eqt_cli.experiment.yaml_source import dotted, dump

RESULTS, MANIFEST, CONFIG = "results.h5", "manifest.json", "config.yaml"
FIGURES, PLUGINS, REPORT = "figures", "stored_plugins", "report.html"
_OURS = (RESULTS, MANIFEST, CONFIG, FIGURES, PLUGINS, REPORT)


@dataclass(frozen=True)
class ResultFolder:
    """The folder that one experiment writes to."""

    path: Path

    @property
    def results(self) -> Path:
        """The result file."""
        return self.path / RESULTS

    @property
    def manifest(self) -> dict[str, Any] | None:
        """What the folder's last experiment was; None if it holds none."""
        try:
            text = (self.path / MANIFEST).read_text(encoding="utf-8")
        except FileNotFoundError:
            return None
        except OSError as error:
            raise _refused(self.path, error) from error
        try:
            manifest: dict[str, Any] = json.loads(text)
            return manifest if "digest" in manifest else None
        except (ValueError, TypeError):
            return None

    def is_complete(self, experiment: Experiment) -> bool:
        """Whether the folder already holds the finished results of this very experiment."""
        manifest = self.manifest
        same = manifest is not None and manifest["digest"] == experiment.digest
        return same and self.results.exists()

    def claim(self, experiment: Experiment, manifest: dict[str, Any], force: bool) -> list[str]:
        """Make the folder this experiment's own; returns what was removed from it.

        Raises
        ------
        EqtError
            If it holds results of another experiment and `force` is not given, or files that are
            not eqt's. What was begun and left without results is replaced.
        """
        try:
            removed = self._clear(experiment, force)
            self.path.mkdir(parents=True, exist_ok=True)
            plugins = self._copy_plugins(experiment)
            _write(self.path / CONFIG, dump(experiment.resolved | {"plugins": plugins}))
            _write(self.path / MANIFEST, json.dumps(manifest, indent=2, ensure_ascii=False) + "\n")
        except OSError as error:
            raise _refused(self.path, error) from error
        return removed

    def finish(self, manifest: dict[str, Any]) -> None:
        """Write down how the run went."""
        try:
            _write(self.path / MANIFEST, json.dumps(manifest, indent=2, ensure_ascii=False) + "\n")
        except OSError as error:
            raise _refused(self.path, error) from error

    def _clear(self, experiment: Experiment, force: bool) -> list[str]:
        ours = [self.path / name for name in _OURS]
        there = [entry for entry in ours if entry.exists()]
        manifest = self.manifest
        if there and manifest is None:
            raise EqtError(
                f"{self.path}: holds {there[0].name} that eqt did not write; "
                "choose another folder with --out"
            )
        other = manifest if manifest and manifest["digest"] != experiment.digest else None
        precious = self.results.exists() or (self.path / FIGURES).exists()
        if other is not None and precious and not force:
            keys = _differences(other.get("config", {}), experiment.numeric_config)
            raise EqtError(
                f"{self.path}: holds another experiment, which differs in\n"
                + "\n".join(f"  {line}" for line in keys)
                + "\nchoose another folder with --out, or replace it with --force"
            )
        if other is None and not force:
            return []
        for entry in there:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        return [str(entry) for entry in there] if force else []

    def _copy_plugins(self, experiment: Experiment) -> list[str]:
        """Keep the sources, so that the folder runs again wherever it is; returns their paths."""
        copies = []
        for index, (path, text) in enumerate(experiment.plugins.items()):
            copy = f"{PLUGINS}/{index}-{Path(path).name}"
            (self.path / PLUGINS).mkdir(exist_ok=True)
            _write(self.path / copy, text)
            copies.append(copy)
        return copies


_ABSENT = object()


def _differences(old: Any, new: Any, path: Steps = ()) -> list[str]:
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


def _write(path: Path, text: str) -> None:
    """Replace a small text file in one step."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def _refused(path: Path, error: OSError) -> EqtError:
    reason = (error.strerror or str(error)).lower()
    return EqtError(f"{path}: cannot be used: {reason}; choose another folder with --out")
