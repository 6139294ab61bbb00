"""Numbers per run of signals for which they are known exactly."""

import numpy as np
import pytest

from eqt_cli.components.vehicle import Vehicle
from eqt_cli.extend import SampledRuns
from eqt_cli.results.metrics import MEASURED, QUANTITIES, settling_time
from eqt_cli.results.quantity import WHOLE, Window

T, H = 20.0, 0.5
TIMES = np.linspace(0, T, 41)
RAMP = TIMES[None]
FALLING = np.exp(-2 * TIMES)[None]

EXACT = {
    # ∫t dt/T, exact for straight lines by the trapezoidal rule.
    "mean_torque": ({"torque_norm": RAMP}, T / 2),
    "mean_pose_error": ({"pose_error": RAMP}, T / 2),
    "mean_pointing_error": ({"pointing_error": RAMP}, T / 2),
    "final_pointing_error": ({"pointing_error": T + 1 - RAMP}, 1.0),
    "mean_position_error": ({"position_error": RAMP}, T / 2),
    "position_rms": ({"position_error": RAMP}, np.sqrt(T**2 / 3 + H**2 / 6)),
    "peak_position_error": ({"position_error": 3 * np.sin(np.pi * RAMP / T)}, 3.0),
    "final_position_error": ({"position_error": T + 1 - RAMP}, 1.0),
    "heading_rms": ({"heading_error": RAMP}, np.sqrt(T**2 / 3 + H**2 / 6)),
    "attitude_command_rms": ({"attitude_command_error": RAMP}, np.sqrt(T**2 / 3 + H**2 / 6)),
    "mean_velocity_error": ({"velocity_error": RAMP}, T / 2),
    "early_torque": ({"torque_norm": RAMP}, 2.5),
    # Simpson's rule is exact for parabolas; the trapezoidal rule adds T h²/6 to T³/3.
    "effort": ({"torque_norm": RAMP}, T**3 / 3),
    "squared_pose_error": ({"pose_error": RAMP}, T**3 / 3 + T * H**2 / 6),
    "peak_torque": ({"torque_norm": 3 * np.sin(np.pi * RAMP / T)}, 3.0),
    "final_pose_error": ({"pose_error": T + 1 - RAMP}, 1.0),
    "mean_attitude_error": ({"attitude_angle": RAMP}, T / 2),
    "final_attitude_error": ({"attitude_angle": T + 1 - RAMP}, 1.0),
    "peak_attitude_error": ({"attitude_angle": 3 * np.sin(np.pi * RAMP / T)}, 3.0),
    "final_velocity_error": ({"velocity_error": T + 2 - RAMP}, 2.0),
    # |⟨τ, V⟩| = |(2, 7)·(−1, 0) − t| = 2 + t, a power that flows back.
    "actuator_work": (
        {
            "torque": np.stack([2 + 0 * TIMES, 7 + 0 * TIMES, TIMES], axis=-1)[None],
            "velocity": np.broadcast_to([-1.0, 0.0, -1.0], (1, 41, 3)),
        },
        2 * T + T**2 / 2,
    ),
    # 1 − (t + 0.2)/T comes below 0.05 at 0.95 T − 0.2, between the samples at 18.5 and 19.
    "settling_time": ({"pose_error": 1 - (RAMP + 0.2) / T}, 0.95 * T - 0.2),
    "decay_rate": ({"lyapunov": FALLING}, 1.0),
    # L falls to 1 at 10 s, and then rises to 3 of the 5 that it began with.
    "lyapunov_rise": ({"lyapunov": np.interp(TIMES, [0, 10, 20], [5.0, 1.0, 3.0])[None]}, 2 / 5),
    "settled": ({"pose_error": 1 - RAMP / T}, 1.0),
    # At a limit over the first half, of 19 of 40 intervals and half of the next.
    "saturated_share": ({"at_limit": (RAMP < T / 2).astype(float)}, 19.5 / 40),
    "cut_share": ({"cut": (RAMP < T / 2).astype(float)}, 19.5 / 40),
    "propellant": ({"burnt": 2 * RAMP}, 2 * T),
    "final_stored_momentum": ({"stored_momentum": RAMP}, T),
    # Constant over the last quarter, and greater before.
    "closing_pose_error": ({"pose_error": np.where(RAMP < 0.7 * T, 9.0, 2.0)}, 2.0),
    "closing_attitude_error": ({"attitude_angle": np.where(RAMP < 0.7 * T, 9.0, 2.0)}, 2.0),
    "closing_torque": ({"torque_norm": np.where(RAMP < 0.7 * T, 9.0, 3.0)}, 3.0),
    # √(T²/3 + h²/6), as for the square of an error.
    "estimate_rms": ({"estimate_error": RAMP}, np.sqrt(T**2 / 3 + H**2 / 6)),
    "bias_rms": ({"bias_error": RAMP}, np.sqrt(T**2 / 3 + H**2 / 6)),
    "estimate_settling_time": ({"estimate_error": 1 - (RAMP + 0.2) / T}, 0.95 * T - 0.2),
    "nees_ratio": ({"nees": 3 * RAMP, "nees_dof": 6 + 0 * RAMP}, T / 4),
    # 12.59 is the 95 % limit of χ² with 6 degrees of freedom: from 12.5 at sample 25 to 13.
    "ellipsoid_share": ({"nees": RAMP, "nees_dof": 6 + 0 * RAMP}, 26 / 41),
    "final_innovation_square": ({"innovation_square": 1 + RAMP}, 1 + T),
    "final_innovation_correlation": ({"innovation_correlation": RAMP / T}, 1.0),
    "energy_residual": (
        {"lyapunov": 4 * FALLING, "energy_balance": 4 + 0.02 * np.sin(np.pi * RAMP / T)},
        0.02 / 4,
    ),
}


