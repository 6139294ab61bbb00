"""The styles of figures and the looks of curves."""

import matplotlib
import matplotlib.style
import pytest
from ci_cases import mostly_ci
from matplotlib.font_manager import fontManager
from said import error_of, says

from eqt_cli.api.loading import open_at
from eqt_cli.figures import style as styles
from eqt_cli.figures.figure import figures
from eqt_cli.figures.layout import freeze, one_panel
from eqt_cli.figures.render import encode
from eqt_cli.figures.style import WIDTHS, CurvePlace, Style, distinct, house_style, ink, line_style
from eqt_cli.figures.time_figures import Summary
from eqt_cli.results.result import rename

unarranged = pytest.mark.usefixtures("unarranged")


@pytest.fixture
def style(tmp_path):
    """The style of a sheet of these lines."""

    def of(*lines):
        path = tmp_path / "mine.mplstyle"
        path.write_text("\n".join(lines), encoding="utf-8")
        return Style((str(path),))

    return of


def test_the_sheet_holds_inside_and_leaves_nothing_behind():
    before = dict(matplotlib.rcParams)
    with house_style():
        assert matplotlib.rcParams["pdf.fonttype"] == 42
        assert matplotlib.rcParams["mathtext.fontset"] == "stix"
    assert dict(matplotlib.rcParams) == before


def test_later_sheets_win_and_eqts_own_comes_first(style):
    mine = style("font.size: 9", "text.color: blue").sheets
    with house_style(Style(("dark_background", *mine))):
        assert matplotlib.rcParams["font.size"] == 9
        assert matplotlib.rcParams["text.color"] == "blue"
        assert matplotlib.rcParams["axes.facecolor"] == "black"
        assert matplotlib.rcParams["mathtext.fontset"] == "stix"
    with house_style(Style((*mine, "dark_background"))):
        assert matplotlib.rcParams["text.color"] == "white"


def test_colours_come_from_the_cycle_and_dashes_from_eqt(style):
    # Four colours and four dashes: all sixteen pairs occur before one repeats.
    with house_style(style('axes.prop_cycle: cycler(color=["k", "0.4", "r", "b"])')):
        looks = [line_style(index) for index in range(16)]
        assert [look["color"] for look in looks[:5]] == [
            "#000000",
            "#666666",
            "#ff0000",
            "#0000ff",
            "#000000",
        ]
        assert len({str(look) for look in looks}) == 16


def test_dashes_come_from_the_cycle_where_it_has_them(style):
    cycle = 'cycler(color=["k", "k", "r"], linestyle=["-", ":", "--"])'
    with house_style(style(f"axes.prop_cycle: {cycle}")):
        looks = [line_style(index) for index in range(4)]
    # The fourth is not drawn as the first is: it gets the next dashes of eqt.
    assert [look["linestyle"] for look in looks] == ["-", ":", "--", (0, (4.5, 1.5))]
    assert [look["color"] for look in looks] == ["#000000", "#000000", "#ff0000", "#000000"]


CYCLES = {
    "two colours": 'color=["k", "r"]',
    "two looks": 'color=["k", "r"], linestyle=["-", "--"]',
    "one look": 'color=["k"], linestyle=["dotted"]',
    "dashes": 'linestyle=["-", (0, (3, 1))]',
    "markers": 'marker=["o", "s"]',
}


