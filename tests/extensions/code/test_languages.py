"""Laws in Python and C++ are judged as those in C, and one in Python cannot leave its process."""

import ctypes
import json
import re
import shutil
import socket
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from said import mentions
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base import yaml_source
from eqt_cli.base.errors import ConfigError
from eqt_cli.components.mechanics import LawInput
from eqt_cli.extend import group_named
from eqt_cli.extensions.code import code_rows, guests
from eqt_cli.extensions.code.controllers import Signal

LEE = Path(__file__).with_name("lee2010.py").read_text(encoding="utf-8")
DOUBLE = "torque of Lee 2010, double, at random states"
PYTHON = {"file": "lee.py", "function": "compute"}
E, A = "E[3 * j + i] * in->desired_velocity[j]", "E[3 * j + i] * in->desired_acceleration[j]"
LAST, LAST_C = " - J * (np.cross(velocity, W) - A)", "- n->J[i] * (WxW[i] - A[i])"
CARRIED = ("E.T @ desired_velocity", "E.T @ desired_acceleration")

FAULTS = {
    "lacks desired acceleration: coefficient 0.00 of 1, transport: coefficient 0.00 of 1; the same":
        ([(LAST_C, "")], [(LAST, "")]),
    "lacks damping of the desired velocity: coefficient 0.00 of 1; the same":
        ([("(in->velocity[i] - W[i])", "in->velocity[i]")], [("(velocity - W)", "velocity")]),
    "has gyroscopic: coefficient -1.00 of 1 (the sign is wrong)":
        ([("+ gyro[i]", "- gyro[i]")], [("+ gyro", "- gyro")]),
    "has stiffness: coefficient 0.999 of 1": ([("-n->kR", "-0.999*n->kR")], [("-kR", "-0.999*kR")]),
    "V_d is not carried to the body frame": (
        [(E, E.replace("E[3 * j + i]", "(i == j)")), (A, A.replace("E[3 * j + i]", "(i == j)"))],
        [(each, each.removeprefix("E.T @ ")) for each in CARRIED]),
    "V_d is carried the wrong way, by Q_d⁻¹Q for Q⁻¹Q_d":
        ([("E[3 * j + i]", "E[3 * i + j]")], [(a, a.replace("E.T", "E")) for a in CARRIED]),
    "V_d is read on axis 3 only": (
        [(E, E.replace("[j]", "[2] * (j == 2)")), (A, A.replace("[j]", "[2] * (j == 2)"))],
        [(each, each.replace("@ ", "@ np.diag([0, 0, 1]) @ ")) for each in CARRIED]),
    "the frames are exchanged: the pose error is in the other frame, Q Q_d⁻¹ for Q_d⁻¹Q, wherever":
        ([("in->desired_pose[3 * k + i] * in->pose[3 * k + j]",
           "in->pose[3 * i + k] * in->desired_pose[3 * j + k]")],
         [("desired_pose.T @ pose", "pose @ desired_pose.T")]),
    "has stiffness: coefficient 0.50 of 1; has symmetric part of the pose error: coefficient 0.50":
        ([("(E[7] - E[5]) / 2", "E[7] / 2"), ("(E[2] - E[6]) / 2", "E[2] / 2"),
          ("(E[3] - E[1]) / 2", "E[3] / 2")], [("vee(E - E.T) / 2", "vee(E) / 2")]),
    "within the bound of float": ([("const real eR[3]", "const float eR[3]")],
                                  [("vee(E - E.T) / 2", "np.float32(vee(E - E.T) / 2)")]),
    "no sum of the law's parts in any frame: 13 % of the torque is none of them":
        ([("n->kR * eR[i]", "n->kR * eR[i] * eR[i]")], [("kR * eR", "kR * eR * eR")]),
    "lacks gyroscopic: coefficient 0.00 of 1": ([("+ gyro[i]", "")], [("+ gyro", "")]),
    "lacks desired acceleration: coefficient 0.00 of 1; the same":
        ([("(WxW[i] - A[i])", "WxW[i]")], [("np.cross(velocity, W) - A", "np.cross(velocity, W)")]),
    "lacks transport: coefficient 0.00 of 1; the same":
        ([("(WxW[i] - A[i])", "(-A[i])")], [("(np.cross(velocity, W) - A)", "-A")]),
    "has stiffness: coefficient -1.00 of 1 (the sign is wrong)":
        ([("-n->kR", "n->kR")], [("-kR", "kR")]),
    "has damping: coefficient -1.00 of 1 (the sign is wrong)":
        ([("- n->kW", "+ n->kW")], [("- kW", "+ kW")]),
    "the pose is transposed": ([("in->pose[3 * k + j]", "in->pose[3 * j + k]")],
                               [("desired_pose.T @ pose", "desired_pose.T @ pose.T")]),
    "has stiffness: coefficient 2.00 of 1": ([("-n->kR", "-2 * n->kR")], [("-kR", "-2 * kR")]),
    "has damping: coefficient 0.50 of 1":
        ([("- n->kW", "- 0.5 * n->kW")], [("- kW", "- 0.5 * kW")]),
    "lacks stiffness: coefficient 0.00 of 1": ([("-n->kR * eR[i]", "")], [("-kR * eR", "")]),
}  # fmt: skip


