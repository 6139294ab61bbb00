"""A recorded wrench drives a plant again, and the recorded motion is its reference."""

from dataclasses import replace

import numpy as np
import pytest

import eqt_cli
from eqt_cli.api.loading import source_from
from eqt_cli.controllers.replay import Replay
from eqt_cli.core.errors import ConfigError, EqtError, InputError
from eqt_cli.experiment.build import build
from eqt_cli.groups import group_named
from eqt_cli.logs.mapping import LogMapping
from eqt_cli.logs.recording import read_recording
from eqt_cli.references.log import LogReference
from tests.fitting.conftest import model, true_plant

AGAIN = 1e-8
"""Of poses of a few rad and velocities of a few rad/s: that of the integrator, 1e-9 a step."""


def replayed(engine="solve_ivp", **changes):
    """The configuration of a recording that drives the true plant."""
    file = {"file": "flight.csv"}
    return (
        model(
            "SO3",
            reference={"kind": "log", **file},
            controllers=[{"kind": "replay", **file}],
            plant=true_plant("SO3"),
            time={"duration": 2.0, "samples": 51},
            solver={"engine": engine, "cross_check": 0},
        )
        | changes
    )


@pytest.mark.parametrize(
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.slow("compiles"))]
)
def test_a_true_plant_repeats_the_motion(recorded, engine):
    recorded(noise=0.0)
    data = eqt_cli.open_results(eqt_cli.run(replayed(engine), "again"))
    assert float(data.pose_error.max()) < AGAIN
    assert float(abs(data.velocity - data.desired_velocity).max()) < AGAIN


def rows(*numbers, names="t,qx,qy,qz,qw,tx,ty,tz"):
    lines = (",".join(map(str, row)) for row in numbers)
    return "\n".join([names, *lines]) + "\n"


STEPS = rows((0, 0, 0, 0, 1, 1, 0, 0), (0.5, 0, 0, 0, 1, 3, 0, 0), (1, 0, 0, 0, 1, 2, 0, 0))


@pytest.mark.parametrize(
    ("hold", "expected"), [("zero", [1, 1, 3, 3, 2]), ("linear", [1, 2, 3, 2.5, 2])]
)
def test_the_wrench_between_rows(hold, expected, loop_on_so3):
    law = Replay(file="a.csv", hold=hold).with_files({"a.csv": STEPS})
    times = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
    loop = loop_on_so3(law)
    np.testing.assert_allclose(found := torque(loop, times), expected, rtol=1e-15)
    held = [torque(loop.holding(t), t) for t in times]
    np.testing.assert_array_equal(held, found)
    np.testing.assert_array_equal(loop.instants(1.0), [0.0, 0.5, 1.0])


@pytest.mark.parametrize("start", [-1e6, 0.0, 1e6])
def test_a_step_that_begins_a_rounding_early_takes_the_row_that_begins(start, loop_on_so3):
    """Engines take the time of a row for the one that it is but for rounding."""
    text = rows(*((start + t, 0, 0, 0, 1, wrench, 0, 0) for t, wrench in ((0, 1), (1, 3), (2, 2))))
    law = Replay(file="a.csv").with_files({"a.csv": text})
    early = np.array([np.nextafter(start + 1, -np.inf), start + 1 - 1e-4, start - 1])
    np.testing.assert_array_equal(torque(loop_on_so3(law), early), [3, 1, 1])


def torque(loop, t):
    states = np.zeros((*np.shape(t), loop.state_length))
    return loop.torque(loop.tracking(t, states))[..., 0]


@pytest.fixture
def loop_on_so3():
    base = build(source_from(model("SO3", plant=None), {}))
    return lambda law: replace(next(iter(base.loops.values())), controller=law)


