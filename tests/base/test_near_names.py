"""What is suggested for a path that is not there."""

from __future__ import annotations

from pathlib import Path

import pytest

from eqt_cli.base.files import near


@pytest.fixture(autouse=True)
def _here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("results/sat", "results/paper", "other"):
        Path(folder).mkdir(parents=True)


@pytest.mark.parametrize("given", ["results/sta", "sat", "Sat", "results/satt"])
def test_the_closest_name_is_suggested(given: str) -> None:
    assert near(Path(given), Path.is_dir) == f"; did you mean '{Path('results/sat')}'?"


def test_only_what_fits_is_suggested() -> None:
    assert near(Path("results/sta"), Path.is_file) == ""


def test_nothing_is_suggested_for_a_name_like_none() -> None:
    assert near(Path("results/quite different"), Path.is_dir) == ""
    assert near(Path("no/folder/x"), Path.is_dir) == ""
