"""What deserves a word: input that is read as something else than its writer meant.

Each kind has a right answer that stands beside it, and random variations in sign, order, unit and
size. EQT_VARIATIONS says how many of them; 25 of each were run.
"""

import os
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.api import load_experiment
from eqt_cli.base.errors import ConfigError
from eqt_cli.config.remarks import remarks

VARIATIONS = int(os.environ.get("EQT_VARIATIONS", "2"))

BODY = {
    "group": "SO3",
    "inertia": [2, 1, 2.5],
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"kind": "constant"},
    "controllers": ["eqt"],
    "time": {"duration": 9.0, "samples": 10},
}
FLYING = {
    "group": "SE3",
    "inertia": [0.1, 0.1, 0.15, 2, 2, 2],
    "model": {"forces": [{"kind": "restoring", "weight": 19.6133}]},
    "reference": {"kind": "flat", "position": ["sin(t)", 0, "0.2*t"]},
    "controllers": [
        {
            "kind": "cascade",
            "attitude": "lee2010",
            "position": {"kx": 4, "kv": 3},
            "gains": {"kp": 2, "kd": 0.5},
            "along": [0, 0, 1],
        }
    ],
    "time": {"duration": 9.0, "samples": 10},
}
AFLOAT = FLYING | {
    "reference": {"kind": "constant"},
    "controllers": ["gt"],
    "gains": {"kp": [2, 2, 2, 9], "kd": 2},
    "model": None,
}


def words(data):
    """All that is said of a configuration before it is run."""
    data = {key: value for key, value in data.items() if value is not None}
    try:
        checked = load_experiment(data).base
        return [str(each) for each in remarks(checked, checked.reference_over_horizon())]
    except ConfigError as error:
        return str(error).splitlines()


def turned(rng, degrees):
    """A turn as it may be written."""
    axis = int(rng.integers(3))
    vector = [0.0] * 3
    vector[axis] = f"{degrees} deg" if rng.random() < 0.5 else float(np.radians(degrees))
    if rng.random() < 0.5:
        return {"rotvec": vector}
    return {"euler": {"sequence": "xyz"[axis], "angles": [vector[axis]]}}


def slew(rng):
    """Right: a turn by more than half of one is no motion between two poses."""
    degrees = int(rng.choice([-1, 1]) * rng.integers(181, 720))
    to, duration = turned(rng, degrees), float(rng.uniform(1, 90))
    return BODY | {"reference": {"kind": "slew", "to": to, "duration": duration}}, "reference.to"


def waypoints(rng):
    """Right: neither are two waypoints."""
    step = int(rng.integers(181, 300))
    vectors = [[f"{k * step} deg", 0, 0] for k in range(3)]
    points = [{"t": 10 * k, "pose": {"rotvec": each}} for k, each in enumerate(vectors)]
    reference = {"kind": "waypoints", "points": points}
    return BODY | {"reference": reference}, "reference.points[1].pose: turns by"


def weight(rng):
    """Right: 19.6133 N are the weight of 2 kg."""
    other = float(rng.choice([2.0, 2 * 32.2, 2 * 9.80665 * rng.uniform(1.05, 3)]))
    forces = [{"kind": "restoring", "weight": other}]
    return FLYING | {"model": {"forces": forces}}, "model.forces[0].weight: belongs to"


def known_weight(rng):
    """Right: what the law knows is the weight of 2 kg, too."""
    data, said = weight(rng)
    return data | {"plant": {"forces": FLYING["model"]["forces"]}}, said


def no_weight(rng):
    """Right: what acts has the weight, too."""
    forces = [
        {"kind": "drag", "linear": float(rng.uniform(0.1, 1))},
        {"kind": "constant", "force": rng.normal(size=6).tolist()},
    ]
    acting = {"forces": [forces[int(rng.integers(2))]]}
    return FLYING | {"plant": acting}, "plant.forces: lacks the weight"


def centre_of_mass(rng):
    """Right: an origin off the centre of mass couples torque and force by m r×."""
    r = rng.normal(size=3).round(3).tolist()
    forces = [{"kind": "restoring", "weight": 19.6133, "centre_of_mass": r}]
    return AFLOAT | {"plant": {"forces": forces}}, "plant.forces[0].centre_of_mass: does not fit"


def coupled_the_other_way(rng):
    """Right: the block of torque and force is m r×, and not its transpose."""
    x, y, z = r = rng.normal(size=3).round(3).tolist()
    block = -2 * np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
    inertia = np.diag([9.0, 9, 9, 2, 2, 2])
    inertia[:3, 3:], inertia[3:, :3] = block, block.T
    inertia[:3, :3] += 2 * (np.dot(r, r) * np.eye(3) - np.outer(r, r))
    forces = [{"kind": "restoring", "weight": 19.6133, "centre_of_mass": r}]
    changes = {"inertia": inertia.tolist(), "plant": {"forces": forces}}
    return AFLOAT | changes, "plant.forces[0].centre_of_mass: does not fit"


