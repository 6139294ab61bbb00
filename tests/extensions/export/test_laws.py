"""Exported laws, allocations and filters: within the bound of their header, and eqt's own bits."""

import ctypes
import functools
import re
import subprocess

import numpy as np
import plain_current as plain
import pytest
from case_tables import in_ci, refusal
from exported_laws import ALL, FLAGS, IN_TURN, checked, compilers, law_of, library, made, written
from said import says

import eqt_cli
from eqt_cli.components.mechanics import LawInput
from eqt_cli.config.study import Study
from eqt_cli.engines import compiler
from eqt_cli.engines import library as native_library
from eqt_cli.engines.library import Rows
from eqt_cli.engines.native import at_instants, held_rows, parameter_rows, programs
from eqt_cli.extend import EqtError, group_named, load_plugin
from eqt_cli.extensions.export.export import bounds_in_words
from eqt_cli.extensions.export.export_laws import _random, exported
from eqt_cli.extensions.export.program_error import ARITHMETICS
from eqt_cli.extensions.spacecraft.wheels import Wheels
from eqt_cli.extensions.thrusters.parts import Priority
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from eqt_cli.loop.law_program import INPUT, MEMORY
from eqt_cli.numbers.rounded import evaluated
from eqt_cli.runs.batches import batches

STATES = 400
NEAR = 100
"""The bound is no larger than so many times the largest error that is seen."""


def answers(law, path, states, name="torque", size=None):
    """What the exported law gives at some states, or another function of it; and its memory."""
    real = {"double": ctypes.c_double, "float": ctypes.c_float}[law.by.name]
    compiled, program = ctypes.CDLL(str(path)), law.program
    numbers = ctypes.c_char.in_dll(compiled, f"{law.name}_defaults")
    states = {name: np.reshape(values, (len(values), -1)) for name, values in states.items()}
    told = np.concatenate([states[INPUT + each.name] for each in program.inputs], axis=1)
    memory = [states[MEMORY + each.name] for each in program.memory] or [np.zeros((len(told), 1))]
    told, memory = (x.astype(law.by.dtype) for x in (told, np.concatenate(memory, axis=1)))
    found = np.empty((len(told), size or program.torque.size), dtype=law.by.dtype)
    function = getattr(compiled, f"{law.name}_{name}")
    for rows in zip(memory, told, found, strict=True):
        given = [row.ctypes.data_as(ctypes.POINTER(real)) for row in rows]
        function(ctypes.byref(numbers), *given)
    return found.astype(float), memory


def errors_and_bounds(law, folder, count):
    """Those of the exported law at random states, and which of them are near singularities."""
    path = library(law, written(law, folder), compilers()[0])
    runs = law.states.at(slice(0, law.states.along))
    drawn = _random(runs, law.loop.group, np.random.default_rng(99))
    states = {name: values[-count:] for name, values in drawn.items()}
    exact = np.array(
        [
            [float(x) for x in evaluated(law.program.step, {**state, **law.flat_numbers})["torque"]]
            for k in range(count)
            for state in [{name: values[k] for name, values in states.items()}]
        ]
    )
    # What a double loses of the exact number.
    lost = 2.0**-53 * np.abs(exact)
    error = np.abs(answers(law, path, states)[0] - exact)
    found = law.bounded(law.program.step, states)["torque"]
    return error, lost, found


@pytest.mark.parametrize(
    ("law", "group", "real"), [("lee2010", "SE3", "double"), ("logarithmic", "SE2", "float")]
)
def test_a_law_is_within_its_bound(tmp_path, law, group, real):
    judge(law_of(group, law, real), tmp_path, 80)


@pytest.mark.ci("every law, at hundreds of states in decimals")
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


@pytest.mark.parametrize("real", ["double", in_ci("laws in float are fast", "float")])
def test_a_regulator_with_a_model_of_its_actuators_is_within_its_bound(tmp_path, real):
    law = regulator(real)
    gain = law.program.values(law.loop)["regulator_gain"]
    np.testing.assert_array_equal(gain, law.loop.controller.regulator.gain)
    assert [(entry.name, entry.size) for entry in law.program.memory] == [("actuators", 9)]
    judge(law, tmp_path, 60)
    status, said = checked(law, tmp_path, compilers()[0])
    assert status == 0, said


