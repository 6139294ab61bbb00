"""Numbers of a plant that are fitted to recordings, and recorded wrenches that drive it again."""

import json
import math
import re
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import h5py
import numpy as np
import plain_current as plain
import pytest
from case_tables import refusal
from said import mentions, says
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.api.loading import document_from
from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.components.pose_tables import LogMapping
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.config.preflight import build
from eqt_cli.extend import group_named
from eqt_cli.extensions.flights.prediction import Linear, Replay, by_rotors, covariance
from eqt_cli.extensions.logs.recording import read_log
from eqt_cli.extensions.logs.recording_check import LogReference, recording_of
from eqt_cli.extensions.thrusters.propellers import Propellers
from eqt_cli.extensions.thrusters.thrusters import Thrusters
from tests.extensions.flights.conftest import DRAG, NAMES, NOISE, RELATIVE, model, true_plant

INERTIA, ABOUT, ALONG = (
    "plant.inertia.relative",
    "plant.forces[0].linear[0:3]",
    "plant.forces[0].linear[3:6]",
)
TRUE = {INERTIA: RELATIVE, ABOUT: DRAG["SE3"][0], ALONG: DRAG["SE3"][3]}


def test_the_true_numbers_are_found(recorded):
    """Without noise, as exactly as derivatives by differences allow."""
    recorded(noise=0.0)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT], horizon=0.6)
    assert [n.value for n in found.numbers] == pytest.approx([RELATIVE, 0.05], rel=1e-5)
    assert found.config.as_posix() == "results/model-fitted/fitted.yaml"
    written = eqt_cli.load_experiment(found.config).base.resolved
    assert written["plant"]["inertia"]["relative"] == found.numbers[0].value
    assert written["plant"]["forces"][0]["linear"] == [found.numbers[1].value] * 3


@pytest.mark.ci("fits twice")
def test_flights_of_a_list_are_fitted_together(recorded):
    """No window reaches from one to the next, so that the numbers are as exact as of one."""
    recorded(noise=0.0)
    recorded(noise=0.0, named="other.csv", without=(60, 70))
    Path("flights.csv").write_text("file,begin\nflight.csv,\nother.csv,+0.5\n")
    found = eqt_cli.fit(model("SO3"), "flights.csv", [INERTIA, ABOUT], horizon=0.6)
    assert [n.value for n in found.numbers] == pytest.approx([RELATIVE, 0.05], rel=1e-5)
    words = "2 flights, one after the other: flight.csv and other.csv"
    assert any(words in note for note in found.notes)
    moved = "times were moved, also for forces that depend on t: other.csv by +3.88 s"
    assert any(moved in note for note in found.notes)
    Path("flights.csv").write_text("file,begin\nflight.csv,\nother.csv,99\n")
    said = refusal(EqtError, eqt_cli.fit, model("SO3"), "flights.csv", [INERTIA])
    assert says(said, "flights.csv:3: begin: no rows are left; the recording is from 0 to 4 s")


@pytest.mark.ci("integrates 60 pieces here, and compiles")
def test_added_mass_and_a_current_are_found(tmp_path, monkeypatch):
    """From a motion by Fossen's equations, under a wrench that is held from row to row."""
    monkeypatch.chdir(tmp_path)
    body, added = [0.16, 0.18, 0.2, 11.5, 11.5, 11.5], [0.12, 0.1, 0.14, 5.5, 12.7, 14.57]
    drag, current, period = [0.07, 0.07, 0.07, 4.03, 6.22, 5.18], [0.4, 0.3, -0.1], 0.04
    flow = (lambda t: np.array(current)), (lambda t: np.zeros(3))
    vehicle = plain.Vehicle(body, added, drag, np.zeros((6, 6)), *flow)
    R, p, V, rows = np.eye(3), np.zeros(3), np.zeros(6), []
    for k in range(76):
        wrench = np.array([0.05, 0.06, 0.05, 6, 6, 5]) * np.sin(0.1 * k + np.arange(6))
        turned = Rotation.from_matrix(R).as_quat()
        rows.append([k * period, *turned, *V[:3], *wrench[:3], *p, *V[3:], *wrench[3:]])
        vehicle.control = lambda R, p, V, wrench=wrench: wrench
        R, p, V = (each[-1] for each in vehicle.run(R, p, V, np.array([0.0, period])))
    header = ",".join((NAMES["SO3"] + NAMES["SE3"]).split())
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    forces = [{"kind": "drag", "linear": drag, "current": [0.1, 0.1, -0.1]}]
    inertia = {"rigid": body, "added": [*added[:3], 8.0, 8.0, 14.57]}
    plant = {"inertia": inertia, "forces": forces}
    config = model("SE3", inertia={"rigid": body, "added": added}, plant=plant)
    keys = [f"plant.inertia.added[{k}]" for k in (3, 4)]
    keys += [f"plant.forces[0].current[{k}]" for k in (0, 1)]
    found = eqt_cli.fit(config, "flight.csv", keys, {"velocity": "body"}, horizon=0.4)
    assert [n.value for n in found.numbers] == pytest.approx([5.5, 12.7, 0.4, 0.3], rel=1e-7)


