"""Checks the settling thresholds for the parts of a group."""

import math
from collections.abc import Mapping
from typing import Any

from eqt_cli.core.option_types import written_in_degrees
from eqt_cli.core.problems import Problems
from eqt_cli.core.validation import unknown_key
from eqt_cli.groups import MatrixLieGroup


def check_thresholds(
    thresholds: Mapping[str, float],
    written: Mapping[str, Any],
    G: MatrixLieGroup,
    problems: Problems,
) -> None:
    """Note unknown parts, and thresholds that are not valid angles or distances.

    Parameters
    ----------
    thresholds
        Thresholds by part: angles in rad, and distances.
    written
        The same thresholds as written in the configuration.
    """
    parts = {part.name: part for part in G.parts}
    for name, threshold in thresholds.items():
        here = problems.at(name)
        if name not in parts:
            here.add(unknown_key(name, parts))
        elif not parts[name].turns and written_in_degrees(written[name]) is not None:
            here.add(f"expected a number, in {parts[name].pose_unit}, got '{written[name]}'")
        elif parts[name].turns and threshold > math.pi:
            got = f"got {math.degrees(threshold):.6g} deg"
            here.add(f"expected an angle of at most 180 deg, {got}")