def weight_at_the_origin(rng):
    """Right: where the inertia couples torque and force, the weight is off the origin."""
    data, said = coupled_the_other_way(rng)
    forces = [{"kind": "restoring", "weight": 19.6133}]
    return data | {"plant": {"forces": forces}}, said


def gradient(rng):
    """Right: the torque of gravity is of the body's own tensor."""
    tensor = (np.array([2, 1, 2.5]) * rng.choice([0.1, 1.1, 10, 1000])).tolist()
    force = {"kind": "gravity_gradient", "rate": 0.001, "inertia": tensor}
    return BODY | {"plant": {"forces": [force]}}, "plant.forces[0].inertia: differs from"


def angle(rng):
    """Right: these are degrees, and no radians."""
    degrees = float(rng.integers(7, 90))
    sampled = {"control": {"period": 0.1}}
    wheels = {"kind": "wheels", "pyramid": degrees, "limit": 1}
    return [
        (BODY | {"actuators": [wheels]}, "actuators[0].pyramid"),
        (BODY | sampled | {"sensors": {"pose": [{"kind": "noise", "std": degrees}]}}, "'{} deg'"),
        (FLYING | {"reference": FLYING["reference"] | {"heading": degrees}}, "reference.heading"),
        (BODY | {"settling_threshold": degrees}, "settling_threshold"),
        (BODY | {"initial": {"pose": {"kind": "exp_normal", "std": degrees}}}, "initial.pose.std"),
        (BODY | {"initial": {"pose": {"kind": "angle", "angle": degrees}}}, "initial.pose.angle"),
    ][int(rng.integers(6))]


def sampled(rng):
    """Right: a torque that is held for so long turns the error around, and more."""
    stiff = float(rng.uniform(30, 90))
    gains, reference = {"kp": stiff, "kd": stiff}, rng.choice(["constant", "torque"])
    motion = {"kind": reference} | ({"torque": ["sin(3*t)", 0, 0]} if reference == "torque" else {})
    changes = {"gains": gains, "reference": motion, "control": {"period": 0.1}}
    return BODY | changes, "controllers: the loop of 'eqt' is unstable"


def delay(rng):
    """Right: a number counts periods."""
    seconds = round(float(rng.uniform(0.001, 0.9)), 4)
    control = {"period": 0.1, "delay": seconds}
    return BODY | {"control": control}, f"control.delay: counts control periods, got {seconds:g}"


def twice(rng):
    """Right: k_R is kp."""
    gains = {"kp": 1.0, "kd": 1.0, "k_R": float(rng.uniform(1, 9))}
    return BODY | {"gains": gains}, "gains.k_R: gives kp, which is given as well"


KINDS = (
    slew,
    waypoints,
    weight,
    known_weight,
    no_weight,
    centre_of_mass,
    coupled_the_other_way,
    weight_at_the_origin,
    pytest.param(gradient, marks=pytest.mark.needs("spacecraft")),
    angle,
    sampled,
    delay,
    twice,
)


@pytest.mark.parametrize("kind", KINDS, ids=lambda kind: kind.__name__)
def test_what_was_meant_otherwise_gets_a_word(kind):
    rng = np.random.default_rng(7)
    for _ in range(VARIATIONS):
        data, expected = kind(rng)
        said = words(data)
        assert any(expected.partition("{")[0] in line for line in said), (data, said)


@pytest.mark.parametrize(
    "data", [BODY, pytest.param(FLYING, marks=pytest.mark.needs("underactuated")), AFLOAT]
)
def test_what_is_right_gets_none(data):
    assert words(data) == []


def test_waypoints_that_wrap_are_one_way():
    """170, -170 and -150 deg, as a recording has them, and 0, 120, … 720 deg."""
    for degrees in ([170, -170, -150], range(0, 721, 120)):
        points = [
            {"t": 10 * k, "pose": {"rotvec": [f"{each} deg", 0, 0]}}
            for k, each in enumerate(degrees)
        ]
        assert words(BODY | {"reference": {"kind": "waypoints", "points": points}}) == []


@pytest.mark.needs("underactuated")
def test_gains_of_papers_are_those_of_eqt():
    """K = k_R/2 and K_d = k_Omega; gains of the force are m times those of the acceleration."""
    cascade = FLYING["controllers"][0]
    written = cascade | {"gains": {"k_R": 4, "k_Omega": 0.5}, "position": {"k_x": 8, "k_v": 6}}
    one, other = (load_experiment(FLYING | {"controllers": [each]}) for each in (cascade, written))
    assert one.digest == other.digest
    shared = [BODY | {"gains": gains} for gains in ({"k_R": 2, "k_Omega": 1}, BODY["gains"])]
    one, other = map(load_experiment, shared)
    assert one.digest == other.digest
    [said] = words(AFLOAT | {"gains": {"k_R": 4, "kd": 1}})
    assert "gains.k_R: is a gain of attitudes alone, got SE3; give kp" in said


