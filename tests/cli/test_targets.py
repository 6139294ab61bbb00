"""Where reports, animations and figures may be written: never over what eqt did not write."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

Eqt = Callable[..., Any]

FOREIGN = "exists, and is no file that eqt wrote; choose another place with --out"


@pytest.fixture
def result(eqt: Callable[..., Any]) -> Path:
    """A result in the folder `out`."""
    eqt("run", "c.yaml", "--out", "out", "--quiet")
    return Path("out")


@pytest.fixture
def _no_work(monkeypatch: pytest.MonkeyPatch) -> None:
    """Targets are refused before any work: verifying, drawing or reading curves."""

    def work(*_: object, **__: object) -> None:
        raise AssertionError("worked before the target was checked")

    monkeypatch.setattr("eqt_cli.analysis.verification.verify_stored", work)
    monkeypatch.setattr("eqt_cli.report.report", work)
    monkeypatch.setattr("eqt_cli.plots.animation.gif.gif", work)
    monkeypatch.setattr("eqt_cli.report.animation.animation", work)
    monkeypatch.setattr("eqt_cli.plots.render.render", work)


@pytest.mark.usefixtures("_no_work")
@pytest.mark.parametrize("name", ["out/results.h5", "c.yaml", "mine.html"])
def test_a_report_replaces_no_file_of_others(eqt: Eqt, result: Path, name: str) -> None:
    Path("mine.html").write_text("<!DOCTYPE html>\n<title>eqt</title>\n", encoding="utf-8")
    path = Path(name)
    before = path.read_bytes()
    done = eqt("report", result, "--out", name)
    assert (done.code, done.out, done.err) == (2, "", f"eqt: {path}: {FOREIGN}\n")
    assert path.read_bytes() == before


@pytest.mark.usefixtures("_no_work")
@pytest.mark.parametrize("name", [".", "out"])
def test_a_report_is_a_file_and_no_folder(eqt: Eqt, result: Path, name: str) -> None:
    done = eqt("report", result, "--out", name)
    example = Path(name) / "report.html"
    expected = f"eqt: {name}: is a folder; expected a file, such as {example}\n"
    assert (done.code, done.err) == (2, expected)


@pytest.mark.usefixtures("_no_work")
def test_an_animation_replaces_no_file_of_others(eqt: Eqt, result: Path) -> None:
    path = result / "figures" / "run0.gif"
    path.parent.mkdir()
    path.write_bytes(b"GIF89a of mine")
    done = eqt("animate", result)
    assert (done.code, done.err) == (2, f"eqt: {path}: {FOREIGN}\n")


@pytest.mark.usefixtures("_no_work")
def test_a_figure_replaces_no_file_of_others(eqt: Eqt, result: Path) -> None:
    path = result / "figures" / "torque.svg"
    path.parent.mkdir()
    path.write_text('<?xml version="1.0"?><svg/>', encoding="utf-8")
    done = eqt("plot", result, "--figure", "paper", "--figure", "torque")
    assert (done.code, done.err) == (2, f"eqt: {path}: {FOREIGN}\n")


@pytest.mark.slow("writes two reports and two animations")
@pytest.mark.usefixtures("unarranged")
def test_reports_and_animations_are_replaced(eqt: Eqt, result: Path) -> None:
    for _ in range(2):
        assert eqt("report", result, "--figure", "paper").code == 0
        assert eqt("animate", result, "--seconds", 0.2, "--quiet").code == 0
