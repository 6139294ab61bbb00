"""A pulse that is shorter than a step of the motion is integrated, by every engine."""

import numpy as np
import pytest

from eqt_cli import load_experiment
from eqt_cli.engines import compiler
from eqt_cli.runs.compute_part import shared_reference

HEIGHT = "3.5/(1e-5*sqrt(2*pi))"
AGAIN = pytest.mark.ci("compiles another reference")
BODY = {"inertia": 1.0, "rigid": False, "time.duration": 5.0, "time.samples": 6}


@pytest.mark.parametrize(
    ("engine", "inner"),
    [
        ("solve_ivp", "t - 3"),
        ("native", "t - 3"),
        pytest.param("native", "(t**2 - 9)/6", marks=AGAIN),
        pytest.param("native", "sin(t - 3)", marks=AGAIN),
    ],
)
def test_a_pulse_shorter_than_a_step_gives_its_impulse(engine, inner):
    """The impulse of 3.5 N m s, on 1 kg m², is a rate of 3.5 rad/s; rtol is 1e-9."""
    if engine == "native" and (missing := compiler.missing()):
        pytest.skip(missing)
    torque = [f"{HEIGHT}*exp(-(({inner})/1e-5)**2/2)", 0, 0]
    changes = BODY | {"reference.torque": torque, "solver": {"engine": engine}}
    study = load_experiment("configs/paper.yaml", changes)
    found = shared_reference(study)["desired_velocity"]
    np.testing.assert_allclose(found[2], 0, atol=1e-12)
    np.testing.assert_allclose(found[-1], [3.5, 0, 0], atol=1e-7)