def test_a_regulator_whose_gains_change_at_knots_is_refused():
    assert says(
        refusal(EqtError, exported, made("SO3", ["lqr"]), [], ARITHMETICS["double"]),
        "lqr: the numbers of lqr change during the…",
    )


@pytest.mark.ci("compiles")
def test_a_regulator_in_c_holds_a_vehicle_in_a_current(tmp_path):
    """By Fossen's equations at the reference, and as eqt around it."""
    body, added = [0.16, 0.16, 0.16, 11.5, 11.5, 11.5], [0.12, 0.12, 0.12, 5.5, 12.7, 14.57]
    drag, current = [0.07, 0.07, 0.07, 4.03, 6.22, 5.18], [0.4, 0.3, -0.1]
    known = [
        {"kind": "drag", "linear": drag, "current": current},
        {"kind": "restoring", "weight": 112.8, "buoyancy": 114.8, "centre_of_buoyancy": [0.02] * 3},
    ]
    changes = {
        "inertia": {"rigid": body, "added": added},
        "model": {"forces": known},
        "reference": {"kind": "constant", "pose": {"rotvec": [0.3, -0.4, 0.9]}},
    }
    [law] = exported(made("SE3", ["lqr"], **changes), [], ARITHMETICS["double"])
    loop, random, n = law.loop, np.random.default_rng(4), 20
    G, Qd = loop.group, loop.reference.motion(loop.group, 0.0)[0]
    x = 0.3 * random.normal(size=(n, 18)) * (np.arange(n) > 0)[:, None]  # at the reference first
    at = {"pose": Qd @ G.exp(x[:, :6]), "velocity": x[:, 6:12]}
    at |= {"t": np.zeros(n), "desired_pose": np.broadcast_to(Qd, (n, 4, 4))}
    at |= {"desired_velocity": np.zeros((n, 6)), "desired_acceleration": np.zeros((n, 6))}
    states = {INPUT + name: values.reshape(n, -1) for name, values in at.items()}
    found, _ = answers(
        law,
        library(law, written(law, tmp_path), compilers()[0]),
        states | {MEMORY + "actuators": x[:, 12:]},
    )
    flow = (lambda t: np.array(current)), (lambda t: np.zeros(3))
    lift = {"weight": 112.8, "buoyancy": 114.8, "at": [0.02] * 3}
    vehicle = plain.Vehicle(body, added, drag, np.zeros((6, 6)), *flow, **lift)
    rates = vehicle.acceleration(0.0, Qd[:3, :3], np.zeros(3), np.zeros(6))
    np.testing.assert_allclose(found[0], -np.add(body, added) * rates, rtol=0, atol=1e-13)
    s = LawInput(**at).tracking(G, loop.inertia, loop.gains, {"actuators": x[:, 12:]})
    np.testing.assert_allclose(found, loop.controller.torque(s), rtol=0, atol=1e-12)


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


# The allocation -----------------------------------------------------------------------------------


CONFIG = {
    "group": "SO3",
    "inertia": [0.04, 0.04, 0.01],
    "gains": {"kp": 0.001, "kd": 0.01},
    "reference": {"kind": "torque", "torque": [0, 0, 0]},
    "controllers": ["lee2010"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.1}},
    "time": {"duration": 1},
    "ensemble": {"runs": 2},
}
MATRIX = [[1.0, -1.0, 0.5, 0.0], [0.0, 0.3, 1.0, -1.0], [0.2, 0.0, 0.4, 1.0]]


def allocation(folder, section, **changes):
    """The exported allocation of an actuator, and the header that states its bound."""
    if compiler.missing():
        pytest.skip("no C compiler")
    eqt_cli.export({**CONFIG, "actuators": [section], **changes}, folder / "law")
    made, source = folder / "law.so", folder / "law" / "lee2010.c"
    flags = [*FLAGS, "-fPIC", "-shared", str(source), "-o", str(made)]
    subprocess.run([*compilers()[0], *flags], check=True)
    function = ctypes.CDLL(str(made)).lee2010_allocate

    def allocate(torque):
        found = (ctypes.c_double * 4)()
        function((ctypes.c_double * 3)(*torque), found)
        return np.array(found)

    header = (folder / "law" / "lee2010.h").read_text(encoding="utf-8")
    bound = re.search(r"rounding moves them by at\s+most (\S+);", header).group(1)
    return allocate, float(bound), header


