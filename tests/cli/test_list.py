"""`eqt list`: the components there are."""

import json

import pytest
import yaml

from eqt_cli.base import extensions, registry
from eqt_cli.base.yaml_source import LONGEST
from eqt_cli.components.laws import controllers
from eqt_cli.config import shipped
from eqt_cli.results.metrics import METRICS

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

METRIC = '''\
from typing import ClassVar
from eqt_cli.extend import Metric

class Mine(Metric):
    """Number of mine."""

    name: ClassVar[str] = "mine"
    signals: ClassVar[tuple[str, ...]] = ("pose_error",)
    units: ClassVar[str] = "{}"
    better: ClassVar[str] = "lower"

    def of(self, over, error):
        return over.mean(error)
'''


def named(out):
    """The names in the first column of a table."""
    lines = out.splitlines()
    return [line.split()[0] for line in lines[3:] if line.strip() and not line.startswith(" ")]


@pytest.mark.needs("proofs")
def test_without_a_kind_the_kinds_are_counted(eqt):
    done = eqt("list")
    assert (done.code, done.err) == (0, "")
    header, _, *lines, gap, more = done.out.splitlines()
    assert (header.split(), gap) == (["kind", "number"], "")
    assert [line.split() for line in lines][1] == ["controllers", str(len(controllers.names()))]
    assert [line.split()[0] for line in lines] == [*KINDS, "configs"]
    assert more == "`eqt list KIND` shows one kind, `eqt list NAME` one of its components"


@pytest.mark.needs("proofs")
@pytest.mark.parametrize(
    ("words", "kinds"),
    [
        *((kind[:-3] + "y" if kind == "velocities" else kind[:-1], [kind]) for kind in KINDS),
        ("law", ["controllers"]),
        ("laws", ["controllers"]),
        ("config", ["configs"]),
        ("start", ["poses", "velocities"]),
        ("starts", ["poses", "velocities"]),
    ],
)
def test_a_kind_in_singular_and_by_the_words_of_the_field(eqt, words, kinds):
    assert list(json.loads(eqt("list", words, "--json").out)) == kinds


def test_several_kinds_stand_under_their_names(eqt):
    lines = eqt("list", "starts").out.splitlines()
    assert [line for line in lines if line.endswith(":")] == ["poses:", "velocities:"]
    assert lines.index("velocities:") > next(k for k, x in enumerate(lines) if "haar" in x)


def test_one_kind(eqt):
    title, header, *lines = eqt("list", "velocities").out.splitlines()
    assert (title, header.split()) == ("velocities:", ["name", "meaning", "options"])
    normal = "normal  Independent normal velocity coordinates."
    assert [line.split()[-1] for line in lines if line.startswith(normal)] == ["std"]


def test_the_laws_of_the_paper_lead_the_list(eqt):
    assert named(eqt("list", "laws").out)[:4] == ["eqt", "gt", "nog", "asym"]


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


@pytest.mark.needs("proofs")
def test_every_registry_is_listed():
    assert list(extensions.all_kinds()) == KINDS
    listed = {registry.registry(kind).kind for kind in KINDS}
    assert {one.kind for one in registry._registries} == listed


@pytest.mark.needs("proofs")
def test_json_is_one_document(eqt):
    document = json.loads(eqt("list", "--json").out)
    assert list(document) == [*KINDS, "configs"]
    assert sorted(entry["name"] for entry in document["controllers"]) == controllers.names()
    assert [entry["name"] for entry in document["configs"]] == shipped.names()
    assert all(set(entry) == {"name", "summary", "options"} for entry in document["engines"])
    assert all(entry["summary"] for kind in KINDS for entry in document[kind])


def test_metrics_have_a_unit_and_a_meaning(eqt, folder):
    """Also those of a plugin; a unit of the group is named, since it depends on it."""
    (folder / "mine.py").write_text(METRIC, encoding="utf-8")
    listed = json.loads(eqt("list", "metrics", "--plugin", "mine.py", "--json").out)["metrics"]
    units = {entry["name"]: (entry["unit"], entry["summary"]) for entry in listed}
    assert units["settling_time"] == ("s", "last time ||I - Q_E||_F leaves the settling threshold")
    assert units["effort"][0] == "(force unit)^2 s"
    assert units["mine"] == ("pose unit", "Number of mine")
    assert {metric.name for metric in METRICS} < set(named(eqt("list", "metric").out))


def test_a_plugin(eqt, folder):
    (folder / "push.py").write_text(PLUGIN, encoding="utf-8")
    lines = eqt("list", "controllers", "--plugin", "push.py").out.splitlines()
    at = next(index for index, line in enumerate(lines) if line.split()[:1] == ["push"])
    assert lines[at].split() == ["push", "Pushes", "back.", "gain"]


@pytest.mark.needs("proofs")
@pytest.mark.parametrize(
    ("kind", "hint"),
    [
        ("controler", "did you mean 'controllers'?"),
        ("cascde", "did you mean 'cascade'?"),
        ("xyz", f"kinds: {', '.join([*KINDS, 'configs'])}"),
    ],
)
def test_an_unknown_kind(refused, kind, hint):
    assert refused("list", kind) == f"unknown kind or component '{kind}'; {hint}\n"


@pytest.mark.needs("underactuated")
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
    end = next(k for k, line in enumerate(lines) if line.startswith("about "))
    example = yaml.safe_load("\n".join(lines[at + 1 : end]))
    whole = yaml.safe_load(shipped.text("planar_vtol"))
    assert example["controllers"] == whole["controllers"][:1]


def test_components_of_one_name_are_all_explained(eqt):
    document = json.loads(eqt("list", "lag", "--json").out)
    assert [each["kind"] for each in document["components"]] == ["actuators", "sensors"]
    assert all(option["meaning"] for each in document["components"] for option in each["options"])


def test_every_configuration_says_what_it_is(eqt):
    assert named(eqt("list", "configs").out) == shipped.names()
    assert all(15 < len(shipped.summary(name)) <= LONGEST for name in shipped.names())


def test_an_unknown_plugin(refused):
    assert refused("list", "--plugin", "no.py").startswith("plugin no.py: cannot be read: ")
