"""The diagram has every block that the engines evaluate, in text and in both pictures."""

import re
from dataclasses import dataclass, replace
from xml.etree import ElementTree

import pytest

import eqt_cli
from eqt_cli.base.option_types import VELOCITY, UnitPlace
from eqt_cli.components import blocks
from eqt_cli.components.sensors import Noise
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.study import study, without_sweep
from eqt_cli.extend import group_named
from eqt_cli.extensions.diagram.wires import Wire, observed
from eqt_cli.extensions.diagram.wording import SPACE, option_text
from eqt_cli.loop import closed_loop

pytestmark = pytest.mark.needs("diagram")

WHEELS = "satellite_wheels"


@dataclass(frozen=True)
class Planted(blocks.Block):
    """Doubles what passes."""

    source: str

    def output(self, now):
        return 2.0 * now[self.source]


def words_of(picture):
    return " ".join(" ".join(ElementTree.fromstring(picture).itertext()).split())


def test_a_planted_block_is_drawn_between_those_that_it_joins(monkeypatch):
    blocks_of = closed_loop.blocks_of

    def with_planted(*arguments):
        walk = [*blocks_of(*arguments).named.values()]
        k = next(k for k, block in enumerate(walk) if isinstance(block, blocks.Forces))
        planted = Planted("doubler", (), walk[k].source)
        return blocks.Blocks([*walk[:k], planted, replace(walk[k], source="doubler.output")])

    monkeypatch.setattr(closed_loop, "blocks_of", with_planted)
    loop = eqt_cli.diagram("sweep_lag")
    assert re.search(r"─ .*: lag.*▼ τ.*─ doubler.*Doubles what passes.*─ plant", loop.text(), re.S)
    for narrow in (False, True):
        assert "doubler Doubles what passes" in words_of(loop.svg(narrow=narrow))


def test_a_wire_is_what_a_block_has_read():
    loop = eqt_cli.load_experiment("cubesat_orbit").base.loop
    _, wires = observed(loop)
    assert Wire("actuators_0.momentum", "actuators_1") in wires
    assert "reads momentum of 4 wheels" in eqt_cli.diagram("cubesat_orbit").text()


def test_laws_are_told_apart_by_what_differs():
    text = eqt_cli.diagram("quadrotor_lee").text()
    assert "▸ no rates: rates none" in text and "▸ model: rates model" in text
    assert text.count("Lee 2010") == 1
    assert "┌╌ sensors: exact ╌" in text and "acts continuously" in text


def test_a_cascade_says_what_it_takes_off():
    text = eqt_cli.diagram("crazyflie").text()
    assert re.search(r"law: cascade.*takes off restoring.*─ Lee 2010", text, re.S)
    assert text.count("the law knows such a force") == 1


def test_cones_and_bounds_that_end_runs_are_drawn_where_they_act():
    loop = eqt_cli.diagram("cubesat_sun", {"failed_when": {"rate": "5 deg/s", "torque_norm": 1}})
    facts = r"slew.*keep-out cones.*30 deg off \(1, 0.35, 0\).*moving direction.*no law.*"
    stop = r"gravity gradient.*ends as failed.*rate beyond 5 deg/s.*torque norm beyond 1 N m"
    assert re.search(f"{facts}law: .*plant: .*{stop}.*sensors", loop.text(), re.S)
    for narrow in (False, True):
        drawn = words_of(loop.svg(narrow=narrow))
        assert re.search(facts, drawn) and re.search(stop, drawn)
    assert "ends as failed" not in eqt_cli.diagram("cubesat_sun").text()


def test_a_cone_whose_direction_has_a_function_with_a_t_does_not_move():
    cone = {"axis": [0, 0, 1], "at": ["sqrt(2)", 0, 1], "angle": "30 deg"}
    metrics = [{"kind": "keep_out_time", "cones": [cone]}]
    assert "off (sqrt(2), 0, 1)" in eqt_cli.diagram("cubesat_sun", {"metrics": metrics}).text()


def test_the_torque_of_a_law_stands_before_what_rejects_for_it():
    rejecting = {"kind": "indi", "law": "lee2010", "cutoff": "0.1 Hz"}
    text = eqt_cli.diagram("satellite_breaks", {"controllers": [rejecting]}).text()
    assert re.search(r"─ law: Lee 2010 .*┘\n│ +▼ τ\n│  ┌─ INDI ", text, re.S)


@pytest.mark.ci("draws all shipped configurations")
@pytest.mark.parametrize("name", shipped.names())
def test_a_shipped_configuration_has_all_its_parts_in_the_diagram(name):
    base = study(without_sweep(read_config(shipped.folder() / f"{name}.yaml", []))).base
    loop = eqt_cli.diagram(name)
    text, wide = loop.text(), words_of(loop.svg())
    assert max(map(len, text.splitlines())) <= 80
    for drawn in (text, wide, words_of(loop.svg(narrow=True))):
        bare = re.sub(r"\s", "", drawn)
        for title in base.titles.values():
            assert title.replace(" ", "") in bare
        for place, part in base.vehicle.parts.items():
            for word in getattr(part, "members", {}) or [getattr(part, "name", "")]:
                assert word.replace("_", "") in bare, place


@pytest.mark.parametrize(
    ("density", "text"),
    [
        (["0.3 deg/√h"] * 3 + [0.002] * 3, "0.3 deg/√h; 0.002 m/√s"),
        ([5e-4] * 3 + ["0.2 m/s/√Hz"] * 3, "0.0005 rad/√s; 0.2 m/s/√Hz"),
        ([5e-4] * 3 + [0.002] * 3, "0.0005 rad/√s; 0.002 m/√s"),
        ("0.3 deg/√h", "0.3 deg/√h"),
    ],
)
def test_numbers_without_a_unit_have_that_of_their_coordinate(density, text):
    """A list whose first half has a unit does not lend it to the second."""
    noise, place = Noise(density=0.1), UnitPlace(group_named("SE3"), VELOCITY)
    written = option_text(noise, "density", density, place, density).replace(SPACE, " ")
    assert written == f"density {text}"