@pytest.fixture
def python(config):
    """A configuration with a law in Python, with parts of its text replaced."""

    def make(*changes, more="", **options):
        text = LEE
        for old, new in changes:
            assert old in text, old
            text = text.replace(old, new)
        Path("lee.py").write_text(text + more, encoding="utf-8")
        return config(**PYTHON | options)

    return make


@pytest.fixture
def cplusplus(written, config):
    """The same in C++."""

    def make(*changes, more="", **options):
        if not shutil.which("g++"):
            pytest.skip("needs a C++ compiler")
        written(
            *changes, ("void lee_torque", f'{more}\nextern "C" void lee_torque'), name="lee.cpp"
        )
        return config(file="lee.cpp", **options)

    return make


@pytest.mark.parametrize(
    "said",
    [
        name if k == 0 else pytest.param(name, marks=pytest.mark.ci("one of them is fast"))
        for k, name in enumerate(FAULTS)
    ],
)
def test_twenty_faults_are_named_in_python_as_in_c(said, written, config, python, judged):
    in_c, in_python = FAULTS[said]
    written(*in_c)
    expected = judged(config())[DOUBLE]
    assert expected.startswith(said)
    found = judged(python(*in_python))
    assert found[DOUBLE].split("%")[-1] == expected.split("%")[-1]


def test_laws_that_were_typed_in_well(python, judged):
    assert judged(python()) == {}


def test_one_in_cplusplus(cplusplus, judged):
    """It uses what C has not: a template, a reference, a constant that is computed."""
    more = "template <typename T> static T same(const T &x) { return x; }\n"
    assert judged(cplusplus(("-n->kR", "-same(n->kR)"), more=more)) == {}


# Memory: what the object keeps ------------------------------------------------------------------

INTEGRAL = {"function": "Lee(kR, kW, J, kI).update", "memory": ["integral"]}
NUMBERS = {"kR": 2.0, "kW": 0.5, "J": [1.0, 2.0, 3.0], "kI": 0.3}
UPDATE = {"adapter": {"inputs": {name: {"signal": name} for name in LawInput._fields[:6]},
                      "output": {"torque": "result['torque']"}}, "numbers": NUMBERS}  # fmt: skip
GOODARZI = {"as": {"kind": "goodarzi2013", "ki": 0.3, "c2": 1.0}}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        pytest.param([], [], marks=pytest.mark.ci("a stale one is fast")),
        (
            [("integral + period", "integral + 0 * period")],
            ["integral does not advance: it is stale"],
        ),
        (
            [("velocity - E.T @ desired_velocity + ", "2 * ")],
            [
                "its integral lacks velocity error: coefficient 0.00 of 1; "
                "its integral has pose error: coefficient 2.00 of 1"
            ],
        ),
    ],
)
def test_what_the_object_keeps_is_memory(changes, said, python, judged):
    rows = judged(python(*changes, **UPDATE, **INTEGRAL, **GOODARZI))
    assert [remark for name, remark in rows.items() if "memory" in name] == said


def test_a_state_that_is_not_named(python, judged):
    more = (
        "\ncount = [0]\ndef counted(velocity):\n    count[0] += 1\n    return count[0] * velocity\n"
    )
    with pytest.raises(ConfigError, match=r"counted in lee\.py: it keeps something"):
        judged(python(more=more, function="counted"))


