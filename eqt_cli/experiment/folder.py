"""The folder of a result: what it holds, whose it is, and that nothing in it is lost."""

from __future__ import annotations

import json
import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from eqt_cli.core.errors import EqtError
from eqt_cli.experiment.build import Experiment
from eqt_cli.experiment.source import ConfigSource
from eqt_cli.experiment.translate import shown
from eqt_cli.experiment.yaml_source import dump

RESULTS, MANIFEST, CONFIG, FIGURES = "results.h5", "manifest.json", "config.yaml", "figures"


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
            raise _refused(self.path / MANIFEST, error) from error
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

    def claim(
        self, experiment: Experiment, source: ConfigSource, manifest: dict[str, Any], force: bool
    ) -> list[str]:
        """Make the folder this experiment's own; returns what was removed from it.

        Raises
        ------
        EqtError
            If it holds another experiment and `force` is not given, or files that are not eqt's.
        """
        removed = self._clear(experiment, force)
        try:
            self.path.mkdir(parents=True, exist_ok=True)
            _write(self.path / CONFIG, dump(self._relocated(experiment, source)))
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
        ours = [self.path / name for name in (RESULTS, MANIFEST, CONFIG, FIGURES)]
        there = [entry for entry in ours if entry.exists()]
        manifest = self.manifest
        if there and manifest is None:
            raise EqtError(
                f"{self.path}: holds {there[0].name} that eqt did not write; "
                "choose another folder with --out"
            )
        if manifest is not None and manifest["digest"] != experiment.digest and not force:
            keys = _differences(manifest.get("config", {}), experiment.numeric_config)
            raise EqtError(
                f"{self.path}: holds another experiment, which differs in\n"
                + "\n".join(f"  {line}" for line in keys)
                + "\nchoose another folder with --out, or replace it with --force"
            )
        if not force:
            return []
        for entry in there:
            shutil.rmtree(entry) if entry.is_dir() else entry.unlink()
        return [str(entry) for entry in there]

    def _relocated(self, experiment: Experiment, source: ConfigSource) -> dict[str, Any]:
        """The resolved configuration with plugin paths as seen from this folder."""
        config = dict(experiment.resolved)
        if config.get("plugins"):
            config["plugins"] = [
                os.path.relpath(source.folder / path, self.path) for path in config["plugins"]
            ]
        return config


def _differences(old: Any, new: Any, path: str = "") -> list[str]:
    """The keys in which two configurations differ, with both values."""
    if isinstance(old, dict) and isinstance(new, dict):
        found = []
        for key in [*new, *(key for key in old if key not in new)]:
            inner = f"{path}.{key}" if path else str(key)
            found += _differences(old.get(key), new.get(key), inner)
        return found
    return [] if old == new else [f"{path}: {shown(old)} there, {shown(new)} here"]


def _write(path: Path, text: str) -> None:
    """Replace a small text file in one step."""
    temporary = path.with_name(path.name + ".tmp")
    temporary.write_text(text, encoding="utf-8")
    temporary.replace(path)


def _refused(path: Path, error: OSError) -> EqtError:
    reason = (error.strerror or str(error)).lower()
    return EqtError(f"{path}: cannot be used: {reason}; choose another folder with --out")