def test_a_recorded_reference_has_the_pose_and_the_velocity_of_each_row():
    random, G = np.random.default_rng(2), group_named("SE3")
    quaternions = random.normal(size=(5, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    numbers = np.c_[np.cumsum(random.uniform(0.1, 0.3, 5)), quaternions, random.normal(size=(5, 9))]
    text = rows(*numbers.tolist(), names="t,qx,qy,qz,qw,x,y,z,wx,wy,wz,vx,vy,vz")
    log = read_recording(text, "a.csv", "csv", G, LogMapping())
    Q, V, _ = LogReference(file="a.csv").with_files({"a.csv": text}).motion(G, log.times)
    np.testing.assert_allclose(Q, log.poses, atol=1e-12)  # rounding of exp and log
    np.testing.assert_allclose(V, log.velocities, atol=1e-9)


def test_theorems_do_not_cover_it(recorded):
    recorded(noise=0.0)
    found = eqt_cli.verify(replayed(plant=None, time={"duration": 0.2, "samples": 5}))
    said = {row.name: row.verdict for row in found.rows if row.controller == "replay"}
    assert {said[name] for name in ("decrease of L", "Q → Q_d", "the law is covered")} == {
        "not covered"
    }
    assert not found.failures


MISTAKES = {
    "no wrench": (
        {"columns": "t qx qy qz qw wx wy wz"},
        {},
        ["controllers[0].file: flight.csv:1: missing column tx, ty, tz; a wrench on SO3 has "
         "tx, ty, tz"],
    ),
    "a gap": (
        {"without": (20, 40)},
        {},
        [
            f"{key}: has a gap of 0.84 s after t = 0.76 s, within the run; end the run there, "
            "`time: {duration: 0.76}`, or begin after it, `mapping: {time: {begin: …, offset: "
            "first}}`"
            for key in ("reference", "controllers[0]")
        ],
    ),
    "too long": (
        {},
        {"time": {"duration": 9}},
        [
            f"time.duration: expected at most 4 s, the end of the {what}, got 9"
            for what in ("reference", "recording of controllers[0]")
        ],
    ),
    "another group": (
        {},
        {"group": "SE3", "inertia": 1.0, "plant": None},
        [
            f"{key}: flight.csv:1: missing column x, y, z; a pose of SE3 has qx, qy, qz, qw, x, y, "
            "z (or yaw, pitch, roll, x, y, z, or the coordinates wx, wy, wz, vx, vy, vz)"
            for key in ("reference.file", "controllers[0].file")
        ],
    ),
}  # fmt: skip


@pytest.mark.parametrize("mistake", MISTAKES)
def test_mistakes(recorded, mistake):
    how, changes, expected = MISTAKES[mistake]
    recorded(**how)
    with pytest.raises(ConfigError) as caught:
        eqt_cli.load_experiment(replayed(**changes))
    found = [f"{problem.path}: {problem.message}" for problem in caught.value.problems]
    assert sorted(found) == sorted(expected)


@pytest.mark.slow("compiles")
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_sampled_wrench_is_the_same_by_both_engines(recorded, hold):
    recorded()
    laws = [{"kind": "replay", "file": "flight.csv", "hold": hold}]
    first, second = (
        eqt_cli.open_results(
            eqt_cli.run(replayed(each, control={"period": 0.05}, controllers=laws), each)
        )
        for each in ("native", "solve_ivp")
    )
    for name in ("pose", "velocity", "torque"):
        np.testing.assert_allclose(first[name].values, second[name].values, rtol=0, atol=AGAIN)


def test_a_recorded_wrench_is_not_exported(recorded):
    recorded()
    with pytest.raises(EqtError) as caught:
        eqt_cli.export(replayed(control={"period": 0.05}), out="exported")
    assert str(caught.value) == (
        "replay: the numbers of replay change at instants of the run, and C code has one set of "
        "them; export another law, or lqr for a reference that does not change its loop"
    )


# The growth of the error.


def test_a_true_plant_predicts_to_the_noise(recorded):
    found = eqt_cli.replay(
        model("SO3", plant=true_plant("SO3")), recorded(), horizon=0.4, windows=50
    )
    assert found.parts == ("rotation", "rotation rate")
    # 10 windows have no common row. So many squares of 3 coordinates are right to √(2/30) = 26 %,
    # and their root to 13 %.
    np.testing.assert_allclose(found.rms.mean(axis=1), found.noise.mean(axis=1), rtol=0.26)


@pytest.mark.slow("computes an experiment several times")
def test_errors_of_a_wrong_plant_grow(recorded):
    found = eqt_cli.replay(model("SO3"), recorded(), horizon=1.0, windows=10, out="figures")
    assert (np.diff(found.median[0, 2:]) > 0).all()  # before, noise is as large
    assert (found.low <= found.median).all() and (found.median <= found.high).all()
    assert found.median[0, -1] > 5 * found.noise[0, -1]
    assert {path.name for path in (recorded().parent / "figures").iterdir()} == {
        "replay.pdf",
        "replay.svg",
        "replay.png",
    }


REFUSED = {
    "flight.csv: its longest stretch without a gap has 4 s; give a horizon of at most that, got "
    "5 s": {"horizon": 5.0},
    "flight.csv: a window of 0.1 s has 4 rows; give a longer horizon, of at least 5 rows": {
        "horizon": 0.1
    },
    "horizon: expected a time greater than 0 s, got 0": {"horizon": 0.0},
    "windows: expected 1 or more, got 0": {"windows": 0},
    "hold: expected one of zero, linear, got 'cubic'": {"hold": "cubic"},
}


@pytest.mark.parametrize("message", REFUSED)
def test_what_is_refused(recorded, message):
    recorded()
    with pytest.raises(InputError if "hold" in message else EqtError) as caught:
        eqt_cli.replay(model("SO3"), "flight.csv", **REFUSED[message])
    assert str(caught.value) == message


UNKNOWN = {
    "plant.forces[0]: is drawn for each run; give a number to replay a recording": {
        "plant": {"forces": [{"kind": "drag", "linear": {"uniform": [0, 1]}}]}
    },
    "actuators[0]: has a state that the recording does not hold; remove the actuator, and record "
    "the wrench that it applies": {"actuators": [{"kind": "lag", "time_constant": 0.1}]},
}


@pytest.mark.parametrize("message", UNKNOWN)
def test_plants_of_which_a_recording_does_not_tell_all(recorded, message):
    recorded()
    with pytest.raises(EqtError) as caught:
        eqt_cli.replay(model("SO3", **UNKNOWN[message]), "flight.csv")
    assert str(caught.value) == message
