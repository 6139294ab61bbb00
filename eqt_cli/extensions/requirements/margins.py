"""Margins of the linear loops, computed with a result only where a requirement asks for them."""

from __future__ import annotations

import json
import math
from typing import Any

import eqt_cli
from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.config.study import Study
from eqt_cli.extensions.requirements.reading import MARGINS

STORED = "margins"
"""Attribute of a result with the numbers of each law."""


@purposes.errors_of_a_result
def stored_margins(study: Study) -> dict[str, Any]:
    """Return the margins of each law of an experiment as an attribute, if they are asked for."""
    required = getattr(study.base.config, "require", None) or ()
    if not any(requirement.metric in MARGINS for requirement in required):
        return {}
    if study.sweep is not None:
        return {}
    try:
        laws = eqt_cli.margins(study)
    except EqtError as error:
        return {STORED: json.dumps({"": str(error)})}
    numbers: dict[str, Any] = dict(laws.refused)
    for law in laws.laws:
        gain = law.gains.get("both")
        # None of a margin: no factor that was tried makes the loop unstable.
        upper = None if gain is None else math.inf if gain.upper is None else gain.upper
        lower = None if gain is None else 0.0 if gain.lower is None else gain.lower
        numbers[law.label] = {
            "delay_margin": law.delay,
            "gain_margin": upper,
            "gain_reduction": lower,
            "stable": law.growth.is_stable,
            "indicative": law.is_indicative,
        }
    return {STORED: json.dumps(numbers)}