def test_noise_is_all_that_is_left(recorded):
    found = eqt_cli.fit(model("SO3"), recorded(), [INERTIA, ABOUT], horizon=0.6)
    assert all(n.low < TRUE[n.key] < n.high for n in found.numbers)
    rotation, rate = found.residuals
    for one, size in ((rotation, NOISE["rotation"]), (rate, NOISE["rate"])):
        # The deviation of 3·101 numbers is right to 1/√(2·3·101) = 4 %.
        assert [one.after, one.noise] == pytest.approx([size, size], rel=0.15)
    assert rate.before > 2 * rate.after


@pytest.mark.ci("fits ten recordings")
def test_intervals_hold_the_truth(recorded):
    """95 % intervals of ten recordings: fewer than 7 of them hold a number once in 970 times."""
    keys = [INERTIA, ABOUT, ALONG]
    held, values, widths = np.zeros(len(keys)), [], []
    for seed in range(10):
        recorded("SE3", duration=8.0, period=0.04, seed=seed)
        # The velocity of a run is that of the body.
        found = eqt_cli.fit(model("SE3"), "flight.csv", keys, {"velocity": "body"}, horizon=0.4)
        held += [n.low <= TRUE[n.key] <= n.high for n in found.numbers]
        values.append([n.value for n in found.numbers])
        widths.append([n.high - n.low for n in found.numbers])
    assert (held >= 7).all()
    # No bias beyond four standard errors, and intervals as wide as the spread asks for.
    spread = np.std(values, axis=0, ddof=1)
    truth = np.array([TRUE[key] for key in keys])
    assert (abs(np.mean(values, axis=0) - truth) < 4 * spread / np.sqrt(10)).all()
    np.testing.assert_allclose(np.mean(widths, axis=0) / (2 * 1.96), spread, rtol=0.5)


def test_first_velocities_that_were_not_recorded_are_found(recorded):
    recorded(columns="t qx qy qz qw tx ty tz", noise=0.1)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA], horizon=0.6, out="found")
    (inertia,) = found.numbers
    assert inertia.low < RELATIVE < inertia.high
    assert [each.part for each in found.residuals] == ["rotation"]


def test_the_covariance_is_that_of_least_squares():
    """Of white errors of size 2, it is 4 (JᵀJ)⁻¹; 2,000 windows give it to 1/√1000, five sigma."""
    random = np.random.default_rng(1)
    J = random.normal(size=(2000, 8, 2)) @ np.array([[1.0, 0.8], [0.0, 30.0]])
    state = np.zeros(0)
    fits = [Linear(2 * random.normal(size=8), one, state) for one in J]
    expected = 4 * np.linalg.inv(np.einsum("wki,wkj->ij", J, J))
    sizes = np.sqrt(np.diag(expected))
    difference = (covariance(fits) - expected) / np.outer(sizes, sizes)
    assert abs(difference).max() < 5 / np.sqrt(1000)