def measured(name, signals, window=None, times=TIMES):
    quantity = QUANTITIES[name]
    settings = {"threshold": 0.05} if quantity.settings else {}
    return quantity.measure(SampledRuns(times), signals, window or quantity.window, **settings)


def test_every_formula_of_the_table_has_a_case():
    assert set(EXACT) == {name for name, quantity in QUANTITIES.items() if quantity.of}


@pytest.mark.parametrize("name", EXACT)
def test_numbers_that_are_known_exactly_also_beside_a_run_without_them(name):
    signals, expected = EXACT[name]
    # Sums of 41 terms, and logarithms of exponentials.
    beside = {key: np.concatenate([values, np.nan * values]) for key, values in signals.items()}
    with np.errstate(invalid="ignore"):
        first, second = measured(name, beside)
    assert first == pytest.approx(expected, rel=1e-12)
    assert np.isnan(second) or name in ("final_pose_error", "final_velocity_error")


@pytest.mark.parametrize(("end", "samples", "mean"), [(20, 8, 2.5), (3, 4, 1.5)])
def test_the_first_5_s_need_no_sample_at_their_end_and_a_shorter_run_is_early(end, samples, mean):
    times = np.linspace(0, end, samples)
    found = measured("early_torque", {"torque_norm": times[None]}, times=times)
    assert found == pytest.approx(mean)


def test_any_window_of_what_has_windows():
    assert measured("effort", {"torque_norm": RAMP}, Window(5, 10)) == pytest.approx(875 / 3)
    assert measured("final_pose_error", {"pose_error": RAMP}, Window(0, 7.25)) == 7.25


def test_peaks_between_samples_are_missed():
    peak = measured("peak_torque", {"torque_norm": np.cos(np.pi * (RAMP - H / 2) / H)}, WHOLE)
    assert peak == pytest.approx([0.0], abs=1e-12)  # cos ±π/2


@pytest.mark.parametrize(
    ("error", "expected"),
    [
        ([1.0, 0.5, 0.5, 0.5, 0.2], np.nan),
        ([0.05, 0.04, 0.0, 0.05, 0.01], 0.0),
        ([1.0, 0.0, 1.0, 0.0, 0.0], 2.95),
        ([1.0, 0.0, np.nan, 0.0, 0.0], np.nan),
        ([0.0, 0.0, 0.0, 0.0, 0.06], np.nan),
    ],
)
def test_settling_is_the_last_time_through_the_threshold(error, expected):
    found = settling_time(SampledRuns(np.arange(5.0)), np.array([error]), 0.05)
    assert found == pytest.approx([expected], rel=1e-12, nan_ok=True)


def test_energy_is_relative_to_no_less_than_1_joule():
    signals = {"lyapunov": 0.01 * FALLING, "energy_balance": 0.01 + 0.002 * RAMP / T}
    assert measured("energy_residual", signals) == pytest.approx([0.002], rel=1e-9)


def test_early_is_up_to_5_s_and_no_further():
    pulse = np.where((RAMP > 2) & (RAMP < 5), 1.0, 0.0)
    later = np.where(RAMP > 5, 9.0, 0.0)
    # Half an interval beside each end of the pulse; 5 of its samples at 1.
    assert measured("early_torque", {"torque_norm": pulse + later}) == pytest.approx([5 * H / 5])


def test_closing_is_the_last_quarter_with_the_sample_at_its_start():
    """Of x = t − 15 over 15 to 20 s, 25/3 and the error of the trapezoidal rule, h²/6."""
    values = {"torque_norm": np.where(RAMP < 15, 99.0, RAMP - 15)}
    expected = np.sqrt((125 / 3 + 5 * H**2 / 6) / 5)
    assert measured("closing_torque", values) == pytest.approx([expected], rel=1e-12)


