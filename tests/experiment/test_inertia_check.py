"""A time-varying inertia is refused where it is singular, and only there."""

from __future__ import annotations

from collections.abc import Callable

import pytest

from eqt_cli.experiment.build import Experiment

Build = Callable[..., Experiment]
TURNING = "['cos(500*t)', '-sin(500*t)', 0], ['sin(500*t)', 'cos(500*t)', 0], [0, 0, 1]"


@pytest.mark.parametrize(
    "inertia",
    [
        "{initial: 1, factor: [['1 - 0.999*sin(5*t)', 0, 0], [0, 1, 0], [0, 0, 1]]}",
        "{initial: 1, factor: [['exp(-9*t)', 0, 0], [0, 'exp(-9*t)', 0], [0, 0, 'exp(-9*t)']]}",
        f"{{initial: [1, 100, 100], factor: [{TURNING}]}}",
    ],
)
def test_nearly_singular_is_not_singular(experiment: Build, inertia: str) -> None:
    assert experiment(inertia=inertia).name == "c"
