"""Sweeps whose points fly differently: with other parts, and so with other states."""

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import ConfigError
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.results.result import open_result
from eqt_cli.runs.batches import batches

CONFIG = mapping(
    name="flies",
    time={"duration": 0.5, "samples": 6},
    solver={"cross_check": 0, "error_estimate": False},
)
POINTS = [  # what the first case changes, the others leave as it is
    {"actuators": [{"kind": "limit", "limit": 1.2}]},
    {},
    {
        "control": {"period": 0.1, "delay": 1},
        "plant": {"inertia": {"relative": {"uniform": [-0.1, 0.1]}}},
        "sensors": {"pose": [{"kind": "noise", "std": 0.01}]},
    },
]
NAMES = ("limited", "ideal", "measured")
SWEEP = {"sweep": [{"cases": dict(zip(NAMES, POINTS, strict=True))}]}


@pytest.fixture(scope="module")
def swept(tmp_path_factory):
    folder = tmp_path_factory.mktemp("vehicles")
    return api.run(api.load_experiment(CONFIG | SWEEP), folder / "sweep").path


@pytest.mark.ci("computes each point by itself")
@pytest.mark.parametrize("point", range(len(POINTS)))
def test_a_point_is_the_experiment_by_itself(swept, point, tmp_path):
    alone = api.run(api.load_experiment(CONFIG | POINTS[point]), tmp_path / "alone").path
    with open_at(swept, point=point) as one, open_at(alone) as other:
        for name in ("pose", "torque", "effort", "settling_time"):
            np.testing.assert_array_equal(one[name], other[name])


def test_what_one_point_stores_all_store(swept):
    with open_at(swept) as results:
        shares = results.metric("saturated_share")
        assert set(results.metrics) >= {"settled", "closing_torque"}
    assert (shares[[1, 2]] == 0).all()
    assert (shares[0] > 0).any()


def test_cases_are_called_by_their_names_wherever_points_are(swept):
    with open_at(swept) as results:
        assert results.coordinate("case").tolist() == list(NAMES)
    with open_result(swept) as result:
        assert [result.point_name(point) for point in range(3)] == list(NAMES)
        (key,) = result.swept_keys
        assert [key.at(point) for point in range(3)] == list(NAMES)


def test_the_order_of_points_is_part_of_an_experiment():
    """Parts of the one order would else be taken for those of the other."""
    there, back = (dict(order(SWEEP["sweep"][0]["cases"].items())) for order in (list, reversed))
    one, other = (
        api.load_experiment(CONFIG | {"sweep": [{"cases": cases}]}).digest
        for cases in (there, back)
    )
    assert one != other


def test_a_result_of_cases_runs_again_from_its_own_configuration(swept, tmp_path):
    """The stored configuration has none of what the first case changes."""
    again = api.load_experiment(swept)
    assert again.digest == api.load_experiment(CONFIG | SWEEP).digest
    assert "actuators" not in again.resolved
    assert again.experiment(1).config.actuators is None


def test_a_swept_delay_changes_the_states_of_its_points(tmp_path):
    config = CONFIG | {"control": {"period": 0.1}, "ensemble": {"runs": 1, "seed": 1}}
    config |= {"sweep": [{"grid": {"control.delay": [0, 2]}}]}
    path = api.run(api.load_experiment(config), tmp_path / "delays").path
    with open_at(path, point=1) as late:
        assert (late["torque"][:, :, :2] == 0).all()  # until the first command arrives
        assert (late["torque"][:, :, 2] != 0).any()


# The errors of measurement, which points share.


DRAWN = {
    "control": {"period": 0.1},
    "sensors": {
        "pose": [{"kind": "noise", "std": 0.01}],
        "velocity": [{"kind": "noise", "std": [0.1, 0.2, 0.3]}],
    },
    "sweep": [{"grid": {"gains.kp": [1.0, 2.0]}}],
}


def drawn(changes, entries):
    found = api.load_experiment(CONFIG | DRAWN | changes)
    [batch] = batches(found, "eqt", np.array(entries))
    return batch.problem