MISTAKES = {
    "gains.kp: expected a number of the plant, such as plant.inertia.relative or "
    "plant.forces[0].linear, or delay": ["gains.kp"],
    "plant.mass: is not in the configuration; add it with a value to start at": ["plant.mass"],
    "plant.forces[0].linear: expected a key that holds a number, got [0.0, 0.0, 0.0]; give an "
    "entry, such as plant.forces[0].linear[0]": ["plant.forces[0].linear"],
    "plant.forces[0].kind: expected a key that holds a number, got 'drag'": [
        "plant.forces[0].kind"
    ],
    "expected different keys, got none": [],
    f"expected different keys, got {INERTIA}, {INERTIA}": [INERTIA, INERTIA],
    "inertia[0]: has no influence on the prediction of flight.csv; leave it out, give a recording "
    "in which it acts, or start at a value of its magnitude": [ABOUT, "inertia[0]"],
}


@pytest.mark.parametrize("message", MISTAKES)
def test_keys_that_cannot_be_fitted(recorded, message):
    recorded()
    config = model("SO3")
    if "inertia[0]" in MISTAKES[message]:
        config["plant"]["inertia"] = 0.3  # in the place of the one that a law believes in
    keys = MISTAKES[message]
    assert refusal(EqtError, eqt_cli.fit, config, "flight.csv", keys, horizon=0.6) == message


def test_few_windows_give_no_interval(recorded):
    recorded()
    assert says(
        refusal(EqtError, eqt_cli.fit, model("SO3"), "flight.csv", [INERTIA], horizon=1.0),
        "flight.csv: has 3 windows of 1 s that share no row…",
    )


@pytest.mark.parametrize(
    ("is_link", "said"),
    [
        (False, "exists, but eqt did not write it; choose another place with out=…"),
        (True, "is a symbolic link; expected a file that eqt wrote, or no such entry; rename or "
         "remove it"),
    ],
)  # fmt: skip
def test_a_file_of_another_is_not_replaced(recorded, tmp_path, is_link, said):
    recorded()
    (tmp_path / "mine").mkdir()
    theirs = tmp_path / "theirs.yaml" if is_link else tmp_path / "mine" / "fitted.yaml"
    theirs.write_text("mine\n")
    if is_link:
        (tmp_path / "mine" / "fitted.yaml").symlink_to(theirs)
    config, keys = model("SO3"), [INERTIA]
    found = refusal(EqtError, eqt_cli.fit, config, "flight.csv", keys, horizon=0.6, out="mine")
    assert found == f"mine/fitted.yaml: {said}"
    assert theirs.read_text() == "mine\n"


@pytest.mark.ci("fits a plant again")
def test_keys_of_the_command_have_no_values(refused):
    said = refused("fit", "c.yaml", "--measured", "m.csv", "--over", "gains=[1,2]")
    assert said == "--over: expected keys without values, such as 'gains', got 'gains=[1,2]'\n"


def test_the_command_prints_what_the_function_finds(recorded, invoke, tmp_path):
    recorded()
    (tmp_path / "model.yaml").write_text(json.dumps(model("SO3")))
    words = f"fit model.yaml --measured flight.csv --over {INERTIA},{ABOUT} --horizon 0.6"
    printed, found = (
        invoke(*words.split(), "--json"),
        eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT], horizon=0.6),
    )
    document = json.loads(printed.stdout)
    assert document["numbers"] == [vars(each) for each in found.numbers]
    assert document["singular_values"] == found.singular_values
    assert document["config"] == "results/model-fitted/fitted.yaml"


SCALED = {"actuators": [{"kind": "scale", "factor": 1.0}]}


def normalised(scale, name="flight.csv"):
    """Write the wrench of a recording as shares of the largest, as autopilots do."""
    rows = np.genfromtxt(name, delimiter=",", names=True)
    wrench = [each for each in rows.dtype.names if each in ("tx", "ty", "tz", "fx", "fy", "fz")]
    for each in wrench:
        rows[each] /= scale
    head = ",".join(n + " (normalised)" * (n in wrench) for n in rows.dtype.names)
    np.savetxt(name, rows, delimiter=",", header=head, comments="", fmt="%.17g")


