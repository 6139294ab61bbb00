"""Exported C that comes back: the very bits, and faults that are told and named."""

import re

import numpy as np
import pytest
from case_tables import slow

import eqt_cli
from eqt_cli.api.loading import open_at


@pytest.mark.slow("compiles two closed loops for each law")
@pytest.mark.parametrize("law", ["eqt", "goodarzi2013"])
def test_a_run_with_the_exported_c_has_the_bits_of_the_law(law, faulty, tmp_path):
    """Double, sampled, by native: with errors of measurement and a delay, too."""
    made = faulty(law, over=[{"kind": law, "bound": 0.3} if law == "goodarzi2013" else law])
    made |= {
        "solver": {"engine": "native", "cross_check": 0},
        "control": {"period": 0.02, "delay": 1},
        "sensors": {"velocity": [{"kind": "noise", "std": 0.01}]},
    }
    found = eqt_cli.run(made, out=tmp_path / "r")
    with open_at(found.path) as result:
        for name in ("pose", "velocity", "torque", "command", "lyapunov"):
            one, other = (result.read(name, controller=k) for k in range(2))
            assert np.isfinite(one).all()
            np.testing.assert_array_equal(one, other)


@pytest.mark.parametrize(
    "law",
    [slow("eqt is fast", law, unless=law == "eqt") for law in ("lee2010", "eqt", "goodarzi2013")],
)
def test_exported_c_is_the_law(law, faulty, judged):
    assert judged(faulty(law)) == {}


@pytest.mark.slow("another fault of a memory is fast")
def test_a_memory_that_begins_otherwise(faulty, judged):
    last = "memory->integral, next.integral);"
    rows = judged(faulty("goodarzi2013", (last, f"{last} next.integral[0] = 1;")))
    assert rows == {
        "memory of Goodarzi 2013 at the start of a run": "integral begins with [1.0, 0.0, 0.0]; "
        "the law's begins with [0.0, 0.0, 0.0]"
    }


TORQUE = "torque of {}, double, at random states"
ORDER = {str(3 * i + j): 3 * j + i for i in range(3) for j in range(3)}


FAULTS = {
    "gyroscopic dropped": ("eqt", "in_number_gyroscopic", "(0 * in_number_gyroscopic[K])",
        "it is nog; lacks gyroscopic (weight g): coefficient 0.00 of 1"),
    "transport dropped": ("eqt", "in_number_transport", "(0 * in_number_transport[K])",
        "lacks transport (weight c): coefficient 0.00 of 1"),
    "integral dropped": ("goodarzi2013", "in_number_ki", "(0 * in_number_ki[K])", "lacks integral: "
        "coefficient 0.00 of 1"),
    "pose transposed": ("lee2010", "in_input_pose", "in_input_pose[T]", "the pose is transposed"),
    "gain transposed": ("lee2010", "in_number_kd", "in_number_kd[T]", "kd is transposed"),
    "bound missing": ("goodarzi2013", "in_number_bound", "(1e9 * in_number_bound[K])",
        "the option bound is missing"),
}  # fmt: skip


FAST = ("gyroscopic dropped", "gain transposed")
"""Of a law with memory, the faults of its memory are fast."""


@pytest.mark.parametrize(
    "fault", [slow("one of several faults", fault, unless=fault in FAST) for fault in FAULTS]
)
def test_a_fault_is_told_and_named(fault, faulty, judged, exports):
    law, read, by, said = FAULTS[fault]
    body = exports[law][1]
    changed = re.sub(
        rf"\b{read}\[(\d+)\]",
        lambda found: by.replace("K", found[1]).replace("T", str(ORDER.get(found[1], 0))),
        body,
    )
    assert changed != body
    rows = judged(faulty(law, (body, changed)))
    [remark] = rows.values()
    assert remark.startswith(said), remark


def test_exchanged_frames_are_told_and_named(faulty, judged):
    """A law with its errors in the spatial frame that claims to be one in the body frame."""
    rows = judged(faulty("spatial", claims="lee2010"))
    assert list(rows.values()) == ["the frames are exchanged: all errors are in the spatial frame"]


@pytest.mark.slow("another fault of a memory is fast")
def test_a_memory_that_does_not_go_on_is_told_and_named(faulty, judged):
    stale = "    goodarzi2013_memory next;\n    goodarzi2013_step"
    fixed = "    goodarzi2013_memory next = *memory;\n    goodarzi2013_step"
    rows = judged(
        faulty(
            "goodarzi2013",
            (stale, fixed),
            ("torque, next.integral);\n    *memory = next;", "torque, next.integral);"),
        )
    )
    assert rows == {
        "memory of Goodarzi 2013 after a period": "integral does not go on: it is stale"
    }


def test_a_memory_that_goes_on_too_early_is_told_and_named(faulty, judged, exports):
    """It is moved on before it is used, as where a loop is turned inside out."""
    _, body = exports["goodarzi2013"]
    step = re.search(r"    goodarzi2013_step\(.*?;\n", body[body.index("_torque(const") :], re.S)[0]
    once = "    *memory = next;\n"
    later = step.replace("next.integral", "(double[3]){0}")
    rows = judged(faulty("goodarzi2013", (step + once, step + once + later)))
    assert rows[TORQUE.format("Goodarzi 2013")] == (
        "memory goes on before it is used, and not after"
    )