def test_it_flies_as_the_law(python, config):
    """At control instants, and at any time."""
    over = {"solver": {"engine": "solve_ivp", "cross_check": 0}}
    for more in ({}, {"control": None}):
        data = python(over=over | more)
        laws = {"controllers": ["lee2010", *data["controllers"]]}
        results = eqt_cli.run(data | laws, out=Path(f"r{len(more)}"))
        final = results["final_pose_error"]
        assert np.allclose(final[0], final[1], rtol=1e-7)


# What it reads and returns ----------------------------------------------------------------------


def states(G, count=4):
    random = np.random.default_rng(3)
    x = [random.standard_normal((count, G.dimension)) for _ in range(5)]
    return LawInput(np.linspace(0, 1, count), G.exp(x[0]), x[1], G.exp(x[2]), x[3], x[4])


@pytest.mark.parametrize(
    ("options", "plain"),
    [
        ({"signal": "pose", "as_": "quaternion xyzw"}, lambda x, R, Rd: R.as_quat()),
        ({"signal": "pose", "as_": "quaternion wxyz"},
         lambda x, R, Rd: R.as_quat()[:, [3, 0, 1, 2]]),
        ({"signal": "desired_pose", "as_": "columns"}, lambda x, R, Rd: Rd.inv().as_matrix()),
        ({"signal": "pose", "as_": "roll-pitch-yaw", "unit": "deg"},
         lambda x, R, Rd: R.as_euler("ZYX", degrees=True)[:, ::-1]),
        ({"signal": "pose", "as_": "roll-pitch-yaw", "sign": [1, -1, 1]},
         lambda x, R, Rd: R.as_euler("ZYX")[:, ::-1] * [1, -1, 1]),
        ({"signal": "pose", "sign": [1, -1, -1]},
         lambda x, R, Rd: np.diag([1, -1, -1]) @ R.as_matrix() @ np.diag([1, -1, -1])),
        ({"signal": "velocity", "unit": "deg/s", "scale": 2},
         lambda x, R, Rd: 360 / np.pi * x.velocity),
        ({"signal": "velocity", "frame": "space"}, lambda x, R, Rd: R.apply(x.velocity)),
        ({"signal": "desired_velocity", "frame": "body", "sign": -1},
         lambda x, R, Rd: -R.inv().apply(Rd.apply(x.desired_velocity))),
        ({"signal": "desired_acceleration", "frame": "space"},
         lambda x, R, Rd: Rd.apply(x.desired_acceleration)),
        ({"signal": "velocity", "frame": "desired"},
         lambda x, R, Rd: Rd.inv().apply(R.apply(x.velocity))),
        ({"signal": "t", "unit": "ms"}, lambda x, R, Rd: 1000 * x.t),
    ],
)  # fmt: skip
def test_a_signal_is_that_of_scipy(options, plain):
    x = states(group_named("SO3"))
    R, Rd = Rotation.from_matrix(x.pose), Rotation.from_matrix(x.desired_pose)
    assert np.allclose(Signal(**options).values(group_named("SO3"), x), plain(x, R, Rd), atol=1e-12)


def test_the_parts_of_a_rigid_motion():
    x = states(group_named("SE3"))._replace(
        position=np.random.default_rng(1).normal(size=(4, 5, 3))
    )
    R, p = x.pose[:, :3, :3], x.pose[:, :3, 3]
    G = group_named("SE3")
    for signal, frame, plain in (
        ("pose.translation", None, p),
        ("pose.translation", "body", np.einsum("nji,nj->ni", R, p)),
        ("velocity.translation", "space", np.einsum("nij,nj->ni", R, x.velocity[:, 3:])),
        ("pose.rotation", None, R),
        ("position", "space", x.position),
        ("position", "body", np.einsum("nji,nkj->nki", R, x.position)),
    ):
        assert np.allclose(Signal(signal, frame=frame).values(G, x), plain, atol=1e-12)


OF_OTHERS = {
    "q": {"signal": "pose", "as": "quaternion xyzw"}, "w": {"signal": "velocity", "unit": "deg/s"},
    "qd": {"signal": "desired_pose", "as": "quaternion wxyz"},
    "wd": {"signal": "desired_velocity", "frame": "space"},
    "ad": {"signal": "desired_acceleration", "frame": "body"},
}  # fmt: skip
OTHER = """
from scipy.spatial.transform import Rotation
def other(q, w, qd, wd, ad, kR, kW, J):
    R, Rd = Rotation.from_quat(q), Rotation.from_quat(np.roll(qd, -1))
    v = np.radians(w)
    vd, ad = Rd.inv().apply(wd), Rd.inv().apply(R.apply(ad))
    torque = compute(R.as_matrix(), v, Rd.as_matrix(), vd, ad, kR, kW, J)
    return {"rate": R.apply(torque / J)}
"""


