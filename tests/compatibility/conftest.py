"""What users of the first version have: plugins, configurations, results and what was said of them.

`first_version/make_results.py` wrote the results, with that version.
"""

from __future__ import annotations

import json
import math
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from eqt_cli.cli import main
from eqt_cli.config.catalogue import KINDS, registry
from eqt_cli.core import registry as registries
from eqt_cli.core.registry import load_plugin

HERE = Path(__file__).parent / "first_version"


@pytest.fixture(autouse=True)
def _alone(monkeypatch: pytest.MonkeyPatch) -> None:
    """No plugin of another test is known, and nothing is printed while a command works."""
    monkeypatch.setattr(registries, "_loaded_plugins", {})
    for kind in KINDS:
        monkeypatch.setattr(registry(kind), "_plugins", {})
    monkeypatch.setattr("eqt_cli.cli.shared.progress.SHOW_AFTER", math.inf)


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A copy of everything, as the current folder."""
    copy = tmp_path / "first_version"
    shutil.copytree(HERE, copy)
    monkeypatch.chdir(copy)
    return copy


@pytest.fixture
def plugins(here: Path) -> Callable[..., list[str]]:
    """Load plugins by the names of their files, or all; returns what they define."""

    def load(*names: str) -> list[str]:
        paths = sorted((here / "plugins").glob("*.py"))
        return [one for p in paths if not names or p.stem in names for one in load_plugin(p)]

    return load


@pytest.fixture
def eqt(
    here: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> Callable[..., tuple[int, str, str]]:
    """Call the command within this process."""

    def call(*arguments: Any) -> tuple[int, str, str]:
        monkeypatch.setattr(sys, "argv", ["eqt", *map(str, arguments)])
        monkeypatch.setattr(sys.modules["__main__"], "__package__", None)
        with pytest.raises(SystemExit) as end:
            main()
        out, err = capsys.readouterr()
        return int(end.value.code or 0), out, err

    return call


# Rounding on another machine, as steps of adaptive length carry it on.
CLOSE = 1e-6


def differences(then: Any, now: Any, place: str = "") -> list[str]:
    """What a document had then and has not now; it may have gained entries."""
    if isinstance(then, dict) and isinstance(now, dict):
        lost = [f"{place}.{key}: gone" for key in then if key not in now]
        both = [differences(then[key], now[key], f"{place}.{key}") for key in then if key in now]
        return lost + [one for found in both for one in found]
    if isinstance(then, list) and isinstance(now, list) and len(then) == len(now):
        pairs = enumerate(zip(then, now, strict=True))
        return [one for k, (a, b) in pairs for one in differences(a, b, f"{place}[{k}]")]
    numbers = all(isinstance(x, int | float) and not isinstance(x, bool) for x in (then, now))
    if numbers and math.isclose(then, now, rel_tol=CLOSE, abs_tol=1e-9):
        return []
    return [] if then == now else [f"{place}: {str(then)[:80]} is now {str(now)[:80]}"]


@pytest.fixture
def unlike() -> Callable[[Any, Any], list[str]]:
    return differences


@pytest.fixture
def kept(here: Path) -> Callable[[str], Any]:
    """A document of the first version."""
    return lambda name: json.loads((here / "documents" / f"{name}.json").read_text())
