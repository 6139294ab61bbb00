"""Writing figures, and what a command gives to `render`."""

import re
import xml.etree.ElementTree as ElementTree

import numpy as np
import pytest
from case_tables import from_yaml
from matplotlib.figure import Figure
from PIL import Image
from said import error_of, mentions, says

from eqt_cli.base.files import is_eqts, write_all
from eqt_cli.extend import EqtError
from eqt_cli.figures.render import curves, encode, figure_from, render
from eqt_cli.figures.time_figures import Summary, Torque

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


def test_text_of_an_svg_is_as_wide_in_any_font_and_keeps_its_order():
    """Widths as Matplotlib draws them; letters from right to left are isolated."""
    drawing, said = Figure(figsize=(4, 1)), ["mean & <error>", "שם 2, א, 8 runs"]
    texts = [
        drawing.text(0.1, 0.1, text, fontfamily=["STIXGeneral", "DejaVu Sans"]) for text in said
    ]
    svg = ElementTree.fromstring(encode(drawing, "svg"))
    written = [element for element in svg.iter() if element.tag.endswith("}text")]
    assert [x.text for x in written] == [said[0], "\u2068שם 2, א\u2069, 8 runs"]
    for text, element in zip(texts, written, strict=True):
        width = text.get_window_extent(dpi=72).width
        assert float(element.get("textLength")) == pytest.approx(width, abs=2)  # whole pixels


def test_figures_are_known_as_eqts_and_png_is_for_print(so3, opened, tmp_path):
    paths = render([opened(so3)], "summary", tmp_path, ["pdf", "svg", "png", "json"], "column")
    assert len(paths) == 5
    assert [path.name for path in paths if not is_eqts(path)] == []
    with Image.open(paths[2]) as image:
        assert image.width == 1050  # 3.5 in at 300 dpi
        assert image.info["Title"] == "small: summary"
        assert image.info["Description"].startswith("Medians over runs of pose error")
        assert image.info["Description"].endswith(str(opened(so3).attributes["digest"]))


@pytest.mark.ci("writes every format")
def test_a_slide_is_13_inches_wide_but_as_pdf(so3, opened, tmp_path):
    files = render([opened(so3)], "summary", tmp_path, ["png", "svg", "pdf"], "slide")
    with Image.open(files[0]) as image:
        assert (image.width, round(image.info["dpi"][0])) == (3990, 300)  # 13.3 in
    assert b'width="957.6pt"' in files[1].read_bytes()[:600]
    assert re.search(rb"/MediaBox \[ 0 0 425.6 [0-9.]+ \]", files[2].read_bytes())  # to be enlarged
    assert b"DejaVuSans" in files[2].read_bytes() and b"STIXGeneral" not in files[2].read_bytes()
    assert len(files) == 3  # its remarks stand below the panels


def test_remarks_are_a_caption_and_metadata_and_the_artwork_has_a_few_words(so3, opened, tmp_path):
    pdf, svg, caption = render([opened(so3)], "summary", tmp_path, ["pdf", "svg"])
    bands = "Curves: median, quartiles of EqT and GT, 6 runs."
    said = f"Thin dashes: threshold of settled. {bands}"
    assert caption.read_text(encoding="utf-8") == f"% caption by eqt: small: summary\n{said}%\n"
    assert is_eqts(caption)
    root = ElementTree.parse(svg).getroot()
    texts = ["".join(each.itertext()) for each in root.iter() if each.tag.endswith("}text")]
    note = "median, quartiles of EqT and GT, 6 runs, thin dashes: threshold of settled"
    assert note in texts and "EqT" in texts
    assert not any("Curves" in text for text in texts)
    assert [each.text for each in root if each.tag.endswith("}title")] == ["small: summary"]
    assert said in svg.read_text(encoding="utf-8")
    assert said.encode() in pdf.read_bytes()


def test_panels_of_one_unit_have_one_prefix(so3, altered, opened):
    torque = opened(so3)["torque"] / abs(opened(so3)["torque"]).max() * [2e-5, 3e-3, 1e-4]
    drawing = Torque().draw([altered(so3, torque=torque, desired_torque=0 * torque[0, 0])])
    assert {curve.up[-6:] for curve in curves(drawing)} == {"(mN m)"}


@pytest.mark.parametrize(
    ("size", "unit", "factor"), [(2e-5, "µN m", 1e6), (0.3, "N m", 1), (7e4, "kN m", 1e-3)]
)
def test_small_and_large_units_have_prefixes(size, unit, factor, so3, altered, opened):
    torque = opened(so3)["torque"] / abs(opened(so3)["torque"]).max() * size
    changed = altered(so3, torque=torque, desired_torque=0 * torque[0, 0])
    drawing = Torque(controllers=["eqt"]).draw([changed])
    drawing.draw_without_rendering()
    for curve in (each for each in curves(drawing) if each.name == "eqt"):
        axis = "xyz".index(curve.panel[1])
        rms = np.sqrt(np.mean(torque[0, ..., axis] ** 2, axis=0))
        np.testing.assert_allclose(curve.y, factor * rms, rtol=1e-12)
        assert curve.up == f"rms τ_{'xyz'[axis]} ({unit})"
    assert not any(axes.yaxis.get_offset_text().get_text() for axes in drawing.axes)
    number = drawing.axes[0].get_yticklabels()[1]
    assert float(number.get_text().strip("$").removeprefix(r"\mathdefault{").rstrip("}")) == (
        pytest.approx(factor * number.get_position()[1])
    )


def test_pdf_embeds_fonts_that_can_be_edited(so3, opened, picture):
    pdf = encode(picture(Summary(), opened(so3)), "pdf")
    assert b"/CIDFontType2" in pdf
    assert b"/Type3" not in pdf


def test_a_folder_that_cannot_be_made_is_named(tmp_path):
    (tmp_path / "file").write_text("")
    path = tmp_path / "file" / "figures" / "summary.pdf"
    assert says(error_of(write_all, {path: b"new"}, tmp_path), f"{tmp_path / 'file'}: is a file…")


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
    (tmp_path / f"{path.name}.{'0' * 16}.tmp").write_bytes(b"of a process that was killed")
    other = tmp_path / f"notes.pdf.{'0' * 16}.tmp"
    other.write_bytes(b"of another file")
    write_all({path: b"new"}, tmp_path)
    assert path.read_bytes() == b"new"
    assert {*tmp_path.iterdir()} == {path, other}


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
    assert figure_from("summary", {"log": True, "controllers": ["eqt"]}) == (
        Summary(log=True, controllers=["eqt"])
    )
    assert figure_from("summary", {}) == Summary()


@from_yaml
def test_wrong_options_are_explained(name, options, message):
    assert mentions(error_of(figure_from, name, options), message)


def test_unknown_formats_and_widths_are_explained(so3, opened, tmp_path):
    assert (
        error_of(render, [opened(so3)], "summary", tmp_path, ["pdf", "jpeg"])
        == "unknown format 'jpeg'; known: pdf, svg, png, tiff, json"
    )
    assert error_of(render, [opened(so3)], "summary", tmp_path, ["pdf"], "columns") == (
        "unknown width 'columns'; did you mean 'column'? known: column, page, slide, "
        "and lengths of 38 mm to 356 mm"
    )
