"""A recording beside a run: its clock, what the run explains of its error, what is refused."""

import json
from dataclasses import replace

import numpy as np
import pytest
from case_tables import in_ci, refusal
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.components.motions import through
from eqt_cli.components.pose_tables import LogMapping, TimeMapping
from eqt_cli.extend import group_named
from eqt_cli.extensions.flights.measured import Course, aligned, explained, measured_runs
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.recording_check import Recording, recording_of
from eqt_cli.results.result import open_result

pytestmark = pytest.mark.usefixtures("unarranged")

OFFSET = 0.137
MS = 1e-3
TIMES = np.linspace(0.0, 12.0, 601)


def course(G, velocity, times=TIMES):
    """A motion of this body velocity, by the midpoints of its steps."""
    V = np.array([velocity(t) for t in times])
    middle = np.array([velocity(t) for t in (times[1:] + times[:-1]) / 2])
    poses = [G.identity]
    for step in G.exp(np.diff(times)[:, None] * middle):
        poses.append(poses[-1] @ step)
    return through(G, times, np.array(poses), V)


def waving(G):
    """No two parts of it are alike."""
    rates = 0.5 + np.sqrt(np.arange(1.0, G.dimension + 1))
    return course(G, lambda t: 0.6 * np.sin(rates * t) + 0.3 * np.cos(2.6 * rates * t + 1))


def recorded(G, run, times, noise=0.0, rate_noise=None, seed=0):
    """Poses in another frame of the world with noise; rates with noise, or none."""
    numbers = np.random.default_rng(seed)
    Q, V, _ = run.motion(G, times)
    Q = G.exp(numbers.normal(size=G.dimension)) @ Q
    Q = Q @ G.exp(noise * numbers.normal(size=V.shape))
    none = np.full(V.shape, np.nan)
    V = none if rate_noise is None else V + rate_noise * numbers.normal(size=V.shape)
    steps = np.diff(times)
    gaps = np.flatnonzero(steps > 5 * np.median(steps))
    return Recording("log.csv", "log.csv:1", G, times - OFFSET, Q, V, none, gaps)


def with_gaps(times):
    return times[~(((times > 3) & (times < 3.7)) | ((times > 8) & (times < 8.4)))]


SAMPLED = with_gaps(np.arange(0.6, 11.0, 0.0203))


@pytest.mark.parametrize("name", ["SO3", "SE3", "SE2", "R2"])
@pytest.mark.parametrize("rate_noise", [None, 0.002])
def test_the_offset_of_a_clock_in_noise_and_gaps(name, rate_noise):
    G = group_named(name)
    run = waving(G)
    found = aligned(recorded(G, run, SAMPLED, 0.005, rate_noise), TIMES, run)
    assert abs(found.offset - OFFSET) < MS
    assert abs(found.offset - OFFSET) < 4 * found.error < 4 * MS
    assert found.by == ("poses" if rate_noise is None else "body velocities")


def test_its_standard_error_is_that_of_many_recordings():
    G = group_named("SO2")
    run = waving(G)
    found = [aligned(recorded(G, run, SAMPLED[::4], 0.01, None, k), TIMES, run) for k in range(12)]
    errors = np.array([each.offset - OFFSET for each in found])
    told = np.array([each.error for each in found])
    # The mean of 12 squares of normal numbers is beyond 2.4 once in 200 cases.
    assert np.mean((errors / told) ** 2) < 2.4
    assert np.sqrt(np.mean(told**2)) < 4 * np.sqrt(np.mean(errors**2))


def test_without_noise_it_is_exact():
    G = group_named("SO3")
    run = waving(G)
    found = aligned(recorded(G, run, TIMES[30:500]), TIMES, run)
    assert abs(found.offset - OFFSET) < 1e-8


def refused(G, run, recording):
    with pytest.raises(InputError) as caught:
        aligned(recording, TIMES, run)
    before, after = (
        "log.csv: cannot be aligned with the run: ",
        "; give the offset of the clock in the mapping, as `time: {offset: 0.137}`",
    )
    text = str(caught.value)
    assert text.startswith(before)
    assert text.endswith(after)
    return text[len(before) : -len(after)]