def test_work_counts_power_of_either_sign():
    torque = np.stack([np.where(TIMES < 10, 2.0, -2.0), 0 * TIMES], axis=-1)[None]
    velocity = np.stack([1.5 + 0 * TIMES, 4 + 0 * TIMES], axis=-1)[None]
    found = measured("actuator_work", {"torque": torque, "velocity": velocity})
    assert found == pytest.approx([3 * T], rel=1e-12)


@pytest.mark.parametrize(
    ("lyapunov", "rise"),
    [
        ([4.0, 3.0, 2.0, 1.0], 0.0),
        ([4.0, 3.0, 5.0, 1.0], 2 / 4),
        ([4.0, 1.0, 2.0, 3.0], 2 / 4),
        ([4.0, 6.0, 0.0, 1.0], 2 / 4),
        ([4.0, 3.0, 3.5, 1.0], 0.5 / 4),
        ([0.0, 0.0, 0.0, 0.0], 0.0),
    ],
)
def test_a_rise_is_above_the_least_before_it(lyapunov, rise):
    signals = {"lyapunov": np.array([lyapunov])}
    assert measured("lyapunov_rise", signals, times=np.arange(4.0)) == pytest.approx([rise])


def test_a_decay_rate_ends_with_the_last_digits_of_L():
    """exp(−2t) is below 1e-12 from 13.8 s on; what is behind, flat, takes no part."""
    floor = np.maximum(FALLING, 1e-13)
    assert measured("decay_rate", {"lyapunov": floor}) == pytest.approx([1.0], rel=1e-9)
    assert measured("decay_rate", {"lyapunov": 1e6 * floor}) == pytest.approx([1.0], rel=1e-9)


def test_one_sample_has_no_decay_rate():
    fallen = np.where(TIMES > 0, 0.0, 1.0)[None]
    assert np.isnan(measured("decay_rate", {"lyapunov": fallen})).all()
    two = np.where(TIMES > H, 0.0, FALLING)
    assert measured("decay_rate", {"lyapunov": two}) == pytest.approx([1.0])


@pytest.mark.parametrize(
    ("error", "found"),
    [([1.0, 0.05], 1.0), ([1.0, 0.06], 0.0), ([0.0, 0.0], 1.0), ([np.nan, 0.0], np.nan)],
)
def test_settled_ends_within_the_threshold(error, found):
    signals = {"pose_error": np.array([error])}
    settled = measured("settled", signals, times=np.arange(2.0))
    assert settled == pytest.approx([found], nan_ok=True)


def test_energy_residuals_of_either_sign_count():
    signals = {"lyapunov": 4 * FALLING, "energy_balance": 4 - 0.02 * np.sin(np.pi * RAMP / T)}
    assert measured("energy_residual", signals) == pytest.approx([0.005])


@pytest.mark.parametrize(("freedom", "limit"), [(1, 3.841459), (3, 7.814728), (18, 28.869299)])
def test_a_sample_is_within_the_ellipsoid_below_the_limit_of_its_degrees_of_freedom(freedom, limit):
    """The 95 % limits of χ², of a table; without a degree of freedom, nothing is within."""
    square = np.array([[limit - 1e-5, limit + 1e-5, limit - 1e-5, 0.0]])
    count = np.array([[freedom, freedom, freedom, 0.0]])
    signals = {"nees": square, "nees_dof": count}
    assert measured("ellipsoid_share", signals, times=np.arange(4.0)) == [0.5]
    signals = {"nees": np.array([[np.nan, 0.0]]), "nees_dof": np.array([[1.0, 1.0]])}
    assert np.isnan(measured("ellipsoid_share", signals, times=np.arange(2.0))).all()


def test_a_rate_is_that_of_each_run():
    """Of three runs; the samples of the second count up to its fall only, the third has none."""
    lyapunov = np.stack([np.exp(-2 * TIMES), np.exp(-0.6 * TIMES), 0 * TIMES])
    lyapunov[1, 21:] = 0.0
    lyapunov[1, 30:] = 5.0
    found = measured("decay_rate", {"lyapunov": lyapunov})
    assert found == pytest.approx([1.0, 0.3, np.nan], rel=1e-9, nan_ok=True)


def test_some_numbers_only_say_more_of_a_vehicle():
    flown = (
        "settled saturated_share cut_share propellant final_stored_momentum closing_pose_error "
        "closing_torque "
        "estimate_rms bias_rms estimate_settling_time nees_ratio ellipsoid_share "
        "final_innovation_square final_innovation_correlation"
    ).split()
    assert [quantity.name for quantity in MEASURED if not quantity.stored_of(Vehicle())] == flown


def test_what_is_known_of_numbers_besides_their_values():
    def those(of):
        return {quantity.name for quantity in QUANTITIES.values() if of(quantity)}

    assert those(lambda row: row.censored) == {"settling_time", "estimate_settling_time"}
    assert those(lambda row: row.counts) == {"settled"}
    assert those(lambda row: row.better == "higher") == {"decay_rate", "settled"}
    assert those(lambda row: row.implied_by) == {"settled"}
