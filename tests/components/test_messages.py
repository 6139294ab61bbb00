"""What is said of parts of a vehicle that will not do: each mistake with its place."""

import pytest
from case_tables import from_yaml
from said import says

from eqt_cli.base.errors import ConfigError

OTHERS = {
    "SO3": {},
    "SE2": {"inertia": "[1, 2, 2]", "reference": "{torque: [0, 0, 0]}"},
    "SE3": {"inertia": "[1.0, 2.0, 2.5, 3.0, 4.0, 5.0]", "reference": "{kind: constant}"},
    "R1": {"inertia": "2.0", "reference": "{kind: constant}", "initial": "{velocity: normal}"},
}
"""What a group takes beside the mistake."""


@from_yaml
def test_what_is_wrong_is_said_once_and_at_its_place(experiment, group, sections, said):
    given = (line.split(": ", 1) for line in sections.replace("\n  ", " ").splitlines())
    with pytest.raises(ConfigError) as caught:
        experiment(**{"group": group} | OTHERS[group] | dict(given))
    problems = " | ".join(f"{each.path}: {each.message}" for each in caught.value.problems)
    assert says(problems, said)
