import pickle

import numpy as np
import pytest
from case_tables import from_yaml
from hypothesis import given
from hypothesis import strategies as st
from said import says

from eqt_cli.config.designs import Choices, DrawnRange, Sweep
from eqt_cli.extend import Problems


def sweep(*blocks):
    problems = Problems()
    found = Sweep.read(list(blocks), problems)
    assert not problems
    return found


def points(found):
    return [found.point(k) for k in range(len(found))]


def test_grid_changes_its_last_axis_fastest():
    assert points(sweep({"grid": {"a": [1, 2], "b": ["x", "y"]}})) == [
        {"a": 1, "b": "x"},
        {"a": 1, "b": "y"},
        {"a": 2, "b": "x"},
        {"a": 2, "b": "y"},
    ]


def test_grid_takes_ranges_on_linear_and_logarithmic_scales():
    found = sweep(
        {
            "grid": {
                "a": {"low": 0, "high": 1, "points": 3},
                "b": {"low": 0.01, "high": 100, "points": 3, "scale": "log"},
            }
        }
    )
    assert [p["a"] for p in points(found)[::3]] == [0.0, 0.5, 1.0]
    np.testing.assert_allclose([p["b"] for p in points(found)[:3]], [0.01, 1, 100], rtol=1e-14)


def test_zip_changes_all_axes_together():
    assert points(sweep({"zip": {"a": [1, 2], "b": [3, 4]}})) == [
        {"a": 1, "b": 3},
        {"a": 2, "b": 4},
    ]


def test_blocks_multiply_and_the_first_changes_slowest():
    found = sweep({"zip": {"a": [1, 2], "b": [3, 4]}}, {"grid": {"c": [5, 6, 7]}})
    assert len(found) == 6
    assert points(found)[2] == {"a": 1, "b": 3, "c": 7}
    assert points(found)[3] == {"a": 2, "b": 4, "c": 5}


def test_concat_adds():
    found = sweep(
        {
            "concat": [
                {"grid": {"a": [1, 2], "b": [3]}},
                [{"grid": {"b": [4]}}, {"grid": {"a": [5]}}],
            ]
        }
    )
    assert points(found) == [{"a": 1, "b": 3}, {"a": 2, "b": 3}, {"a": 5, "b": 4}]
    assert found.place(1, "a") == (0, "concat", 0, "grid", "a", 1)
    assert found.place(2, "b") == (0, "concat", 1, 0, "grid", "b", 0)
    assert found.sets == found.always == ("a", "b")


def test_what_parts_that_are_added_always_change():
    parts = [{"cases": {"x": {"a": 1, "b": 1}, "y": {"a": 2}}}, {"cases": {"z": {"a": 3, "c": 1}}}]
    found = sweep({"concat": parts})
    assert [found.point(k)["case"] for k in range(3)] == ["x", "y", "z"]
    settings = [{"a": 1, "b": 1}, {"a": 2}, {"a": 3, "c": 1}]
    assert [found.settings(k) for k in range(3)] == settings
    assert (found.sets, found.always) == (("a", "b", "c"), ("a",))


def test_cases_change_what_they_name_and_multiply_like_any_block():
    found = sweep({"cases": {"ideal": {}, "late": {"b.c": 2, "d": 1}}}, {"grid": {"a": [1, 2]}})
    assert [found.point(k)["case"] for k in range(4)] == ["ideal", "ideal", "late", "late"]
    settings = [found.settings(k) for k in range(4)]
    assert settings == [{"a": 1}, {"a": 2}, {"b.c": 2, "d": 1, "a": 1}, {"b.c": 2, "d": 1, "a": 2}]
    assert (found.sets, found.always) == (("b.c", "d", "a"), ("a",))
    assert found.place(2, "d") == (0, "cases", "late", "d")
    assert found.first_place("d") == (0, "cases", "late", "d")


def test_some_points_of_a_sweep_are_a_sweep():
    whole = sweep({"cases": {"ideal": {}, "late": {"b": 2}}}, {"grid": {"a": [1, 2]}})
    found = Sweep(whole.blocks, whole.section, [3, 0])
    assert points(found) == [{"case": "late", "a": 2}, {"case": "ideal", "a": 1}]
    assert found.place(0, "a") == (1, "grid", "a", 1)


