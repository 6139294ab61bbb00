"""Remarks on values that some run alone has: the runs are those of closed forms."""

import numpy as np
import pytest
import yaml
from said import mentions

import eqt_cli
from eqt_cli.config.document import read_config
from eqt_cli.config.remarks import remarks
from eqt_cli.extensions.draws.remarks import ends
from eqt_cli.extensions.failures.drawn import drawn_numbers, values_of
from eqt_cli.extensions.search.worst import WorstSearch

pytestmark = pytest.mark.needs("draws")
RUNS, J, KP, KD, G = 60, 0.02, 0.04, 0.04, 9.80665
STIFFNESS = 2 * KP  # of tr(K(I − R))
BODY = {
    "group": "SO3",
    "inertia": [J, J, J],
    "gains": {"kp": KP, "kd": KD},
    "controllers": ["lee2010"],
    "reference": {"kind": "constant"},
    "initial": {"pose": "haar"},
    "control": {"period": 0.02},
    "time": {"duration": 20.0, "samples": 201},
    "ensemble": {"runs": RUNS},
    "solver": {"engine": "solve_ivp"},
}
MOVING = BODY | {
    "group": "SE3",
    "inertia": [J, J, J, 1, 1, 1],
    "gains": {"kp": 1, "kd": 1},
    "controllers": ["eqt"],
    "initial": {},
    "control": None,
}
CASCADE = MOVING | {
    "gains": None,
    "model": {"forces": [{"kind": "restoring", "gravity": G}]},
    "reference": {"kind": "flat", "position": [0, 0, 1], "heading": 0},
    "controllers": [
        {
            "kind": "cascade",
            "attitude": "lee2010",
            "position": {"kx": 4, "kv": 3},
            "gains": {"kp": 1, "kd": 0.2},
            "along": [0, 0, 1],
        }
    ],
}


def uniform(low, high):
    return {"uniform": [low, high]}


def of(tmp_path, base, shown=True, **sections):
    """Return the remarks on an experiment, and the numbers that its runs draw, (numbers, runs)."""
    path = tmp_path / "drawn.yaml"
    data = {key: value for key, value in (base | sections).items() if value is not None}
    path.write_text(yaml.safe_dump(data))
    experiment = eqt_cli.load_experiment(path).base
    horizon = experiment.reference_over_horizon() if shown else None
    said = [str(remark).partition(": ")[2] for remark in remarks(experiment, horizon)]
    return said, values_of(experiment, drawn_numbers(experiment)), experiment


def in_runs(wrong):
    assert 0 < wrong.sum() < RUNS
    return f"in {wrong.sum()} of {RUNS} runs, such as run {np.flatnonzero(wrong)[0]}: "


@pytest.mark.parametrize(
    ("sensors", "key", "most"),
    [
        ({"pose": [{"kind": "noise", "std": uniform(0, 1.5)}]}, "sensors.pose[0]", 1.0),
        (
            {"velocity": [{"kind": "bias", "value": [{"normal": [0, 0.5]}, 0, 0]}]},
            "sensors.velocity[0]",
            1.0,
        ),
    ],
)
def test_errors_that_no_instrument_has_are_counted(tmp_path, sensors, key, most):
    [said], [size], _ = of(tmp_path, BODY, sensors=sensors)
    assert mentions(said, f"{key}: {in_runs(np.abs(size) > most)}…")


@pytest.mark.ci("what limits leave is computed for 60 runs")
def test_directions_in_which_thrusters_hardly_push_are_told(tmp_path):
    ends_of_arms = [([0, 0.2, 0], 0), ([0, -0.2, 0], 0), ([0, 0, 0.2], 1), ([0, 0, -0.2], 1)]
    places = [*ends_of_arms, ([0.2, 0, 0], 2), ([uniform(-0.2, 0.2), 0, 0], 2)]
    along = np.eye(3)
    thrusters = [{"at": at, "along": along[k].tolist()} for at, k in places]
    part = {"kind": "thrusters", "low": -5, "high": 5, "thrusters": thrusters}
    said, [x], _ = of(tmp_path, MOVING, actuators=[part])
    # The last two thrusters give (−0.2, −x) about y and (1, 1) along z.
    B = np.array([[[-0.2, -k], [1.0, 1.0]] for k in x])
    B /= np.linalg.norm(B, axis=2, keepdims=True)
    least = np.linalg.svd(B)[1][:, 1]
    # The largest size of all rows is that of the other pairs, √2 at most.
    largest = np.maximum(np.linalg.svd(B)[1][:, 0], 1.0)
    [text] = [text for text in said if "push along" in text]
    assert mentions(text, f"actuators[0]: {in_runs(least < 0.05 * largest)}…ωy…")


