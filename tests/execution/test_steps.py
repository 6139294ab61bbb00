"""Long steps are counted under their own names."""

from eqt_cli.execution.steps import SILENT, Steps


def test_a_step_tells_its_name_and_size_before_it_is_counted() -> None:
    told: list[object] = []
    advance = Steps(told.append, lambda name, count: told.append((name, count))).begin("turns", 2)
    advance(1)
    advance(1)
    assert told == [("turns", 2), 1, 1]


def test_without_a_stage_no_step_is_counted() -> None:
    told: list[float] = []
    Steps(told.append).begin("turns", 2)(1)
    assert not told


def test_nobody_is_told_where_nobody_asks() -> None:
    SILENT.begin("turns", 2)(1)