def test_a_law_with_names_frames_and_units_of_its_own(python, judged):
    adapter = {"inputs": OF_OTHERS}
    adapter["output"] = {"torque": "result['rate']", "per": "inertia", "frame": "space"}
    assert judged(python(more=OTHER, function="other", adapter=adapter)) == {}


def test_the_same_adapter_names_the_fields_of_c(written, config, judged):
    written(
        ("pose[9], velocity[3], desired_pose[9]", "rotation[9], omega[3], desired_pose[9]"),
        ("in->pose", "in->rotation"),
        ("in->velocity", "in->omega"),
    )
    names = {"t": "t", "rotation": "pose", "omega": "velocity"}
    names |= {name: name for name in LawInput._fields[3:6]}
    adapter = {"inputs": {name: {"signal": signal} for name, signal in names.items()}}
    assert judged(config(adapter=adapter)) == {}


# What a law in Python may not do ----------------------------------------------------------------

LAW = "\ndef bad(velocity):\n    {}\n    return velocity\n"
HOSTILE = {
    "open('x', 'w')": "PermissionError: open x",
    "open('lee.py', 'a')": "PermissionError: open lee.py",
    "__import__('os').remove('lee.py')": "PermissionError: os.remove lee.py",
    "__import__('os').system('touch x')": "PermissionError: os.system",
    "__import__('os').fork()": "PermissionError: os.fork",
    "import sys; sys.modules.pop('_posixsubprocess'); import _posixsubprocess": "PermissionError",
    "__import__('_posixsubprocess').fork_exec()": "TypeError: 'NoneType' object is not callable",
    "__import__('subprocess').run(['touch', 'x'])": "PermissionError: subprocess.Popen",
    "__import__('socket').create_connection(('127.0.0.1', PORT))": "PermissionError: socket.",
    "__import__('ctypes').CDLL(None).fork()": "PermissionError: ctypes.dlopen",
    "__import__('os').kill(__import__('os').getppid(), 9)": "PermissionError: os.kill",
    "bytearray(2 * 2**30)": "MemoryError",
    "while True: pass": " within ",  # as itself says, or eqt where the machine is busy
    "__import__('os')._exit(3)": "ended the process with code 3",
}


@pytest.mark.parametrize("does", HOSTILE)
def test_a_hostile_law_is_contained(does, python, told, monkeypatch):
    """A law that does nothing of it passes: what is refused is what it does."""
    monkeypatch.setattr(guests, "SECONDS", 1.0 if "while" in does else 10.0)
    with socket.create_server(("127.0.0.1", 0)) as server:
        server.settimeout(0.1)
        line = does.replace("PORT", str(server.getsockname()[1]))
        said = told(python(more=LAW.format(line), function="bad"))
        with pytest.raises(TimeoutError):
            server.accept()
    assert said.startswith("controllers[0]: bad in lee.py") and HOSTILE[does] in said
    assert sorted(path.name for path in Path().iterdir()) == ["lee.py"]


ESCAPES = {
    "os.open('lee.py', os.O_WRONLY | os.O_TRUNC)": 13,
    "os.open('x', os.O_WRONLY | os.O_CREAT)": 13,
    "os.open('/proc/self/mem', os.O_RDWR)": 13,
    "os.remove('lee.py')": 13,
    "os.symlink('lee.py', 'x')": 13,
    "os.posix_spawn('/bin/sh', ['sh', '-c', 'echo > x'], {})": 13,
    "os.kill(os.getppid(), 0)": 1,
    "open(f'/proc/{os.getppid()}/environ', 'rb')": 13,
    "socket.create_connection(('127.0.0.1', PORT))": 13,
    "socket.socket(2, socket.SOCK_DGRAM).sendto(b'x', ('127.0.0.1', PORT))": 101,
}
"""What Linux itself refuses, with the numbers of its errors."""


