"""SDF files: composed links, frames, included models, rotors and water."""

import re
from pathlib import Path

import numpy as np
import pytest
from case_tables import from_yaml
from said import error_of
from vehicle_files import CENTRE, LINKS, MASS, MOMENTS, MOTORS, QUAD, ROV, sdf, tensor, thrusters

from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

DIGITS = 1e-9
"""Ten digits are written."""


def same(config):
    """Whether it is the quadrotor of `made`."""
    assert config["inertia"]["mass"] == pytest.approx(MASS, rel=DIGITS)
    np.testing.assert_allclose(tensor(config), np.diag(MOMENTS), rtol=DIGITS, atol=1e-11)


def test_links_are_composed_about_their_centre_of_mass(imported):
    text, config = imported(QUAD)
    same(config)
    assert "at [0, 0, 0.01] m" in text
    assert config["model"]["forces"][0]["weight"] == pytest.approx(MASS * 9.80665, rel=DIGITS)


def test_a_link_without_mass_keeps_its_inertia(imported):
    camera = """<link name="camera"><pose>1 2 3 0 0 0</pose><inertial><mass>0</mass>
      <inertia><ixx>0.3</ixx><iyy>0.5</iyy><izz>0.6</izz></inertia></inertial></link>
      <joint name="held" type="fixed"><parent>base</parent><child>camera</child></joint>"""
    config = imported(sdf(LINKS + camera + MOTORS))[1]
    expected = np.diag(MOMENTS) + np.diag([0.3, 0.5, 0.6])
    np.testing.assert_allclose(tensor(config), expected, rtol=DIGITS, atol=1e-11)


def test_rotors_are_sorted_and_turn_the_body_against_their_spin(imported):
    """ccw as seen from above: the torque on the body is clockwise, −k_m η² about z."""
    part = thrusters(imported(QUAD)[1])
    rotors = part["thrusters"]
    assert [rotor["name"] for rotor in rotors] == ["rotor0", "rotor1", "rotor2", "rotor3"]
    assert [rotor["turns"] for rotor in rotors] == [-1, -1, 1, 1]
    assert rotors[0]["at"] == pytest.approx([0.2, -0.3, 0.05 - CENTRE[2]])
    constants = part["thrust_constant"], part["moment_constant"], part["high_speed"]
    assert constants == pytest.approx((1e-5, 2e-7, 1000.0))
    assert (part["time_constant"], part["time_constant_down"]) == (0.01, 0.02)


def test_every_number_has_its_place(imported):
    text, _ = imported(QUAD)
    line = QUAD[: QUAD.index("<mass>1.6")].count("\n") + 1
    assert re.search(rf"1\.6 at \[0, 0, 0\]: base, \w+/model\.sdf:{line}\n", text)


@pytest.mark.parametrize("version", ["1.4", "1.6", "1.12"])
def test_frames_of_all_kinds_give_the_same_vehicle(imported, version):
    """The same bodies behind degrees, quaternions, frames and turned inertial axes."""
    turned = LINKS.replace(
        '<link name="rotor0"><pose>0.2 -0.3 0.05 0 0 0</pose>',
        '<frame name="arm" attached_to="base"><pose degrees="true">0.2 0 0 0 0 90</pose></frame>'
        '<link name="rotor0"><pose relative_to="arm" degrees="true">-0.3 0 0.05 0 0 -90</pose>',
    ).replace(
        '<link name="rotor1"><pose>-0.2 0.3 0.05 0 0 0</pose>',
        '<link name="rotor1"><pose rotation_format="quat_xyzw">-0.2 0.3 0.05 0 0 1 1</pose>',
    ).replace(
        "<mass>1.6</mass>\n  <inertia><ixx>0.01</ixx><iyy>0.02</iyy>",
        "<pose>0 0 0 0 0 1.5707963267948966</pose><mass>1.6</mass>"
        "<inertia><ixx>0.02</ixx><iyy>0.01</iyy>",
    )  # fmt: skip
    start = turned.index("quat_xyzw")  # rotor 1 is turned by 90°, and so are its moments
    own = turned[start:].replace("<ixx>1e-5</ixx><iyy>2e-5", "<ixx>2e-5</ixx><iyy>1e-5", 1)
    turned = turned[:start] + own
    assert turned.count("relative_to") == turned.count("quat_xyzw") == 1
    config = imported(sdf(turned + MOTORS, version=version))[1]
    same(config)
    assert [rotor["along"] for rotor in thrusters(config)["thrusters"]] == [[0, 0, 1]] * 4