PULSE = """
import numpy as np
from dataclasses import dataclass
from typing import ClassVar
from eqt_cli.extend import Controller, Force, less, where


@dataclass(frozen=True)
class Pulse(Force):
    name: ClassVar[str] = "pulse"
    departs: ClassVar[str] = "a pulse"

    def acting(self, G, t, Q, V):
        on = where(less(3.0, t), where(less(t, 3.5), 1.0, 0.0), 0.0)
        return 0 * V + (on[..., None] if np.ndim(on) else on)


@dataclass(frozen=True)
class Known(Pulse):
    name: ClassVar[str] = "known"

    def instants(self, G, until):
        return np.array([3.0, 3.5])


@dataclass(frozen=True)
class Steady(Pulse):
    name: ClassVar[str] = "steady"

    def acting(self, G, t, Q, V):
        return np.full(G.dimension, 0.1)


@dataclass(frozen=True)
class Answers(Controller):
    name: ClassVar[str] = "answers"

    def torque(self, s):
        return s.tau_d

    def answer(self, s, period):
        return -s.V, {}
"""


@pytest.mark.parametrize(
    ("kind", "expected"),
    [("pulse", "plant.forces[0]: jumps at about t = 2.999 s"), ("known", ""), ("steady", "")],
)
def test_a_force_that_jumps_without_instants(tmp_path, monkeypatch, kind, expected):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(PULSE)
    said = words(BODY | {"plugins": ["own.py"], "plant": {"forces": [kind]}})
    assert [expected in line for line in said] == [True] * bool(expected)


def test_a_law_that_only_answers_needs_a_clock(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(PULSE)
    data = BODY | {"plugins": ["own.py"], "controllers": ["answers"]}
    assert "controllers[0]: answers at control instants only; set" in "".join(words(data))
    assert words(data | {"control": {"period": 0.1}}) == []


OWN_NOISE = """
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Noise


@dataclass(frozen=True, kw_only=True)
class OwnNoise(Noise):
    name: ClassVar[str] = "own_noise"
    std: float = 3.0
"""


def test_a_sensor_named_by_a_word_alone_is_judged_by_its_defaults(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("own.py").write_text(OWN_NOISE)
    sampled = {"plugins": ["own.py"], "control": {"period": 0.1}}
    said = words(BODY | sampled | {"sensors": {"velocity": ["own_noise"]}})
    assert "sensors.velocity[0]: a noise of 3 rad/s" in "".join(said)


@pytest.mark.parametrize(
    ("written", "count"), [(0.07 / 0.01, 7), (0.29 / 0.01, 29), (0.3 / 0.1, 3), (4, 4)]
)
def test_a_count_that_a_division_misses_by_rounding_is_whole(written, count):
    config = BODY | {"control": {"period": 0.1, "delay": written}, "ensemble": {"runs": written}}
    read = load_experiment(config).base.config
    assert (read.control.delay, read.ensemble.runs) == (count, count)


@pytest.mark.parametrize("written", [7.5, 7.0000001])
def test_a_count_that_is_not_whole_is_printed_as_it_is(written):
    with pytest.raises(ConfigError, match=f"control.delay.*got {written!r}; take a whole number"):
        load_experiment(BODY | {"control": {"period": 0.1, "delay": written}})


@pytest.mark.parametrize(("changes", "place", "words"), [
    ({"inertia": [[0.15, -0.2, 0], [-0.2, 0.12, 0], [0, 0, 0.05]]}, "inertia", "= 0.134"),
    ({"inertia": {"rigid": [1, 1, 1], "added": [-0.1, -0.2, -0.3]}}, "inertia.added", "Fossen"),
    ({"gains": {"k_R": [0.3, 0.3, 0.2], "k_Omega": 0.1}}, "gains.k_R", "kp: [0.1, 0.1, 0.2]"),
    ({"inertia": {"urdf": [1, 0, 0, 1, 0, 1], "mass": {}}}, "inertia.mass", "one number"),
    ({"plant": {"inertia": {"urdf": [1, 0, 0, 1, 0, 1], "mass": {"normal": [2, 1]}}}},
     "plant.inertia.mass", "draws: {mass: {normal: [2, 1]}} and plant.inertia: [1, 1, 1, mass, "),
    ({"group": "SE3", "inertia": {"rigid": {"urdf": [1, 0, 0, 1, 0, 1]}, "added": [1, 1, 1]}},
     "inertia.rigid", "got {urdf:"),
    ({"reference": {"kind": "path", "factors": [{"axis": "wz", "by": "8*clip(t, 0, 1) deg"}]}},
     "reference.factors[0].by", "'8*clip(t, 0, 1)': unknown name 'clip' at column 3"),
])  # fmt: skip
def test_the_cure_stands_in_the_message(changes, place, words):
    """√(0.15 · 0.12) = 0.134; with κ = (0.1, 0.1, 0.2), sums of two are 0.3, 0.3 and 0.2."""
    with pytest.raises(ConfigError) as refused:
        load_experiment(BODY | {"group": "SO3"} | changes)
    [problem] = [one for one in refused.value.problems if one.path == place]
    assert words in problem.message
