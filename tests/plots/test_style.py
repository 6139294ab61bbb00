"""The style sheet and the looks of curves."""

import itertools

import matplotlib
from matplotlib.colors import to_rgb

from eqt_cli.plots.style import house_style, line_style


def test_the_sheet_holds_inside_and_leaves_nothing_behind():
    before = dict(matplotlib.rcParams)
    with house_style():
        assert matplotlib.rcParams["pdf.fonttype"] == 42
        assert matplotlib.rcParams["mathtext.fontset"] == "cm"
    assert dict(matplotlib.rcParams) == before


def test_28_curves_look_different():
    with house_style():
        looks = {str(line_style(index)) for index in range(28)}
    assert len(looks) == 28


def test_four_neighbours_differ_in_dashes_and_colour():
    with house_style():
        looks = [line_style(index) for index in range(8)]
    for four in zip(*(looks[k:] for k in range(4)), strict=False):
        for one, other in itertools.combinations(four, 2):
            assert one["linestyle"] != other["linestyle"]
            assert one["color"] != other["color"]


def test_colours_stand_out_from_white_paper():
    # WCAG 2's relative luminance; 2 : 1 is what Okabe and Ito's lightest colour here reaches.
    with house_style():
        for index in range(7):
            channels = [
                c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4
                for c in to_rgb(line_style(index)["color"])
            ]
            luminance = 0.2126 * channels[0] + 0.7152 * channels[1] + 0.0722 * channels[2]
            assert 1.05 / (luminance + 0.05) > 2
