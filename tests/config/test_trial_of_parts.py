"""Forces, actuators and sensors of the user's own are tried when the configuration is checked."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from plugin_sources import component

DEPARTS = '    departs: ClassVar[str] = "a part of my own"\n'
PLACES = {
    "Force": ("plant", "{forces: [{kind: constant, force: 0.1}, own]}", "plant.forces[1]"),
    "Actuator": ("actuators", "[own]", "actuators[0]"),
    "Sensor": ("sensors", "{velocity: [{kind: noise, std: 0.1}, own]}", "sensors.velocity[1]"),
}
METHODS = {
    "Force": "    def acting(self, G, t, Q, V):\n        return -V\n",
    "Actuator": "    def output(self, G, command, x):\n        return command\n",
    "Sensor": "    def errors(self, G, instants, period, random):\n"
    "        return random.standard_normal((instants, 3))\n",
}
WRONG = "own' is wrong at the start of run 0: own.py:10: "


def said(message, base, body):
    source = component(f"import numpy as np\nown(eqt_cli.extend.{base}):\n{body}")
    Path("own.py").write_text(source, encoding="utf-8")
    section, value, place = PLACES[base]
    text = message(**{"plugins": "[own.py]", "control": "{period: 0.1}", section: value})
    before, found, after = text.partition(f": {place}: {base.lower()} '")
    assert found, text
    assert before.startswith("c.yaml:")
    return after


@pytest.mark.parametrize("base", PLACES)
@pytest.mark.parametrize(
    ("line", "found"),
    [
        ("    departs: ClassVar[str] = ' '\n", "is ' '"),
        ("    departs: ClassVar[int] = 3\n", "is 3"),
    ],
)
def test_a_part_without_words_for_a_report(message, base, line, found):
    assert said(message, base, line + METHODS[base]) == (
        f"own': `departs` {found}; expected text that says in a few words how the loop departs "
        'from the ideal one, such as departs: ClassVar[str] = "a tether"'
    )


@from_yaml
def test_a_part_that_does_not_fit(message, base, old, new, found):
    assert said(message, base, DEPARTS + METHODS[base].replace(old, new)) == found


def test_a_limit_for_each_axis(message):
    body = "\n    limits: ClassVar[bool] = True\n\n    def at_limit(self, G, command, x):\n"
    text = DEPARTS + METHODS["Actuator"] + body + "        return command > 1\n"
    assert said(message, "Actuator", text) == (
        "own' is wrong at the start of run 0: own.py:15: at_limit returns an array of shape "
        "(5, 3); expected (5,)"
    )