def test_a_constant_velocity_tells_no_offset():
    G = group_named("SE3")
    V = np.array([0.1, 0.2, 0.3, 1.0, 0.0, 0.5])
    run = course(G, lambda t: V)
    said = refused(G, run, recorded(G, run, SAMPLED, 0.005, 0.01))
    assert said == "the velocity of the run is constant"


def test_a_periodic_motion_tells_several():
    G = group_named("SO3")
    run = course(G, lambda t: np.array([np.sin(2 * np.pi * t / 3), 0.2, np.cos(2 * np.pi * t / 3)]))
    said = refused(G, run, recorded(G, run, SAMPLED, 0.005))
    assert said == "offsets of -2.86 s and 0.146 s fit about equally well"


def test_another_motion_tells_none():
    G = group_named("SO3")
    other = course(G, lambda t: np.array([np.cos(5.3 * t), np.sin(0.3 * t * t), np.cos(7 * t)]))
    said = refused(G, waving(G), recorded(G, other, SAMPLED))
    assert said == (
        "the motions correlate by 0.22 at most, and 0.5 is needed; check the number of the run, "
        "the units and the axes of the body"
    )


def test_few_rows_tell_none():
    G = group_named("SO3")
    run = waving(G)
    said = refused(G, run, recorded(G, run, SAMPLED[:19]))
    assert said == "expected 20 rows or more, got 19"


# A log that eqt has made itself ----------------------------------------------------------------

NOISE = {"rotation": 0.005, "position": 0.002, "rate": 0.01, "speed": 0.01, "wrench": 0.003}
NED = np.array([[0.0, 1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, -1.0]])
FRD = np.diag([1.0, -1.0, -1.0])
MAPPING = {
    "columns": {"t": "stamp"},
    "quaternion": "wxyz",
    "world": "NED to ENU",
    "body": "FRD to FLU",
}
CONFIG = {
    "gains": {"kp": 1.0, "kd": 1.0},
    "controllers": ["eqt", "gt"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.5}, "velocity": "normal"},
    "ensemble": {"runs": 1, "seed": 1},
    "time": {"duration": 8.0, "samples": 401},
    "solver": {"engine": "solve_ivp", "rtol": 1e-5, "cross_check": 0, "error_estimate": False},
}
MADE = {
    "SO3": {"inertia": [2, 1, 3], "reference": {"torque": ["cos(t)", "sin(2*t)", "0.5"]}},
    "SE3": {
        "inertia": [0.2, 0.3, 0.4, 2, 2, 2],
        "reference": {"torque": ["0.1*cos(t)", "0.1*sin(2*t)", "0", "cos(t)", "sin(t/2)", "0"]},
    },
}


@pytest.fixture(scope="module", params=[in_ci("SE3 has its part, too", "SO3"), "SE3"])
def made(request, made_once):
    """The folder of a result on this group, and its trajectories of EqT."""
    name = request.param

    def make(folder):
        config = CONFIG | MADE[name] | {"name": name, "group": name}
        eqt_cli.run(eqt_cli.load_experiment(config), folder / "result")

    return made_once(f"measured {name}", make) / "result"