def test_points_share_errors_and_each_run_has_its_own():
    seed, runs = 7, CONFIG["ensemble"]["runs"]
    problem = drawn({"ensemble": CONFIG["ensemble"] | {"seed": seed}}, [1, 0, runs + 1])
    errors = problem.drawn()
    for place, run in enumerate((1, 0, 1)):
        random = generator_at(seed, Stream.VEHICLE, run, "sensors.velocity[0]")
        expected = [0.1, 0.2, 0.3] * random.standard_normal((5, 3))
        np.testing.assert_array_equal(errors.velocity[place], expected)
        n = 0.01 * generator_at(seed, Stream.VEHICLE, run, "sensors.pose[0]").standard_normal(
            (5, 3)
        )
        np.testing.assert_array_equal(errors.pose[place], n)
        turn = problem.drawn().measured(problem.loop.group, slice(None), 4).pose[place]
        np.testing.assert_allclose(turn, Rotation.from_rotvec(n[4]).as_matrix(), atol=1e-15)


@pytest.fixture
def drawings(monkeypatch):
    """What is drawn, one entry for each drawing."""
    draw, found = Vehicle.measurement_errors, []

    def counted(*arguments):
        found.append(draw(*arguments))
        return found[-1]

    monkeypatch.setattr("eqt_cli.runs.batches._errors_cache", {})
    monkeypatch.setattr(Vehicle, "measurement_errors", counted)
    return found


def errors(changes, runs):
    return drawn(changes, runs).errors.of(np.arange(len(runs)))


def test_errors_are_drawn_once_for_equal_sensors(drawings):
    first = errors({}, [0, 1])
    errors({"gains": {"kp": 0.5, "kd": 0.5}}, [1, 0])
    assert len(drawings) == 1
    noisier = {"sensors": DRAWN["sensors"] | {"pose": [{"kind": "noise", "std": 0.02}]}}
    np.testing.assert_array_equal(errors(noisier, [0, 1]).pose, 2 * first.pose)
    assert errors({"time": {"duration": 0.3, "samples": 4}}, [0, 1]).pose.shape[1] == 3
    errors({"ensemble": CONFIG["ensemble"] | {"seed": 8}}, [0, 1])
    assert len(drawings) == 4
    errors({}, [0])
    errors({"control": {"period": 0.1, "delay": 2}}, [1, 0])
    assert len(drawings) == 4


def test_errors_are_drawn_of_the_runs_that_are_read(drawings):
    few = drawn({}, [0, 1, 2, 3]).select(np.array([3, 1]))
    found = few.drawn()
    assert [len(each.pose) for each in drawings] == [2]
    alone = drawn({}, [3]).drawn()
    np.testing.assert_array_equal(found.velocity[0], alone.velocity[0])


def test_only_so_many_errors_are_kept(drawings, monkeypatch):
    errors({}, [0])
    size = sum(part.nbytes for part in drawings[0])
    monkeypatch.setattr("eqt_cli.runs.batches.KEPT_BYTES", 2 * size)
    for run in (1, 0, 2, 0):
        errors({}, [run])
    assert len(drawings) == 3
    errors({}, [1])  # which was not used for the longest time
    assert len(drawings) == 4


def test_points_share_what_no_swept_key_changes():
    keys = {"gains.kp": [1.0, 2.0, 2.0], "time.duration": [0.5, 0.5, 1.0]}
    found = api.load_experiment(CONFIG | {"sweep": [{"zip": keys}]})
    first, second, third = (found.experiment(point) for point in range(3))
    one, other, longer = (each.loops["eqt"] for each in (first, second, third))
    assert one.group is other.group is longer.group
    assert one.reference is other.reference is longer.reference
    assert first.solver is second.solver is third.solver
    assert other.gains.K.tolist() == (2 * one.gains.K).tolist() == longer.gains.K.tolist()
    assert (second.times[-1], third.times[-1]) == (0.5, 1.0)


def test_a_wrong_value_at_one_point_is_no_other_ones():
    for values, line in (([1.0, -1.0], "greater than 0"), ([-1.0, 1.0], "greater than 0")):
        with pytest.raises(ConfigError, match=line) as caught:
            api.load_experiment(CONFIG | {"sweep": [{"grid": {"time.duration": values}}]})
        assert len(caught.value.problems) == 1
