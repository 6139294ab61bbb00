"""The table of attributes against the names of the schemas, which `schemas` has with versions."""

import re
from pathlib import Path

import pytest
from case_tables import from_yaml
from said import error_of
from vehicle_files import QUAD, ROV, URDF

from eqt_cli.extensions.vehicles.attributes import MANY, USED, is_silent, kind_of, rows, shortest
from eqt_cli.extensions.vehicles.elements import Element
from eqt_cli.extensions.vehicles.mjcf_checks import mjcf_path
from eqt_cli.extensions.vehicles.model import is_plugin
from eqt_cli.extensions.vehicles.plugins import NUMBERS, PX4_WATER, WINGS
from eqt_cli.extensions.vehicles.vehicle_file import configuration_of

SCHEMAS = Path(__file__).parent / "schemas"
BESIDE = {
    "SDF": {"sdf/include", "sdf/@xmlns*", "model/@xmlns*", "include/experimental:params"},
    "URDF": {
        *("robot/properties", "properties/@*", "robot/@xmlns*"),  # of gym-pybullet-drones
        *("geometry/capsule", "geometry/capsule/@radius", "geometry/capsule/@length"),
        # of SDF, which parser_urdf.cc copies from <gazebo>
        *("gazebo/gravity", "gazebo/kinematic", "gazebo/inertial", "gazebo/velocity_decay"),
        *("gazebo/initialJointPosition", "gazebo/enable_wind", "gazebo/sensor"),
    },
    "MJCF": set(),
}


def lines(name):
    """The lines of a list, of which a long one goes on indented."""
    text = re.sub(r"\n +", " ", (SCHEMAS / name).read_text(encoding="utf-8"))
    return [line for line in text.splitlines() if not line.startswith("#")]


def mjcf():
    """Paths of attributes as of ``body/geom/mass``."""
    for line in lines("mjcf.txt"):
        path, _, names = line.partition(":")
        yield from (mjcf_path(f"{path}/{name}") for name in names.split())


def tree(form):
    """Elements and attributes below each element, by the path that the table has of it."""
    below = {}
    if form == "URDF":
        for line in lines("urdf.txt"):
            path, _, names = line.partition(":")
            below.setdefault(shortest(form, path), set()).update(names.split())
        return below, "robot"
    parts = {}
    for line in lines("sdf.txt"):
        name, path, names = line.split(":", 2)
        parts.setdefault(name.strip(), {})[path.strip()] = names.split()

    parts_of = {f"&{name}" for name in parts}

    def add(name, at):
        for path, names in parts[name].items():
            here = shortest(form, "/".join([at, *path.split("/")[1:]]))
            inside = below.setdefault(here, set())
            for word in names:
                name = word.lstrip("&")
                if word in parts_of:
                    name = next(iter(parts[word[1:]])).split("/")[0]
                fresh = shortest(form, f"{here}/{name}") not in below
                inside.add(name)
                if word in parts_of and fresh:
                    add(word[1:], f"{here}/{name}")

    add("root", "sdf")
    return below, "sdf"


def walked(form):
    """Paths that a reader meets: it goes into what is used, and stops at the rest."""
    below, root = tree(form)
    left, done = [root], set()
    while left:
        here = left.pop()
        for name in below.get(here, ()):
            path = shortest(form, f"{here}/{name}")
            if path not in done:
                done.add(path)
                if kind_of(form, path) in (USED, MANY) and name != "plugin":
                    left.append(path)
    return done


PATHS = {"SDF": lambda: walked("SDF"), "URDF": lambda: walked("URDF"), "MJCF": lambda: set(mjcf())}


@pytest.mark.parametrize("form", PATHS)
def test_every_attribute_of_a_schema_is_in_the_table(form):
    """Used, without effect on the motion, noted or refused: none is passed over."""
    paths = PATHS[form]()
    assert len(paths) > 60
    assert sorted(path for path in paths if kind_of(form, path) is None) == []


@pytest.mark.parametrize(
    ("path", "of"),
    [
        ("mujoco/default/default/class", "default/class"),
        ("mujoco/default/default/general/dyntype", "general/dyntype"),
        ("mujoco/default/joint/damping", "joint/damping"),
        ("mujoco/worldbody/body/body/joint/damping", "joint/damping"),
        ("mujoco/worldbody/body/frame/geom/mass", "geom/mass"),
        ("mujoco/tendon/fixed/joint/coef", "tendon/fixed/joint/coef"),
        ("mujoco/actuator/position/kp", "actuator/position/kp"),
    ],
)
def test_an_attribute_is_looked_up_where_it_stands(path, of):
    assert mjcf_path(path) == of
    assert kind_of("MJCF", of)


