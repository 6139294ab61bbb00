"""Tables on terminals that are narrower than they are, and on a pipe."""

import os
import sys

import pytest
from rich.cells import cell_len

from eqt_cli.cli import output
from eqt_cli.cli.output import folded, room, table
from eqt_cli.cli.tables import as_latex, table_text
from eqt_cli.extend import Block, TextTable

ROWS = [
    ["eqt", "1.830", "holds", "-0.283 [-0.346, -0.219]"],
    ["stabilising", "-", "a sentence that is rather long", "0.03 [-0.57, 0.65]"],
]
TABLE = TextTable(
    "t", "", ["law", "mean ‖I − Q_E‖ 0-5 s", "remark", "difference"], [Block("", ROWS)]
)


def laid_out(width, shown=TABLE):
    return table_text(shown, width).plain.splitlines()


def with_(**changes):
    return TextTable(**{**vars(TABLE), **changes})


def words(lines):
    return {word for line in lines for word in line.split() if set(word) != {"─"}}


def test_numbers_have_a_minus_sign_and_what_is_typed_a_hyphen():
    cells = ["-1.5", "(-1, 2e-3)", "-2 to -1", "a-1", "2026-11-28", "gains.kp=-1", "-"]
    said = ["−1.5", "(−1, 2e-3)", "−2 to −1", "a-1", "2026-11-28", "gains.kp=-1", "-"]
    shown = with_(header=["x"], blocks=[Block("", [[cell] for cell in cells])])
    assert [line.strip() for line in laid_out(None, shown)[2:]] == said
    typed = with_(header=["default"], blocks=[Block("", [["-1.5"]])])
    assert laid_out(None, typed)[-1].strip() == "-1.5"
    aligned = with_(header=["long heading"], blocks=[Block("", [["-1.5"], ["2"]])])
    assert laid_out(None, aligned)[2:] == ["        −1.5", "           2"]


def test_a_pipe_gets_every_column_unbroken():
    assert laid_out(None) == laid_out(99)
    assert laid_out(None) == [
        "law          mean ‖I − Q_E‖ 0-5 s  remark                          difference",
        "───────────  ────────────────────  ──────────────────────────────  "
        "───────────────────────",
        "eqt                         1.830  holds                           "
        "−0.283 [−0.346, −0.219]",
        "stabilising                     -  a sentence that is rather long  0.03 [−0.57, 0.65]",
    ]


def test_headings_are_folded_first_and_formulas_are_not():
    assert laid_out(86)[0].strip() == "mean ‖I − Q_E‖"  # two lines at most where they fit
    assert "‖I − Q_E‖" in laid_out(82)[1]
    assert "a sentence that is rather long" in laid_out(82)[-1]


def test_then_text_is_wrapped():
    lines = laid_out(75)
    assert max(map(cell_len, lines)) <= 75
    assert words(lines) == words(laid_out(None))


def test_then_the_least_important_columns_are_left_out():
    lines = laid_out(50, with_(spare=("remark", "difference")))
    assert "remark" not in lines[0] + lines[1] + lines[2]
    assert lines[-2:] == ["", "Not shown at this width: remark."]
    assert any("−0.283 [−0.346, −0.219]" in line for line in lines)


def test_numbers_that_fit_only_apart_become_tables_of_their_own():
    rows = [[f"measure {k}", *(f"{k}.{c}00 ± 0.0{c}" for c in range(1, 7))] for k in range(2)]
    shown = TextTable("t", "", ["measure", *"abcdef"], [Block("", rows)])
    lines = laid_out(60, shown)
    assert max(map(cell_len, lines)) <= 60
    assert sum(line.startswith("measure 0") for line in lines) == 2
    for cell in rows[0][1:]:
        assert any(cell in line for line in lines)


def test_else_each_row_becomes_a_block_of_lines():
    lines = laid_out(30)
    assert lines[:4] == [
        "eqt",
        "  mean ‖I − Q_E‖ 0-5 s  1.830",
        "  remark                holds",
        "  difference            −0.283",
    ]


@pytest.mark.parametrize("width", range(24, 100, 3))
def test_no_word_is_ever_broken(width):
    spare = with_(spare=("remark",))
    for shown in (TABLE, spare):
        plain = "\n".join(laid_out(width, shown))
        for word in ("stabilising", "1.830", "−0.283", "0.65]"):
            assert word in plain


