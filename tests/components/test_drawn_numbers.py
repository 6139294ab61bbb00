"""The page that says who knows a drawn number names every number that can be drawn."""

import re
from pathlib import Path
from typing import get_type_hints

import pytest

from eqt_cli.base.option_types import option_names
from eqt_cli.components.actuators import actuators
from eqt_cli.components.estimators import estimators
from eqt_cli.components.forces import forces
from eqt_cli.components.sensors import sensors

PAGE = Path(__file__).parents[2] / "docs/howto/vehicle.md"
PARTS = [(kind, part) for kind in (actuators, forces, sensors, estimators) for part in kind.core()]


def drawable(part):
    """The options that take a distribution."""
    hints = get_type_hints(part, include_extras=True)
    return [name for name in option_names(part) if "Uniform" in repr(hints[name])]


@pytest.mark.parametrize("part", [part for _, part in PARTS], ids=lambda part: part.name)
def test_the_page_says_who_knows_each_number_that_can_be_drawn(part):
    section = PAGE.read_text(encoding="utf-8").partition("## Who knows a drawn number")[2]
    rows = [row for row in section.partition("\n## ")[0].splitlines() if row.startswith("|")]
    named = {name for row in rows for name in re.findall(r"`(\w+)`", row) if part.name in row}
    named |= {
        name
        for row in rows
        if row.startswith("| estimators")
        for name in re.findall(r"`(\w+)`", row)
    }
    assert {*drawable(part)} <= named