def test_the_axes_are_those_of_the_canonical_link(imported):
    """The model as a whole stands anywhere, and its first link is another one."""
    first = '<link name="first"><pose>0 0 0.05 0 0 1</pose><inertial><mass>0.1</mass>'
    first += "<inertia><ixx>1e-5</ixx><iyy>1e-5</iyy><izz>1e-5</izz></inertia></inertial></link>"
    first += '<joint name="f" type="fixed"><parent>base</parent><child>first</child></joint>'
    inside = f"<pose>3 2 1 0 1 0</pose>{first}{LINKS}{MOTORS}"
    text, config = imported(sdf(inside, attributes=' canonical_link="base"'))
    assert "those of base" in text
    assert config["inertia"]["mass"] == pytest.approx(2.1)
    assert thrusters(config)["thrusters"][0]["along"] == [0, 0, 1]


@pytest.mark.parametrize("merge", ["true", "false"])
def test_included_models_are_part_of_the_body(imported, tmp_path, merge):
    """The frame of a quadrotor in one file, its motors in another, one named by model.config."""
    (tmp_path / "frame").mkdir()
    (tmp_path / "frame" / "frame.sdf").write_text(sdf(f"<pose>0 0 9 0 0 0</pose>{LINKS}"))
    config = "<model><sdf version='1.9'>frame.sdf</sdf></model>"
    (tmp_path / "frame" / "model.config").write_text(config)
    include = f"<include merge='{merge}'><uri>model://frame</uri><name>f</name></include>"
    motors = MOTORS if merge == "true" else re.sub("Name>(joint|rotor)", r"Name>f::\1", MOTORS)
    _, config = imported(sdf(include + motors), "quad/model.sdf")
    same(config)
    assert thrusters(config)["thrusters"][0]["name"] == "rotor0"


def test_a_placement_frame_is_what_the_pose_places(imported, tmp_path):
    """A camera of 0.4 kg, held by a frame 0.1 m below its middle, 0.1 m above the base."""
    (tmp_path / "camera").mkdir()
    (tmp_path / "camera" / "model.sdf").write_text(
        sdf(
            '<frame name="foot"><pose>0 0 -0.1 0 0 0</pose></frame><link name="eye"><inertial>'
            "<mass>0.4</mass><inertia><ixx>0</ixx><iyy>0</iyy><izz>0</izz></inertia></inertial>"
            "</link>",
            name="camera",
        )
    )
    include = (
        "<include><uri>model://camera</uri><placement_frame>foot</placement_frame>"
        "<pose>0 0 0.1 0 0 0</pose></include>"
        '<joint name="c" type="fixed"><parent>base</parent><child>camera::eye</child></joint>'
    )
    text, config = imported(sdf(LINKS + MOTORS + include), "quad/model.sdf")
    assert config["inertia"]["mass"] == pytest.approx(2.4)
    assert "0.4 at [0, 0, 0.2]: camera::eye" in text


def test_constants_of_jinja_are_filled_in_and_lines_stay(imported):
    """The other braces of PX4's templates are in plugins that eqt does not read."""
    text = "{# a vehicle #}\n{%- set m = 0.8 -%}\n" + QUAD.replace(
        "<mass>1.6</mass>", "<mass>{{ 2*m }}</mass>"
    ).replace("</model>", "<plugin filename='x'><port>{{ port }}</port></plugin></model>")
    written, config = imported(text, "model.sdf.jinja")
    same(config)
    assert "model.sdf.jinja:4" in written


def test_joints_that_move_are_held_and_told(imported):
    arm = (
        '<joint name="hinge" type="revolute"><parent>base</parent><child>arm</child></joint>'
        '<link name="arm"><inertial><mass>0.1</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy>'
        "<izz>1e-5</izz></inertia></inertial></link>"
    )
    moving = LINKS + arm
    text, config = imported(sdf(moving + MOTORS))
    assert "held at 0: hinge" in text
    assert config["inertia"]["mass"] == pytest.approx(2.1)


