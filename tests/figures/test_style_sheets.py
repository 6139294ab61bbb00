"""Style sheets as files: what is read, and what is said of lines that are wrong."""

import matplotlib
import pytest
from said import error_of, said_of

from eqt_cli.figures import style

OF_A_MACHINE = ("animation.", "keymap.", "agg.", "docstring.", "_internal.")


@pytest.fixture
def sheet(tmp_path):
    """The path of a sheet of these lines."""

    def write(*lines):
        path = tmp_path / "mine.mplstyle"
        path.write_text("\n".join(lines), encoding="utf-8")
        return path

    return write


def refused(path):
    return error_of(style.read, str(path)).removeprefix(f"{path}:")


def test_the_last_line_of_a_key_holds(sheet):
    path = sheet("lines.linewidth: 1", "lines.linewidth: 2  # a comment")
    assert style.read(str(path)) == {"lines.linewidth": 2.0}


@pytest.mark.parametrize(
    "text",
    [
        "open('harm', 'w')",
        "cycler(color=[(lambda: open('harm', 'w'))()])",
        "cycler(color=[f for f in (g.gi_frame.f_back.f_globals for g in [1])])",
        '"cycler(color=[f for f in (g.gi_frame.f_back.f_globals for g in [1])])"',
        "cycler(color=f\"{''.__class__}\")",
        "(" * 5000,
    ],
)
def test_no_version_of_matplotlib_executes_a_sheet(sheet, text, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert refused(sheet("font.size: 9", f"axes.prop_cycle: {text}")).startswith(
        "2: the style sheet is wrong: axes.prop_cycle is not a sum of cyclers of literal values: "
    )
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mplstyle"]


@pytest.mark.parametrize(
    "text", ["cycler(color='rgb').by_key()", "cycler(c=[g.gi_frame for g in [1]])", "cycler("]
)
def test_cyclers_with_attributes_never_reach_matplotlib(sheet, text, monkeypatch):
    def validate(value):
        raise AssertionError("reached Matplotlib, which may evaluate it")

    monkeypatch.setitem(matplotlib.RcParams.validate, "axes.prop_cycle", validate)
    assert refused(sheet(f"axes.prop_cycle: {text}")) == (
        "1: the style sheet is wrong: axes.prop_cycle is not a sum of cyclers of literal values: "
        f"{text}"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    said_of("""
lines.linewidth: thick → Key lines.linewidth: Could not convert 'thick' to float
line.linewidth: 1 → Matplotlib has no key line.linewidth; did you mean 'lines.linewidth'?
font.size 9 → expected 'key: value'
font.family: "STIX → a closing quotation mark is missing
axes.facecolor: #EEEEEE → Key axes.facecolor: '' does not look like a color arg
root:x:0:0:root → expected a key of Matplotlib
""").items(),
)
def test_a_wrong_line_is_refused(sheet, line, said, caplog):
    assert refused(sheet("font.size: 9", line)) == f"2: the style sheet is wrong: {said}"
    assert not caplog.records


@pytest.mark.parametrize(
    ("line", "said"),
    [
        *said_of("""
path.sketch: 1, 1e-9, 1 → Key path.sketch: does not change how a figure looks; remove the line
figure.hooks: os:abort → Key figure.hooks: does not change how a figure looks; remove the line
animation.ffmpeg_path: ./program →
    Key animation.ffmpeg_path: does not change how a figure looks; remove the line
savefig.dpi: 1e9 → Key savefig.dpi: expected numbers of at most 2400, got 1e+09
font.size: inf → Key font.size: expected numbers of at most 300, got inf
font.size: nan → Key font.size: expected numbers of at most 300, got nan
figure.figsize: 1, 1e6 → Key figure.figsize: expected numbers of at most 50, got 1e+06
text.usetex: True → Key text.usetex: eqt draws without LaTeX; remove the line
text.latex.preamble: \\input{x} →
    Key text.latex.preamble: eqt draws without LaTeX; remove the line
axes.prop_cycle: cycler('lw', [1]*1000000000) →
    axes.prop_cycle is not a sum of cyclers of literal values: cycler('lw', [1]*1000000000)
""").items(),
        (
            product := "axes.prop_cycle: cycler(lw=[1, 2]) * cycler(ms=[1, 2])",
            product.replace(":", " is not a sum of cyclers of literal values:"),
        ),
    ],
)
def test_a_sheet_sets_only_what_a_style_may(sheet, line, said):
    assert refused(sheet(line)) == f"1: the style sheet is wrong: {said}"


def test_the_sheets_of_matplotlib_are_within_the_bounds(sheet):
    """And its own settings."""
    for settings in ({}, *matplotlib.style.library.values()):
        for key, value in {**matplotlib.rcParamsDefault, **settings}.items():
            if not key.startswith(OF_A_MACHINE):
                style.check(key, value, matplotlib.rcParamsDefault[key])


def test_files_that_cannot_be_read_are_errors(tmp_path):
    missing = tmp_path / "no.mplstyle"
    assert refused(missing) == " cannot be read as a style sheet: no such file or directory"
    (tmp_path / "bytes.mplstyle").write_bytes(b"\xff\xfe")
    assert refused(tmp_path / "bytes.mplstyle") == (
        " cannot be read as a style sheet: it is not text in UTF-8"
    )


def test_misspelt_names_are_corrected():
    assert refused("grayscal") == (
        "style sheet 'grayscal' is neither a file nor one of Matplotlib's; did you mean "
        "'grayscale'?"
    )


def test_other_names_say_which_there_are():
    said = refused("journal")
    assert said.startswith(
        "style sheet 'journal' is neither a file nor one of Matplotlib's; Matplotlib has: Solarize"
    )
    assert "grayscale, " in said
