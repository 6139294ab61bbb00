"""Facts of the page on vehicles from files that no other test holds."""

from types import SimpleNamespace

import numpy as np
import pytest
from said import error_of
from vehicle_files import LINKS, MOTORS, QUAD, ROV, URDF, sdf

from eqt_cli.extensions.vehicles import configuration
from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

BANDWIDTH = 5.0
"""rad/s, of the configurations of `imported`."""

DIGITS = 1e-3
"""Gains have four digits."""


def joined(text):
    """A configuration with its comments in one line each."""
    return text.replace("\n#   ", " ")


def test_an_added_mass_that_is_not_symmetric_is_replaced_by_its_mean(imported):
    """Without remark where it is symmetric."""
    coupled = ROV.replace("<yDotV>-6", "<xDotV>-1</xDotV><yDotV>-6")
    text, config = imported(coupled)
    added = np.array(config["inertia"]["added"])
    assert added[3, 4] == added[4, 3] == pytest.approx(0.5)
    assert "added mass is not symmetric by 1; the mean is taken" in joined(text)
    assert "not symmetric" not in imported(ROV)[0]


def test_gains_under_water_are_those_of_the_mass_with_the_water(imported):
    """By hand: both poles of a displacement at −5 rad/s or faster, 2 √(k m) for the spring k."""
    gains = imported(ROV)[1]["gains"]
    masses = 10.0 + np.array([5.0, 6.0, 7.0])
    spring = BANDWIDTH**2 * masses.max()
    assert np.array(gains["kp"])[3] == pytest.approx(spring, rel=DIGITS)
    damping = np.array(gains["kd"])[3:]
    damping = np.diag(damping[:, 3:]) if damping.ndim == 2 else damping
    assert damping == pytest.approx(2 * np.sqrt(spring * masses), rel=DIGITS)


def test_a_vehicle_in_water_without_a_plugin_of_the_water_lacks_drag_and_added_mass(imported):
    dry = ROV[: ROV.index('<plugin filename="gz-sim-hydrodynamics')] + "</model></sdf>"
    text, config = imported(dry, kind="auv", thrust="-40,50")
    assert "no plugin of the file has drag or added mass of the water" in joined(text)
    assert np.array(config["inertia"])[3:, 3:] == pytest.approx(10 * np.eye(3))
    # By its collision shapes, it is as buoyant as with the plugin.
    buoyancy = 1000 * 9.80665 * 0.5 * 0.2 * 0.11
    assert config["model"]["forces"][0]["buoyancy"] == pytest.approx(buoyancy)


@pytest.mark.parametrize(("text", "name"), [(QUAD, "m.sdf"), (URDF, "m.urdf")])
def test_a_satellite_has_no_weight_and_stands_on_so3(imported, text, name):
    still = text.replace(MOTORS, "").replace("<properties", "<left_out")
    config = imported(still, name, kind="satellite")[1]
    assert config["group"] == "SO3"
    assert "model" not in config and "plant" not in config
    assert config["controllers"] == ["lee2010", "bullo_murray"]


def test_a_link_of_a_urdf_without_inertial_has_no_mass(imported):
    held = '<link name="frame"/><joint name="f" type="fixed"><parent link="base_link"/>'
    more = URDF.replace("</robot>", held + '<child link="frame"/></joint></robot>')
    config = imported(more, "m.urdf")[1]
    assert config["inertia"]["mass"] == pytest.approx(0.03)


def test_a_moment_that_no_vehicle_has_is_refused(tmp_path):
    """About any axis, also the one with the largest moment alone."""
    (tmp_path / "quad.sdf").write_text(QUAD.replace("<izz>0.025", "<izz>1e30"))
    said = error_of(configuration_of, tmp_path / "quad.sdf", bandwidth=BANDWIDTH)
    assert "principal moments" in said and "1e+30" in said


def test_a_mass_of_zero_is_no_negative_mass(imported, tmp_path):
    camera = """<link name="camera"><inertial><mass>{}</mass>
      <inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial></link>
      <joint name="held" type="fixed"><parent>base</parent><child>camera</child></joint>"""
    assert imported(sdf(LINKS + camera.format("0") + MOTORS))[1]["inertia"]["mass"] == 2.0
    (tmp_path / "bad.sdf").write_text(sdf(LINKS + camera.format("-1") + MOTORS))
    said = error_of(configuration_of, tmp_path / "bad.sdf", bandwidth=BANDWIDTH)
    assert "expected a mass of at least 0 kg, got -1" in said