TORQUES = 0.02 * np.random.default_rng(1).standard_normal((40, 3))
"""Within and beyond the limits."""


@pytest.mark.parametrize(
    ("section", "part"),
    [
        pytest.param(
            {"kind": "wheels", "pyramid": 0.9, "limit": 0.02},
            Wheels(pyramid=0.9, limit=0.02),
            marks=pytest.mark.ci("thrusters are fast"),
        ),
        (
            {"kind": "thrusters", "matrix": MATRIX, "low": -0.02, "high": 0.03},
            Thrusters(matrix=MATRIX, low=-0.02, high=0.03),
        ),
    ],
)
def test_an_exported_allocation_is_that_of_the_actuator(tmp_path, section, part):
    """Within the bound of the header."""
    allocate, bound, _ = allocation(tmp_path, section)
    assert 1e-17 < bound < 1e-14
    G = group_named("SO3")
    part = part.of_run(G, None)
    for torque in TORQUES:
        x = np.zeros(part.states(G))
        expected = (part.thrust if section["kind"] == "thrusters" else part_torques(part))(
            G, torque, x
        )
        # Both sums round.
        assert np.abs(allocate(torque) - expected).max() <= 2 * bound * np.abs(torque).max()


@pytest.mark.ci("exports and compiles a law with 4 rotors")
def test_an_exported_allocation_by_priority_is_that_of_the_actuator(tmp_path):
    """Within the bound of the header."""
    order = [["torque x", "torque y"], "torque z"]
    section = {"kind": "thrusters", "matrix": MATRIX, "low": -0.02, "high": 0.03}
    section["allocation"] = {"kind": "priority", "order": order}
    part = Thrusters(matrix=MATRIX, low=-0.02, high=0.03, allocation=Priority("priority", order))
    allocate, bound, header = allocation(tmp_path, section, control={"period": 0.1})
    assert "by priority" in header
    assert 1e-19 < bound < 1e-14
    G = group_named("SO3")
    part = part.of_run(G, None)
    at_limits = 0
    for torque in TORQUES:
        found = allocate(torque)
        expected = part.solution(G, torque[None])[0]
        assert np.abs(found - expected).max() <= 2 * bound + 1e-16
        at_limits += bool(((found == part.low) | (found == part.high)).any())
    assert 5 < at_limits < 40


@pytest.mark.ci("exports and compiles a law with an anti-windup")
def test_an_exported_anti_windup_is_told_of_the_limits(tmp_path):
    """Its own check passes, whose states are partly beyond the limits, and so does eqt's law."""
    if compiler.missing():
        pytest.skip("no C compiler")
    law = {"kind": "goodarzi2013", "ki": 0.01, "anti_windup": {"back_calculation": 0.5}}
    limits = {"actuators": [{"kind": "limit", "limit": 1e-3}], "control": {"period": 0.1}}
    eqt_cli.export({**CONFIG, "controllers": [law], **limits}, tmp_path)
    sources = [str(tmp_path / f"goodarzi2013{end}.c") for end in ("_check", "")]
    check = tmp_path / "check"
    subprocess.run([*compilers()[0], *FLAGS, *sources, "-o", str(check), "-lm"], check=True)
    said = subprocess.run([str(check)], check=True, capture_output=True, text=True).stdout
    assert "states pass" in said
    header = (tmp_path / "goodarzi2013.h").read_text(encoding="utf-8")
    assert re.search(r"acting_0_high\[3\];\s+/\* .*fixed by the law; leave it", header)


