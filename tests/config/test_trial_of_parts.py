"""Forces, actuators and sensors of the user's own are tried when the configuration is checked."""

from pathlib import Path

import pytest
from plugin_sources import component
from said import cases

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


@pytest.mark.parametrize(
    ("base", "old", "new", "found"),
    [
        *cases(r"""
Force, return -V, "return -V[..., :2]" →
    own' is wrong at the start of run 0: own.py:10: acting returns an array of shape (5, 2) for 5
        runs; expected (5, 3)
Force, return -V, "return -V\n\n    def instants(self, G, until):\n        return 3.0" →
    own' is wrong at the start of run 0: own.py:13: instants returns no list of times, s, in order
Force, return -V, return -self.drag * V →
    own' fails at the start of run 0: AttributeError: 'Own' object has no attribute 'drag' at
        own.py:11: return -self.drag * V
Actuator, return command, "return command[..., 0]" →
    own' is wrong at the start of run 0: own.py:10: output returns an array of shape (5,) for 5
        runs; expected (5, 3)
Actuator, return command, "return x\n\n    def states(self, G):\n        return 3" →
    own': has 3 states, but neither `moves` nor `sampled` is True; set `moves`, and give their time
        derivative in `state_rate`, or `sampled`, and give the states after an instant in `step`
Actuator, return command, "return x\n\n    moves: ClassVar[bool] = True" →
    own': `moves` is True; give the number of its states in `states` and their time derivative in
        `state_rate`
Sensor, "(instants, 3)", instants →
    own': own.py:10: errors returns an array of shape (3,) for 3 measurements; expected (3, 3)
Sensor, "(instants, 3))", "(3, instants)).T" →
    own': own.py:10: errors: the first values depend on how many are drawn; draw the numbers of each
        measurement in a separate row
"""),
        (
            "Actuator",
            "return command",
            "return x\n\n    sampled: ClassVar[bool] = True\n\n    def states(self, G):\n"
            "        return 3",
            "own': has 3 states; give them after an instant in `step`",
        ),
        (
            "Sensor",
            "3))\n",
            "3))\n\n    loses: ClassVar[bool] = True\n\n    def lost(self, measurements, random):\n"
            "        return random.random(measurements)\n",
            "own': own.py:15: lost returns an array of float64 of shape (3,) for 3 measurements; "
            "expected booleans of shape (3,)",
        ),
    ],
)
def test_a_part_that_does_not_fit(message, base, old, new, found):
    assert said(message, base, DEPARTS + METHODS[base].replace(old, new)) == found


def test_a_limit_for_each_axis(message):
    body = "\n    limits: ClassVar[bool] = True\n\n    def at_limit(self, G, command, x):\n"
    text = DEPARTS + METHODS["Actuator"] + body + "        return command > 1\n"
    assert said(message, "Actuator", text) == (
        "own' is wrong at the start of run 0: own.py:15: at_limit returns an array of shape "
        "(5, 3); expected (5,)"
    )