def test_the_unit_of_a_normalised_torque_is_found(recorded):
    """J ω̇ + ω × Jω = s τ: a known inertia gives s, a known s the inertia, and nothing both."""
    true = true_plant("SO3")
    recorded(noise=0.0)
    normalised(0.8)
    config = model("SO3", plant=true, **SCALED)
    found = eqt_cli.fit(config, "flight.csv", ["actuators[0].factor"], horizon=0.6)
    assert found.numbers[0].value == pytest.approx(0.8, rel=1e-5)
    assert any("tx, ty, tz: normalised; the actuator `scale` gives" in x for x in found.notes)
    config["actuators"] = [{"kind": "scale", "factor": 0.8}]
    config["plant"] = {"inertia": {"relative": 0.0}, "forces": true["forces"]}
    found = eqt_cli.fit(config, "flight.csv", [INERTIA], horizon=0.6, out="known")
    assert found.numbers[0].value == pytest.approx(RELATIVE, rel=1e-4)
    config["plant"]["forces"] = []
    said = refusal(
        EqtError, eqt_cli.fit, config, "flight.csv", ["actuators[0].factor", INERTIA], horizon=0.6
    )
    assert said.startswith(
        f"actuators[0].factor and {INERTIA}: flight.csv cannot distinguish them, because a change "
        "of one acts like a change of the others (smallest singular value "
    )
    assert said.endswith("); leave one out")


@pytest.mark.ci("fits forty recordings")
@pytest.mark.parametrize(("duration", "horizon"), [(4.0, 0.4), (8.0, 0.8)])
def test_intervals_of_a_normalised_torque_hold_the_truth(recorded, duration, horizon):
    """Of 20 intervals of 95 %, fewer than 17 hold the truth once in 60 times."""
    config, held = model("SO3", plant=true_plant("SO3"), **SCALED), 0
    for seed in range(20):
        recorded(duration=duration, seed=seed)
        normalised(0.8)
        (s,) = eqt_cli.fit(config, "flight.csv", ["actuators[0].factor"], horizon=horizon).numbers
        held += s.low <= 0.8 <= s.high
    assert held >= 17


ROTORS = {
    "kind": "thrusters",
    "thrust_constant": 2.0e-5,
    "moment_constant": 4.0e-7,
    "low_speed": 0,
    "high_speed": 1500,
    "thrusters": [
        {"at": [x, y, 0], "along": [0, 0, 1], "turns": 100 * x * y}
        for x in (0.1, -0.1)
        for y in (0.1, -0.1)
    ],
}


def test_speeds_of_rotors_are_a_wrench(tmp_path, monkeypatch):
    """A body of 1.5 kg under speeds that change each 0.02 s, by a plain program."""
    monkeypatch.chdir(tmp_path)
    J, mass, h, rows = np.array([0.02, 0.025, 0.03]), 1.5, 0.02, []
    R, p, w, v = np.eye(3), np.zeros(3), np.zeros(3), np.zeros(3)
    for k in range(101):
        n = 430 + 6 * np.sin(0.3 * k * np.array([1, 1.3, 0.7, 1.6]) + np.arange(4))
        rows.append([k * h, *Rotation.from_matrix(R).as_quat(), *p, *w, *v, *(n * 30 / np.pi)])
        f = 2e-5 * n**2
        turn = [0.1 * (f[0] - f[1] + f[2] - f[3]), -0.1 * (f[0] + f[1] - f[2] - f[3])]
        torque = np.array([*turn, 0.02 * (f[0] - f[1] - f[2] + f[3])])

        def rate(t, x, torque=torque, f=f):
            R, w = x[:9].reshape(3, 3), x[12:15]
            a = R[:, 2] * f.sum() / mass - [0, 0, 9.81]
            hat = np.cross(np.eye(3), w)
            return np.r_[(R @ hat).ravel(), x[15:], (torque - np.cross(w, J * w)) / J, a]

        x = np.r_[R.ravel(), p, w, v]
        x = solve_ivp(rate, (0, h), x, method="DOP853", rtol=1e-11, atol=1e-12).y[:, -1]
        R, p, w, v = x[:9].reshape(3, 3), x[9:12], x[12:15], x[15:]
    header = "t,qx,qy,qz,qw,x,y,z,wx,wy,wz,vx,vy,vz," + ",".join(f"n{k} (rpm)" for k in "1234")
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    weight = {"kind": "restoring", "weight": 1.5 * 9.81}
    parts = {"plant": {"inertia": {"relative": 0.0}, "forces": [weight]}}
    config = model("SE3", inertia=[*(J / 1.1), *[mass / 1.1] * 3], actuators=[ROTORS], **parts)
    found = eqt_cli.fit(config, "flight.csv", [INERTIA], horizon=0.2)
    assert found.numbers[0].value == pytest.approx(0.1, rel=1e-5)
    said = refusal(EqtError, eqt_cli.fit, config | {"actuators": []}, "flight.csv", [INERTIA])
    assert said == (
        "flight.csv:1: 4 speeds of rotors need an actuator `kind: thrusters` with "
        "`thrust_constant` and 4 thrusters"
    )
    lagging = config | {"actuators": [ROTORS | {"time_constant": 0.02}]}
    lag = "actuators[0].time_constant"
    said = refusal(EqtError, eqt_cli.fit, lagging, "flight.csv", [INERTIA, lag], horizon=0.2)
    assert mentions(said, f"{lag}: has no influence…rotor speeds were measured behind this…")
    # Thrust without a unit: gravity gives the thrust of a command, for a known mass.
    config = model(
        "SE3", inertia=[*J, *[mass] * 3], actuators=[ROTORS, {"kind": "scale", "factor": 0.7}]
    )
    config["plant"] = {"forces": [weight]}
    (s,) = eqt_cli.fit(config, "flight.csv", ["actuators[1].factor"], horizon=0.2).numbers
    assert s.value == pytest.approx(1.0, rel=1e-5)