@pytest.mark.parametrize("kind", ["random", "lhs", "sobol"])
def test_sampled_points_stay_within_their_axes(kind):
    axes = {
        "linear": {"low": -1, "high": 2},
        "log": {"low": 0.1, "high": 10, "scale": "log"},
        "whole": {"low": 1, "high": 3, "integer": True},
        "choice": {"values": ["p", "q"]},
    }
    found = points(sweep({kind: {"points": 200, "seed": 3, "axes": axes}}))
    assert all(-1 <= p["linear"] <= 2 and 0.1 <= p["log"] <= 10 for p in found)
    assert {p["whole"] for p in found} == {1, 2, 3}
    assert {p["choice"] for p in found} == {"p", "q"}
    # Half of the points lie below the middle of the logarithmic scale; 4 σ of a binomial is 28.
    assert abs(sum(p["log"] < 1 for p in found) - 100) < 28


@pytest.mark.parametrize("kind", ["random", "sobol"])
@pytest.mark.parametrize(("few", "many"), [(5, 6), (8, 9), (1, 100)])
def test_more_points_keep_the_earlier_ones(kind, few, many):
    def design(count):
        axes = {"a": {"low": 0, "high": 1}, "b": {"low": 0, "high": 1}}
        return points(sweep({kind: {"points": count, "seed": 7, "axes": axes}}))

    assert design(many)[:few] == design(few)


def test_lhs_has_one_point_in_every_share():
    axes = {"a": {"low": 0, "high": 10}, "b": {"low": 0, "high": 10}}
    found = points(sweep({"lhs": {"points": 10, "axes": axes}}))
    for key in axes:
        assert sorted(int(p[key]) for p in found) == list(range(10))


def test_seeds_make_designs_differ():
    axes = {"a": {"low": 0, "high": 1}}
    one, other = (sweep({"sobol": {"points": 4, "seed": s, "axes": axes}}) for s in (1, 2))
    assert points(one) != points(other)


def test_a_million_points_are_not_listed():
    axis = {"low": 0, "high": 1, "points": 1000}
    found = sweep({"grid": {"a": axis, "b": axis}})
    assert len(found) == 1_000_000
    assert found.point(999_999) == {"a": 1.0, "b": 1.0}


@given(st.integers(0, 2**20 - 1))
def test_points_do_not_depend_on_the_order_of_asking(point):
    blocks = (
        {"grid": {"a": {"low": 0, "high": 1, "points": 2**10}}},
        {"sobol": {"points": 2**10, "axes": {"b": {"low": 0, "high": 1}}}},
    )
    found = sweep(*blocks)
    assert found.point(point) == pickle.loads(pickle.dumps(found)).point(point)
    assert found.point(point)["a"] == (point >> 10) / 1023


@from_yaml
def test_what_is_wrong_is_said_at_its_place(blocks, said):
    problems = Problems()
    assert Sweep.read(blocks, problems) is None
    [problem] = problems
    assert says(f"{problem.path}: {problem.message}".removeprefix(": "), said)


def test_a_number_of_401_digits_is_shortened():
    block, problems = {"points": 4, "axes": {"a": {"low": 0, "high": 10**400}}}, Problems()
    assert Sweep.read([{"random": block}], problems) is None
    assert [problem.message for problem in problems] == [f"expected a number, got 1{56 * '0'}..."]


@pytest.mark.parametrize(
    "block",
    [
        {"zip": {"a": [1, 2]}},
        {"grid": {"a": [[1, 2], [3, 4], {"kind": "b"}]}},
        {"grid": {"a": [1, True, "1"]}},  # three values, and not one three times
        {"cases": {40 * "x": {}}},
        {"grid": {"a": {"low": 0, "high": 1, "points": 10**6}, "b": [*range(10)]}},
        {"random": {"points": 4, "axes": {"a": {"low": 1, "high": 2, "integer": True}}}},
    ],
)
def test_what_is_just_right_is_accepted(block):
    assert len(sweep(block)) > 0


@pytest.mark.parametrize("scale", ["linear", "log"])
@pytest.mark.parametrize("share", [0.0, 0.25, 0.6, 1.0])
def test_a_drawn_value_knows_how_far_along_its_way_it_is(scale, share):
    axis = DrawnRange(low=2.0, high=50.0, scale=scale)
    assert axis.share(axis.at(share)) == pytest.approx(share, abs=1e-12)


@pytest.mark.parametrize("value", [2, 3, 7])
def test_a_whole_number_is_in_the_middle_of_its_part(value):
    axis = DrawnRange(low=2.0, high=7.0, integer=True)
    assert axis.share(value) == pytest.approx((value + 0.5 - 2) / 6)
    assert axis.at(axis.share(value)) == value


@pytest.mark.parametrize(
    ("share", "value"), [(0.0, "p"), (0.33, "p"), (0.34, "q"), (0.67, "r"), (1.0, "r")]
)
def test_choices_have_equal_parts_of_the_way_and_the_end_belongs_to_the_last(share, value):
    assert Choices(["p", "q", "r"]).at(share) == value
