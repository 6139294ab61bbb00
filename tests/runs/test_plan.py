import json

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eqt_cli.config.parts import Plan, Plans

PLANS = st.builds(
    Plan, points=st.integers(1, 9), runs=st.integers(1, 9), controllers=st.integers(1, 3),
    size=st.integers(1, 40),
)  # fmt: skip


@given(PLANS)
def test_parts_hold_every_run_once(plan):
    seen = np.zeros((plan.controllers, plan.points, plan.runs), dtype=int)
    for number in range(len(plan)):
        part = plan.part(number)
        assert part.number == number
        assert len(part) <= plan.size
        np.add.at(seen, (part.controller, part.points, part.run_numbers), 1)
    assert (seen == 1).all()
    assert plan.total == seen.size


@given(PLANS, st.integers(0, 9))
def test_boxes_hold_every_kept_run_of_a_part_in_its_order(plan, kept):
    kept = min(kept, plan.runs)
    for number in range(len(plan)):
        part = plan.part(number)
        entries = np.arange(part.start, part.stop)
        entries = entries[entries % plan.runs < kept]
        boxes = list(part.boxes(kept))
        assert len(boxes) <= 3
        found = np.full(len(entries), -1)
        for box in boxes:
            points = np.arange(box.points.start, box.points.stop)
            runs = np.arange(box.runs.start, box.runs.stop)
            assert box.shape == (len(points), len(runs))
            found[box.rows] = (points[:, None] * plan.runs + runs).ravel()
        np.testing.assert_array_equal(found, entries)


@pytest.mark.parametrize("number", [0, 1, 2])
def test_controllers_take_turns(number):
    assert Plan(1, 10, 3, 5).part(number).controller == number


@given(st.lists(PLANS, min_size=1, max_size=4))
def test_parts_of_several_plans_are_numbered_through(listed):
    plans = Plans(tuple(listed))
    expected = [(k, n) for k, plan in enumerate(listed) for n in range(len(plan))]
    assert [plans.where(number) for number in range(len(plans))] == expected
    assert sum(map(plans.runs_of, range(len(plans)))) == plans.total
    assert Plans.of_data(json.loads(json.dumps(plans.data))) == plans
