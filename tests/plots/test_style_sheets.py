"""Style sheets as files: what is read, and what is said of lines that are wrong."""

import matplotlib
import pytest

from eqt_cli.core.errors import EqtError
from eqt_cli.plots.drawing import style_sheets


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
        style_sheets.read(str(path))
    return str(caught.value).removeprefix(f"{path}: the style sheet ")


def test_the_last_line_of_a_key_holds(sheet):
    path = sheet("lines.linewidth: 1", "lines.linewidth: 2  # a comment")
    assert style_sheets.read(str(path)) == {"lines.linewidth": 2.0}


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
    assert refused(sheet("font.size: 9", f"axes.prop_cycle: {text}")).startswith("is wrong: ")
    assert [path.name for path in tmp_path.iterdir()] == ["mine.mplstyle"]


@pytest.mark.parametrize(
    "text", ["cycler(color='rgb').by_key()", "cycler(c=[g.gi_frame for g in [1]])", "cycler("]
)
def test_cyclers_with_attributes_never_reach_matplotlib(sheet, text, monkeypatch):
    def validate(value):
        raise AssertionError("reached Matplotlib, which may evaluate it")

    monkeypatch.setitem(matplotlib.RcParams.validate, "axes.prop_cycle", validate)
    assert refused(sheet(f"axes.prop_cycle: {text}")) == (
        f"is wrong: axes.prop_cycle is no cycler of literal values: {text}"
    )


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("lines.linewidth: thick", "Key lines.linewidth: Could not convert 'thick' to float"),
        ("line.linewidth: 1", "Bad key line.linewidth in file "),
        ("font.size 9", "Missing colon in file "),
        ('font.family: "STIX', "Missing closing quote in: "),
        ("axes.facecolor: #EEEEEE", "Key axes.facecolor: '' does not look like a color arg"),
    ],
)
def test_a_wrong_line_is_refused_in_the_words_of_matplotlib(sheet, line, said, caplog):
    assert refused(sheet(line)).startswith(f"is wrong: {said}")
    assert not caplog.records


def test_files_that_cannot_be_read_are_errors(tmp_path):
    missing = tmp_path / "no.mplstyle"
    assert refused(missing) == "cannot be read: no such file or directory"
    (tmp_path / "bytes.mplstyle").write_bytes(b"\xff\xfe")
    assert refused(tmp_path / "bytes.mplstyle").startswith("is wrong: 'utf-8' codec can't decode")


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
