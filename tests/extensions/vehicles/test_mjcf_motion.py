"""Every attribute of MJCF against MuJoCo's own motion: what changes it, eqt reads or tells."""

import re
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.attributes import kind_of
from eqt_cli.extensions.vehicles.configuration import configuration
from eqt_cli.extensions.vehicles.mjcf import vehicle_of
from eqt_cli.extensions.vehicles.mjcf_checks import mjcf_path
from eqt_cli.extensions.vehicles.request import Request

mujoco = pytest.importorskip("mujoco", reason="MuJoCo is not installed; make oracles installs it")

SCHEMA = (Path(__file__).parent / "schemas" / "mjcf.txt").read_text(encoding="utf-8")

VEHICLE = """<mujoco model="quad"><compiler autolimits="true"/>
<option gravity="0 0 -9.80665"><flag/></option>
<worldbody><body name="core" pos="0 0 5"><freejoint/>
<inertial pos="0.01 0 0" mass="1" diaginertia="0.01 0.011 0.02"/>
<site name="a" pos="0.2 0.2 0"/><site name="b" pos="-0.2 -0.2 0"/>
<site name="c" pos="-0.2 0.2 0"/><site name="d" pos="0.2 -0.2 0"/>
<body name="arm" pos="0 0 -0.05"><joint name="hinge" axis="0 1 0"/>
<geom type="box" size="0.02 0.03 0.1" pos="0 0 -0.1" mass="0.2"/></body></body></worldbody>
<actuator>
<general name="ra" site="a" gear="0 0 1 0 0 0.02" gainprm="8" ctrlrange="0 1"/>
<general name="rb" site="b" gear="0 0 1 0 0 0.02" gainprm="8" ctrlrange="0 1"/>
<general name="rc" site="c" gear="0 0 1 0 0 -0.02" gainprm="8" ctrlrange="0 1"/>
<general name="rd" site="d" gear="0 0 1 0 0 -0.02" gainprm="8" ctrlrange="0 1"/>
</actuator></mujoco>"""

LOOSE = VEHICLE.replace("<freejoint/>", '<joint type="free"/>')
SATELLITE = """<mujoco model="sat"><option gravity="0 0 0"/>
<worldbody><body name="bus"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="3"/>
<body name="wheel" pos="0 0 0.05"><joint name="spin" axis="0 0 1"/>
<geom type="cylinder" size="0.03 0.01" mass="0.2"/></body></body></worldbody>
<actuator><general name="m" joint="spin" gear="2" ctrllimited="true" ctrlrange="-0.1 0.1"/>
</actuator></mujoco>"""

PLACES = [
    (VEHICLE, "mujoco/compiler", "<compiler"),
    (VEHICLE, "mujoco/option", "<option"),
    (VEHICLE, "mujoco/option/flag", "<flag"),
    (VEHICLE, "mujoco/body", '<body name="core"'),
    (VEHICLE, "mujoco/body/inertial", "<inertial"),
    (VEHICLE, "mujoco/body/joint", "<joint"),
    (VEHICLE, "mujoco/body/geom", "<geom"),
    (VEHICLE, "mujoco/body/site", '<site name="a"'),
    (VEHICLE, "mujoco/actuator/general", '<general name="ra"'),
    (LOOSE, "mujoco/body/joint", '<joint type="free"'),
    (SATELLITE, "mujoco/body/joint", '<joint name="spin"'),
    (SATELLITE, "mujoco/actuator/general", "<general"),
]
VALUES = (
    *("true", "false", "enable", "disable", "radian", "zyx", "yes", "no", "never"),
    *("0.5", "3", "1 0.5", "0.3 0.7", "0.1 0.2 0.3", "0.9 0.1 0.2 0.3", "0.1 0.2 0.3 0.4 0.5 0.6"),
    *("1 0 0 0 1 0", "filter", "filterexact", "integrator", "muscle", "affine", "fixed", "sphere"),
    *("none", "Newton", "CG", "implicitfast", "elliptic", "sparse", "ellipsoid", "core"),
    *("hinge", "slide", "b", "arm"),
)
NAMES = {"name", "class", "childclass", "mesh", "material", "hfield"}
UNTRIED = NAMES | {
    *("conflict", "coordinate", "inertiagrouprange", "fullinertia", "fromto"),
    *("actdim", "armature", "cranklength", "damping", "delay", "input", "interp", "slidersite"),
}
"""Attributes of which MuJoCo takes no value above, or not at this element."""

START = {"pos", "quat", "euler", "axisangle", "xyaxes", "zaxis"}
EXPECTED = {
    "mujoco/body": START,  # from where the vehicle starts
    "mujoco/body/joint": {"axis", "pos", "type", "ref"},  # held at 0, with its name
    "mujoco/option": {"integrator", "timestep"},  # of the numerical solution
}
SAME = 1e-9
"""Rounding of a few hundred steps; what changes the motion changes it by 1e-3 and more."""


def motion(text):
    """Pose and velocity of the vehicle after 0.2 s of unequal commands, one of them too large."""
    model = mujoco.MjModel.from_xml_string(text)
    model.opt.timestep = 1e-3
    data = mujoco.MjData(model)
    data.ctrl[:] = [1.4, 0.5, 0.4, 0.3][: model.nu]
    for _ in range(200):
        mujoco.mj_step(model, data)
    return np.concatenate([data.qpos[:7], data.qvel[:6]])


