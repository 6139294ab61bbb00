"""URDF files, and xacro files that become such."""

import re

import numpy as np
import pytest
from case_tables import from_yaml
from said import error_of
from vehicle_files import URDF, tensor, thrusters

from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

pytestmark = pytest.mark.usefixtures("without_process")

RPM = 60 / (2 * np.pi)


def test_rotors_of_gym_pybullet_drones(imported):
    """Constants per rpm², a thrust for g = 9.8, places of massless links, signs of its code."""
    text, config = imported(URDF, "cf2.urdf")
    assert config["inertia"]["mass"] == pytest.approx(0.03)
    np.testing.assert_allclose(tensor(config)[0, :2], [1e-5, 2e-6])
    part = thrusters(config)
    assert part["thrust_constant"] == pytest.approx(3e-10 * RPM**2, rel=1e-9)
    assert part["moment_constant"] == pytest.approx(7e-12 * RPM**2, rel=1e-9)
    most = part["thrust_constant"] * part["high_speed"] ** 2
    assert most == pytest.approx(2 * 9.8 * 0.03 / 4, rel=1e-8)
    assert [rotor["turns"] for rotor in part["thrusters"]] == [-1, 1, -1, 1]
    assert part["thrusters"][1]["at"] == [-0.03, -0.03, 0]
    assert "assumed" in text


def test_the_other_robot_of_gym_pybullet_drones_turns_otherwise(imported):
    part = thrusters(imported(URDF.replace("cf2", "racer"), "racer.urdf")[1])
    assert [rotor["turns"] for rotor in part["thrusters"]] == [1, -1, 1, -1]


def test_links_hang_on_joints(imported):
    """A point of 2 kg on an arm that is turned twice by 90°: about z, then about the new x."""
    arm = """<link name="a"/><link name="b"><inertial><origin xyz="0 0 0.5"/><mass value="2"/>
      <inertia ixx="0" ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link>
      <joint name="j" type="fixed"><origin xyz="1 0 0" rpy="0 0 1.5707963267948966"/>
      <parent link="base_link"/><child link="a"/></joint>
      <joint name="k" type="revolute"><origin xyz="0 0 0" rpy="1.5707963267948966 0 0"/>
      <parent link="a"/><child link="b"/><axis xyz="0 0 1"/></joint></robot>"""
    text, config = imported(URDF.replace("</robot>", arm), "arm.urdf")
    assert "2 at [1.5, 0, 0]: b" in text
    assert "held at 0: k" in text
    assert config["inertia"]["mass"] == pytest.approx(2.03)


@from_yaml
def test_refuses_a_urdf(tmp_path, old, new, said):
    assert old in URDF
    (tmp_path / "cf2.urdf").write_text(URDF.replace(old, new, 1), encoding="utf-8")
    message = error_of(configuration_of, tmp_path / "cf2.urdf", bandwidth=5.0)
    assert "\n" not in message
    for word in said:
        assert word in message


XACRO = """<robot name="cf2" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:arg name="mass" default="0.03"/>
<xacro:include filename="$(find parts)/box.xacro"/>
<xacro:property name="m" value="$(arg mass)"/>
<link name="$(arg prefix)base"><inertial><mass value="${2*m}"/>
  <xacro:box x="0.1" y="0.2" z="0.3" m="${2*m}"/></inertial></link></robot>"""
BOX = """<robot xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:macro name="box" params="x y z m"><inertia ixx="${m*(y**2+z**2)/12}" ixy="0" ixz="0"
  iyy="${m*(x**2+z**2)/12}" iyz="0" izz="${m*(x**2+y**2)/12}"/></xacro:macro></robot>"""


@pytest.fixture
def parts(tmp_path):
    pytest.importorskip("xacro", reason="needs the extra xacro")
    (tmp_path / "src" / "parts").mkdir(parents=True)
    (tmp_path / "src" / "parts" / "box.xacro").write_text(BOX)
    return tmp_path / "src"


def test_xacro_is_expanded_without_ros(imported, parts):
    """A box of 0.06 kg with sides of 0.1, 0.2 and 0.3 m."""
    options = {"models": [parts], "arg": ["prefix:=v/"], "kind": "satellite"}
    text, config = imported(XACRO, "cf2.xacro", **options)
    moments = [0.06 * each / 12 for each in (0.04 + 0.09, 0.01 + 0.09, 0.01 + 0.04)]
    np.testing.assert_allclose(np.diag(tensor(config)), moments, rtol=1e-9)
    assert config["group"] == "SO3"
    assert "cf2.xacro: link v/base" in text


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("$(arg prefix)", "$(arg suffix)", "--arg suffix=VALUE"),
        ("$(find parts)", "$(find wholes)", "--models"),
        ("${2*m}", "${().__class__}", "__class__"),
        ("${2*m}", "${(lambda: 1)()}", "Lambda"),
        ("${2*m}", "${''.format(m)}", "format"),
        ("${2*m}", "${'a'*10**9}", "numbers to multiply"),
        ("${2*m}", "${9**9**9}", "Pow"),
        ("${2*m}", "$(eval 2*3)", "eval"),
        ("<robot", "<!DOCTYPE a [<!ENTITY b 'c'>]><robot", "document types"),
    ],
)
def test_xacro_refuses(tmp_path, parts, old, new, said):
    assert old in XACRO
    (tmp_path / "cf2.xacro").write_text(XACRO.replace(old, new, 1))
    options = {"models": [parts], "arg": ["prefix:=v/"]}
    message = error_of(configuration_of, tmp_path / "cf2.xacro", bandwidth=5.0, **options)
    assert said in message
    assert not re.search("\n", message)


def test_macros_that_call_each_other_forever_end(tmp_path, parts, monkeypatch):
    """A macro that calls another one twice, and so on: 2^30 calls."""
    macros = "".join(
        f'<xacro:macro name="m{k}" params=""><xacro:m{k + 1}/><xacro:m{k + 1}/></xacro:macro>'
        for k in range(30)
    )
    monkeypatch.setattr("eqt_cli.extensions.vehicles.macros.MOST_CALLS", 200)
    last = '<xacro:macro name="m30" params=""/>'
    text = XACRO.replace("<link", f"{last}{macros}<xacro:m0/><link", 1)
    (tmp_path / "cf2.xacro").write_text(text)
    options = {"models": [parts], "arg": ["prefix:=v/"]}
    assert "macro" in error_of(configuration_of, tmp_path / "cf2.xacro", bandwidth=5.0, **options)
