"""Exported laws are within the bound that their header states, which is no more than it must be."""

import ctypes
import functools

import numpy as np
import pytest
from exported_laws import IN_TURN, checked, compilers, law_of, library, made, written

from eqt_cli.analysis.evidence.program_error import ARITHMETICS
from eqt_cli.closed_loop.law_program import MEMORY, NUMBER, TOLD
from eqt_cli.core.errors import EqtError
from eqt_cli.exporting.files import bounds_in_words
from eqt_cli.exporting.laws import _random, exported
from eqt_cli.program.decimals import evaluated

STATES = 400
NEAR = 100
"""The bound is no larger than so many times the largest error that is seen."""


def torques(law, path, states):
    """What the exported law gives at some states."""
    real = {"double": ctypes.c_double, "float": ctypes.c_float}[law.by.name]
    compiled, program = ctypes.CDLL(str(path)), law.program
    numbers = ctypes.c_char.in_dll(compiled, f"{law.name}_defaults")
    told = np.concatenate([states[TOLD + each.name] for each in program.told], axis=1)
    memory = [states[MEMORY + each.name] for each in program.memory] or [np.zeros((len(told), 1))]
    told, memory = (x.astype(law.by.dtype) for x in (told, np.concatenate(memory, axis=1)))
    found = np.empty((len(told), program.torque.size), dtype=law.by.dtype)
    function = getattr(compiled, f"{law.name}_torque")
    for k in range(len(told)):
        rows = [np.ascontiguousarray(each[k]) for each in (memory, told)]
        given = [row.ctypes.data_as(ctypes.POINTER(real)) for row in rows]
        function(ctypes.byref(numbers), *given, found[k].ctypes.data_as(ctypes.POINTER(real)))
    return found.astype(float)


def errors_and_bounds(law, folder, count):
    """Those of the exported law at random states, and which of them are near singularities."""
    path = library(law, written(law, folder), compilers()[0])
    runs = law.states.at(slice(0, law.states.along))
    drawn = _random(runs, law.loop.group, np.random.default_rng(99))
    states = {name: values[-count:] for name, values in drawn.items()}
    numbers = {NUMBER + name: values.reshape(-1) for name, values in law.numbers.items()}
    exact = np.array(
        [
            [float(x) for x in evaluated(law.program.step, {**state, **numbers})["torque"]]
            for k in range(count)
            for state in [{name: values[k] for name, values in states.items()}]
        ]
    )
    # What a double loses of the exact number.
    lost = 2.0**-53 * np.abs(exact)
    error = np.abs(torques(law, path, states) - exact)
    found = law.bounded(law.program.step, states)["torque"]
    return error, lost, found


@pytest.mark.parametrize(
    ("law", "group", "real"), [("lee2010", "SE3", "double"), ("logarithmic", "SE2", "float")]
)
def test_a_law_is_within_its_bound(tmp_path, law, group, real):
    judge(law_of(group, law, real), tmp_path, 80)


@pytest.mark.slow("every law, at hundreds of states in decimals")
@pytest.mark.parametrize(("law", "group", "real"), IN_TURN)
def test_every_law_is_within_its_bound(tmp_path, law, group, real):
    judge(law_of(group, law, real), tmp_path, STATES)


LATE = {
    "reference": {"kind": "constant", "velocity": [0, 0, 0.1]},
    "control": {"period": 0.1, "delay": 1},
    "actuators": [{"kind": "lag", "time_constant": 0.2}],
}


@functools.cache
def regulator(real):
    """LQR of a late loop, with its model of the delay and the lag."""
    [law] = exported(made("SO3", ["lqr"], **LATE), [], ARITHMETICS[real])
    return law


@pytest.mark.parametrize(
    "real", ["double", pytest.param("float", marks=pytest.mark.slow("laws in float are fast"))]
)
def test_a_regulator_with_a_model_of_its_actuators_is_within_its_bound(tmp_path, real):
    law = regulator(real)
    gain = law.program.values(law.loop)["regulator_gain"]
    np.testing.assert_array_equal(gain, law.loop.controller.regulator.gain)
    assert [(entry.name, entry.size) for entry in law.program.memory] == [("actuators", 9)]
    judge(law, tmp_path, 60)
    status, said = checked(law, tmp_path, compilers()[0])
    assert status == 0, said


def test_a_regulator_whose_gains_change_at_knots_is_refused():
    with pytest.raises(EqtError) as caught:
        exported(made("SO3", ["lqr"]), [], ARITHMETICS["double"])
    assert str(caught.value) == (
        "lqr: the numbers of lqr change at instants of the run, and C code has one set of them; "
        "export another law, or lqr for a reference that does not change its loop"
    )


def judge(law, folder, count):
    """The bound of the header holds, and is near; so does that of each state."""
    error, lost, found = errors_and_bounds(law, folder, count)
    far = ~found.singular
    assert far.mean() > 0.9
    assert (error[far] <= (law.torque_bound + lost)[far]).all()
    assert (error <= found.errors + lost).all()
    ratio = law.torque_bound.max() / error[far].max()
    print(f"ratio {law.name} {law.loop.group.name} {law.by.name} {ratio:.1f}")
    assert ratio < NEAR


def test_the_header_states_the_bound_rounded_up():
    law = law_of("SE2", "logarithmic")
    said = bounds_in_words(law)
    printed = [float(word.split()[1]) for word in said.split(";")[0].split(", ")]
    assert (law.torque_bound <= printed).all()
    assert (np.array(printed) <= 1.1 * law.torque_bound).all()
    assert said.endswith("; N m (rotation), N (translation)")


def test_states_near_a_half_turn_are_counted_apart():
    """The quaternion's torque jumps there, so that no bound is small."""
    law = law_of("SO3", "quaternion", "float")
    assert 0 < np.count_nonzero(law.singular) <= 100
    assert law.singular_bound.max() > 0.1
    assert law.torque_bound.max() < 1e-4
