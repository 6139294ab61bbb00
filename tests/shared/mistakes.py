"""What is said of mistakes in parts of a vehicle, on small configurations of some groups."""

import pytest

from eqt_cli.base.errors import ConfigError

OTHERS = {
    "SO3": {},
    "SE2": {"inertia": "[1, 2, 2]", "reference": "{torque: [0, 0, 0]}"},
    "SE3": {"inertia": "[1.0, 2.0, 2.5, 3.0, 4.0, 5.0]", "reference": "{kind: constant}"},
    "R1": {"inertia": "2.0", "reference": "{kind: constant}", "initial": "{velocity: normal}"},
}
"""What a group takes beside the mistake."""


def said_of(experiment, group, sections):
    """What is said of sections of a configuration, each problem with its place."""
    given = (line.split(": ", 1) for line in sections.replace("\n  ", " ").splitlines())
    with pytest.raises(ConfigError) as caught:
        experiment(**{"group": group} | OTHERS[group] | dict(given))
    return " | ".join(f"{each.path}: {each.message}" for each in caught.value.problems)
