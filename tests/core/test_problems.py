"""What is wrong with an input: noted at its place, by whoever checks a part of it."""

from __future__ import annotations

import pytest

from eqt_cli.core.errors import ConfigError, InputError, Problems, dotted, parse_key


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


@pytest.mark.parametrize("key", ["gains.kp", "controllers[0].label", "inertia[0][1]"])
def test_a_key_is_written_as_it_is_read(key: str) -> None:
    assert dotted(parse_key(key)) == key
