"""The window of `measure`: numbers over it by a plain program, by all ways; what is no window."""

import numpy as np
import pytest
from scipy.integrate import simpson
from small_experiment import mapping

from eqt_cli.api import run
from eqt_cli.base.errors import ConfigError
from eqt_cli.results.result import open_result


def config(**changes):
    return mapping(
        plant={"forces": [{"kind": "constant", "force": 0.1}]},
        ensemble={"runs": 12},
        time={"duration": 4, "samples": 41},
        **changes,
    )


def cut(t, x, start):
    """The samples from a time on, the first interpolated."""
    inside = t > start + 1e-9
    first = [np.interp(start, t, run) for run in x]
    return np.append(start, t[inside]), np.column_stack([first, x[:, inside]])


@pytest.mark.ci("compiles what measures on the way, and runs twice")
@pytest.mark.parametrize(
    ("engine", "stored", "start"),
    [
        ("native", "all", 1.5),
        ("native", 0, 1.5),
        ("solve_ivp", "all", 1.5),
        ("native", "all", 1.53),
        ("native", 0, 1.53),
    ],
)
def test_metrics_are_over_the_window(engine, stored, start, tmp_path):
    run(config(solver={"engine": engine, "rtol": 1e-8}), tmp_path / "whole")
    changed = config(
        measure={"start": start},
        solver={"engine": engine, "rtol": 1e-8},
        store={"trajectories": stored},
    )
    run(changed, tmp_path / "part")
    with open_result(tmp_path / "whole") as whole, open_result(tmp_path / "part") as part:
        t, torque = cut(whole["time"], whole["torque_norm"][0], start)
        _, angle = cut(whole["time"], whole["attitude_angle"][0], start)
        expected = {
            "mean_torque": np.trapezoid(torque, t, axis=1) / (4 - start),
            "effort": simpson(torque**2, x=t, axis=1),
            "peak_torque": torque.max(axis=1),
            "mean_attitude_error": np.trapezoid(angle, t, axis=1) / (4 - start),
            "final_attitude_error": angle[:, -1],
            "settling_time": whole["settling_time"][0],
            "energy_residual": whole["energy_residual"][0],
        }
        for name, values in expected.items():  # rounding of other orders of sums
            np.testing.assert_allclose(part[name][0], values, rtol=1e-12, err_msg=name)


@pytest.mark.parametrize(
    ("window", "place", "word"),
    [
        ({"start": 4}, "measure.start", "less than time.duration, 4 s, got 4"),
        ({"start": -1}, "measure.start", "0 or more"),
        ({"stop": 5}, "measure.stop", "at most time.duration, 4 s, got 5"),
        ({"start": 2, "stop": 1}, "measure.stop", "more than the start, 2 s, got 1"),
        ({"start": 1.01, "stop": 1.19}, "measure", "there is 1 sample"),
        ({"start": "20 deg"}, "measure.start", "deg"),
    ],
)
def test_what_is_no_window_is_refused(window, place, word, tmp_path):
    with pytest.raises(ConfigError) as refused:
        run(config(measure=window), tmp_path / "out")
    assert place in str(refused.value)
    assert word in str(refused.value)