def test_recorded_speeds_are_commands_of_rotors(tmp_path, monkeypatch):
    """Each thrust is k n² of its own rotor, within the limits, and not B⁺ of their wrench."""
    monkeypatch.chdir(tmp_path)
    times = np.arange(0.0, 0.5, 0.1)
    n = 400 + 30 * np.sin(3 * times[:, None] + np.arange(4))
    n[2, 0] = 900.0
    still = np.tile([0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0], (len(times), 1))
    header = "t,qx,qy,qz,qw,x,y,z,n1,n2,n3,n4"
    rows = np.column_stack([times, still, n])
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    config = model("SE3", inertia=[0.02, 0.02, 0.03, 1.5, 1.5, 1.5], actuators=[dict(ROTORS)])
    config["controllers"] = [{"kind": "replay", "file": "flight.csv"}]
    config |= {"time": {"duration": 0.4, "samples": 5}, "reference": {"kind": "constant"}}
    config |= {"ensemble": {"runs": 1}, "initial": {"pose": "identity"}}
    result = eqt_cli.run(config, "flown")
    with h5py.File(result.path / "results.h5") as file:
        flown = file["thrust"][0, 0]
    high = ROTORS["thrust_constant"] * ROTORS["high_speed"] ** 2
    np.testing.assert_allclose(flown, np.clip(2e-5 * n**2, 0.0, high), rtol=1e-12)


@pytest.mark.ci("runs a quadrotor")
@pytest.mark.filterwarnings("ignore::eqt_cli.base.errors.EqtWarning")
def test_rotor_speeds_of_a_log_are_its_wrench_beside_a_run(tmp_path, monkeypatch):
    """The log has the speeds that the thrusts of the run itself need, k n²."""
    monkeypatch.chdir(tmp_path)
    config = model("SE3", actuators=[ROTORS], plant={}, ensemble={"runs": 1})
    config |= {"initial": {"pose": {"kind": "exp_normal", "std": 0.1}}}
    made = eqt_cli.run(config | {"time": {"duration": 1, "samples": 21}}, "made")
    Q, thrust = (made.read(name, controller="eqt", run=0) for name in ("pose", "thrust"))
    rows = [made.times, Rotation.from_matrix(Q[:, :3, :3]).as_quat(), Q[:, :3, 3]]
    rows = np.column_stack([*rows, np.sqrt(thrust / 2e-5)])
    header = "t,qx,qy,qz,qw,x,y,z,n1,n2,n3,n4"
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="", fmt="%.17g")
    [found] = eqt_cli.compare_measured("made", "flight.csv", {"time": {"offset": 0}})
    wrench = [share for share in found.shares if share.quantity == "wrench" and not share.axis]
    assert [share.explained for share in wrench] == pytest.approx([1, 1], abs=1e-12)
    assert any(mentions(note, "rotor speeds give the wrench") for note in found.notes)