def log_of(folder, law="eqt"):
    """A run as an autopilot would have written it, in NED and FRD, with another clock and noise."""
    numbers = np.random.default_rng(4)
    with open_at(folder) as result:
        k, t = result.labels.index(law), result.times
        Q, V, tau = (result.trajectory(name, 0)[k] for name in ("pose", "velocity", "torque"))
    kept = (t > 0.5) & (t < 7.5) & ~((t > 3) & (t < 3.5))
    t, Q, V, tau = t[kept], Q[kept], V[kept], tau[kept]

    def noisy(values, size):
        return values + size * numbers.normal(size=values.shape)

    turned = Q[:, :3, :3] @ Rotation.from_rotvec(noisy(0 * V[:, :3], NOISE["rotation"])).as_matrix()
    quaternions = np.roll(Rotation.from_matrix(NED @ turned @ FRD).as_quat(), 1, axis=1)
    header = "stamp [ms],q0,q1,q2,q3,wx (deg/s),wy (deg/s),wz (deg/s),tx (mN m),ty (mN m),tz (mN m)"
    rows = [
        1000 * (t - OFFSET)[:, None],
        quaternions,
        np.degrees(noisy(V[:, :3], NOISE["rate"]) @ FRD),
        1000 * noisy(tau[:, :3], NOISE["wrench"]) @ FRD,
    ]
    if Q.shape[1] == 4:
        header += ",x,y,z,vx,vy,vz,fx,fy,fz"
        speed = np.einsum("nij,nj->ni", Q[:, :3, :3], V[:, 3:])
        rows += [noisy(Q[:, :3, 3], NOISE["position"]) @ NED, noisy(speed, NOISE["speed"]) @ NED]
        rows += [noisy(tau[:, 3:], NOISE["wrench"]) @ FRD]
    lines = (",".join(map(repr, row)) for row in np.hstack(rows).tolist())
    return header + "\n" + "\n".join(lines) + "\n"


@pytest.fixture
def log(made, folder):
    """A recording of the run in the current folder, and its mapping."""
    (folder / "flight.csv").write_text(log_of(made))
    (folder / "log.yaml").write_text(json.dumps(MAPPING))
    return "flight.csv", "log.yaml"


def test_a_log_of_eqt_itself_is_aligned_and_explained_to_the_noise(made, log):
    found = eqt_cli.compare_measured(made, *log, controllers=["eqt"])[0]
    assert abs(found.offset - OFFSET) < MS
    assert abs(found.offset - OFFSET) < 4 * found.offset_error < 4 * MS
    sizes = {(s.quantity, s.part): s.difference for s in found.shares if not s.axis}
    noise = {
        ("pose", "rotation"): NOISE["rotation"],
        ("pose", "translation"): NOISE["position"],
        ("velocity", "rotation"): NOISE["rate"],
        ("velocity", "translation"): NOISE["speed"],
        ("wrench", "rotation"): NOISE["wrench"],
        ("wrench", "translation"): NOISE["wrench"],
    }
    for key, size in sizes.items():  # of three axes; the noise of the attitude turns the velocity
        more = 0.25 if key == ("velocity", "translation") else 0.1
        assert size == pytest.approx(np.sqrt(3) * noise[key], rel=more), key
    assert len(sizes) in (3, 6)
    assert all(share.explained > 0.99 for share in found.shares)


def test_the_law_that_flew_explains_more(made, log):
    eqt, gt = eqt_cli.compare_measured(made, *log)
    assert (eqt.controller, gt.controller) == ("eqt", "gt")
    assert eqt.offset == gt.offset  # the recording has one clock
    pose = [one.shares[0].explained for one in (eqt, gt)]
    assert pose[0] > 0.99 > pose[1]


def pair_of(folder, text, run=0, controllers=(0,), **mapping):
    with open_result(folder) as result:
        said = LogMapping(**(MAPPING | mapping))
        recording = recording_of(
            read_log(text, "flight.csv", "csv", group_named(result.group_name), said)
        )
        return measured_runs(result, recording, controllers, run)[0]


@pytest.fixture(scope="module")
def pair(made):
    """The run and the recording of it."""
    return pair_of(made, log_of(made))


def test_shares_are_those_of_their_definition(pair):
    G, seen = pair.recording.group, pair.recording
    Qd = pair.reference.at(seen.times).pose
    error = G.log(G.inverse(Qd) @ seen.poses)[:, 1]
    left = G.log(G.inverse(pair.simulated.at(seen.times).pose) @ seen.poses)[:, 1]
    share = next(
        each for each in explained(pair, lambda name, unit: (unit, 1.0)).shares if each.axis == "ωy"
    )
    assert share.measured == pytest.approx(np.sqrt(np.mean(error**2)))
    assert share.difference == pytest.approx(np.sqrt(np.mean(left**2)))
    assert share.explained == pytest.approx(1 - np.sum(left**2) / np.sum(error**2))