@pytest.mark.ci("exports and compiles two laws")
@pytest.mark.parametrize("law", [
    {"kind": "indi", "law": "lee2010", "cutoff": 2.0, "linear": "accelerometer"},
    {"kind": "observer", "law": "eqt", "rate": 5.0},
])  # fmt: skip
def test_a_law_that_rejects_disturbances_passes_its_check(tmp_path, law):
    """With its memory, the cut command and, of INDI, the accelerometer among its inputs."""
    if compiler.missing():
        pytest.skip("no C compiler")
    weight = {"forces": [{"kind": "restoring", "weight": 9.81}]}
    flight = {
        "group": "SE3",
        "inertia": [1.0, 2.0, 2.5, 1.0, 1.0, 1.0],
        "gains": {"kp": 1.0, "kd": 0.5},
        "reference": {"kind": "constant", "velocity": [0.1, 0.2, 0.3, 0.1, 0.0, 0.2]},
        "model": weight,
        "controllers": [law],
        "actuators": [{"kind": "limit", "limit": 12.0}, {"kind": "lag", "time_constant": 0.1}],
        "control": {"period": 0.02},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.3}},
        "ensemble": {"runs": 2},
        "time": {"duration": 0.5},
    }
    eqt_cli.export(flight, tmp_path)
    name = law["kind"]
    sources = [str(tmp_path / f"{name}{end}.c") for end in ("_check", "")]
    check = tmp_path / "check"
    subprocess.run([*compilers()[0], *FLAGS, *sources, "-o", str(check), "-lm"], check=True)
    said = subprocess.run([str(check)], check=True, capture_output=True, text=True).stdout
    assert "36 states pass" in said
    header = (tmp_path / f"{name}.h").read_text(encoding="utf-8")
    assert ("double specific_force[3];" in header) == (name == "indi")


GIVES_MORE = """\
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Goodarzi2013, norm, stack


@dataclass(frozen=True)
class GivesMore(Goodarzi2013):
    name: ClassVar[str] = "gives_more"
    output_units: ClassVar[dict[str, str]] = {"twice": "rad/s"}

    def outputs(self, G):
        return {**self.memory(G), "speed": 1, "twice": 3}

    def output(self, s):
        return {**s.memory, "speed": stack([norm(s.V)]), "twice": 2.0 * s.V}
"""


def test_the_other_numbers_of_a_law_are_a_function_in_c(tmp_path):
    plugin = tmp_path / "gives_more.py"
    plugin.write_text(GIVES_MORE, encoding="utf-8")
    load_plugin(plugin)
    made_of = made("SO3", ["gives_more"], plugins=[str(plugin)])
    [law] = exported(made_of, [], ARITHMETICS["double"])
    folder = written(law, tmp_path)
    text = (folder / "gives_more.h").read_text(encoding="utf-8")
    assert "double twice[3]; /* rad/s; twice of the law */" in text
    assert checked(law, folder, compilers()[0])[0] == 0
    states = law.states.at(slice(0, 50))
    given, _ = answers(law, library(law, folder, compilers()[0]), states, "give", 4)
    V = states[INPUT + "velocity"]
    expected = np.column_stack([np.linalg.norm(V, axis=1), 2 * V])
    np.testing.assert_allclose(given, expected, rtol=1e-15)
    source = folder / "gives_more.c"
    wrong = source.read_text(encoding="utf-8").replace(
        "outputs->twice);", "outputs->twice);\n    outputs->twice[1] += 1e-9;"
    )
    source.write_text(wrong, encoding="utf-8")
    status, said = checked(law, folder, compilers()[0])
    assert status == 1
    assert ": output[2] is " in said


def part_torques(part):
    """The torques of wheels, called as the thrusts of thrusters."""
    return lambda G, torque, x: part.torques(torque, x)


# Filters ------------------------------------------------------------------------------------------


def filtered(kind, real="double", rates=None, **timing):
    """A law with memory on SO(3), which reads an estimate."""
    pose = {"kind": "noise", "std": 0.02, "period": 0.2, "dropout": 0.3, **timing}
    velocity = [{"kind": "noise", "std": 0.01, **(rates or {})}, {"kind": "bias", "value": 0.05}]
    sensors, estimator = {"pose": [pose], "velocity": velocity}, {"kind": kind}
    config = made("SO3", ["goodarzi2013"], sensors=sensors, estimator=estimator)
    [found] = exported(config, [], ARITHMETICS[real])
    return found


