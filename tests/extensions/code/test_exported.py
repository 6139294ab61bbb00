"""Exported C that comes back: the very bits, and faults that are told and named."""

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from case_tables import in_ci
from exported_laws import FLAGS, compilers

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base import yaml_source
from eqt_cli.extend import EqtError, group_named
from eqt_cli.extensions.code.controllers import Adapter, Signal


@pytest.mark.ci("compiles two closed loops for each law")
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
    [in_ci("eqt is fast", law, unless=law == "eqt") for law in ("lee2010", "eqt", "goodarzi2013")],
)
def test_exported_c_is_the_law(law, faulty, judged):
    assert judged(faulty(law)) == {}


@pytest.mark.ci("another fault of a memory is fast")
def test_a_memory_that_begins_otherwise(faulty, judged):
    last = "memory->integral, next.integral);"
    rows = judged(faulty("goodarzi2013", (last, f"{last} next.integral[0] = 1;")))
    assert rows == {
        "memory of Goodarzi 2013 at the start of a run": "integral starts at [1.0, 0.0, 0.0], "
        "but at [0.0, 0.0, 0.0] in the law"
    }


TORQUE = "torque of {}, double, at random states"
ORDER = {str(3 * i + j): 3 * j + i for i in range(3) for j in range(3)}


FAULTS = {
    "gyroscopic dropped": ("eqt", "in_number_gyroscopic", "(0 * in_number_gyroscopic[K])",
        "it is nog; lacks gyroscopic (weight g): coefficient 0.00 of 1"),
    "transport dropped": ("eqt", "in_number_transport", "(0 * in_number_transport[K])",
        "lacks transport (weight c): coefficient 0.00 of 1"),
    "integral dropped": ("goodarzi2013", "in_number_ki", "(0 * in_number_ki[K])",
        "it is Lee 2012; lacks integral: coefficient 0.00 of 1"),
    "pose transposed": ("lee2010", "in_input_pose", "in_input_pose[T]", "the pose is transposed"),
    "gain transposed": ("lee2010", "in_number_kd", "in_number_kd[T]", "kd is transposed"),
    "bound missing": ("goodarzi2013", "in_number_bound", "(1e9 * in_number_bound[K])",
        "the option bound is missing"),
}  # fmt: skip


FAST = ("gyroscopic dropped", "gain transposed")
"""Of a law with memory, the faults of its memory are fast."""