@pytest.mark.parametrize("cycle", CYCLES)
def test_no_two_curves_look_alike_whatever_the_style(style, cycle):
    with house_style(style(f"axes.prop_cycle: cycler({CYCLES[cycle]})")):
        for variants, grey in ((1, None), (3, None), (1, 0)):
            places = [
                CurvePlace(law, variant, variants, None if grey is None else law)
                for law in range(12 // variants)
                for variant in range(variants)
            ]
            looks = distinct(places)
            assert len({str(line_style(look)) for look in looks}) == len(places)
            assert len({(look.colour, look.marker) for look in looks}) == len(places)


@pytest.mark.parametrize(
    ("lines", "full", "half"),
    [
        ([], "#000000", "#808080"),
        (["text.color: white", "axes.facecolor: black"], "#ffffff", "#808080"),
        (["axes.facecolor: none", "figure.facecolor: FF0000"], "#000000", "#800000"),
    ],
)
def test_ink_is_the_colour_of_text_and_its_tints_are_on_the_paper(style, lines, full, half):
    with house_style(style(*lines)):
        assert (ink(), ink(0.5)) == (full, half)


@unarranged
def test_what_belongs_to_no_controller_is_drawn_in_ink(so3, opened):
    style = Style(("dark_background",))
    for name, options in (("runs", {}), ("torque", {"share": "total"})):
        drawing = figures.get(name)(**options).draw([opened(so3)], style=style)
        colours = {line.get_color() for axes in drawing.axes for line in axes.lines}
        assert colours & {"#ffffff", "#404040"}  # ink, and the tint of it behind torques
        assert "black" not in colours


def test_a_grid_as_dark_as_text_is_drawn_as_a_tint():
    with house_style(Style(("grayscale",))):
        assert matplotlib.rcParams["grid.color"] == "#e2e2e2"
    with house_style(Style(("ggplot",))):
        assert matplotlib.rcParams["grid.color"] == "white"


@unarranged
def test_a_sheet_changes_neither_width_nor_names_in_files(style, so3, opened, picture):
    greedy = style("savefig.bbox: tight", "svg.hashsalt: other", "figure.autolayout: True")
    drawing = figures.get("paper")().draw([opened(so3)], style=greedy)
    plain = picture(figures.get("paper")(), opened(so3))
    assert encode(drawing, "svg", style=greedy) == encode(plain, "svg")


@unarranged
def test_a_style_holds_for_the_file_too(style, so3, opened):
    grey = style("figure.facecolor: 123456", "svg.fonttype: none")
    drawing = figures.get("paper")().draw([opened(so3)], style=grey)
    svg = encode(drawing, "svg", style=grey)
    assert b"fill: #123456" in svg
    assert b"EqT</text>" in svg


# With frames and fonts that differ most; the others are variations of them.
DISTINCT = ("classic", "seaborn-v0_8-poster")
COLOURS = {"axes.prop_cycle", "patch.facecolor"}


# A few of many; those of colours alone find place as others do.
OTHERS = [
    each
    for each in matplotlib.style.available
    if each not in DISTINCT and not set(matplotlib.style.library[each]) <= COLOURS
][::4]


@mostly_ci("name", [*DISTINCT, *OTHERS], DISTINCT[:1], "draws other figures")
def test_figures_can_be_drawn_in_every_style_of_matplotlib(name, so3, opened, caplog):
    style = Style((name,))
    drawing = figures.get("paper")().draw([opened(so3)], style=style)
    assert drawing.get_figwidth() == WIDTHS["column"]
    with house_style(style):
        inked = drawing.get_tightbbox()
    # Half a line width of a frame, 2 pt in the widest of them, may touch the edge.
    assert inked.x0 >= -0.02
    assert inked.x1 <= WIDTHS["column"] + 0.02
    assert not caplog.records


def test_type_that_leaves_no_room_is_an_error(style, so3, opened):
    huge = style("legend.fontsize: 90", "axes.labelsize: 200")
    assert error_of(figures.get("paper")().draw, [opened(so3)], style=huge) == (
        "the font size of the style leaves no room for the panels in a figure 3.5 in wide; "
        "use a wider figure or smaller type"
    )


def test_fonts_that_are_not_installed_are_passed_over(style):
    lines = ["font.family: Nowhere, serif", "font.serif: Nowhere Serif, STIXGeneral"]
    with house_style(style(*lines)):
        assert matplotlib.rcParams["font.family"] == ["STIXGeneral"]


def test_no_font_at_all_is_an_error(style):
    assert says(
        error_of(
            lambda: style("font.family: Nowhere, serif", "font.serif: Nowhere Serif").settings
        ),
        "none of the fonts that the style…: Nowhere, Nowhere Serif…",
    )


def test_keys_of_a_machine_change_nothing(style, recwarn):
    before = matplotlib.rcParams["toolbar"]
    with house_style(style("toolbar: None", "font.size: 9")):
        assert matplotlib.rcParams["toolbar"] == before
        assert matplotlib.rcParams["font.size"] == 9
    assert not recwarn.list


@pytest.mark.parametrize(
    ("largest", "number", "power"),
    [(3.0, "1", ""), (3e-6, r"$\mathdefault{1}$", r"$\times\mathdefault{10^{−6}}\mathdefault{}$")],
)
def test_numbers_are_plain_and_a_common_power_of_ten_is_typeset(largest, number, power):
    with house_style():
        drawing, axes = one_panel("column", 1.5)
        axes.plot([0, 1], [0, largest])
        freeze(drawing)
        assert number in [tick.get_text() for tick in axes.yaxis.get_majorticklabels()]
        drawing.draw_without_rendering()
        assert axes.yaxis.get_offset_text().get_text() == power


@unarranged
def test_letters_that_the_fonts_lack_take_an_installed_one_or_are_refused(so3, monkeypatch):
    """Hebrew, which DejaVu Sans has and neither STIX nor DejaVu Serif."""
    with open_at(so3) as result:
        rename(result, {"eqt": "שלום"})
        drawing = Summary().draw([result])
        assert "DejaVu Sans" in drawing.legends[0].get_texts()[0].get_fontfamily()
        few = [x for x in fontManager.ttflist if x.name in ("STIXGeneral", "DejaVu Serif")]
        monkeypatch.setattr(fontManager, "ttflist", few)
        monkeypatch.setattr(styles, "findSystemFonts", list)
        message = error_of(Summary().draw, [result])
    assert says(message, "no installed font has the letter ש (U+05E9) of “שלום”…")
