"""A whole cascade in C: the example, and faults that are named."""

import dataclasses
from pathlib import Path

import numpy as np
import pytest
from case_tables import in_ci
from said import says

import eqt_cli
from eqt_cli.extend import Inertia
from eqt_cli.extensions.code.code_evidence import Question, drawn_states, explained_cascade
from eqt_cli.extensions.underactuated import cascade
from eqt_cli.numbers.leaves import with_fields

TYPED = (Path(__file__).parents[3] / "examples/code/quad.c").read_text(encoding="utf-8")
LAW = {"kind": "cascade", "attitude": "lee2010", "along": [0, 0, 1], "position": {"kx": 6, "kv": 4}}
EXPERIMENT = {
    "group": "SE3",
    "inertia": [0.01, 0.01, 0.02, 1.0, 1.0, 1.0],
    "model": {"forces": [{"kind": "restoring", "weight": 9.81}]},
    "reference": {"kind": "flat", "position": ["sin(t)", "sin(2*t)/2", 0.0], "heading": "0.2*t"},
    "control": {"period": 0.01},
    "initial": {"pose": "fixed", "velocity": "fixed"},
    "time": {"duration": 0.2},
}
NUMBERS = {"mass": 1.0, "weight": 9.81, "kx": 6, "kv": 4, "kR": 2.0, "kW": 0.2}
CODE = {
    "kind": "code",
    "label": "ours",
    "file": "quad.c",
    "as": LAW,
    "gains": {"kp": 1.0, "kd": 0.2},
    "numbers": {**NUMBERS, "J": [0.01, 0.01, 0.02]},
}


def typed(*changes):
    """Write the C of the example, with changes."""
    text = TYPED
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    Path("quad.c").write_text(text, encoding="utf-8")


def flying(**claimed):
    return EXPERIMENT | {"controllers": [{**CODE, "as": LAW | claimed}]}


@pytest.mark.parametrize(
    ("rates", "remark"),
    [
        ("none", {}),
        in_ci(
            "the other is fast",
            "model",
            {"torque of cascade, double, at random states": "torque: Ω_c and Ω̇_c are 0"},
        ),
    ],
)
def test_c_that_was_typed_is_the_cascade_without_rates(rates, remark, judged):
    typed()
    assert judged(flying(rates=rates)) == remark


@pytest.mark.ci("compiles the C that eqt exports, and flies it")
@pytest.mark.parametrize("period", [{}, {"period": 0.03}])
def test_exported_c_is_the_cascade(judged, period):
    law = LAW | {"position": LAW["position"] | period}
    eqt_cli.export(
        EXPERIMENT | {"name": "c", "controllers": [{**law, "gains": CODE["gains"]}]}, "c"
    )
    kept = {"memory": ["held", "left"]} if period else {}
    code = CODE | kept | {"file": "c/cascade.c", "numbers": {}, "as": law}
    assert judged(EXPERIMENT | {"controllers": [code]}) == {}


def test_what_does_not_fit_the_claim_is_told(told):
    typed(("position[5][3]", "place[5][3]"), ("in->position", "in->place"))
    assert told(flying()).endswith(
        "input: quad_input in quad.c has no field desired_pose; it has t, pose, velocity, place, "
        "heading"
    )
    six = "desired_pose[16], desired_velocity[6], desired_acceleration[6], place[5][3]"
    typed(("position[5][3]", six), ("in->position", "in->place"))
    assert "quad_input in quad.c has a field place, which is no signal" in told(flying())
    typed()
    free = flying() | {"reference": {**EXPERIMENT["reference"], "heading": "free"}}
    assert told(free).endswith(
        "file: quad_input has a heading, and the reference gives none; remove it there"
    )


# Faults are planted in the law itself, because one in generated C is hard to place. ---------------


@pytest.fixture(scope="module")
def question():
    loop = eqt_cli.load_experiment(
        EXPERIMENT | {"controllers": [{**LAW, "gains": CODE["gains"]}]}
    ).base.loops["cascade"]
    drawn = drawn_states(loop, 5.0, np.random.default_rng(0))
    return Question(loop, *drawn).of(np.arange(64))


def wrench_of(question, **changes):
    loop = dataclasses.replace(question.loop, **changes)
    return dataclasses.replace(question, loop=loop).torque()


def with_mass(inertia, mass):
    scale = np.array([1, 1, 1, mass, mass, mass])
    return Inertia(inertia.matrix * scale, inertia.inverse / scale)


WITHOUT = "the same as in the law: position error, velocity error, desired acceleration"
FAULTS = {
    "gravity": ({"known_forces": ()},
        f"push: lacks known forces, such as gravity: coefficient 0.00 of 1; {WITHOUT}"),
    "rates": ({"rates": "reference"}, "torque: Ω_c and Ω̇_c are those of the reference"),
    "both": ({"rates": "none", "known_forces": ()},
        f"push: lacks known forces, such as gravity: coefficient 0.00 of 1; {WITHOUT}; "
        "torque: Ω_c and Ω̇_c are 0"),
}  # fmt: skip


@pytest.mark.parametrize(
    "fault", [in_ci("with another it is fast", fault, unless=fault == "rates") for fault in FAULTS]
)
def test_what_is_missing_is_named(question, fault):
    changes, words = FAULTS[fault]
    law = with_fields(question.loop.controller, **changes)
    assert explained_cascade(question, wrench_of(question, controller=law), "double") == words


@pytest.mark.ci("one of several faults")
def test_a_wrong_mass_is_named(question):
    wrench = wrench_of(question, inertia=with_mass(question.loop.inertia, 0.7))
    assert explained_cascade(question, wrench, "double") == (
        "push: mass: coefficient 0.70 of 1, and of known forces, such as gravity: 1.00"
    )
    law = question.loop.controller
    scaled = wrench_of(question)
    scaled[:, 3:] *= 0.7
    assert explained_cascade(question, scaled, "double") == "push: mass: coefficient 0.70 of 1"
    stiffer = with_fields(law, position=with_fields(law.position, kx=3.0))
    assert says(
        explained_cascade(question, wrench_of(question, controller=stiffer), "double"),
        "push: has position error: coefficient 0.50 of 1…",
    )


@pytest.mark.ci("one of several faults")
def test_a_missing_acceleration_is_named(question, monkeypatch):
    of = cascade.attitude
    monkeypatch.setattr(
        cascade,
        "attitude",
        lambda *given: (found := of(*given))._replace(acceleration=0.0 * found.acceleration),
    )
    wrench = wrench_of(question)
    monkeypatch.undo()
    words = explained_cascade(question, wrench, "double")
    assert words.startswith("torque: lacks Ω̇_c: coefficient 0.00 of 1; the same as in the law:")
