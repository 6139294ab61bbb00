"""Writing figures, and what a command gives to `render`."""

import re
import xml.etree.ElementTree as ElementTree

import pytest
from case_tables import from_yaml
from PIL import Image
from said import error_of

from eqt_cli.base.errors import EqtError
from eqt_cli.base.files import is_eqts, write_all
from eqt_cli.figures.render import encode, figure_from, render
from eqt_cli.figures.time_figures import Summary

pytestmark = pytest.mark.usefixtures("unarranged")


def test_files_say_what_they_show(so3, opened, picture):
    drawing = picture(Summary(), opened(so3))
    pdf = encode(drawing, "pdf", "small: summary", "Means\x01over runs.")
    assert b"(small: summary)" in pdf
    assert b"(Means over runs.)" in pdf
    assert b"Date" not in pdf
    svg = ElementTree.fromstring(encode(drawing, "svg", "small: summary", "Means\x01over runs."))
    texts = [(element.tag.rpartition("}")[2], element.text) for element in svg.iter()]
    assert ("title", "small: summary") in texts
    assert ("description", "Means over runs.") in texts
    assert "date" not in dict(texts)


def test_figures_are_known_as_eqts_and_png_is_for_print(so3, opened, tmp_path):
    paths = render([opened(so3)], "summary", tmp_path, ["pdf", "svg", "png", "json"], "column")
    assert len(paths) == 4
    assert [path.name for path in paths if not is_eqts(path)] == []
    with Image.open(paths[2]) as image:
        assert image.width == 1050  # 3.5 in at 300 dpi
        assert image.info["Title"] == "small: summary"
        assert image.info["Description"].startswith("Medians over runs of pose error")
        assert image.info["Description"].endswith(str(opened(so3).attributes["digest"]))


@pytest.mark.ci("writes every format")
def test_a_slide_is_13_inches_wide_but_as_pdf(so3, opened, tmp_path):
    files = render([opened(so3)], "summary", tmp_path, ["png", "svg", "pdf"], "slide", caption=True)
    with Image.open(files[0]) as image:
        assert (image.width, round(image.info["dpi"][0])) == (3990, 300)  # 13.3 in
    assert b'width="957.6pt"' in files[1].read_bytes()[:600]
    assert re.search(rb"/MediaBox \[ 0 0 425.6 [0-9.]+ \]", files[2].read_bytes())  # to be enlarged
    assert b"DejaVuSans" in files[2].read_bytes() and b"STIXGeneral" not in files[2].read_bytes()
    assert files[3].read_bytes() == (
        b"% caption by eqt: small: summary\nCurves: median over 6 runs; bands: quartiles.%\n"
    )
    assert is_eqts(files[3])


def test_pdf_embeds_fonts_that_can_be_edited(so3, opened, picture):
    pdf = encode(picture(Summary(), opened(so3)), "pdf")
    assert b"/CIDFontType2" in pdf
    assert b"/Type3" not in pdf


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "figures" / "summary.pdf"
    assert error_of(write_all, {path: b"new"}, tmp_path) == (
        f"{tmp_path / 'file'}: is a file; expected a folder that eqt wrote, or no such entry; "
        "rename or remove it"
    )


def test_a_file_that_cannot_be_replaced_stays_and_nothing_is_left_behind(tmp_path):
    blocked = tmp_path / "summary.pdf"
    blocked.mkdir()
    (blocked / "inside").write_text("")
    assert error_of(write_all, {blocked: b"new"}, tmp_path) == (
        f"{blocked}: is a folder; expected a file, such as {blocked / 'report.html'}"
    )
    assert list(tmp_path.iterdir()) == [blocked]


def test_files_are_replaced(tmp_path):
    path = tmp_path / "summary.pdf"
    path.write_bytes(b"%PDF-1.4\n<< /Creator (eqt 0.0.1) >>")
    write_all({path: b"new"}, tmp_path)
    assert path.read_bytes() == b"new"
    assert list(tmp_path.iterdir()) == [path]


def test_files_of_others_are_not_replaced(tmp_path):
    path = tmp_path / "summary.pdf"
    path.write_bytes(b"%PDF-1.4\n<< /Creator (TeX) >>")
    assert error_of(write_all, {path: b"new"}, tmp_path) == (
        f"{path}: exists, but eqt did not write it; choose another place with out=…"
    )
    assert b"TeX" in path.read_bytes()


def test_nothing_is_written_when_the_figure_cannot_be_drawn(so3, altered, tmp_path):
    results = altered(so3, lyapunov=None)
    with pytest.raises(EqtError):
        render([results], "summary", tmp_path / "figures")
    assert not (tmp_path / "figures").exists()


def test_options_come_as_data():
    assert figure_from("summary", {"log": True, "bands": "none", "controllers": ["eqt"]}) == (
        Summary(log=True, bands="none", controllers=["eqt"])
    )
    assert figure_from("summary", {}) == Summary()


@from_yaml
def test_wrong_options_are_explained(name, options, message):
    assert error_of(figure_from, name, options).startswith(message)


def test_unknown_formats_and_widths_are_explained(so3, opened, tmp_path):
    assert (
        error_of(render, [opened(so3)], "summary", tmp_path, ["pdf", "jpeg"])
        == "unknown format 'jpeg'; known: pdf, svg, png, json"
    )
    assert error_of(render, [opened(so3)], "summary", tmp_path, ["pdf"], "columns") == (
        "unknown width 'columns'; did you mean 'column'? known: column, page, slide"
    )