@pytest.mark.parametrize("does", ESCAPES)
def test_a_law_that_disarms_the_hook_is_contained(does, python, told):
    if sys.platform != "linux" or ctypes.CDLL(None).syscall(444, None, ctypes.c_size_t(0), 1) < 6:
        pytest.skip("needs Landlock of Linux 6.12")
    more = "\nimport os, socket, __main__\n__main__.CHANGES, __main__.WRITES = ('none',), 0\n"
    with socket.create_server(("127.0.0.1", 0)) as server:
        line = does.replace("PORT", str(server.getsockname()[1]))
        said = told(python(more=more + LAW.format(line), function="bad"))
    assert f"[Errno {ESCAPES[does]}]" in said
    assert Path("lee.py").read_text(encoding="utf-8").startswith(LEE)
    assert sorted(path.name for path in Path().iterdir()) == ["lee.py"]


def test_an_error_at_one_state_is_no_torque(python, judged):
    more = LAW.format("1 / float(abs(velocity).max() > 1e-9)")
    rows = judged(python(more=more, function="bad"))
    assert "no error" in rows["finite torque at half turns and without an error"]


# Messages and the command -----------------------------------------------------------------------


@from_yaml
def test_what_is_said_of_python_that_is_no_law(options, said, python, told):
    assert mentions(told(python(**options)), said)


def test_a_line_of_the_file_is_named(python, told):
    assert told(python(("eR = vee(E - E.T) / 2", "eR = vee(E - E.T) / zero"))) == (
        "controllers[0]: compute in lee.py: line 14: NameError: name 'zero' is not defined"
    )
    assert told(python(("return -kR", "return kR or -kR"))) == (
        "controllers[0]: compute in lee.py: line 10: expected 3 numbers as output, got shape ()"
    )


def test_no_cplusplus_compiler(cplusplus, told, monkeypatch):
    data = cplusplus()
    Path("cc").write_text(
        '#!/bin/sh\ncase "$*" in *c++*) echo "error: no cc1plus" >&2; exit 1;; esac\n'
        'exec gcc "$@"\n'
    )
    Path("cc").chmod(0o755)
    monkeypatch.setenv("CC", str(Path("cc").absolute()))
    assert "lee.cpp cannot be compiled: error: no cc1plus; install g++" in told(data)


SLOW = """
class Slow:
    def __init__(self):
        self.last = np.zeros(3)

    def update(self, pose, velocity, desired_pose, desired_velocity, desired_acceleration, period):
        torque = compute(pose, velocity, desired_pose, desired_velocity, desired_acceleration,
                         2.0, 0.5, np.array([1.0, 2.0, 3.0]))
        self.last = self.last + np.clip(torque - self.last, -20 * period, 20 * period)
        return self.last
"""
ANSWERS = {
    "is lee2010": {"as": None},
    "is lee2010 but lacks desired acceleration, transport": {"changes": [(LAST, "")]},
    "is lee2010 but lacks damping, damping of the desired velocity": {
        "changes": [("- kW * (velocity - W)", "")], "as": None},
    "is lee2010 but is limited in rate to ±20 N m/s": {
        "more": SLOW, "function": "Slow().update", "memory": ["last"]},
    "is lee2010 but has an integral of pose error and velocity error": INTEGRAL | UPDATE,
    "is lee2012 but has an integral of pose error": {"as": None, **INTEGRAL, **UPDATE, "changes": [
        ("velocity - E.T @ desired_velocity + ", ""),
        ("np.cross(velocity, J * velocity)", "np.cross(W, J * W)"), (LAST, " + J * A")]},
    "differs from lee2010: has gyroscopic: coefficient -1.00 of 1 (the sign is wrong)": {
        "changes": [("+ gyro", "- gyro")]},
    "differs from lee2010: has stiffness: coefficient 0.9999999995 of 1": {
        "changes": [("-kR * eR", "-(kR - 1e-9) * eR")]},
    "differs from eqt: it is Lee 2010; is clipped to ±4 N m": {
        "as": "eqt", "changes": [("return -kR", "return np.clip(-kR"), (LAST, f"{LAST}, -4, 4)")]},
    "claims no law; the nearest is lee2010: has stiffness: coefficient -1.00 of 1 (the sign is "
    "wrong)": {"as": None, "changes": [("-kR", "kR")]},
}  # fmt: skip


PUSH = {"model": {"forces": [{"kind": "constant", "force": [0.3, -0.1, 0.2]}]}}


