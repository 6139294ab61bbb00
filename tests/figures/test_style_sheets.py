"""Style sheets as files: what is read, and what is said of lines that are wrong."""

import matplotlib
import pytest
from case_tables import from_yaml
from said import error_of, says

from eqt_cli.figures import style


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
    assert says(
        refused(sheet(f"axes.prop_cycle: {text}")),
        f"1: the style sheet is wrong: axes.prop_cycle is…: {text}",
    )


@from_yaml
def test_a_wrong_line_is_refused(sheet, line, said, caplog):
    said = f"2: the style sheet is wrong: {said}"
    assert says(refused(sheet("font.size: 9", line)), said)
    assert not caplog.records


@from_yaml
def test_a_sheet_sets_only_what_a_style_may(sheet, line, said):
    assert says(refused(sheet(line)), f"1: the style sheet is wrong: {said}")


def test_the_sheets_of_matplotlib_are_within_the_bounds():
    """And its own settings."""
    for settings in (matplotlib.rcParamsDefault, *matplotlib.style.library.values()):
        for key, value in settings.items():
            if key != "agg.path.chunksize":  # of no figure of eqt
                style.check(key, value)


def test_files_that_cannot_be_read_are_errors(tmp_path):
    missing = tmp_path / "no.mplstyle"
    assert refused(missing) == " cannot be read as a style sheet: no such file or directory"
    (tmp_path / "bytes.mplstyle").write_bytes(b"\xff\xfe")
    assert refused(tmp_path / "bytes.mplstyle") == (
        " cannot be read as a style sheet: it is not text in UTF-8"
    )


def test_misspelt_names_are_corrected():
    assert says(refused("grayscal"), "style sheet 'grayscal' is neither a file…'grayscale'…")


def test_other_names_say_which_there_are():
    said = refused("journal")
    assert said.startswith(
        "style sheet 'journal' is neither a file nor one of Matplotlib's; Matplotlib has: Solarize"
    )
    assert "grayscale, " in said
