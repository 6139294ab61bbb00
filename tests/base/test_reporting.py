"""Steps are counted under their own names, by whoever asked to be told."""

from __future__ import annotations

from typing import Any

import pytest

from eqt_cli.base.errors import EqtWarning
from eqt_cli.base.reporting import Reporter, percent, reporter, reporting, step


def test_a_step_tells_its_name_its_size_and_its_end(told: Any) -> None:
    with step("turns", 2):
        reporter().advance(1)
        assert told.ended == 0
    assert (told.steps, told.total("turns"), told.ended) == ([("turns", 2)], 1, 1)


def test_a_step_that_is_interrupted_ends(told: Any) -> None:
    with pytest.raises(KeyboardInterrupt), step("turns", 2):
        raise KeyboardInterrupt
    assert told.ended == 1
    assert reporter() is told


def test_a_step_within_a_step_is_not_counted(told: Any) -> None:
    with step("turns", 2), step("loops", 50), step("turns", 9):
        reporter().advance(7)
        reporter().skip(3)
        reporter().note("law", "found")
    assert told.steps == [("turns", 2)]
    assert (told.total("turns"), told.skipped) == (0, [])
    assert told.notes == {"law": "found"}


def test_what_counts_the_same_counts_towards_the_whole(told: Any) -> None:
    with step("runs", 9):
        for _ in range(3):
            with step("runs", 3):
                reporter().skip(1)
                reporter().advance(2)
    assert told.steps == [("runs", 9)]
    assert (told.total("runs"), sum(told.skipped)) == (6, 3)


def test_a_remark_is_by_default_a_warning_at_the_line_that_called_eqt() -> None:
    with pytest.warns(EqtWarning, match="^careful$") as caught:
        Reporter().remark(EqtWarning("careful"))
    assert caught[0].filename == __file__


def test_a_share_that_is_none_is_no_number() -> None:
    assert [percent(share) for share in (0.125, float("nan"), float("inf"))] == [
        "12.5 %",
        "- %",
        "- %",
    ]


def test_nobody_is_told_behind_the_block(told: Any) -> None:
    other = type(told)()
    with reporting(other):
        reporter().note("law", "found")
    assert (other.notes, told.notes) == ({"law": "found"}, {})