@pytest.mark.ci("gains are tried along a reference")
def test_a_gust_that_turns_the_body_by_its_lever_is_told(tmp_path):
    points = [{"t": t, "pose": {"position": [0, 3, 0]}} for t in (0, 10, 20)]
    gust = {"kind": "gust", "std": [0, 0, 0, uniform(0, 2.4), 0, 0], "time_constant": 2.0}
    gust |= {"frame": "spatial", "at": "line"}
    reference = {"kind": "waypoints", "points": points}
    said, [std], _ = of(tmp_path, MOVING, reference=reference, plant={"forces": [gust]})
    # About z, with the lever of 3 m: k_R = 2 k_p, and k_p 3² and k_d 3² of the lever, over J.
    w2, d, T = (2 + 9) / J, (1 + 9) / J, 2.0
    angle = 3 * std / J * np.sqrt((1 / T + d) / (w2 * d * (1 / T**2 + d / T + w2)))
    [text] = [text for text in said if "lever" in text]
    assert mentions(text, f"plant.forces[0].at: {in_runs(angle > 1 / 3)}…")


def test_the_run_is_named_whose_lag_makes_the_loop_unstable(tmp_path):
    lag = {"kind": "lag", "time_constant": uniform(0.1, 0.8)}
    said, [T], _ = of(tmp_path, BODY, control=None, actuators=[lag])
    worst = int(T.argmax())
    # J T s³ + J s² + k_d s + k_R is stable for T < k_d/k_R, 0.5 s, by Routh.
    assert T.mean() < KD / STIFFNESS < T[worst]
    growth = np.roots([J * T[worst], J, KD, STIFFNESS]).real.max()
    [text] = [text for text in said if "unstable" in text]
    assert mentions(text, f"controllers: in run {worst}, …unstable: …grow at {growth:.3g} 1/s;…")
    before = of(tmp_path, BODY, shown=False, control=None, actuators=[lag])[0]
    assert any(f"in run {worst}, " in text and "unstable" in text for text in before)


@pytest.mark.ci("a loop is tried by Radau")
def test_the_run_is_named_whose_lag_makes_the_loop_stiff(tmp_path):
    lag = {"kind": "lag", "time_constant": uniform(1e-6, 1e-2)}
    said, [T], _ = of(tmp_path, BODY, control=None, actuators=[lag])
    [text] = [text for text in said if "stiff" in text]
    fastest = np.abs(np.roots([J * T.min(), J, KD, STIFFNESS])).max()
    assert mentions(text, f"gains: in run {T.argmin()}, …at up to {fastest:.2g} 1/s…")


def test_what_extensions_say_is_said_of_the_ends(tmp_path):
    gradient = {"kind": "gravity_gradient", "rate": uniform(0.0005, 0.0016), "inertia": [J] * 3}
    late = {"kind": "constant", "force": [0.01, 0, 0], "since": uniform(1, 25)}
    forces = [gradient, late]
    said, [rate, since], experiment = of(tmp_path, BODY, plant={"forces": forces})
    fastest, last = int(rate.argmax()), int(since.argmax())
    key = "plant.forces[0].rate"
    expected = f"{key}: in run {fastest}, which draws the greatest {key}: is {rate[fastest]:.6g}…"
    assert any(mentions(text, expected) for text in said)
    expected = f"plant.forces[1].since: in run {last}, which draws the greatest…never acts"
    assert any(mentions(text, expected) for text in said)
    assert {*ends(experiment)} == {int(x) for n in (rate, since) for x in (n.argmin(), n.argmax())}


