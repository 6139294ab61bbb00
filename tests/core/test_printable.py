"""What of a text is shown as an escape."""

import pytest

from eqt_cli.core.errors import (
    OTHER_FOLDER,
    ConfigError,
    EqtError,
    InputProblem,
    keyword,
    printable,
)

UNSEEN = {
    "\x1b[2J": r"\x1b[2J",
    "a\nb": r"a\nb",
    "\x9b31m": r"\x9b31m",
    "\u202eabc": r"\u202eabc",
    "\u2066a\u2069": r"\u2066a\u2069",
    "a\u2028b": r"a\u2028b",
    "\udcff": r"\udcff",
    "\x00": r"\x00",
}


@pytest.mark.parametrize("text", UNSEEN)
def test_what_a_terminal_would_obey_is_escaped(text):
    assert printable(text) == UNSEEN[text]


@pytest.mark.parametrize("text", ["τ_d = 𝕀V̇_d", "a b\u2009c\u00a0d", "日本語", ""])
def test_what_has_a_shape_stays(text):
    assert printable(text) == text


def test_line_breaks_stay_where_they_are_kept():
    assert printable("a\n\x1bb", "\n") == "a\n\\x1bb"


def test_a_message_is_one_line_and_its_further_lines_are_one_each():
    error = EqtError("holds 'a\nb', which differs in", OTHER_FOLDER, lines=["  c\rd", "  e"])
    assert (
        str(error)
        == "holds 'a\\nb', which differs in\n  c\\rd\n  e\nchoose another folder with out=…"
    )


def test_a_problem_is_one_line_with_its_place_and_path():
    problem = InputProblem("a\x1b[2J", "unknown '\u202e'", "c\n.yaml:1:1")
    assert str(ConfigError([problem])) == r"c\n.yaml:1:1: a\x1b[2J: unknown '\u202e'"
    assert problem.with_advice(keyword) == r"unknown '\u202e'"
