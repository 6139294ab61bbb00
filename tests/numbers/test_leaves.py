"""The numbers of a component by path."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np
import pytest

from eqt_cli.numbers.leaves import STRUCTURE, leaves, structure, with_fields, with_leaves


@dataclass(frozen=True)
class Inner:
    rate: float
    order: int = 2


@dataclass(frozen=True)
class Outer:
    matrix: Any
    parts: tuple[Inner, ...]
    own: Inner
    option: float = 1.0
    text: str = "a"
    fixed: float = field(default=7.0, metadata=STRUCTURE)
    derived: float = field(default=3.0, init=False)

    @cached_property
    def doubled(self) -> float:
        return 2 * self.option


OUTER = Outer(np.eye(2), (Inner(0.5), Inner(0.25)), Inner(4.0))


def test_leaves_are_the_numbers_of_a_component_by_path():
    found = leaves(OUTER)
    expected = ["matrix", "parts[0].rate", "parts[1].rate", "own.rate", "option", "derived"]
    assert list(found) == expected
    assert found["parts[1].rate"].tolist() == [0.25]
    assert found["matrix"] is OUTER.matrix


def test_other_leaves_change_nothing_else_and_forget_what_followed_from_the_old_ones():
    assert OUTER.doubled == 2.0
    other = with_leaves(OUTER, {"parts[1].rate": np.array([[1.0], [2.0]]), "option": 5.0})
    assert other.doubled == 10.0
    assert other.parts[1].rate.tolist() == [[1.0], [2.0]]
    assert (other.parts[0], other.own, other.derived) == (Inner(0.5), Inner(4.0), 3.0)
    assert OUTER.parts[1].rate == 0.25


def test_a_path_without_a_leaf_is_an_error():
    with pytest.raises(KeyError, match=r"own\.order, parts\[2\]\.rate"):
        with_leaves(OUTER, {"own.order": 1.0, "parts[2].rate": 1.0, "option": 1.0})


@pytest.mark.parametrize(
    ("changes", "equal"),
    [
        ({"option": 2.0, "matrix": 3 * np.eye(2), "derived": 0.0}, True),
        *(({"matrix": np.eye(3)}, False), ({"text": "b"}, False), ({"fixed": 8.0}, False)),
        *(({"own": Inner(4.0, order=3)}, False), ({"parts": (Inner(0.5),)}, False)),
    ],
)
def test_components_of_equal_structure_differ_in_numbers_only(changes, equal):
    other = with_fields(OUTER, **changes)
    assert (structure(other) == structure(OUTER)) is equal
    hash(structure(other))
