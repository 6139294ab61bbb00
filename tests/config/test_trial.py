"""Mistakes in a user's components are found when the configuration is checked, with their line."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from plugin_sources import component
from said import says

import eqt_cli
from eqt_cli.base.errors import ComponentError, ConfigError

BODIES = {
    "Controller": """\
    title: ClassVar[str] = "Own"

    def torque(self, s):
        return -s.V
""",
    "Reference": """\
    def driving_torque(self, G, inertia, t, Pd):
        return 0.0 * Pd
""",
    "Force": """\
    departs: ClassVar[str] = "a part of my own"
    def acting(self, G, t, Q, V):
        return -V
""",
    "Actuator": """\
    departs: ClassVar[str] = "a part of my own"
    def output(self, G, command, x):
        return command
""",
    "Sensor": """\
    departs: ClassVar[str] = "a part of my own"
    def errors(self, G, instants, period, random):
        return random.standard_normal((instants, 3))
""",
}
GROUP = """\
from typing import ClassVar

from eqt_cli.components.matrix_groups import SO3


class Own(SO3):
    name: ClassVar[str] = "Own"

    def hat(self, v):
        return BODY
"""
SECTIONS = {
    "Controller": {"controllers": "[eqt, own]"},
    "Reference": {"reference": "{kind: own}"},
    "Force": {"plant": "{forces: [{kind: constant, force: 0.1}, own]}"},
    "Actuator": {"actuators": "[own]", "control": "{period: 0.1}"},
    "Sensor": {"sensors": "{velocity: [{kind: noise, std: 0.1}, own]}", "control": "{period: 0.1}"},
}


def changes(base, old="", new=""):
    """A configuration with a component, in whose text `old` is replaced."""
    assert old in BODIES[base]
    source = f"import numpy as np\nown(eqt_cli.extend.{base}):\n{BODIES[base].replace(old, new)}"
    Path("own.py").write_text(component(source), encoding="utf-8")
    return {"plugins": "[own.py]", **SECTIONS[base]}


@from_yaml
def test_a_mistake(message, base, old, new, said):
    text = message(**changes(base, old, new))
    assert says(text, f"c.yaml:…: {said}")


GAIN = """\
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from eqt_cli.extend import CLASS, stack


@dataclass(frozen=True)
class Own(CLASS):
    name: ClassVar[str] = "own"
    departs: ClassVar[str] = "a part of my own"
    k: float = 0.3

    def acting(self, G, t, Q, V):
        x = V[..., 0]
        return stack([PRODUCT, 0 * x, 0 * x])
"""


@pytest.mark.parametrize("product", ["self.k * x", "(np.sqrt(self.k) + 1) * x", "x / self.k"])
@pytest.mark.parametrize(
    ("of", "sections"),
    [
        ("Controller", SECTIONS["Controller"]),
        pytest.param(
            "Controller",
            {"controllers": "[{kind: observer, law: own, rate: 5}]", "control": "{period: 0.1}"},
            marks=pytest.mark.needs("designed_laws"),
        ),
        ("Force", SECTIONS["Force"]),
    ],
)
def test_a_number_of_each_run_times_a_field_is_named_with_its_line(message, of, sections, product):
    text = GAIN.replace("CLASS", of).replace("PRODUCT", product)
    if of == "Controller":
        text = text.replace("acting(self, G, t, Q, V)", "torque(self, s)").replace("= V", "= s.V")
    Path("own.py").write_text(text, encoding="utf-8")
    said = message(plugins="[own.py]", **sections)
    assert "(5, 1)" in said and "(5,)" in said and "[..., None]" in said and "[..., 0]" in said
    assert f"own.py:17: return stack([{product}, 0 * x, 0 * x])" in said


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("v.foo", "AttributeError: 'numpy.ndarray' object has no attribute 'foo' at own.py:10: "),
        ("v", "ValueError: matmul: "),
    ],
)
def test_a_group(message, body, said):
    Path("own.py").write_text(GROUP.replace("BODY", body), encoding="utf-8")
    found = message(plugins="[own.py]", group="Own", controllers="[eqt]").partition(": group: ")[2]
    assert found.startswith(f"group 'Own' fails at the start of run 0: {said}")


@pytest.mark.parametrize(
    ("body", "said"),
    [
        ("sys.exit(0)", "…'own' fails at the start of run 0: SystemExit: calls exit(0)…own.py…"),
        ("sys.exit('')", "…'own' fails at the start of run 0: SystemExit: calls exit('')…own.py…"),
        ("-s.V if np.max(s.t) < 0.02 else exit()", "SystemExit: calls exit(None)…own.py…"),
        ("threading.Thread(target=exit).run()", "…'own' fails…SystemExit…own.py…"),
        (
            "(t := threading.Thread(target=exit)).start() or t.join() or -s.V",
            "a thread…ends by SystemExit…",
        ),
    ],
)
def test_a_law_that_ends_the_process_is_named(run, body, said):
    sections = changes("Controller", "-s.V", body)
    text = Path("own.py").read_text("utf-8")
    Path("own.py").write_text(f"import sys, threading\n{text}", encoding="utf-8")
    with pytest.raises((ComponentError, ConfigError)) as caught:
        run("solver.engine=solve_ivp", **sections)
    assert says(str(caught.value), f"…{said}")


def test_a_law_that_fails_later_is_named_too(run):
    body = "-s.V if np.max(s.t) < 0.5 else 1 / 0"
    with pytest.raises(ComponentError) as caught:
        run("solver.engine=solve_ivp", **changes("Controller", "-s.V", body))
    assert str(caught.value) == f"ZeroDivisionError: division by zero at own.py:12: return {body}"


@pytest.mark.parametrize("base", BODIES)
def test_a_component_that_is_right(experiment, base):
    experiment(**changes(base))


@pytest.mark.parametrize(
    ("stiffness", "said"),
    [
        (-1.0, "stiffness: expected a number greater than 0, got -1"),
        ({"uniform": [3, 1]}, "uniform: expected the smaller number first, got [3, 1]"),
        ({"uniform": [-2, -1]}, "uniform: expected numbers greater than 0, got -2"),
    ],
)
def test_what_a_part_says_of_its_numbers_holds_though_its_check_does_not_look(stiffness, said):
    tethered = Path(__file__).parents[2] / "examples/parts/tethered.yaml"
    changed = {"plant.forces[0].stiffness": stiffness}
    with pytest.raises(ConfigError) as caught:
        eqt_cli.load_experiment(tethered, changed, trust_plugins=True)
    assert said in str(caught.value)