@pytest.mark.ci("gains are tried along a reference")
def test_a_wind_whose_mean_is_zero_is_weighed_at_the_ends(tmp_path):
    wind = [{"normal": [0, 3]}, {"normal": [0, 3]}, 0]
    drag = {"kind": "drag", "linear": [0, 0, 0, 0.3, 0.3, 0.3], "current": wind}
    forces = [{"kind": "restoring", "gravity": G}, drag]
    said, current, _ = of(tmp_path, CASCADE, plant={"forces": forces})
    [text] = [text for text in said if "steady force" in text]
    run = int(text.partition("in run ")[2].partition(":")[0])
    assert run in {int(k) for x in current for k in (x.argmin(), x.argmax())}
    force = 0.3 * np.linalg.norm(current[:, run])  # N, of a body of 1 kg
    assert mentions(text, f"controllers[0].rates: …does not know, {force:.2g} m/s^2,…")


@pytest.mark.ci("what limits leave is computed")
def test_a_friction_that_brings_wheels_to_rest_is_told_of_the_slowest(tmp_path):
    wheels = {
        "kind": "wheels",
        "axes": [[1, 0, 0], [0, 1, 0], [0, 0, 1], [1, 1, 1]],
        "inertia": 1e-4,
        "start": [uniform(0.001, 0.02), 0, 0, 0],
        "friction": {"viscous": 1e-6, "coulomb": 1e-4},
        "momentum": 0.1,
        "limit": 0.1,
    }
    said, [h], _ = of(tmp_path, BODY, actuators=[wheels])
    A = np.array([[1, 0, 0, 3**-0.5], [0, 1, 0, 3**-0.5], [0, 0, 1, 3**-0.5]])
    null = np.eye(4) - np.linalg.pinv(A) @ A
    most = h.min() * np.abs(null[:, 0]).max()
    lasts = 1e-4 / 1e-6 * np.log1p(1e-6 * most / 1e-4 / 1e-4)  # J_w/c ln(1 + c Ω/T_c)
    [text] = [text for text in said if "to rest" in text]
    assert mentions(text, f"actuators[0]: in run {h.argmin()}, …in about {lasts:.3g} s…")


def test_a_true_inertia_that_is_of_no_rigid_body_is_told_even_without_a_draw(tmp_path):
    said, _, _ = of(tmp_path, BODY, plant={"inertia": [0.02, 0.02, 0.05]})
    assert any(
        mentions(text, "plant.inertia: not of a rigid body…0.02 + 0.02 < 0.05") for text in said
    )
    third = [0.02, 0.02, uniform(0.02, 0.06)]
    said, [moment], _ = of(tmp_path, BODY, plant={"inertia": third})
    [text] = [text for text in said if "rigid" in text]
    # At rounding of 0.04 itself, no run is.
    assert mentions(text, f"plant.inertia: {in_runs(moment > 0.04)}not of a rigid body…")


@pytest.mark.needs("search")
def test_the_ends_of_each_range_are_tried_where_those_of_all_fit(tmp_path, told):
    weight = {"kind": "restoring", "weight": G}
    over = {"plant.inertia.relative": [-0.2, 0.2]}
    over |= {"plant.forces[0].weight": [0.8 * G, 1.2 * G]}  # of 1 kg times 0.8 and 1.2
    data = MOVING | {
        "model": {"forces": [weight]},
        "plant": {"inertia": {"relative": 0}, "forces": [weight]},
        "worst": {"objective": "final_pose_error", "over": over},
        "ensemble": {"runs": 2},
        "initial": {"velocity": {"kind": "normal", "std": 0.1}},
    }
    path = tmp_path / "ends.yaml"
    path.write_text(yaml.safe_dump({key: x for key, x in data.items() if x is not None}))
    WorstSearch.read(read_config(path)).remark_on_ends()
    [remark] = map(str, told.remarks)
    where = "at the lower end of plant.inertia.relative, …"
    assert mentions(remark, f"plant.forces[0].weight: {where}belongs to 1 kg…has 0.8 kg…")