def test_an_underwater_vehicle_has_the_water_at_its_origin(imported):
    """Added mass, drag and buoyancy by hand; the centre of mass is 2 cm below the hull's origin."""
    text, config = imported(ROV)
    rigid = np.array(config["inertia"]["rigid"])
    assert rigid[3, 3] == pytest.approx(10.0)
    assert (rigid[0, 4], rigid[1, 3]) == pytest.approx((0.2, -0.2))  # −m z
    assert rigid[0, 0] == pytest.approx(0.1 + 10 * 0.02**2)
    assert np.diag(config["inertia"]["added"]).tolist() == [0.1, 0.2, 0.3, 5, 6, 7]
    restoring, drag = config["model"]["forces"]
    assert restoring["buoyancy"] == pytest.approx(1000 * 9.80665 * 0.5 * 0.2 * 0.11)
    assert restoring["centre_of_buoyancy"] == pytest.approx([0, 0, 0.1])
    assert restoring["centre_of_mass"] == pytest.approx([0, 0, -0.02])
    assert drag["linear"] == [0.4, 0.5, 0.6, 4, 5, 6]
    assert drag["quadratic"] == [0, 0, 0, 14, 15, 16]
    part = thrusters(config)
    assert (part["low"], part["high"]) == (-40, 50)
    assert part["thrusters"][0]["along"] == pytest.approx([0.5**0.5, -(0.5**0.5), 0])
    assert "time_constant: …" in text


def test_added_mass_had_the_other_sign(imported):
    text, config = imported(re.sub(r"(DotU>|DotV>|DotW>|DotP>|DotQ>|DotR>)-", r"\1", ROV))
    assert np.diag(config["inertia"]["added"]).tolist() == [0.1, 0.2, 0.3, 5, 6, 7]
    assert "added mass is positive" in text


def test_rotors_may_push_both_ways(imported):
    part = thrusters(imported(QUAD, reversible=True)[1])
    assert (part["kind"], part["low_speed"], part["high_speed"]) == ("propellers", -1000, 1000)


def test_limits_may_be_told(imported):
    part = thrusters(imported(QUAD, thrust="0,7.5")[1])
    assert (part["low"], part["high"], part["thrust_constant"]) == (0, 7.5, 1e-5)


def test_a_link_may_be_left_out(imported):
    gps = (
        '<link name="gps"><inertial><mass>1</mass><inertia><ixx>1</ixx><iyy>1</iyy><izz>1</izz>'
        "</inertia></inertial></link><joint name='g' type='fixed'><parent>base</parent>"
        "<child>gps</child></joint></model>"
    )
    text, config = imported(QUAD.replace("</model>", gps), without=("gps",))
    same(config)
    assert "link gps is left out" in text


def test_the_rotor_of_a_link_that_is_left_out_is_left_out(imported):
    text, config = imported(QUAD, without=("rotor0",))
    names = [rotor["name"] for rotor in thrusters(config)["thrusters"]]
    assert names == ["rotor1", "rotor2", "rotor3"]
    told = text.replace("\n#   ", " ")
    assert "joint joint0 is left out, too" in told
    assert "plugin MulticopterMotorModel is left out with rotor0" in told


def test_what_stands_on_something_left_out_is_refused(tmp_path):
    (tmp_path / "quad.sdf").write_text(
        QUAD.replace("<pose>0.2 -0.3", '<pose relative_to="gps">0.2 -0.3', 1).replace(
            "</model>", "<link name='gps'><inertial/></link></model>"
        )
    )
    said = error_of(configuration_of, tmp_path / "quad.sdf", bandwidth=5.0, without=("gps",))
    assert "quad.sdf:5" in said
    assert "--without gps" in said


def test_comments_may_hold_command_lines(imported):
    """XML forbids -- in a comment; the files of Gazebo have it, and its parser reads them."""
    same(imported(QUAD.replace("<link", "<!-- gz topic --msgtype a\n-->\n<link", 1))[1])


