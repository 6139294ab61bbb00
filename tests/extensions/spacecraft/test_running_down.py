"""The remark on wheels that friction brings to rest."""

import numpy as np
import pytest

import eqt_cli
from eqt_cli.config.remarks import remarks

pytestmark = pytest.mark.needs("spacecraft")
MOMENTA = [5e-3, -5e-3, 5e-3, -5e-3]
WHEELS = {
    "kind": "wheels", "pyramid": "54.7 deg", "limit": 4e-3, "momentum": 15e-3, "inertia": 2.39e-5,
    "friction": {"viscous": 1e-6, "coulomb": 2e-5}, "start": MOMENTA,
}  # fmt: skip


def rest():
    """The time after which the wheels rest, by small steps."""
    h, t, step = 5e-3, 0.0, 1e-3
    while h > 0:
        h, t = h - step * (2e-5 + 1e-6 * h / 2.39e-5), t + step
    return t


@pytest.mark.parametrize(("changes", "duration", "says"), [
    ({}, 120, True),
    ({}, 50, False),  # they still turn at its end
    ({"start": [5e-3, 5e-3, 5e-3, 5e-3]}, 120, False),  # the momentum of the body, which stays
    ({"bias": {"momentum": MOMENTA, "time_constant": 20}}, 120, False),
    ({"friction": {"viscous": 1e-6}}, 120, False),
])  # fmt: skip
def test_wheels_that_come_to_rest_are_remarked_on(changes, duration, says):
    body = {
        "group": "SO3", "inertia": [0.15, 0.12, 0.05], "gains": {"kp": 0.01, "kd": 0.05},
        "controllers": ["lee2010"], "reference": {"kind": "constant"}, "control": {"period": 0.1},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.01}}, "actuators": [WHEELS | changes],
        "time": {"duration": duration},
    }  # fmt: skip
    said = [str(x) for x in remarks(eqt_cli.load_experiment(body).base) if "friction" in str(x)]
    assert len(said) == says
    if says:
        about = float(said[0].partition("in about ")[2].partition(" s")[0])
        assert about == pytest.approx(rest(), rel=5e-3)  # three digits are printed
        assert np.isfinite(about)