@dataclass
class Rows:
    """What `by_rotors` reads of a recording."""

    speeds: np.ndarray
    wrenches: np.ndarray
    group: object
    place: str = "flight.csv:1"
    rotors: tuple = ()
    times: tuple = (0.5,)


def test_speeds_of_propellers_are_thrusts_by_their_curve():
    """Ahead, astern and within the dead band: 2e-3 (n² − 10²), −0.5 · 2e-3 (n² − 10²) and 0."""
    of = {"thrust_constant": 2e-3, "time_constant": 0.1, "low_speed": -60.0, "high_speed": 60.0}
    part = Propellers(matrix=np.eye(3).tolist(), astern=0.5, dead_speed=10.0, **of)
    rows = Rows(np.array([[30.0, -30.0, 5.0]]), np.full((1, 3), np.nan), group_named("SO3"))
    assert by_rotors(Vehicle(actuators=(part,)), rows).wrenches[0] == pytest.approx(
        [1.6, -0.8, 0.0]
    )


@pytest.mark.parametrize(
    ("speeds", "names", "said"),
    [
        ([1, 2, 3, 4], "n1 n2 n3 n5", "…expected the speeds n1 to n4 of 4 rotors, got n5…"),
        ([1, -2, 3, 4], "n1 n2 n3 n4", "…n2 is -2 rad/s at t = 0.5 s; expected…at least 0…"),
    ],
)
def test_what_are_no_speeds_of_rotors_is_refused(speeds, names, said):
    rows = Rows(np.array([speeds]) * 1.0, np.full((1, 3), np.nan), group_named("SO3"))
    rows.rotors = tuple(names.split())
    part = Thrusters(matrix=np.ones((3, 4)).tolist(), thrust_constant=1e-5)
    assert mentions(refusal(EqtError, by_rotors, Vehicle(actuators=(part,)), rows), said)


@pytest.mark.ci("compiles a plant and fits three numbers")
def test_the_delay_of_a_wrench_is_found(recorded):
    recorded(late=1, noise=0.0)
    found = eqt_cli.fit(model("SO3"), "flight.csv", ["delay", ABOUT, INERTIA], horizon=0.6)
    assert [n.key for n in found.numbers] == [ABOUT, INERTIA, "delay"]
    assert [n.value for n in found.numbers] == pytest.approx([0.05, RELATIVE, 0.04], rel=1e-5)


def is_said_late(note):
    number = r"0\.0[234]\d*"
    return re.fullmatch(
        rf"The errors are smaller with the wrench of {number} s later \(95 % interval \[{number}, "
        rf"{number}\]\): it was recorded with another delay than the motion, or acts with one\. "
        r"Fit it: --over …,delay\.",
        note,
    )


def test_a_wrench_that_was_recorded_a_row_late_is_told(recorded):
    recorded(late=1)
    perfect, words = model("SO3", plant=true_plant("SO3")), {"horizon": 0.5, "windows": 20}
    assert is_said_late(eqt_cli.replay(perfect, "flight.csv", **words).notes[-1])
    assert not eqt_cli.replay(perfect, "flight.csv", **words, delay=0.04).notes


@pytest.mark.ci("fits a longer recording")
def test_a_delay_that_is_not_fitted_is_told_apart_from_drag(recorded):
    recorded(duration=8.0, late=1, noise=0.5)
    found = eqt_cli.fit(model("SO3"), "flight.csv", [INERTIA, ABOUT])
    assert found.numbers[1].low > TRUE[ABOUT]
    assert any(map(is_said_late, found.notes))