@pytest.mark.parametrize("width", range(20, 60))
def test_no_line_begins_with_the_number_of_a_p_value(width):
    note = "McNemar's exact test: settled, EqT − GT: p = 1; settled, EqT − nog: p = 9.3e-09."
    assert not [line for line in folded(note, width).splitlines() if line[0].isdigit()]


@pytest.mark.parametrize("width", range(20, 60))
def test_no_line_parts_the_laws_of_a_pair(width):
    note = "EqT − GT: p = 0.03; mean ‖I − Q_E‖, EqT − asym: p = 0.42; GT − nog, later."
    lines = table_text(TextTable("t", "", ["a"], [], [note]), width).plain.splitlines()
    assert not any(line.startswith("− ") or line.endswith(" −") for line in lines)


def test_verdicts_are_coloured_and_say_the_same_in_words():
    shown = TextTable("t", "", ["what", "verdict"], [Block("", [["a", "holds"], ["b", "FAILS"]])])
    made = table_text(shown, 80)
    styles = {made.plain[span.start : span.end].strip(): str(span.style) for span in made.spans}
    assert {styles[word] for word in ("what", "verdict")} == {"bold"}
    assert (styles["holds"], styles["FAILS"]) == ("green", "bold red")


def test_marked_numbers_are_in_colour():
    rows = [["GT", "−3 % [−4, −2] ✓", "+2 % [+1, +3] ✗"], ["asym", "+1 % [−1, +2]", "-"]]
    made = table_text(TextTable("t", "", ["law", "error", "effort"], [Block("", rows)]), None)
    styles = {made.plain[span.start : span.end].strip(): str(span.style) for span in made.spans}
    assert [styles.get(cell) for cell in rows[0]] == [None, "green", "red"]
    assert not {*rows[1]} & {*styles}


def test_what_comes_from_a_file_is_escaped():
    shown = TextTable("t", "\x1b[2J", ["\x1b[1m"], [Block("\x07", [["\x1b[0m"]])])
    for width in (None, 10):
        assert table_text(shown, width).plain.replace("\n", "").isprintable()


@pytest.mark.parametrize(("terminal", "expected"), [(True, 40), (False, None)])
@pytest.mark.parametrize("columns", ["40", ""])
def test_terminals_have_a_width_and_tables_obey_columns(monkeypatch, terminal, expected, columns):
    monkeypatch.setenv("COLUMNS", columns)
    monkeypatch.setattr("shutil.get_terminal_size", lambda *_, **__: os.terminal_size((40, 24)))
    monkeypatch.setattr(sys.stdout, "isatty", lambda: terminal)
    assert room() == expected
    lines = table(TABLE.header, ROWS).plain.splitlines()
    assert (max(map(cell_len, lines)) > 50) is (not terminal and not columns)


def test_latex_leaves_equal_columns_out_and_says_so():
    rows = [["a", "1.0", "20 s"], ["b", "2.0", "20 s"]]
    made = as_latex(TextTable("t", "Means", ["law", "mean", "window"], [Block("", rows)]))
    assert made.splitlines()[0] == "% Means; window: 20 s"
    assert "law & mean \\\\" in made and "20 s \\\\" not in made


@pytest.mark.parametrize(
    ("arguments", "plain", "coloured"),
    [
        (("no file", "error"), "eqt: error: no file", "\033[1;31merror:\033[0m no file"),
        (("no air", "warning"), "eqt: warning: no air", "\033[1;33mwarning:\033[0m no air"),
        (("c:1", "error", "2 errors"), "2 errors\nc:1", "\033[1;31m2 errors\033[0m\nc:1"),
        (("  a remark",), "  a remark", "  a remark"),
    ],
)
def test_errors_are_in_colour_on_a_terminal_only(monkeypatch, capsys, arguments, plain, coloured):
    monkeypatch.setattr(sys.stderr, "isatty", lambda: True)
    output.complain(*arguments)
    assert capsys.readouterr().err == f"{plain}\n"  # NO_COLOR
    monkeypatch.delenv("NO_COLOR")
    output.complain(*arguments)
    assert capsys.readouterr().err == f"{coloured}\n"


def test_lines_in_a_pipe_have_100_columns(monkeypatch, capsys):
    monkeypatch.delenv("COLUMNS", raising=False)
    monkeypatch.setattr(output, "_silent", False)  # as a command before may have left it
    output.print_text("word " * 50)
    lines = capsys.readouterr().out.splitlines()
    assert len(lines) == 3 and max(map(len, lines)) <= 100