@pytest.mark.parametrize(
    ("old", "new", "without", "said"),
    [
        ("0.3 0.05 0 0 0", "0.3 0.05 3.141592653589793 0 0", (), "-4.903 N of rotor0"),
        ("<maxRotVelocity>1000", "<maxRotVelocity>650", (), "4.903 N of rotor2, which has 4.225 N"),
        ("", "", ("rotor0",), "a torque of"),
    ],
)
def test_a_vehicle_that_cannot_hover_is_told(tmp_path, old, new, without, said):
    """19.61 N on four rotors, of which one is upside down, or too slow, or left out."""
    (tmp_path / "quad.sdf").write_text(QUAD.replace(old, new, 1))
    _, lines = configuration_of(tmp_path / "quad.sdf", bandwidth=5.0, without=without)
    assert "cannot hover" in lines[2]
    assert said in lines[2]


def test_tilted_rotors_lift_along_their_sum(imported):
    """Two rotors tilt by 10° to each side: with unlike arms their torques balance off the vertical.

    The force of thrusts without a torque is along `along`.
    """
    tilted = LINKS.replace("-0.3 0.05 0 0 0", "-0.25 0.05 0.1745 0 0", 1)
    tilted = tilted.replace("0.3 0.05 0 0 0", "0.3 0.05 -0.1745 0 0", 1)
    _, config = imported(sdf(tilted + MOTORS))
    rotors = thrusters(config)["thrusters"]
    ratio = thrusters(config)["moment_constant"] / thrusters(config)["thrust_constant"]
    torques = np.array(
        [np.cross(r["at"], r["along"]) + ratio * r["turns"] * np.array(r["along"]) for r in rotors]
    )
    thrusts = np.linalg.svd(torques.T)[2][-1]
    force = thrusts @ [r["along"] for r in rotors]
    expected = force / np.linalg.norm(force) * np.sign(force[2])
    assert abs(expected[1]) > 1e-3
    assert config["controllers"][0]["along"] == pytest.approx(expected.tolist(), abs=1e-9)


def test_names_from_a_file_are_only_names(imported):
    """A line break in a name would else begin another key, such as plugins."""
    evil = QUAD.replace('name="quad"', 'name="q&#10;plugins: [x.py]&#10;"')
    evil = evil.replace("rotor2", "ro&#10;plugins: [x.py] #&#10;r").replace("rotor3", "🚁\u202e")
    text, config = imported(evil)
    assert "plugins" not in config
    assert thrusters(config)["thrusters"][2]["name"] == "ro\nplugins: [x.py] #\nr"
    assert thrusters(config)["thrusters"][3]["name"] == "🚁\u202e"
    assert all(line.isprintable() for line in text.splitlines())


@from_yaml
def test_refuses(tmp_path, of, old, new, said):
    """The place of the fault, and a word of what is wrong or to be done."""
    source = {"quad": QUAD, "rov": ROV}[of]
    assert old in source
    path = tmp_path / "m" / "model.sdf"
    path.parent.mkdir()
    path.write_text(source.replace(old, new, 1), encoding="utf-8")
    message = error_of(configuration_of, path, bandwidth=5.0)
    assert "\n" not in message
    for word in said:
        assert word in message


def test_all_missing_models_are_listed(tmp_path):
    inside = "<include><uri>model://gps</uri></include><include><uri>model://cam</uri></include>"
    (tmp_path / "quad.sdf").write_text(sdf(LINKS + inside))
    message = error_of(configuration_of, tmp_path / "quad.sdf", bandwidth=5.0)
    assert "--without gps" in message
    assert "--without cam" in message


def test_a_model_that_includes_itself_is_refused(tmp_path):
    (tmp_path / "a").mkdir()
    (tmp_path / "a" / "model.sdf").write_text(sdf("<include><uri>model://a</uri></include>"))
    said = error_of(configuration_of, tmp_path / "a" / "model.sdf", bandwidth=5.0)
    assert "includes itself" in said


def test_the_configuration_is_valid(imported, folder):
    """As eqt builds it: the same B, and an inertia with the centre of mass at the origin."""
    for name, source in (("quad", QUAD), ("rov", ROV)):
        Path(f"{name}.yaml").write_text(imported(source)[0], encoding="utf-8")
        experiment = build(read_config(Path(f"{name}.yaml"), {}))
        G, part = experiment.group, experiment.loop.vehicle.actuators[0]
        assert part.columns(G).shape[0] == 6
        assert np.linalg.matrix_rank(np.asarray(part.matrix)) == (4 if name == "quad" else 6)
