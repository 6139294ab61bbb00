"""MJCF files, which MuJoCo composes."""

import numpy as np
import pytest
from case_tables import from_yaml
from said import error_of
from vehicle_files import tensor, thrusters

from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

pytest.importorskip("mujoco", reason="needs the extra mujoco")
pytestmark = pytest.mark.usefixtures("without_process")

X = """<mujoco model="cross"><compiler autolimits="true"/>
<worldbody><body name="hull"><freejoint/>
<inertial pos="0 0 0" mass="1" diaginertia="0.01 0.02 0.025"/>
<site name="a" pos="0.1 -0.1 0"/><site name="b" pos="-0.1 0.1 0"/>
<site name="c" pos="0.1 0.1 0"/><site name="d" pos="-0.1 -0.1 0"/>
<body name="battery" pos="0 0 -0.1"><geom type="box" size="0.05 0.03 0.01" mass="0.5"/></body>
</body><site name="post" pos="0 0 -1"/></worldbody>
<actuator><motor name="a" site="a" ctrlrange="0 6" gear="0 0 2 0 0 -0.04"/>
<motor name="b" site="b" ctrlrange="0 6" gear="0 0 2 0 0 -0.04"/>
<motor name="c" site="c" ctrlrange="0 6" gear="0 0 2 0 0 0.04"/>
<motor name="d" site="d" ctrlrange="0 6" gear="0 0 2 0.2 0 0.04"/></actuator></mujoco>"""

SATELLITE = """<mujoco model="sat"><option gravity="0 0 0"/>
<worldbody><body name="bus"><freejoint/><geom type="box" size="0.1 0.1 0.1" mass="3"/>
<body name="wheel" pos="0 0 0.05"><joint name="spin" axis="0 0 1"/>
<geom type="cylinder" size="0.03 0.01" mass="0.2"/></body></body></worldbody>
<actuator><motor joint="spin" gear="2" ctrllimited="true" ctrlrange="-0.01 0.01"/></actuator>
</mujoco>"""


def test_bodies_and_motors_at_sites(imported):
    """A box on a stick, by hand; a torque across the thrust moves the point where it pushes."""
    text, config = imported(X, "cross.xml")
    assert config["inertia"]["mass"] == pytest.approx(1.5)
    z = -0.5 * 0.1 / 1.5
    about = 1.0 * z**2 + 0.5 * (0.1 + z) ** 2
    box = [0.5 * each / 3 for each in (0.03**2 + 0.01**2, 0.05**2 + 0.01**2, 0.05**2 + 0.03**2)]
    expected = np.array([0.01 + about, 0.02 + about, 0.025]) + box
    np.testing.assert_allclose(np.diag(tensor(config)), expected, rtol=1e-9)
    part = thrusters(config)
    assert (part["low"], part["high"]) == (0, 12)
    assert [rotor["turns"] for rotor in part["thrusters"]] == [-0.02, -0.02, 0.02, 0.02]
    assert part["thrusters"][3]["at"] == pytest.approx([-0.1, -0.1 + 0.2 / 2, -z])
    assert "cross.xml:8" in text


def test_the_spin_of_wheels_is_not_in_the_inertia(imported):
    """J without m r²/2 of the wheel about its axis; the limit is that of the torque."""
    _, config = imported(SATELLITE, "sat.xml")
    z, spin = 0.2 * 0.05 / 3.2, 0.2 * 0.03**2 / 2
    across = 0.2 * (0.03**2 / 4 + 0.02**2 / 12)
    side = 3 * 0.2**2 / 6 + 3 * z**2 + across + 0.2 * (0.05 - z) ** 2
    np.testing.assert_allclose(np.diag(tensor(config)), [side, side, 3 * 0.2**2 / 6], rtol=1e-9)
    wheels = config["actuators"][0]
    assert (wheels["kind"], wheels["axes"], config["group"]) == ("wheels", [[0, 0, 1]], "SO3")
    assert wheels["limit"] == pytest.approx(0.02)
    assert wheels["inertia"] == pytest.approx(spin, rel=1e-9)


@pytest.mark.filterwarnings("error")
def test_what_mujoco_warns_of_is_a_note(imported):
    """MuJoCo scales the masses to 3 kg, and calls its own attribute deprecated."""
    heavy = X.replace("<worldbody>", '<compiler settotalmass="3"/><worldbody>')
    text, config = imported(heavy, "m.xml")
    assert config["inertia"]["mass"] == pytest.approx(3.0)
    assert "m.xml: MuJoCo: compiler attribute 'settotalmass'" in text.replace("\n#   ", " ")


def test_torques_without_rotors_are_told(imported):
    """A wrench at the centre is no rotor: the vehicle has none."""
    wrench = X.replace("0 0 2 0.2 0 0.04", "0 0 0 1 0 0")
    text, config = imported(wrench, "wrench.xml")
    assert "actuators" not in config
    assert "no rotor is in the file" in text


@from_yaml
def test_refuses_an_mjcf(tmp_path, old, new, said):
    assert old in X
    (tmp_path / "cross.xml").write_text(X.replace(old, new, 1), encoding="utf-8")
    message = error_of(configuration_of, tmp_path / "cross.xml", bandwidth=5.0)
    assert "\n" not in message
    for word in said:
        assert word in message


def test_a_vehicle_that_is_weighed_although_its_file_has_no_gravity(imported):
    off = X.replace("<worldbody>", '<option><flag gravity="disable"/></option><worldbody>', 1)
    text = imported(off, "cross.xml", kind="quadrotor")[0].replace("\n#   ", " ")
    assert "no gravity acts" in text


@from_yaml
def test_notes_what_an_mjcf_says(imported, old, new, said):
    assert old in X
    notes = imported(X.replace(old, new, 1), "cross.xml")[0].replace("\n#   ", " ")
    for word in said:
        assert word in notes


def test_a_mesh_that_is_missing_and_without_mass_is_left_out(imported):
    mesh = X.replace("<worldbody>", '<asset><mesh name="m" file="m.obj"/></asset><worldbody>')
    mesh = mesh.replace("</body>\n", '<geom type="mesh" mesh="m" mass="0"/></body>\n', 1)
    text, config = imported(mesh, "cross.xml")
    assert config["inertia"]["mass"] == pytest.approx(1.5)
    assert "1 mesh files are missing" in text