def lack(thrust, low, high):
    """What is said of four rotors, of which the first must push so much, N."""
    rotors = [SimpleNamespace(name=f"r{k}", low=low, high=high) for k in range(4)]
    body = SimpleNamespace(thrusts=np.array([thrust, 0.1, 0.1, 0.1]), B=np.zeros((6, 4)), weight=1)
    return configuration._lack(SimpleNamespace(rotors=rotors), body)


def test_only_a_rotor_that_would_have_to_push_back_may_be_reversible():
    assert lack(0.5, 0, 0.6) == ""
    assert "0.5 N of r0, which has 0.4 N at most" in lack(0.5, 0, 0.4)
    assert "--reversible" not in lack(0.5, 0, 0.4)
    assert "-0.5 N of r0, which has 0 N at least (--reversible" in lack(-0.5, 0, 0.6)
    assert lack(-0.5, None, 0.6) == ""


def test_of_notes_that_differ_in_numbers_alone_the_first_stands():
    notes = ["a.sdf:3: a lag of 1 s", "a.sdf:5: a lag of 2 s", "a.sdf:7: wind"]
    assert configuration._grouped(notes) == [
        "a.sdf:3: a lag of 1 s (and 1 more such)",
        "a.sdf:7: wind",
    ]


def test_a_remark_stands_behind_its_line_or_where_it_is_long_above_it():
    text = configuration.Text()
    text.add("mass: 1", "kg")
    text.add("  inertia: 2", "word " * 30)
    short, *above, line = text.lines
    assert short == "mass: 1 # kg" and line == "  inertia: 2"
    assert len(above) > 1 and all(each.startswith("  # word") for each in above)


def test_what_stands_in_a_group_of_its_own_is_refused_noted_or_left_alone(imported, tmp_path):
    """A second <mass> is refused, wind is a note, and a picture has no effect."""
    (tmp_path / "two.sdf").write_text(QUAD.replace("<mass>1.6</mass>", "<mass>1</mass>" * 2))
    said = error_of(configuration_of, tmp_path / "two.sdf", bandwidth=BANDWIDTH)
    assert "a second <mass>" in said
    text = joined(imported(QUAD.replace("<inertial>", "<enable_wind>1</enable_wind><inertial>"))[0])
    assert "enable_wind" in text
    seen = QUAD.replace("<inertial>", "<visual name='v'/><inertial>", 1)
    assert imported(seen)[0] == imported(QUAD)[0]


def test_the_lag_of_wheels_stands_before_them(imported, without_process):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    wheel = """<mujoco model="sat"><option gravity="0 0 0"/>
<worldbody><body name="bus"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="3"/>
<body name="wheel" pos="0 0 0.05"><joint name="spin" axis="0 0 1"/>
<geom type="cylinder" size="0.03 0.01" mass="0.2"/></body></body></worldbody>
<actuator><general joint="spin" dyntype="filter" dynprm="0.25" gainprm="1"
 ctrllimited="true" ctrlrange="-0.01 0.01"/></actuator></mujoco>"""
    lag, wheels = imported(wheel, "sat.xml")[1]["actuators"]
    assert (lag["kind"], lag["time_constant"]) == ("lag", 0.25)
    assert wheels["limit"] == pytest.approx(0.01)


def test_a_part_of_an_mjcf_names_no_file_elsewhere_either(tmp_path, without_process):
    pytest.importorskip("mujoco", reason="needs the extra mujoco")
    folder = tmp_path / "robots" / "cross"
    folder.mkdir(parents=True)
    (tmp_path / "secret.xml").write_text("<mujocoinclude/>")
    (folder / "part.xml").write_text(
        '<mujocoinclude>\n<include file="../../secret.xml"/></mujocoinclude>'
    )
    (folder / "cross.xml").write_text('<mujoco><include file="part.xml"/></mujoco>')
    said = error_of(configuration_of, folder / "cross.xml", bandwidth=BANDWIDTH)
    assert "part.xml:2" in said and "outside of the folder" in said


def test_a_plugin_on_the_joint_of_a_link_that_is_left_out_is_left_out(imported):
    motor = """<gazebo><plugin filename="gz-sim-multicopter-motor-model-system" name="Motor">
      <jointName>p0</jointName></plugin></gazebo></robot>"""
    still = URDF.replace("<properties", "<left_out").replace("</robot>", motor)
    text = joined(imported(still, "m.urdf", without=("prop0_link",), kind="satellite")[0])
    assert "link prop0_link is left out, as --without asks" in text
    assert "plugin Motor is left out with" in text
