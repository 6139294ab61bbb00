"""Runs end as failed where an error reaches a bound of `failed_when`, when a closed form says."""

import numpy as np
import pytest
from said import says
from small_experiment import configuration, study_of

from eqt_cli import api
from eqt_cli.base.errors import ConfigError
from eqt_cli.base.stored import Status

FREE = {
    "group": "SO3",
    "inertia": "[2, 2, 2]",
    "gains": "{kp: 1.0e-12, kd: 1.0e-12}",
    "reference": "{kind: constant}",
    "controllers": "[gt]",
    "initial": "{pose: identity}",
    "plant": "{forces: [{kind: constant, force: [{uniform: [0, 1]}, 0, 0]}]}",
    "ensemble": "{runs: 12, seed: 1}",
    "time": "{duration: 2.0, samples: 21}",
}
"""A body that turns by a drawn torque m about one axis alone: θ = m t²/4, ω = m t/2."""


@pytest.mark.ci("two results of each engine and clock")
@pytest.mark.parametrize("period", [None, "0.06"])
@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_a_run_ends_when_an_angle_or_a_rate_reaches_its_bound(tmp_path, period, engine):
    clock = None if period is None else f"{{period: {period}}}"
    solver = f"{{engine: {engine}, rtol: 1.0e-10, cross_check: 0}}"
    results = {}
    for bounds in (None, "{attitude: 10 deg, rate: 30 deg/s}"):
        text = configuration(**FREE, control=clock, solver=solver, failed_when=bounds)
        path = tmp_path / f"{bounds is None}.yaml"
        path.write_text(text)
        results[bounds is None] = api.run(path, tmp_path / path.stem).to_xarray()
    whole, ended = results[True].isel(controller=0), results[False].isel(controller=0)
    m = whole["drawn.plant.forces.0.force.0"].values
    angle, rate = np.sqrt(4 * np.radians(10) / m), 2 * np.radians(30) / m
    t = np.minimum(angle, rate)
    crosses = t < 2.0
    assert 0 < crosses.sum() < 12
    np.testing.assert_array_equal(ended.status, np.where(crosses, Status.BOUND_CROSSED, 0))
    messages = ended.message_text.values[ended.message.values]
    for run in np.flatnonzero(crosses):
        name = "attitude_angle exceeds 10 deg" if angle[run] < rate[run] else "velocity_error"
        assert says(messages[run], f"t = … s: {name}…(failed_when)")
        # Nine digits, and a straight line over a 4096th of 0.1 s.
        assert float(messages[run].split()[2]) == pytest.approx(t[run], abs=2e-8)
        assert np.isnan(ended.mean_pose_error[run])
        np.testing.assert_array_equal(
            np.isfinite(ended.pose_error[run]), ended.time.values <= t[run]
        )
    assert api.verify(tmp_path / "False.yaml").failed_runs == crosses.sum()
    for name in ("pose", "mean_pose_error", "effort", "error_estimate"):
        np.testing.assert_array_equal(whole[name][~crosses], ended[name][~crosses])


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("{}", "…: failed_when: expected at least one bound of attitude, …rate, …"),
        ("{position: 5 m}", "…: failed_when.position: no error…; expected some of attitude, …"),
        ("{atitude: 1}", "…failed_when.atitude: no error…did you mean 'attitude'?…"),
        ("{attitude: 5 m}", "…failed_when.attitude: expected…an angle…got '5 m'…"),
        ("{attitude: 90}", "…failed_when.attitude: no angle is above 180 deg…'90 deg'…"),
        ("{rate: -1}", "…failed_when.rate: expected an angular velocity…greater than 0, got -1…"),
        ("{rate: [1]}", "…failed_when.rate: expected…got [1]…"),
        ("{rate: 1, velocity_error: 2}", "…velocity_error: is velocity_error, which has a bound…"),
        ("5 m", "…failed_when: expected a mapping…"),
    ],
)
def test_a_bound_that_is_none_is_refused_at_its_place(tmp_path, written, said):
    with pytest.raises(ConfigError) as error:
        study_of(tmp_path, configuration(failed_when=written))
    assert says(str(error.value), said)