def configured(path, text):
    """What eqt writes or refuses, without a process of its own for MuJoCo."""
    path.write_text(text, encoding="utf-8")
    request = Request(path, 5.0)
    try:
        return configuration(vehicle_of(mujoco, request), request)[0]
    except EqtError as error:
        return str(error)


def attributes(of):
    """Names of the attributes of an element."""
    for line in re.sub(r"\n +", " ", SCHEMA).splitlines():
        path, _, names = line.partition(":")
        if path == of:
            return names.split()
    raise AssertionError(of)


@pytest.fixture(autouse=True)
def _silent():
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)
    yield
    mujoco.set_mju_user_warning(before)


@pytest.mark.ci("simulates 1,000 vehicles")
@pytest.mark.filterwarnings("ignore")
@pytest.mark.parametrize(("vehicle", "path", "element"), PLACES)
def test_what_changes_the_motion_is_read_or_told(tmp_path, vehicle, path, element):
    """Of each attribute, values that MuJoCo takes: another motion, another text."""
    file = tmp_path / "vehicle.xml"
    plain, text = motion(vehicle), configured(file, vehicle)
    untried, silent = set(), set()
    for name in attributes(path):
        bare = re.sub(rf'({re.escape(element)}[^>]*?) {name}="[^"]*"', r"\1", vehicle)
        count = 0
        for value in VALUES:
            changed = bare.replace(element, f'{element} {name}="{value}"', 1)
            try:
                difference = motion(changed) - plain
            except (ValueError, mujoco.FatalError):
                continue
            count += 1
            if not np.abs(difference).max() < SAME and configured(file, changed) == text:
                silent.add(name)
        if not count:
            untried.add(name)
    assert silent <= EXPECTED.get(path, set())
    is_newest = int(mujoco.__version__.split(".")[0]) >= 4  # 3.3 lacks some, and takes fewer values
    assert vehicle != VEHICLE or not is_newest or untried <= UNTRIED


@pytest.mark.parametrize("kind", ["filter", "filterexact"])
def test_the_lag_is_that_of_mujoco(imported, kind):
    """The force of a motor as it rises: T = −t/ln(1 − f/F), to the error of the steps."""
    lagged = VEHICLE.replace('gainprm="8"', f'gainprm="8" dyntype="{kind}" dynprm="0.08"')
    model = mujoco.MjModel.from_xml_string(lagged)
    model.opt.timestep, data = 1e-5, mujoco.MjData(mujoco.MjModel.from_xml_string(lagged))
    data.ctrl[:] = 1.0
    for _ in range(4000):
        mujoco.mj_step(model, data)
    T = -data.time / np.log(1 - data.actuator_force[0] / 8)
    text, config = imported(lagged, "lag.xml")
    assert config["actuators"][0]["time_constant"] == pytest.approx(T, rel=1e-3)
    assert "not in the file" not in text


def test_the_lag_of_wheels_is_that_of_mujoco(imported):
    """The torque of a wheel as it rises; eqt's `lag` stands before the wheels, and is of all."""
    lagged = SATELLITE.replace("<general", '<general dyntype="filter" dynprm="0.5"')
    model = mujoco.MjModel.from_xml_string(lagged)
    model.opt.timestep, data = 1e-4, mujoco.MjData(model)
    data.ctrl[:] = 0.05
    for _ in range(3000):
        mujoco.mj_step(model, data)
    T = -data.time / np.log(1 - data.actuator_force[0] / 0.05)
    text, config = imported(lagged, "wheels.xml")
    lag, wheels = config["actuators"]
    assert (lag["kind"], wheels["kind"]) == ("lag", "wheels")
    assert lag["time_constant"] == pytest.approx(T, rel=1e-3)
    assert "left out" not in text
    second = '<body name="w2" pos="0 0.05 0"><joint name="spun" axis="0 1 0"/>'
    second += '<geom type="cylinder" size="0.03 0.01" euler="90 0 0" mass="0.2"/></body>'
    two = lagged.replace('<body name="wheel"', f'{second}<body name="wheel"').replace(
        "</actuator>",
        '<general name="n" joint="spun" ctrllimited="true" ctrlrange="-0.1 0.1"/></actuator>',
    )
    with pytest.raises(EqtError, match=r"two\.xml:\d+: spun has a lag of 0 s.*0\.5 s"):
        imported(two, "two.xml")


def test_what_is_limited_after_the_lag(imported):
    """The activation is between 0 and 0.6: 0.6 · 8 N."""
    limited = 'gainprm="8" dyntype="filter" dynprm="0.08" actlimited="true" actrange="0 0.6"'
    config = imported(VEHICLE.replace('gainprm="8"', limited), "act.xml")[1]
    assert config["actuators"][0]["high"] == pytest.approx(0.6 * 8)


def test_every_attribute_of_this_mujoco_is_in_the_table():
    """Of the installed version, which may be newer than the stored list."""
    path, unknown = [], []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        start = re.match(r"( *)(\S+) \(.\)\s*(.*)$", line)
        if start and len(start[1]) < 28:
            path[len(start[1]) // 3 :] = [start[2].replace("(world)", "")]
        for name in (start[3] if start and len(start[1]) < 28 else line).split():
            if kind_of("MJCF", mjcf_path("/".join([*path, name]))) is None:
                unknown.append("/".join([*path, name]))
    assert unknown == []
