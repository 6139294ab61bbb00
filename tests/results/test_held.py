"""Numbers of loops whose command is held between ticks, against own sums over the ticks."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from case_tables import in_ci
from small_experiment import mapping

from eqt_cli import api
from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison_tables import text_tables
from eqt_cli.cli.result_tables import _shares
from eqt_cli.extend import Array
from eqt_cli.results.metrics import QUANTITIES
from eqt_cli.results.quantity import Latex, Plain, Window
from eqt_cli.results.result import Result, open_result
from eqt_cli.results.summary import headline

TICK, TICKS = 0.1, 20
LIMIT, LAG = {"kind": "limit", "limit": 0.5}, {"kind": "lag", "time_constant": 0.05}


def run(
    folder: Path, samples: int, actuators: list[Any], engine: str = "solve_ivp", **more: Any
) -> Result:
    """Three runs of 2 s with a law at 10 Hz."""
    config = mapping(
        name="held",
        reference={"torque": ["0.4*cos(t)", "0.4*sin(t)", "0"]},
        controllers=["eqt"],
        control={"period": TICK},
        actuators=actuators,
        sensors={"velocity": [{"kind": "noise", "std": 0.1}]},
        time={"duration": TICK * TICKS, "samples": samples},
        early_window=1.0,
        solver={"engine": engine, "cross_check": 0, "error_estimate": False},
        **more,
    )
    api.run(config, folder / "held")
    return open_result(folder / "held")


def at_ticks(result: Result, name: str) -> Array:
    """The values from each tick to the next, ``(runs, ticks, …)``."""
    every = (len(result.times) - 1) // TICKS
    return np.asarray(result.read(name, controller=0))[:, : every * TICKS : every]


@pytest.mark.parametrize(
    ("samples", "engine"),
    [(21, "solve_ivp"), in_ci("compiles", 41, "native"), in_ci("as the first", 41, "solve_ivp")],
)
def test_integrals_are_sums_over_ticks(tmp_path: Path, samples: int, engine: str) -> None:
    with run(tmp_path, samples, [LIMIT], engine) as result:
        torque, V = (np.asarray(result.read(x, controller=0)) for x in ("torque", "velocity"))
        size = np.linalg.norm(at_ticks(result, "torque"), axis=-1)
        every = (samples - 1) // TICKS
        power = sum(  # the torque of a tick with the velocity at both ends of each interval
            TICK / every / 2 * abs((torque[:, k] * V[:, k + end]).sum(-1))
            for k in range(samples - 1)
            for end in (0, 1)
        )
        own = {
            "effort": (size**2).sum(-1) * TICK,
            "mean_torque": size.sum(-1) / TICKS,
            "early_torque": size[:, :10].sum(-1) / 10,
            "closing_torque": np.sqrt((size[:, 15:] ** 2).sum(-1) / 5),
            "saturated_share": at_ticks(result, "at_limit").sum(-1) / TICKS,
            "actuator_work": power,
        }
        assert 0 < own["saturated_share"].min() < 1
        found = {name: result.per_run(QUANTITIES[name]) for name in own if name != "early_torque"}
        found["early_torque"] = result.per_run(QUANTITIES["early_torque"], Window(0.0, 1.0))
        for name, expected in own.items():
            np.testing.assert_allclose(found[name].values[0], expected, rtol=1e-12, err_msg=name)
        assert found["mean_torque"].sampling == (0.0, 0)


def test_a_share_at_limit_is_held_before_a_lag_whose_torque_is_not(tmp_path: Path) -> None:
    with run(tmp_path, 21, [LIMIT, LAG]) as result:
        assert result.described.holds == {"at_limit": TICK, "cut": TICK}
        expected = at_ticks(result, "at_limit").mean(axis=-1)
        np.testing.assert_allclose(result.metric("saturated_share")[0], expected, rtol=1e-12)


def test_a_decay_rate_is_the_slope_of_log_L_in_a_sampled_loop(tmp_path: Path) -> None:
    with run(tmp_path, 21, [LIMIT]) as result:
        logs = np.log(result.read("lyapunov", controller=0))
        slopes = [np.polyfit(result.times, each, 1)[0] for each in logs]
        found = result.per_run(QUANTITIES["decay_rate"]).values[0]
        np.testing.assert_allclose(found, -np.array(slopes) / 2, rtol=1e-9)


def test_where_samples_skip_ticks_an_integral_states_its_error(tmp_path: Path) -> None:
    """Every fifth of 20 held values; the stated error is an upper bound, of the same size."""
    effort = QUANTITIES["effort"]
    with run(tmp_path / "all", 21, []) as result:
        true = result.per_run(effort).values.mean()
    with run(tmp_path / "few", 5, []) as result:
        found = result.per_run(effort)
        comparison = compare(result, metrics=["effort"])
        table = text_tables(comparison, Plain())["controllers"]
        in_latex = text_tables(comparison, Latex())["controllers"].notes
        early = result.per_run(QUANTITIES["early_torque"], Window(0.0, 1.0))
        [shown] = [
            line for line in _shares(result, headline(result)) if line.startswith("mean ‖τ‖")
        ]
        size = np.linalg.norm(result.read("torque", controller=0), axis=-1) ** 2
        # The rule that docs/reference/results.md states
        ruled = np.trapezoid(size, result.times) + TICK / 2 * (size[:, 0] - size[:, -1])
        np.testing.assert_allclose(found.values[0], ruled, rtol=1e-12)
    error, missed = found.sampling
    assert missed == 4
    assert error / 8 < abs(found.values.mean() - true) < error
    (note,) = [note for note in table.notes if "samples" in note]
    assert note.startswith("effort ∫‖τ‖² dt: an error of up to ")
    assert any(each.endswith(note.partition("up to")[2]) for each in in_latex)
    held = "they miss 4 of 5 held values, and alias a sensor's noise"
    assert note.endswith(f" (N m)² s by the distance of samples; {held}.")
    assert early.sampling[1] == 4
    assert shown.startswith("mean ‖τ‖: an error of up to ")
    assert shown.endswith(f" N m by the distance of samples; {held}.")


@pytest.mark.parametrize(("samples", "said"), [(21, ""), (41, ""), (5, "4 of 5"), (8, "3 of 4")])
def test_config_check_says_where_samples_skip_ticks(samples, said, tmp_path, invoke):
    """20 ticks: with 21 or 41 samples each of them is one."""
    time = {"duration": TICK * TICKS, "samples": samples}
    clock = {"control": {"period": TICK}, "time": time, "store": {"decimate": 2}}
    path = tmp_path / "c.yaml"
    path.write_text(yaml.safe_dump(mapping(**clock)), encoding="utf-8")
    words = " ".join(invoke("config", "check", path).stdout.split())
    assert words.count("samples skip") == words.count(f"up to {said} values") == bool(said)
    assert ("; exact: time.samples 21, store.decimate 10" in words) == (samples == 5)


def test_thinned_samples_are_all_that_a_stored_number_is_computed_from(tmp_path: Path) -> None:
    """Of 21 samples, at all ticks, five are stored: the sums are over all of them."""
    with run(tmp_path / "all", 21, []) as result:
        true = result.metric("effort")
    with run(tmp_path / "thin", 21, [], store={"decimate": 5}) as result:
        assert len(result.times) == 5
        np.testing.assert_array_equal(result.metric("effort"), true)
        assert result.per_run(QUANTITIES["effort"]).sampling == (0.0, 0)
        assert result.per_run(QUANTITIES["mean_torque"]).sampling == (0.0, 0)
        assert result.per_run(QUANTITIES["actuator_work"]).sampling[1] == 4
        assert not any("samples" in line for line in _shares(result, headline(result)))


def test_a_file_with_one_sample_is_summarised(tmp_path: Path) -> None:
    """Thinned beyond its samples; its metrics are of all of them."""
    with run(tmp_path, 21, [], store={"decimate": 30}) as result:
        assert len(result.times) == 1
        assert not any("distance of samples" in line for line in _shares(result, headline(result)))
