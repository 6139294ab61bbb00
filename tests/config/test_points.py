"""A further point of a sweep takes over parts of the last one, and is what it would be alone."""

from pathlib import Path

import pytest
from case_tables import from_yaml
from small_experiment import configuration

from eqt_cli.base.errors import ConfigError
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.study import at_point, spread, study
from eqt_cli.numbers.leaves import leaves


def studied(sweep, **changes):
    Path("c.yaml").write_text(configuration(**changes, sweep=f"[{sweep}]"), encoding="utf-8")
    return study(read_config(Path("c.yaml")))


def numbers(experiment):
    """The bits of all numbers of all loops."""
    loops = experiment.loops.items()
    return {
        (label, *item): x.tobytes() for label, loop in loops for *item, x in leaves(loop).items()
    }


@from_yaml
def test_a_point_is_what_it_is_alone(folder, sweep):
    vehicle = {"actuators": "[{kind: limit, limit: 3}]", "plant": "{inertia: {relative: 0}}"}
    found = studied(sweep, controllers="[eqt, {kind: family, gyroscopic: 1}]", **vehicle)
    found._built.cache_clear()
    for point in (*range(len(found)), *reversed(range(len(found)))):
        swept, alone = found.experiment(point), build(at_point(found.document, found.sweep, point))
        assert (swept.resolved, swept.digest) == (alone.resolved, alone.digest)
        assert numbers(swept) == numbers(alone)


def test_a_wrong_value_is_told_at_every_point_that_has_it(folder):
    with pytest.raises(ConfigError) as caught:
        studied("{grid: {gains.kp: [1, -1], inertia: [[1, 2, 3], [1, 2, -3]]}}")
    assert [problem.path for problem in caught.value.problems] == ["inertia", "gains.kp"]


@pytest.mark.parametrize(("most", "points"), [(1, [0]), (2, [0, 9]), (4, [0, 3, 6, 9])])
def test_points_are_spread_from_the_first_to_the_last(most, points):
    assert spread(10, most) == points