@pytest.mark.skipif(not compilers(), reason="no C compiler")
@pytest.mark.parametrize(
    ("kind", "real", "rates"),
    [
        ("invariant", "double", {"period": 0.3, "dropout": 0.2}),
        pytest.param("complementary", "double", {}, marks=pytest.mark.ci("one of each is fast")),
        pytest.param("eqf", "float", {}, marks=pytest.mark.ci("one of each is fast")),
    ],
)
def test_a_filter_in_c_estimates_what_eqt_estimates(tmp_path, kind, real, rates):
    law = filtered(kind, real, rates)
    folder, compiler = written(law, tmp_path / "c"), compilers()[0]
    code, said = checked(law, folder, compiler)
    assert (code, " states pass; " in said) == (0, True), said
    source = folder / f"{law.name}.c"
    text = source.read_text(encoding="utf-8")
    kept = "*filter = next;"
    off = "0.1" if real == "float" else "1e-6"
    spoiled = text.replace(kept, f"{kept} filter->bias[0] += {off};")
    source.write_text(spoiled, encoding="utf-8")
    code, said = checked(law, folder, compiler)
    assert code == 1
    assert said.startswith(f"{law.name}: filter, instant 1 of 40: number ")


def test_a_filter_whose_measurements_arrive_late_is_refused():
    with pytest.raises(EqtError) as error:
        filtered("eqf", delay=1)
    assert says(str(error.value), "goodarzi2013: a filter whose measurements arrive late is…")


# What native evaluates at an instant has the bits of the exported law -----------------------------


@pytest.mark.parametrize(("law", "group"), [("goodarzi2013", "SO3"), ("logarithmic", "SE2")])
def test_an_instant_of_native_has_the_bits_of_the_exported_law(tmp_path, law, group):
    compare(tmp_path, law, group)


@pytest.mark.ci("every law is compiled twice")
@pytest.mark.parametrize(("law", "group"), ALL)
def test_an_instant_of_native_has_the_bits_of_every_exported_law(tmp_path, law, group):
    compare(tmp_path, law, group)


def compare(tmp_path, law, group):
    """The torque and the memory of both, after an instant."""
    if compiler.missing():
        pytest.skip("no C compiler")
    found = law_of(group, law)
    loop = found.loop
    path = library(found, written(found, tmp_path), compilers()[0])
    [batch] = batches(Study(None, found.experiment), law, np.arange(2))
    problem = batch.problem
    G, states = loop.group, problem.states.copy()
    if "desired_pose" in loop.layout.slices:  # a pose in which no entry is 0 or 1
        turned = G.exp(0.3 * np.arange(1, 1 + G.dimension))
        states[:, loop.layout.slices["desired_pose"]] = G.pack(turned)
    for each in found.program.memory:  # as if it had flown
        where = loop.layout.slices[f"controller.{each.source}"]
        states[:, where] = 0.1 * np.arange(1, 1 + where.stop - where.start)
    rows = [
        Rows(states, by_run=True),
        Rows(np.array([0.0])),
        Rows(parameter_rows(problem), by_run=True),
    ]
    told, instant = (
        native_library.evaluated(part, problem.runs, 1, [*rows, Rows(held)])
        for part in (at_instants(loop).input, programs(loop).after_instant)
        for held in held_rows(loop, np.array([0.0]), part)
    )
    after = instant["state"][:, 0]
    memory, later = loop.memory(states), loop.memory(after)
    at = {INPUT + each.name: told[each.name][:, 0] for each in found.program.inputs}
    at |= {MEMORY + each.name: memory[each.source] for each in found.program.memory}
    for run, (torque, kept) in enumerate(zip(*answers(found, path, at), strict=True)):
        asked = loop.command(loop.tracking(0.0, after[run]))
        assert torque.tobytes() == asked.tobytes()
        assert np.abs(torque).max() > 1e-3
        if later:
            z = np.concatenate([later[each.source][run] for each in found.program.memory])
            assert kept.tobytes() == z.tobytes()