@pytest.mark.parametrize("form", PATHS)
def test_every_row_of_the_table_is_of_a_schema(form):
    """A row that fits nothing is a slip; `BESIDE` are names that no schema lists."""
    paths = PATHS[form]()
    unused = [path for _, path, pattern in rows(form) if not any(map(pattern.fullmatch, paths))]
    assert set(unused) <= BESIDE[form]


def plugins():
    """Names of plugins, and what is done with them."""
    kinds = (line.partition(":") for line in lines("plugins.txt"))
    return [(name, kind) for kind, _, names in kinds for name in names.split()]


@pytest.mark.parametrize(("name", "kind"), plugins())
def test_plugins_of_gazebo_by_their_names(name, kind):
    """As gz-sim names their files and classes, or as a library is called."""
    camel = "".join(part.capitalize() for part in name.split("_"))
    gz, library = f"gz-sim-{name.replace('_', '-')}-system", f"lib{name}.so"
    files = {"filename": gz, "name": f"gz::sim::systems::{camel}"}
    if re.search("gazebo|plugin|uuv|rotors|hil|controller|Force", name):
        files = {"filename": library}
    plugin = Element("plugin", files, "a.sdf:1")
    reads, refuses = "|".join(NUMBERS), f"{WINGS}|{PX4_WATER}"
    what = "read" if is_plugin(plugin, reads) else "refused" if is_plugin(plugin, refuses) else ""
    assert (what or ("silent" if is_silent(plugin) else "noted")) == kind


ARM = """<joint name="hinge" type="revolute"><parent>base</parent><child>arm</child>
<axis><xyz>0 1 0</xyz><dynamics><damping>0</damping></dynamics></axis></joint>
<link name="arm"><inertial><mass>0.1</mass><inertia><ixx>1e-5</ixx><iyy>1e-5</iyy>
<izz>1e-5</izz></inertia></inertial></link></model>"""
URDF_ARM = """<link name="arm"><inertial><mass value="0.01"/>
<inertia ixx="1e-6" ixy="0" ixz="0" iyy="1e-6" iyz="0" izz="1e-6"/></inertial></link>
<joint name="hinge" type="revolute"><parent link="base_link"/><child link="arm"/>
<axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="2" velocity="3"/></joint></robot>"""
FILES = {
    "sdf": ("quad.sdf", QUAD.replace("</model>", ARM)),
    "rov": ("rov.sdf", ROV),
    "urdf": ("cf2.urdf", URDF.replace("</robot>", URDF_ARM)),
}


@pytest.fixture
def changed(tmp_path):
    """Writes a file with a change, and returns its path and the one without the change."""

    def write(of, old, new):
        name, text = FILES[of]
        assert old in text
        for folder, content in (("plain", text), ("changed", text.replace(old, new, 1))):
            (tmp_path / folder).mkdir()
            (tmp_path / folder / name).write_text(content, encoding="utf-8")
        return tmp_path / "plain" / name, tmp_path / "changed" / name

    return write


def configured(path):
    return configuration_of(path, bandwidth=5.0)[0].replace("\n#   ", " ")


@from_yaml
def test_what_is_left_out_is_told(changed, of, old, new, said):
    """A note with the line, which the file without the change has not."""
    plain, other = changed(of, old, new)
    notes = set(configured(other).splitlines()) - set(configured(plain).splitlines())
    text = "\n".join(note for note in notes if note.startswith("# Note"))
    for word in said:
        assert word in text


@from_yaml
def test_what_changes_the_motion_is_refused(changed, of, old, new, said):
    message = error_of(configuration_of, changed(of, old, new)[1], bandwidth=5.0)
    assert "\n" not in message
    for word in said:
        assert word in message


@from_yaml
def test_what_changes_nothing_is_not_told(changed, of, old, new):
    plain, other = changed(of, old, new)
    assert [*map(without_lines, configured(other).splitlines())] == [
        *map(without_lines, configured(plain).splitlines())
    ]


def without_lines(text):
    return re.sub(r":\d+", "", text)
