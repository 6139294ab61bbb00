"""What is recorded of a field that writes, and what becomes of one that cannot be recorded.

That recordings of eqt's laws, references, forces and actuators equal them is in `tests/contracts`.
"""

import numpy as np
import pytest

from eqt_cli.engines.solve_ivp import (
    COMPARED,
    WORTH_RECORDING,
    NotRecordable,
    RecordedCalls,
    RecordedField,
    _agree,
)

RUNS = 5
# Two or three terms of a few units are added in another order.
ROUNDING = 1e-14


def states(seed, runs=RUNS):
    return np.random.default_rng(seed).standard_normal((runs, 2))


def evaluated(field, evaluations, t=0.3):
    """What a field gives, evaluated at so many states in turn."""
    return [field(t + 0.1 * k, states(k)) for k in range(evaluations)]


def check(field, runs=RUNS):
    """The recording at another time and state equals the field."""
    recording = RecordedCalls(field, 0.2, states(1, runs))
    for t, y in ((0.7, states(2, runs)), (0.2, states(1, runs))):
        np.testing.assert_allclose(recording.repeat(t, y), field(t, y), rtol=0, atol=ROUNDING)
    return recording


def test_zeros_are_zeros_at_every_repetition():
    def field(t, y):
        found = np.zeros_like(y)
        before = found + t
        found[..., 0] = y[..., 1]
        return found + before

    check(field)


def test_calls_with_zeros_of_either_sign_are_not_equal():
    def field(t, y):
        squares = y * y + t
        return np.copysign(1.0, squares * 0.0) + 2 * np.copysign(1.0, squares * -0.0)

    np.testing.assert_array_equal(check(field).repeat(0.1, states(3)), -1.0)


def test_a_call_is_made_again_where_what_it_read_was_written_to():
    def field(t, y):
        kept = y.copy()
        first = kept * 2.0
        kept[..., 0] = t
        return first + kept * 2.0

    check(field)


def test_what_two_calls_share_is_not_written_to():
    def field(t, y):
        one, other = y * 2.0, y * 2.0
        one[..., 0] = 0.0
        return one + other

    with pytest.raises(NotRecordable):
        RecordedCalls(field, 0.2, states(1))


def branching(t, y):
    return -y if t < 2.0 else y


def looking(t, y):
    return -y if y.max() > 0 else y


def filling(t, y):
    found = np.zeros(y.shape)
    found[:] = t * y
    return found


def selecting(t, y):
    return y * len(y[y > 0])


def rounding(t, y):
    return np.add(y, t, dtype=np.float32) + 0 * y


@pytest.mark.parametrize("field", [branching, looking, filling, selecting, rounding])
def test_what_cannot_be_recorded_is_evaluated_as_it_is_written(field):
    with pytest.raises(Exception):  # noqa: B017, PT011  # whatever the field makes of no array
        RecordedCalls(field, 0.3, states(0))
    evaluations = WORTH_RECORDING + COMPARED + 3
    found = evaluated(RecordedField(lambda held: field), evaluations)
    np.testing.assert_array_equal(found, evaluated(field, evaluations))


def test_a_field_that_depends_on_more_than_time_and_state_is_not_repeated():
    def counting():
        counted = iter(range(1000))
        return lambda t, y: next(counted) * 1e-3 + y

    evaluations = WORTH_RECORDING + COMPARED + 3
    field = counting()
    found = evaluated(RecordedField(lambda held: field), evaluations)
    # To record it is one more evaluation.
    for k, each in enumerate(found):
        own = k + (k >= WORTH_RECORDING)
        np.testing.assert_array_equal(each, own * 1e-3 + states(k))


def test_a_recording_goes_on_by_the_numbers_that_are_held():
    called = []

    def fields(held):
        def field(t, y):
            called.append(t)
            return held["speed"] * t * y + held["place"]

        return field

    field = RecordedField(fields)
    for k in range(2 * WORTH_RECORDING):
        speed, place = np.array(k + 1), np.array([0.5, k])
        field.hold({"speed": speed, "place": place})
        expected = speed * (0.1 * k) * states(k) + place
        np.testing.assert_array_equal(field(0.1 * k, states(k)), expected)
    assert len(called) == WORTH_RECORDING + COMPARED + 1


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_recording_may_differ_from_its_field_by_rounding(sign):
    found = sign * np.array([3.0, 0.5, 0.0])
    assert _agree(found + np.array([0.0, 0.0, 1e-10]), found)
    assert not _agree(found + np.array([0.0, 0.0, 1e-9]), found)
    assert not _agree(found + np.array([0.0, 1e-9, 0.0]), found)
    small = 1e-3 * found
    assert _agree(small + np.array([0.0, 0.0, 1e-13]), small)
    assert not _agree(small + np.array([0.0, 0.0, 1e-12]), small)


def test_a_recording_agrees_where_both_are_not_numbers():
    one, other = np.array([np.nan, 1.0, np.inf]), np.array([np.nan, 1.0, -np.inf])
    assert _agree(one, one.copy())
    assert not _agree(one, other)
    assert not _agree(one, np.ones(3))
    assert _agree(one[:1], one[:1])


def test_a_field_that_reads_a_held_number_is_not_repeated():
    def fields(held):
        return lambda t, y: -y if held.get("speed", 0) > 0 else y

    field = RecordedField(fields)
    field.hold({"speed": np.array(1.0)})
    evaluated(field, 2 * WORTH_RECORDING)
    field.hold({"speed": np.array(-1.0)})
    np.testing.assert_array_equal(field(0.0, states(1)), states(1))