@pytest.mark.parametrize(
    ("changes", "answer"),
    [
        ([("return -kR", "return -np.array([0.3, -0.1, 0.2]) - kR")], "is lee2010"),
        pytest.param(
            *([], "is lee2010 but lacks known forces, such as gravity"),
            marks=pytest.mark.ci("one that has them is fast"),
        ),
    ],
)
def test_a_law_is_to_counteract_the_forces_of_the_model(changes, answer, python):
    experiment = eqt_cli.load_experiment(python(*changes) | PUSH).base
    rows = code_rows.code_rows(
        "ours", experiment.loops["ours"], 5.0, np.random.default_rng(0), None
    )
    [found] = code_rows.answers(rows, experiment)
    assert found["answer"].partition(" in lee.py ")[2] == answer


FAST = "is lee2010", "is lee2010 but has an integral of pose error and velocity error"


@pytest.mark.parametrize(
    "answer",
    [x if x in FAST else pytest.param(x, marks=pytest.mark.ci("others are fast")) for x in ANSWERS],
)
def test_the_answer_is_a_sentence(answer, python):
    options = dict(ANSWERS[answer])
    experiment = eqt_cli.load_experiment(python(*options.pop("changes", []), **options)).base
    loop = experiment.loops["ours"]
    loop = replace(loop, controller=loop.controller.unfailing)  # as the law itself is judged
    rows = code_rows.code_rows("ours", loop, 5.0, np.random.default_rng(0), None)
    [found] = code_rows.answers(rows, experiment)
    assert found["answer"].partition(" in lee.py ")[2] == answer
    is_right = "lacks" if " lacks " in answer else "is" if answer == "is lee2010" else "differs"
    assert found["finding"] == is_right


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("1e-9 * velocity**2", "no sum of the law's parts in any frame: .* of the torque"),
        pytest.param(
            *("(np.float64(np.float32(eR)) - eR)", "within the bound of float: operations are"),
            marks=pytest.mark.ci("one that is not is fast"),
        ),
        pytest.param(
            *("(kR - np.float64(np.float32(kR))) * eR", "within the bound of float: constants are"),
            marks=pytest.mark.ci("one that is not is fast"),
        ),
    ],
)
def test_a_small_error_is_that_of_float_only_where_it_is(text, said, python, judged):
    """One in kR is that of a constant: 0.3 is no number in float."""
    data = python(("return -kR", f"return {text} - kR"), numbers=NUMBERS | {"kR": 0.6, "kI": 0.0})
    assert re.match(said, judged(data | {"gains": {"kp": 0.3, "kd": 0.5}})[DOUBLE])


@pytest.mark.ci("flies the law four times")
def test_the_first_line_is_the_answer(python, eqt):
    """And exit codes follow `--fail-on`."""
    data = python((LAST, ""))
    Path("c.yaml").write_text(yaml_source.dump(data), encoding="utf-8")
    asked = ("verify", "c.yaml", "--code", "lee.py:compute", "--as", "lee2010", "--runs", "1")
    done = eqt(*asked, "--json")
    [found] = json.loads(done.out)["code"]
    assert (done.code, found["finding"]) == (4, "lacks")
    lacks = "compute in lee.py is lee2010 but lacks desired acceleration, transport"
    assert found["answer"] == lacks
    assert eqt(*asked, "--fail-on", "differs").out.startswith(lacks)
    codes = {name: eqt(*asked, "--fail-on", name).code for name in ("lacks", "differs")}
    assert codes == {"lacks": 4, "differs": 0}
    assert "--fail-on: expected lacks or differs" in eqt(*asked, "--fail-on", "x").err


@pytest.mark.ci("starts two processes, and runs two loops")
def test_an_entry_takes_the_adapter_beside_its_file(config):
    """A law with other names, quaternions and deg/s: the same run as by an adapter in the entry."""
    folder = Path(eqt_cli.__file__).parents[1] / "examples" / "code"
    for name in ("ours.py", "ours.adapter.yaml"):
        shutil.copy(folder / name, name)
    adapter = yaml_source.load(Path("ours.adapter.yaml").read_bytes(), "adapter").data
    entry = {"file": "ours.py", "function": "Lee(2.0, 0.5).compute", "as": None, "numbers": None}
    one, other = (eqt_cli.run(config(**entry, adapter=at)) for at in (None, adapter))
    assert np.array_equal(one["mean_torque"], other["mean_torque"])