def test_a_run_between_its_samples_is_of_third_order():
    G = group_named("SE3")
    a, b = np.random.default_rng(2).normal(size=(2, 6))

    def state(t):
        """Q = exp(a sin t) exp(b t) with its body velocity."""
        last = G.exp(t[:, None] * b)
        V = G.Ad(G.inverse(last), np.cos(t)[:, None] * a) + b
        return Course(G, t, G.exp(np.sin(t)[:, None] * a) @ last, V, 0 * V)

    def error(step):
        times, between = np.arange(0, 2.001, step), np.arange(step / 2, 2, step)
        return np.abs(state(times).at(between).pose - state(between).pose).max()

    assert 7 < error(0.04) / error(0.02) < 9


def test_of_many_rows_some_are_compared(made, monkeypatch):
    monkeypatch.setattr("eqt_cli.extensions.flights.measured.MOST_ROWS", 100)
    one = pair_of(made, log_of(made))
    seen = one.recording
    assert len(seen.times) == 82  # every fourth of 325
    assert one.notes[0].startswith("flight.csv: 82 of 325 rows from 0.52")
    (gap,) = seen.gaps
    assert seen.times[gap] < 3.01 < 3.49 < seen.times[gap + 1]


def test_another_world_is_noted(made):
    """A recording whose world is turned by 90° about z against that of the reference."""
    with open_result(made) as result:
        recording = recording_of(
            read_log(
                log_of(made),
                "flight.csv",
                "csv",
                group_named(result.group_name),
                LogMapping(**MAPPING),
            )
        )
        G = recording.group
        turn = G.exp(np.pi / 2 * np.eye(G.dimension)[2])
        (one,) = measured_runs(result, replace(recording, poses=turn @ recording.poses), [0], 0)
    assert one.notes[1] == (
        "The rotation of the recording differs from the run's by 90 deg throughout; check "
        "`world` and `attitude` of the mapping, or move its poses to the world of the reference"
    )


def said(folder, text, **more):
    return refusal(EqtError, pair_of, folder, text, **more).replace(str(folder), "result")


SHIFTED = {"time": TimeMapping(offset=100.0)}


def test_a_recording_with_nothing_in_common(made):
    assert said(made, log_of(made), **SHIFTED) == (
        "flight.csv: expected two rows or more within the run, from 0 to 8 s, got 0: its times are "
        "from 100.383 to 107.343 s; change time.offset of the mapping, or leave it out"
    )


def test_the_offset_of_the_mapping_is_taken_as_it_is(made):
    one = pair_of(made, log_of(made), time=TimeMapping(offset=0.1))
    assert one.alignment.offset == 0.0  # it is in the times already
    assert one.recording.times[0] == pytest.approx(0.52 - OFFSET + 0.1)
    assert one.notes[0].endswith("; clock offset from the mapping")


def poses_only(text, names):
    """The columns of a recording with these names."""
    lines = [line.split(",") for line in text.splitlines()]
    kept = [k for k, name in enumerate(lines[0]) if name.split()[0] in names]
    return "".join(",".join(line[k] for k in kept) + "\n" for line in lines)


def test_what_was_not_measured(made):
    text = poses_only(log_of(made), ["stamp", "q0", "q1", "q2", "q3", "x", "y", "z"])
    one = pair_of(made, text)
    assert [error.quantity for error in one.errors] == ["pose"]
    names = "tx, ty, tz" + ", fx, fy, fz" * ("SE3" in str(made))
    assert one.notes[-1] == f"No wrench was measured; record it in columns {names}"


def test_a_run_that_there_is_not(made):
    assert said(made, log_of(made), run=3) == (
        "result/results.h5: the trajectory of run 3 is not stored; stored are runs 0 to 0"
    )


def test_a_recording_of_another_group(made):
    text = poses_only(log_of(made), ["stamp", "x", "y", "z", "q0", "q1", "q2"])
    wanted = "qx, qy, qz, qw" + ", x, y, z" * ("SE3" in str(made))
    missing = wanted.removesuffix(", x, y, z")
    assert said(made, text, quaternion=None).startswith(
        f"flight.csv:1: missing column {missing}; a pose of {made.parent.name.split()[1]} has "
        f"{wanted} (or yaw, pitch, roll"
    )
