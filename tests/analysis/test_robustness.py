"""How far a law carries, on results made up of counts."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from eqt_cli.analysis.comparison.intervals import share
from eqt_cli.analysis.comparison.notation import Plain
from eqt_cli.analysis.comparison.robustness import reaches, robustness_table, runs_to_show
from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import Result
from eqt_cli.results.swept_key import SweptKey

RUNS = 100


class Stored(Result):
    """A sweep in which so many runs settle, ``(points, laws)``."""

    path = "made-up"

    def __init__(self, settled: Any, *keys: SweptKey, runs: int = RUNS) -> None:
        counts = np.array(settled)[..., None]
        self.settled = (np.arange(runs) < counts).astype(float)
        self.labels = [f"law {k}" for k in range(counts.shape[1])]
        self.title_of = {label: label for label in self.labels}
        self.dimensions = {"run": runs, "point": len(counts)}
        self.swept_keys = list(keys)

    def metric(self, name: str, controller: int | None = None) -> Any:
        assert name == "settled"
        return self.settled


def key(name: str, values: list[float]) -> SweptKey:
    return SweptKey(name, np.array(values, dtype=float), {})


def test_a_law_carries_up_to_the_last_value_before_the_first_that_fails() -> None:
    delays = key("control.delay", [0, 1, 2, 3])
    _, (one, other) = reaches(
        Stored([[100, 100], [98, 60], [50, 100], [99, 100]], delays), 0.9, 0.95
    )
    assert (one.lowest, one.highest) == (0, 1)
    assert (other.lowest, other.highest) == (0, 0)
    beyond = one.beyond(above=True)
    assert beyond is not None
    assert (beyond.value, beyond.settled) == (2, 50)
    assert one.beyond(above=False) is None


def test_of_a_limit_the_largest_is_the_easiest() -> None:
    limits = key("actuators[0].limit", [4, 1, 2])  # in any order
    _, (law,) = reaches(Stored([[100], [10], [97]], limits), 0.9, 0.95)
    assert (law.lowest, law.highest) == (2, 4)


def test_of_an_error_the_range_goes_both_ways_from_0() -> None:
    errors = key("plant.inertia.relative", [-0.4, -0.2, 0, 0.2, 0.4])
    _, (law,) = reaches(Stored([[0], [99], [99], [99], [80]], errors), 0.9, 0.95)
    assert (law.lowest, law.highest) == (-0.2, 0.2)


def test_a_law_that_does_not_settle_anywhere_has_no_range() -> None:
    _, (law,) = reaches(Stored([[50], [20]], key("control.delay", [0, 1])), 0.9, 0.95)
    assert np.isnan([law.lowest, law.highest]).all()
    assert not law.holds_at(0)


def test_each_value_of_another_key_has_ranges_of_its_own() -> None:
    keys = key("control.delay", [0, 1, 0, 1]), key("gains.kp", [1, 1, 2, 2])
    _, found = reaches(Stored([[100], [100], [100], [0]], *keys), 0.9, 0.95)
    assert [(each.other, each.highest) for each in found] == [("gains.kp 1", 1), ("gains.kp 2", 0)]


def test_too_few_runs_for_a_share_are_told() -> None:
    stored = Stored([[100], [100]], key("control.delay", [0, 1]))
    table, rows = robustness_table(stored, 0.97, 0.95, Plain())
    assert (
        "100 runs cannot show 0.97: even if all settle, the interval begins at 0.96"
        in (table.notes[1])
    )
    assert [row["within"] for row in rows] == [False, False]


def cells(table: Any) -> list[list[str]]:
    return [row for block in table.blocks for row in block.rows]


def test_where_too_few_runs_all_settle_the_range_is_undecided_and_not_nowhere() -> None:
    stored = Stored([[6, 1], [6, 0]], key("control.delay", [0, 1]), runs=6)
    table, _ = robustness_table(stored, 0.9, 0.95, Plain())
    assert cells(table) == [
        ["law 0", "undecided: 6 runs, 35 are needed", "-"],
        ["law 1", "nowhere", "-"],
    ]
    assert table.notes[1] == (
        "6 runs cannot show 0.9: even if all settle, the interval begins at 0.61. Use 35 runs or "
        "more (ensemble.runs), or a smaller --share."
    )


def test_a_share_near_the_one_that_is_asked_for_is_undecided() -> None:
    stored = Stored([[93, 100], [10, 100]], key("control.delay", [0, 1]))
    table, _ = robustness_table(stored, 0.9, 0.95, Plain())
    assert cells(table)[0] == ["law 0", "undecided: 0.93 [0.86, 0.97] at 0", "-"]


@pytest.mark.parametrize(("wanted", "confidence"), [(0.9, 0.95), (0.5, 0.95), (0.97, 0.8)])
def test_as_many_runs_as_are_needed_show_the_share(wanted: float, confidence: float) -> None:
    needed = runs_to_show(wanted, confidence)
    assert share(needed, needed, confidence).low >= wanted
    assert share(needed - 1, needed - 1, confidence).low < wanted


def test_three_keys_are_refused() -> None:
    keys = (key(name, [0, 1]) for name in ("a", "b", "c"))
    with pytest.raises(EqtError, match="at most one other key; this result sweeps: a, b, c"):
        reaches(Stored([[1], [1]], *keys), 0.9, 0.95)
