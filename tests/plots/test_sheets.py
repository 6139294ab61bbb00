"""Style sheets as files: what is read, and what is said of lines that are wrong."""

import matplotlib.style
import pytest
from cycler import cycler

from eqt_cli.core.errors import EqtError
from eqt_cli.plots.drawing import sheets


@pytest.fixture
def sheet(tmp_path):
    """The path of a sheet of these lines."""

    def write(*lines):
        path = tmp_path / "mine.mplstyle"
        path.write_text("\n".join(lines), encoding="utf-8")
        return path

    return write


def refused(path):
    with pytest.raises(EqtError) as caught:
        sheets.read(str(path))
    return str(caught.value).removeprefix(f"{path}:")


def test_lines_are_read_as_matplotlib_reads_them(sheet):
    path = sheet(
        "\ufeff# a comment",
        "",
        '  axes.facecolor :  "#EEE"   # and another',
        "lines.linewidth: 1",
        "lines.linewidth: 2",
        r"text.latex.preamble: \usepackage{a}: b",
    )
    assert sheets.read(str(path)) == {
        "axes.facecolor": "#EEE",
        "lines.linewidth": 2.0,
        "text.latex.preamble": r"\usepackage{a}: b",
    }


@pytest.mark.parametrize("name", sheets.available())
def test_every_sheet_that_matplotlib_has_is_accepted_and_read_as_by_matplotlib(name):
    assert sheets.read(name) == dict(matplotlib.style.library[name])


def test_settings_of_a_machine_are_passed_over(sheet):
    assert sheets.read(str(sheet("backend: QtAgg", "toolbar: None", "font.size: 9"))) == {
        "font.size": 9.0
    }


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ('cycler("color", ["r", "0072B2"])', cycler(color=["r", "#0072B2"])),
        ('cycler(c="rg") + cycler(ls=["-", "--"])', cycler(color="rg", linestyle=["-", "--"])),
        ('cycler(c="rgb")[:2]', cycler(color="rg")),
    ],
)
def test_cyclers_of_literals_are_evaluated(sheet, text, expected):
    found = sheets.read(str(sheet(f"axes.prop_cycle: {text}")))["axes.prop_cycle"]
    assert list(found) == list(expected)


@pytest.mark.parametrize(
    "text",
    [
        "open('harm', 'w')",
        "cycler(color=[(lambda: open('harm', 'w'))()])",
        "cycler(color=[f for f in (g.gi_frame.f_back.f_globals for g in [1])])",
        "cycler(color='rgb').by_key()",
        "(" * 5000,
        "",
    ],
)
def test_no_version_of_matplotlib_gets_to_execute_a_sheet(sheet, text, monkeypatch):
    def validate(value):
        raise AssertionError("reached Matplotlib, which may evaluate it")

    monkeypatch.setitem(matplotlib.RcParams.validate, "axes.prop_cycle", validate)
    said = refused(sheet("font.size: 9", f"axes.prop_cycle: {text}"))
    assert said.startswith(
        f"2: axes.prop_cycle cannot be '{text}': it is no cycler of literal values; "
    )


def test_a_wrong_cycler_says_how_to_write_one(sheet):
    assert refused(sheet("axes.prop_cycle: 3")) == (
        "1: axes.prop_cycle cannot be '3': Object is not a string or Cycler instance: 3; write "
        'cycler("color", ["0072B2", "D55E00"])'
    )


def test_a_wrong_value_says_where_and_what_would_be_right(sheet):
    assert refused(sheet("# mine", "lines.linewidth: thick")) == (
        "2: lines.linewidth cannot be 'thick': Could not convert 'thick' to float; Matplotlib's "
        "own value is 1.5"
    )


def test_colours_that_became_comments_are_explained(sheet):
    assert refused(sheet("axes.facecolor: #EEEEEE")) == (
        "1: axes.facecolor cannot be '': '' does not look like a color arg; '#' begins a comment, "
        "so write colours as E2E2E2"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("line.linewidth: 1", "'line.linewidth'; did you mean 'lines.linewidth'?"),
        ("x: 1", "'x'; leave it out"),
    ],
)
def test_unknown_settings_are_named(sheet, line, said):
    version = matplotlib.__version__
    assert refused(sheet(line)) == f"1: Matplotlib {version} has no setting {said}"


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("font.size 9", "1: expected 'key: value', got 'font.size 9'"),
        ('font.family: "STIX', "1: a quotation mark (\") is not closed: 'font.family: \"STIX'"),
    ],
)
def test_lines_of_no_form_are_refused(sheet, line, said):
    assert refused(sheet(line)) == said


def test_files_that_cannot_be_read_are_errors(tmp_path):
    missing = tmp_path / "no.mplstyle"
    assert refused(missing) == " the style sheet cannot be read: no such file or directory"
    (tmp_path / "bytes.mplstyle").write_bytes(b"\xff\xfe")
    assert refused(tmp_path / "bytes.mplstyle") == " is no style sheet: it is not UTF-8 text"


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


def test_the_users_own_sheets_have_names_too(sheet, monkeypatch):
    folder = sheet("font.size: 9").parent
    (folder / "stylelib").mkdir()
    (folder / "mine.mplstyle").rename(folder / "stylelib" / "mine.mplstyle")
    monkeypatch.setattr(matplotlib, "get_configdir", lambda: str(folder))
    assert sheets.read("mine") == {"font.size": 9.0}