@pytest.mark.parametrize(
    "fault", [in_ci("one of several faults", fault, unless=fault in FAST) for fault in FAULTS]
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


def test_a_memory_that_goes_on_too_early_is_told_and_named(faulty, judged, exports):
    """It is moved on before it is used, as where a loop is turned inside out."""
    _, body = exports["goodarzi2013"]
    step = re.search(r"    goodarzi2013_step\(.*?;\n", body[body.index("_torque(const") :], re.S)[0]
    once = "    *memory = next;\n"
    later = step.replace("next.integral", "(double[3]){0}")
    rows = judged(faulty("goodarzi2013", (step + once, step + once + later)))
    assert rows[TORQUE.format("Goodarzi 2013")] == ("memory advances before it is used, not after")


# With an adapter: what the vehicle reads and returns ----------------------------------------------

ROTATION = {
    "q": {"signal": "pose", "as": "quaternion wxyz"},
    "w": {"signal": "velocity", "unit": "deg/s"},
    "q_d": {"signal": "desired_pose", "as": "quaternion xyzw"},
    "w_d": {"signal": "desired_velocity", "frame": "space", "sign": [1, -1, -1]},
    "a_d": {"signal": "desired_acceleration", "frame": "body", "scale": 2},
}
EULER = ROTATION | {
    "q": {"signal": "pose", "as": "roll-pitch-yaw", "unit": "deg", "sign": [1, -1, -1]},
    "q_d": {"signal": "desired_pose", "as": "columns"},
}
MOTION = {
    "p": {"signal": "pose.translation", "unit": "mm", "frame": "body"},
    "q": {"signal": "pose.rotation", "as": "quaternion xyzw"},
    "v": {"signal": "velocity.translation", "frame": "space"},
    "w": {"signal": "velocity.rotation", "unit": "deg/s"},
    "q_d": {"signal": "desired_pose.rotation", "as": "quaternion wxyz"},
    "p_d": {"signal": "desired_pose.translation", "sign": -1},
    "V_d": {"signal": "desired_velocity"},
    "A_d": {"signal": "desired_acceleration", "frame": "body"},
}
SPACE = {
    "group": "SE3",
    "inertia": [1.0, 2.0, 3.0, 4.0, 4.0, 4.0],
    "reference": {"kind": "constant"},
}
SPACE |= {"initial": {"pose": {"kind": "exp_normal", "std": 1.0}, "velocity": "normal"}}
ADAPTED = {
    "quaternions": ({}, "lee2010", ROTATION, {"per": "inertia", "frame": "space", "scale": 3}),
    "angles": ({}, "eqt", EULER, {"unit": "mN m"}),
    "a memory": ({}, "goodarzi2013", ROTATION, {}),
    "a rigid motion": (SPACE, "lee2010", MOTION, {"per": "inertia", "sign": -1}),
}


def test_c_says_what_its_angles_are():
    """What stands behind the field in the header: a unit, and what differs from eqt's."""
    plain = {**EULER["q"], "sign": 1.0}
    del plain["unit"]
    for options, said in (
        (plain, "rad, as roll-pitch-yaw"),
        (EULER["q"], "deg, as roll-pitch-yaw, sign [1, -1, -1]"),
        ({**plain, "signal": "pose.rotation"}, "rad, rotation, as roll-pitch-yaw"),
    ):
        signal = Signal(**{"as_" if key == "as" else key: x for key, x in options.items()})
        [entry] = Adapter({"q": signal}).entries(group_named("SO3"), {"pose": "1"})
        assert (entry.name, entry.shape, entry.unit) == ("q", (3,), said)


@pytest.fixture
def adapted(config, tmp_path):
    """Exports a law with an adapter: a configuration with the C and that adapter."""

    def make(over, law, inputs, output, **changed):
        over = dict(over) | {"gains": {"kp": 1.0, "kd": 0.5}}
        adapter = {"inputs": inputs, "output": output}
        Path("a.yaml").write_text(yaml_source.dump(adapter), encoding="utf-8")
        made = config(over=over) | {"controllers": [law]}
        eqt_cli.export(made, tmp_path / "law", adapter="a.yaml")
        memory = ["integral"] if law == "goodarzi2013" else []
        options = {"file": f"law/{law}.c", "numbers": {}, "memory": memory, "as": law}
        options["adapter"] = adapter | {"inputs": {**inputs, **changed}}
        return config(over=over, **options)

    return make


@pytest.mark.parametrize(
    "case", [in_ci("quaternions are fast", case, unless=case == "quaternions") for case in ADAPTED]
)
def test_c_for_an_adapter_is_the_law_through_it(case, adapted, judged):
    said = judged(adapted(*ADAPTED[case])).values()
    assert all(each.startswith("undecided: ") for each in said)  # not all of a sine is reached


@pytest.mark.ci("compiles a program for each case")
@pytest.mark.parametrize("case", ADAPTED)
def test_the_check_of_c_for_an_adapter_passes(case, adapted):
    """It compares the C with exact numbers."""
    adapted(*ADAPTED[case])
    law, [command, *_] = ADAPTED[case][1], compilers()
    made = ["-o", "check", f"law/{law}_check.c", f"law/{law}.c"]
    subprocess.run([*command, *FLAGS, *made], check=True)
    said = subprocess.run(["./check"], check=True, capture_output=True, text=True).stdout
    assert "states pass" in said


def test_c_for_an_adapter_is_not_the_law_through_another(adapted, judged):
    other = {"q": {"signal": "pose", "as": "quaternion xyzw"}}
    assert TORQUE.format("Lee 2010") in judged(adapted(*ADAPTED["quaternions"], **other))


def test_the_header_says_what_the_adapter_says(adapted):
    adapted(*ADAPTED["a rigid motion"])
    text = " ".join(Path("law", "lee2010.h").read_text(encoding="utf-8").split())
    assert re.search(r"double q\[4\]; +/\* .*quaternion xyzw; Q, the pose as it was", text)
    assert re.search(r"double w\[3\]; +/\* deg/s, rotation; V, the body velocity", text)
    assert "sign -1.0, per inertia; then the memory" in text


@pytest.mark.parametrize(
    ("inputs", "said"),
    [
        ({"q": ROTATION["q"]},
         "lee2010: the adapter lacks velocity, or a part of it; add an input"),
        ({"q-1": ROTATION["q"]}, "a.yaml:2:3: adapter.inputs.q-1: expected a name in C, got 'q-1'"),
    ],
)  # fmt: skip
def test_an_adapter_that_gives_no_law(inputs, said, adapted):
    with pytest.raises(EqtError) as caught:
        adapted({}, "lee2010", inputs, {})
    assert str(caught.value) == said


def test_no_reference_with_an_adapter(config):
    Path("a.yaml").write_text(yaml_source.dump({"inputs": ROTATION}), encoding="utf-8")
    made = config(over={"reference": {"kind": "constant"}}) | {"controllers": ["lee2010"]}
    with pytest.raises(EqtError, match="lee2010: leave out --reference and the est"):
        eqt_cli.export(made, "law", adapter="a.yaml", reference=True)
