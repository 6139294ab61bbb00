"""What is wrong with an input: noted at its place, by whoever checks a part of it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import pytest

from eqt_cli.core.errors import ConfigError, InputError
from eqt_cli.core.problems import Problems, dotted, parse_key
from eqt_cli.engines.solve_ivp import SolveIvp
from eqt_cli.ensemble.poses.exp_normal import ExpNormal
from eqt_cli.groups import MatrixLieGroup, group_named


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


# Plugins of the first version, which list what is wrong ------------------------------------------


@dataclass(frozen=True)
class FirstVersionPose(ExpNormal):
    name: ClassVar[str] = "first"

    def problems(self, *group: Any) -> list[tuple[str, str]]:
        return [*super().problems(*group), ("centre[1]", "is odd")]


@dataclass(frozen=True)
class DerivedPose(FirstVersionPose):
    name: ClassVar[str] = "derived"

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        super().check(G, problems)
        problems.at("std").add("is even")


@dataclass(frozen=True)
class FirstVersionEngine(SolveIvp):
    name: ClassVar[str] = "first"

    def problems(self, *group: Any) -> list[tuple[str, str]]:
        return [*super().problems(*group), ("block", "is odd")]


LISTED = [("centre", "expected 3 numbers for SO3, got 2"), ("centre[1]", "is odd")]


def test_problems_that_a_component_lists_are_noted() -> None:
    problems = Problems()
    FirstVersionPose(centre=[1.0, 2.0]).check(group_named("SO3"), problems)
    assert found(problems) == LISTED


def test_a_check_may_ask_one_that_lists() -> None:
    problems = Problems()
    DerivedPose(centre=[1.0, 2.0]).check(group_named("SO3"), problems)
    assert found(problems) == [*LISTED, ("std", "is even")]


def test_problems_that_an_engine_lists_are_noted() -> None:
    problems = Problems()
    FirstVersionEngine(rtol=2.0).check(problems.at("solver"))
    assert [path for path, _ in found(problems)] == ["solver.rtol", "solver.block"]
