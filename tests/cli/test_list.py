"""`eqt list`: the components there are."""

import json

import pytest
import yaml

from eqt_cli.base import registry
from eqt_cli.base import registry as catalogue
from eqt_cli.base.yaml_source import LONGEST
from eqt_cli.components.laws import controllers
from eqt_cli.config import shipped

KINDS = (
    "groups controllers references forces actuators sensors estimators engines poses "
    "velocities metrics designs executors figures certificates claims"
).split()

PLUGIN = '''\
from dataclasses import dataclass
from typing import ClassVar
from eqt_cli.components.laws import Controller

@dataclass(frozen=True)
class Push(Controller):
    """Pushes back.

    Not shown.
    """

    name: ClassVar[str] = "push"
    title: ClassVar[str] = "Push"
    gain: float = 1.0

    def torque(self, s):
        return -self.gain * s.V_tilde
'''


def test_everything(eqt):
    done = eqt("list")
    assert (done.code, done.err) == (0, "")
    counted, _, listed = done.out.partition("\n\n")
    first, *lines = counted.splitlines()
    assert first == "kinds, and how many of each; `eqt list KIND` shows one kind"
    assert [line.split() for line in lines][1] == ["controllers", str(len(controllers.names()))]
    assert [line.split()[0] for line in lines] == [*KINDS, "configs"]
    titles = [line for line in listed.splitlines() if line and not line.startswith(" ")]
    assert titles == [*KINDS, "configs"]


def test_one_kind(eqt):
    title, *lines = eqt("list", "velocities").out.splitlines()
    assert title == "velocities"
    assert lines.index("  normal  Independent normal velocity coordinates.") + 1 == (
        lines.index("          options: std")
    )


@pytest.mark.parametrize(
    ("kind", "name", "options"),
    [
        ("designs", "sobol", ["points", "seed", "axes"]),
        ("designs", "grid", []),  # its section is the axes
        ("executors", "local", ["workers"]),
        ("executors", "auto", ["workers", "threads", "stays"]),
    ],
)
def test_options(eqt, kind, name, options):
    listed = json.loads(eqt("list", kind, "--json").out)[kind]
    assert [entry["options"] for entry in listed if entry["name"] == name] == [options]


def test_every_registry_is_listed():
    assert list(catalogue.KINDS) == KINDS
    listed = {catalogue.registry(kind).kind for kind in KINDS}
    assert {one.kind for one in registry._registries} == listed


def test_json_is_one_document(eqt):
    document = json.loads(eqt("list", "--json").out)
    assert list(document) == [*KINDS, "configs"]
    assert [entry["name"] for entry in document["controllers"]] == controllers.names()
    assert [entry["name"] for entry in document["configs"]] == shipped.names()
    assert all(set(entry) == {"name", "summary", "options"} for entry in document["engines"])
    assert all(entry["summary"] for kind in KINDS for entry in document[kind])


def test_a_kind_of_plugins_alone(eqt):
    said = "metrics\n  none; plugins derive them from eqt_cli.extend.Metric"
    assert eqt("list", "metrics").out.strip() == said


def test_a_plugin(eqt, folder):
    (folder / "push.py").write_text(PLUGIN, encoding="utf-8")
    lines = eqt("list", "controllers", "--plugin", "push.py").out.splitlines()
    at = next(index for index, line in enumerate(lines) if line.split()[:1] == ["push"])
    assert lines[at].split() == ["push", "Pushes", "back."]
    assert lines[at + 1].strip() == "options: gain"


@pytest.mark.parametrize(
    ("kind", "hint"),
    [
        ("controler", "did you mean 'controllers'?"),
        ("cascde", "did you mean 'cascade'?"),
        ("xyz", f"kinds: {', '.join([*KINDS, 'configs'])}"),
    ],
)
def test_an_unknown_kind(refused, kind, hint):
    assert refused("list", kind) == f"eqt: unknown kind or component '{kind}'; {hint}\n"


def test_one_component(eqt):
    """Its options with those in them, and a part of a shipped configuration."""
    first, *lines = eqt("list", "cascade").out.splitlines()
    lines = lines[lines.index("") + 1 :]
    assert first.startswith("cascade, of controllers: A position loop around an attitude law")
    assert lines[0].split() == ["option", "value", "default", "meaning"]
    named = [line.split()[0] for line in lines if line.strip()]
    assert {"attitude", "position", "position.kx", "along"} <= set(named)
    at = next(k for k, line in enumerate(lines) if line.startswith("example, "))
    assert lines[at].endswith("`eqt run planar_vtol`:")
    example = yaml.safe_load("\n".join(lines[at + 1 :]))
    whole = yaml.safe_load(shipped.text("planar_vtol"))
    assert example["controllers"] == whole["controllers"][:1]


def test_components_of_one_name_are_all_explained(eqt):
    document = json.loads(eqt("list", "lag", "--json").out)
    assert [each["kind"] for each in document["components"]] == ["actuators", "sensors"]
    assert all(option["meaning"] for each in document["components"] for option in each["options"])


def test_every_configuration_says_what_it_is(eqt):
    lines = eqt("list", "configs").out.splitlines()[1:]
    assert [line.split()[0] for line in lines if line[2] != " "] == shipped.names()
    assert all(15 < len(shipped.summary(name)) <= LONGEST for name in shipped.names())


def test_an_unknown_plugin(refused):
    assert refused("list", "--plugin", "no.py").startswith("eqt: plugin no.py: cannot be read: ")
