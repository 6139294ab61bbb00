"""Figures as part of a page."""

import re
from html.parser import HTMLParser

import pytest

from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import EqtError
from eqt_cli.report.document import DEFAULT, inline_figures, inlined, named

FILE = b"""<?xml version="1.0"?>
<svg xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink" width="10pt"
 height="5pt" viewBox="0 0 10 5">
 <metadata><x/></metadata><!-- <script>alert(1)</script> -->
 <defs><path id="a" d="M 1.23456789 2"/></defs>
 <use xlink:href="#a" transform="scale(0.015625)" style="fill: #000000; stroke:#ffffff"/>
 <rect clip-path="url(#b)" style="fill: #ffffff; stroke: #404040"/><clipPath id="b"/>
</svg>"""


@pytest.fixture
def svg():
    return inlined(FILE, "figure1", "what it shows")


def test_identifiers_are_unique_in_the_page(svg):
    assert 'id="figure1-a"' in svg and 'href="#figure1-a"' in svg
    assert 'id="figure1-b"' in svg and "url(#figure1-b)" in svg


def test_colours_are_those_of_the_file(svg):
    assert 'style="fill: #000000; stroke:#ffffff"' in svg
    assert 'style="fill: #ffffff; stroke: #404040"' in svg


def test_coordinates_are_rounded_but_scales_are_not(svg):
    assert 'd="M 1.23 2"' in svg
    assert "scale(0.015625)" in svg


def test_size_is_left_to_the_page(svg):
    root = svg.partition(">")[0]
    assert "width=" not in root and "height=" not in root and 'viewBox="0 0 10 5"' in root


def test_comments_and_metadata_are_left_out(svg):
    assert "script" not in svg and "metadata" not in svg


def test_label_says_what_is_drawn(svg):
    assert 'role="img" aria-label="what it shows"' in svg


@pytest.mark.ci("draws every figure of a page, which the tests of pages do too")
@pytest.mark.usefixtures("unarranged")
def test_figures_of_a_result(paper_result):
    with open_at(paper_result) as results:
        drawn, remarks = inline_figures(results, DEFAULT)
    assert [figure["key"] for figure in drawn][:3] == ["figure1", "figure2", "figure3"]
    assert remarks == []
    ids = re.findall(r' id="([^"]+)"', "".join(figure["svg"] for figure in drawn))
    assert len(ids) == len(set(ids))


def test_unknown_figure():
    with pytest.raises(EqtError, match=r"^unknown figure 'papr'; did you mean 'paper'"):
        named(["papr"])


def test_figures_are_html(svg):
    HTMLParser().feed(svg)