def test_slow_noise_is_told_from_white_noise(recorded):
    perfect = model("SO3", plant=true_plant("SO3"))
    recorded(slow=0.95)
    [said] = eqt_cli.replay(perfect, "flight.csv", horizon=0.5, windows=10).notes
    assert re.fullmatch(
        r"The errors are correlated from row to row: rotation \(0\.\d\d\), rotation rate "
        r"\(0\.\d\d\)\. Such errors come from the model, from slow errors of the sensors or from a "
        "wrench at another time; `noise` counts only errors that are independent from row to row.",
        said,
    )
    recorded()
    assert not eqt_cli.replay(perfect, "flight.csv", horizon=0.5, windows=10).notes


def test_what_takes_no_part_is_said(recorded):
    recorded()
    config = model("SO3", plant=true_plant("SO3"), control={"period": 0.01})
    found = eqt_cli.replay(config, "flight.csv", horizon=0.5, windows=1)
    assert found.notes == (
        "control of the configuration are left out: the recorded wrench acts when it was recorded.",
    )


# A recorded wrench drives a plant again, and the recorded motion is its reference -----------------


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
    "engine", ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles"))]
)
def test_a_true_plant_repeats_the_motion(recorded, engine):
    recorded(noise=0.0)
    data = eqt_cli.run(replayed(engine), "again").to_xarray()
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
    base = build(document_from(model("SO3", plant=None), {}))
    return lambda law: replace(next(iter(base.loops.values())), controller=law)


def test_a_recorded_reference_has_the_pose_and_the_velocity_of_each_row():
    random, G = np.random.default_rng(2), group_named("SE3")
    quaternions = random.normal(size=(5, 4))
    quaternions /= np.linalg.norm(quaternions, axis=1)[:, None]
    numbers = np.c_[np.cumsum(random.uniform(0.1, 0.3, 5)), quaternions, random.normal(size=(5, 9))]
    text = rows(*numbers.tolist(), names="t,qx,qy,qz,qw,x,y,z,wx,wy,wz,vx,vy,vz")
    log = recording_of(read_log(text, "a.csv", "csv", G, LogMapping()))
    Q, V, _ = LogReference(file="a.csv").with_files({"a.csv": text}).motion(G, log.times)
    np.testing.assert_allclose(Q, log.poses, atol=1e-12)  # rounding of exp and log
    np.testing.assert_allclose(V, log.velocities, atol=1e-9)


def test_theorems_do_not_cover_it(recorded):
    recorded(noise=0.0)
    found = eqt_cli.verify(replayed(plant=None, time={"duration": 0.2, "samples": 5}))
    said = {row.name: row.verdict for row in found.rows if row.controller == "replay"}
    assert {said[name] for name in ("decrease of L", "Q → Q_d", "theorem for the law")} == {
        "not covered"
    }
    assert not found.failures


