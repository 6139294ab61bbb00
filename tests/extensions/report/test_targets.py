"""Where reports and animations may be written: never over what eqt did not write."""

from pathlib import Path

import pytest

FOREIGN = "exists, but eqt did not write it; choose another place with --out"


@pytest.fixture
def _no_work(monkeypatch):
    """Targets are refused before any work: verifying and drawing."""

    def work(*_, **__):
        raise AssertionError("worked before the target was checked")

    monkeypatch.setattr("eqt_cli.extensions.proofs.verification.verify_stored", work)
    monkeypatch.setattr("eqt_cli.extensions.report.document.report", work)
    monkeypatch.setattr("eqt_cli.extensions.report.scenes.gif", work)


@pytest.mark.usefixtures("_no_work")
@pytest.mark.parametrize("name", ["out/results.h5", "c.yaml", "mine.html"])
def test_a_report_replaces_no_file_of_others(refused, result, name):
    Path("mine.html").write_text("<!DOCTYPE html>\n<title>eqt</title>\n", encoding="utf-8")
    before = Path(name).read_bytes()
    assert refused("report", result, "--out", name) == f"{Path(name)}: {FOREIGN}\n"
    assert Path(name).read_bytes() == before


@pytest.mark.usefixtures("_no_work")
@pytest.mark.parametrize("name", [".", "out"])
def test_a_report_is_a_file_and_no_folder(refused, result, name):
    example = Path(name) / "report.html"
    expected = f"{name}: is a folder; expected a file, such as {example}\n"
    assert refused("report", result, "--out", name) == expected


@pytest.mark.usefixtures("_no_work")
def test_an_animation_replaces_no_file_of_others(refused, result):
    path = Path("out/figures/run0.gif")
    path.parent.mkdir()
    path.write_text("GIF89a of mine", encoding="utf-8")
    assert refused("animate", result) == f"{path}: {FOREIGN}\n"


@pytest.mark.ci("writes two reports and two animations")
@pytest.mark.usefixtures("unarranged")
def test_reports_and_animations_are_replaced(eqt, result):
    for _ in range(2):
        assert eqt("report", result, "--figure", "paper").code == 0
        assert eqt("animate", result, "--seconds", 0.2, "--quiet").code == 0
