"""What is wrong with an input: noted at its place, and shown as what it is."""

from __future__ import annotations

import pytest

from eqt_cli.base.errors import (
    OTHER_FOLDER,
    ConfigError,
    EqtError,
    InputError,
    InputProblem,
    Problems,
    dotted,
    keyword,
    parse_key,
    printable,
)


def found(problems: Problems) -> list[tuple[str, str]]:
    return [(problem.path, problem.message) for problem in problems]


def test_a_place_within_fills_the_same_list() -> None:
    problems = Problems()
    problems.at("reference", "torque").at(1).add("wrong")
    assert found(problems) == [("reference.torque[1]", "wrong")]


def test_a_place_has_the_problems_within_it_only() -> None:
    problems = Problems()
    problems.at("gains", "kp").add("wrong")
    assert problems.at("gains")
    assert not problems.at("gains", "kd")


def test_an_input_error_is_noted_where_it_is_caught() -> None:
    problems = Problems()
    with problems.at("gains").catching("kp"):
        raise InputError("expected 3×3, got 2×2")
    assert found(problems) == [("gains.kp", "expected 3×3, got 2×2")]


def test_the_same_is_noted_once() -> None:
    problems = Problems()
    problems.add("wrong")
    problems.add("wrong")
    assert len(list(problems)) == 1


def test_all_are_raised_in_the_order_of_the_file() -> None:
    places = {("b",): "c.yaml:10:1", ("a",): "c.yaml:9:2"}
    problems = Problems(places.__getitem__)
    for path in places:
        problems.at(*path).add("wrong")
    with pytest.raises(ConfigError) as caught:
        problems.raise_if_any()
    assert str(caught.value) == "c.yaml:9:2: a: wrong\nc.yaml:10:1: b: wrong"


def test_what_keys_share_by_an_anchor_is_told_once() -> None:
    problems = Problems(lambda path: "a.yaml:3:1")
    for path in ("metrics", 0, "angle"), ("metrics", 1, "angle"), ("metrics", 1, "axis"):
        problems.at(*path).add("missing")
    with pytest.raises(ConfigError) as caught:
        problems.raise_if_any()
    assert [each.path for each in caught.value.problems] == ["metrics[0].angle", "metrics[1].axis"]


@pytest.mark.parametrize("key", ["gains.kp", "controllers[0].label", "inertia[0][1]"])
def test_a_key_is_written_as_it_is_read(key: str) -> None:
    assert dotted(parse_key(key)) == key


# What is shown as an escape -----------------------------------------------------------------------


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