UNLIKE = {
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


@pytest.mark.parametrize("mistake", UNLIKE)
def test_mistakes(recorded, mistake):
    how, changes, expected = UNLIKE[mistake]
    recorded(**how)
    with pytest.raises(ConfigError) as caught:
        eqt_cli.load_experiment(replayed(**changes))
    found = [f"{problem.path}: {problem.message}" for problem in caught.value.problems]
    assert sorted(found) == sorted(expected)


@pytest.mark.ci("compiles")
@pytest.mark.parametrize("hold", ["zero", "linear"])
def test_a_sampled_wrench_is_the_same_by_both_engines(recorded, hold):
    recorded()
    laws = [{"kind": "replay", "file": "flight.csv", "hold": hold}]
    first, second = (
        eqt_cli.run(replayed(each, control={"period": 0.05}, controllers=laws), each).to_xarray()
        for each in ("native", "solve_ivp")
    )
    for name in ("pose", "velocity", "torque"):
        np.testing.assert_allclose(first[name].values, second[name].values, rtol=0, atol=AGAIN)


def test_a_recorded_wrench_is_not_exported(recorded):
    recorded()
    config = replayed(control={"period": 0.05})
    assert says(
        refusal(EqtError, eqt_cli.export, config, out="exported"),
        "replay: the numbers of replay change during the…",
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


@pytest.mark.ci("computes an experiment several times")
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


REFUSED_REPLAYS = {
    "flight.csv: its longest stretch without a gap has 4 s; give a horizon of at most that, got "
    "5 s": {"horizon": 5.0},
    "flight.csv: a window of 0.1 s has 4 rows; give a longer horizon, of at least 5 rows": {
        "horizon": 0.1
    },
    "horizon: expected a time greater than 0 s, got 0": {"horizon": 0.0},
    "delay: expected less than the 4 s of flight.csv, got 1e+17 s": {"delay": 1e17},
    "delay: expected less than the 4 s of flight.csv, got nan s": {"delay": math.nan},
    "windows: expected 1 or more, got 0": {"windows": 0},
    "hold: expected one of zero, linear, got 'cubic'": {"hold": "cubic"},
}


@pytest.mark.parametrize("message", REFUSED_REPLAYS)
def test_what_is_refused(recorded, message):
    recorded()
    options = REFUSED_REPLAYS[message]
    assert refusal(EqtError, eqt_cli.replay, model("SO3"), "flight.csv", **options) == message


@pytest.mark.parametrize(
    ("columns", "hold", "x", "gap_at"),
    [
        ("t,angle,wz,tz", "zero", 0.0, None),
        ("t,wz,tz", "zero", 0.0, None),
        ("t,wz,tz", "linear", 0.0, None),
        ("t,angle,wz,tz", "zero", 1.5, None),  # not in equilibrium with the first command
        ("t,wz,tz", "linear", -3.0, None),
        ("t,angle,wz,tz", "zero", 0.0, 60),  # other commands were given in the gap
    ],
)
def test_a_lag_starts_from_the_commands_before_a_window(
    tmp_path, monkeypatch, columns, hold, x, gap_at
):
    """J ω̇ = 0.8 x, T ẋ = u − x, with commands that are held or ramps, in closed form."""
    monkeypatch.chdir(tmp_path)
    J, s, T, h = 2.0, 0.8, 0.06, 0.02
    w, angle, rows = 0.0, 0.0, []
    commands = np.r_[0.0, np.random.default_rng(0).normal(size=160)].tolist()
    for k, (u, then) in enumerate(pairwise(commands)):
        rows.append([h * k, angle, w, u] if "angle" in columns else [h * k, w, u])
        ramp, decay = (then - u) / h * (hold == "linear"), np.exp(-h / T)
        gap = x - u + ramp * T
        once = u * h + ramp * (h**2 / 2 - T * h) + gap * T * (1 - decay)
        twice = u * h**2 / 2 + ramp * (h**3 / 6 - T * h**2 / 2) + gap * T * (h - T * (1 - decay))
        angle, w = angle + h * w + s / J * twice, w + s / J * once
        x = u + ramp * (h - T) + gap * decay

    if gap_at:
        del rows[gap_at : gap_at + 10]
    np.savetxt("a.csv", rows, delimiter=",", header=columns, comments="", fmt="%.12g")
    actuators = [{"kind": "lag", "time_constant": 0.04}, {"kind": "scale", "factor": 1.0}]
    config = model("SO3", inertia=J, plant={}, actuators=actuators) | {"group": "SO2"}
    over = ["actuators[0].time_constant", "actuators[1].factor"]
    found = eqt_cli.fit(
        config, "a.csv", over, {"units": {"tz": "normalised"}}, horizon=0.4, hold=hold
    )
    assert [n.value for n in found.numbers] == pytest.approx([T, s], rel=1e-4)
    parts = ["rotation", "rotation rate"] if "angle" in columns else ["rotation rate"]
    assert [one.part for one in found.residuals] == parts


UNKNOWN = {
    "plant.forces[0]: is drawn for each run; give a number to replay a recording": {
        "plant": {"forces": [{"kind": "drag", "linear": {"uniform": [0, 1]}}]}
    },
    "actuators[0]: has a state that the recording does not hold; remove the actuator, and record "
    "the wrench that it applies": {
        "actuators": [{"kind": "rate_limit", "rate": 0.1}],
        "control": {"period": 0.04},
    },
}


@pytest.mark.parametrize("message", UNKNOWN)
def test_plants_of_which_a_recording_does_not_tell_all(recorded, message):
    config = model("SO3", **UNKNOWN[message])
    assert refusal(EqtError, eqt_cli.replay, config, recorded()) == message
