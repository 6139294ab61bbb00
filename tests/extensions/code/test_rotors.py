"""Code that returns thrusts of rotors, or some directions of a torque."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from ci_cases import mostly_ci
from said import error_of

import eqt_cli

ANGLES = np.pi / 3 * np.arange(6)
PLACES = [
    {"at": [0.2 * np.cos(a), 0.2 * np.sin(a), 0.0], "along": [0, 0, 1], "turns": t, "name": n}
    for a, t, n in zip(ANGLES.tolist(), 3 * [0.02, -0.02], "abcdef", strict=True)
]
C = """typedef struct {
  double t, pose[16], velocity[6], desired_pose[16], desired_velocity[6], desired_acceleration[6];
} mix_input;
typedef struct { double unused; } mix_numbers, mix_memory;
void mix_torque(const mix_numbers *n, mix_memory *m, const mix_input *x, double *y)
{ int i; for (i = 0; i < 6; i++) y[i] = 3.0 + 0.5 * i + 0.3 * x->velocity[i]; }
"""
PYTHON = """import numpy as np
def mix(velocity):
    return 3.0 + 0.5 * np.arange(6) + 0.3 * velocity
"""


def experiment(output, file="mix.py", **options):
    Path("mix.c").write_text(C, encoding="utf-8")
    Path("mix.py").write_text(PYTHON, encoding="utf-8")
    law = {"kind": "code", "file": file, "adapter": {"output": output}, **options}
    law |= {"function": "mix"} if file.endswith("py") else {}
    return {
        "group": "SE3",
        "inertia": [0.03, 0.03, 0.05, 2.0, 2.0, 2.0],
        "reference": {"kind": "constant"},
        "controllers": [law],
        "actuators": [{"kind": "thrusters", "thrusters": PLACES, "low": 0.0, "high": 5.0}],
        "control": {"period": 0.1},
        "initial": {"velocity": {"kind": "normal", "std": 0.3}},
        "ensemble": {"runs": 2},
        "time": {"duration": 0.2, "samples": 3},
        "solver": {"engine": "solve_ivp", "cross_check": 0},
    }


@mostly_ci("file", ["mix.c", "mix.py"], ["mix.c"], "the other language is fast")
def test_its_thrusts_are_flown_in_its_order_within_the_limits(file):
    config = experiment({"as": "rotors", "order": [*"fedcba"]}, file)
    result = eqt_cli.run(config, "flown")
    with h5py.File(result.path / "results.h5") as stored:
        flown, V = stored["thrust"][0, :, :2], stored["velocity"][0, :, :2]
    returned = 3.0 + 0.5 * np.arange(6) + 0.3 * V
    np.testing.assert_allclose(flown, np.clip(returned, 0.0, 5.0)[..., ::-1], rtol=1e-14)


def test_a_curve_and_a_unit_make_thrusts_of_what_it_returns():
    """f = 0.1 + 0.2 y + 0.3 y² of y in kN, and rotors by their numbers."""
    output = {"as": "rotors", "order": [6, 5, 4, 3, 2, 1], "unit": "N", "scale": 2.0}
    config = experiment(output | {"thrust": [0.1, 0.2, 0.3]})
    [loop] = eqt_cli.load_experiment(config).base.loops.values()
    y = np.arange(1.0, 7.0)
    s = loop.tracking(0.0, loop.initial_state(np.eye(4), np.zeros(6), np.eye(4), np.zeros(6)))
    command = loop.controller._command(s, 2.0 * y)
    expected = [*np.zeros(6), *(0.1 + 0.2 * y + 0.3 * y * y)[::-1]]
    np.testing.assert_allclose(command, expected, rtol=1e-14)


def test_some_directions_are_placed_into_the_torque_and_allocated_alone():
    names = ["force z", "torque z", "torque y", "torque x"]
    config = experiment({"order": names})
    Path("mix.py").write_text("def mix(t):\n    return [10.0, 0.1, 0.2, 0.3]\n", encoding="utf-8")
    [loop] = eqt_cli.load_experiment(config).base.loops.values()
    s = loop.tracking(0.0, loop.initial_state(np.eye(4), np.zeros(6), np.eye(4), np.zeros(6)))
    np.testing.assert_array_equal(loop.controller.torque(s), [0.3, 0.2, 0.1, 0.0, 0.0, 10.0])
    assert len(loop.controller.directions(loop.group)) == 4


@pytest.mark.parametrize(
    ("output", "said"),
    [
        ({"as": "rotors"}, "output.order: missing"),
        ({"as": "rotors", "order": [*"abcdex"]}, "output.order[5]: expected one of a, b, c"),
        ({"as": "rotors", "order": [*"abcdea"]}, "output.order[5]: 'a' is named twice"),
        ({"order": ["force z", "thrust"]}, "output.order[1]: expected one of torque x"),
        ({"thrust": [1.0, 2.0, 3.0]}, "output.thrust: expected [c0, c1, c2], with as: rotors"),
        ({"order": ["force z"], "frame": "space"}, "output: frame and per apply"),
    ],
)
def test_what_is_wrong_with_an_output_is_said(output, said):
    assert said in error_of(eqt_cli.load_experiment, experiment(output))


def test_a_claim_needs_a_whole_torque():
    config = experiment({"as": "rotors", "order": [*"abcdef"]}, **{"as": "lee2010"})
    assert "as: needs code that returns a whole torque" in error_of(eqt_cli.load_experiment, config)


@pytest.mark.parametrize("body", ["np.zeros(6) + 1j", "(-1.0) ** 0.5 * np.ones(6)"])
def test_a_complex_torque_is_refused(body):
    config = experiment({})
    law = f"import numpy as np\ndef mix(t):\n    return {body}\n"
    Path("mix.py").write_text(law, encoding="utf-8")
    assert "imaginary parts up to 1" in error_of(eqt_cli.load_experiment, config)
