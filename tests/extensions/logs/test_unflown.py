"""Rows that were not flown: lost telemetry, jumps, and a law that is switched off."""

import numpy as np
import pytest

import eqt_cli

T = np.arange(0.0, 12.0, 0.02)
WANTED = np.c_[np.cos(T), np.sin(1.3 * T), 1 + 0.1 * np.sin(T)]
FLOWN = WANTED + np.c_[0.1 * np.sin(3 * T), 0.05 * np.cos(2 * T), 0 * T + 0.02]


def write(header, *columns, name="f.csv"):
    np.savetxt(name, np.column_stack(columns), "%.17g", ",", header=header, comments="")


def rms_of(rows):
    return pytest.approx(np.sqrt(np.mean(np.sum((FLOWN - WANTED)[rows] ** 2, axis=1))), rel=1e-9)


# Lost telemetry -----------------------------------------------------------------------------------


def lossy(last):
    """Eight columns, of which most go on along their last slope from row `last`."""
    columns = [np.sin((1 + 0.1 * k) * T + k) for k in range(8)]
    for column in columns:
        column[last:] = column[last - 1] + (column[last - 1] - column[last - 2]) * np.arange(
            1, len(T) - last + 1
        )
    write("t,x,y,z,x_ref,y_ref,z_ref,a,b,c,d,e", T, FLOWN, np.stack(columns, axis=-1))
    return np.stack(columns[:3], axis=-1)


def test_rows_after_the_telemetry_are_left_out_and_named():
    wanted = lossy(400)
    words = "8 columns go straight on in the last 200 rows, from 7.98 s: telemetry was lost there"
    check, errors = eqt_cli.check_log("f.csv"), eqt_cli.log_errors("f.csv")
    assert [x for x in check.notes if x.startswith(words)]
    assert (check.rows, check.end) == (400, pytest.approx(7.98))
    assert errors.remarks[0].startswith(words)
    rms = np.sqrt(np.mean(np.sum((FLOWN - wanted)[:400] ** 2, axis=1)))
    assert errors.sizes[0].rms == pytest.approx(rms, rel=1e-9)
    until = {"time": {"end": 9.0}}  # who states an end has decided
    assert eqt_cli.check_log("f.csv", until).rows == 451


def test_straight_lines_of_slow_telemetry_are_no_loss():
    slow = np.stack([np.interp(T, T[::40], np.sin(T[::40] + k)) for k in range(8)], axis=-1)
    write("t,x,y,z,a,b,c,d,e,f,g,h", T, FLOWN, slow)
    assert not [x for x in eqt_cli.check_log("f.csv").notes if "telemetry" in x]


# Jumps --------------------------------------------------------------------------------------------


def test_rows_at_zero_and_jumps_are_left_out():
    flown, glitches = FLOWN.copy(), [100, 101, 102, 350]
    flown[100:103], flown[350] = 0.0, flown[350] + [0.0, 0.5, 0.0]
    write("t,x,y,z,x_ref,y_ref,z_ref", T, flown, WANTED)
    errors = eqt_cli.log_errors("f.csv")
    speed = max(np.linalg.norm(FLOWN[[99, 103]], axis=1)) / 0.02
    words = f"positions jump by up to {speed:.3g} m/s at 2, 7 s: 4 rows left out, 3 of them at 0"
    assert words in errors.remarks
    assert words in eqt_cli.check_log("f.csv").notes
    # Left-out instants are interpolated between their neighbours: 1 to 3 rows of 600
    assert errors.sizes[0].rms == pytest.approx(
        rms_of(np.setdiff1d(np.arange(600), glitches)).expected, rel=1e-3
    )
    assert eqt_cli.check_log("f.csv").rows == 596


@pytest.mark.parametrize(
    "odd",
    [
        lambda p: p * np.minimum(T, 3.0)[:, None] * 20,  # 100 m/s at the end, but smoothly
        lambda p: p + np.where(T > 6, 1.0, 0.0)[:, None],  # an estimator that is set anew
        lambda p: p + 1e-3 * np.random.default_rng(0).normal(size=p.shape),
        lambda p: p[np.arange(len(p)) // 5 * 5],  # motion capture of 10 Hz in rows of 50 Hz
    ],
)
def test_fast_flights_resets_noise_and_held_rows_are_no_jumps(odd):
    write("t,x,y,z", T, odd(FLOWN))
    assert eqt_cli.check_log("f.csv").rows == 600


# The end ------------------------------------------------------------------------------------------


def test_a_law_that_is_switched_off_in_the_last_rows_is_left_out():
    wanted = WANTED.copy()
    wanted[-2:] = 0.0
    write("t,x,y,z,x_ref,y_ref,z_ref", T, FLOWN, wanted)
    errors = eqt_cli.log_errors("f.csv")
    assert errors.sizes[0].rms == rms_of(slice(598))
    words = "setpoints or commands step as nowhere before at 11.96 s, as where a law is switched "
    assert f"{words}off: 2 rows at the end left out" in errors.remarks


def test_setpoints_that_are_held_step_as_before():
    """Of 10 Hz beside 50 Hz; the last one counts as those before."""
    write("t,x,y,z,x_ref,y_ref,z_ref", T, FLOWN, WANTED[np.arange(600) // 5 * 5])
    assert not eqt_cli.log_errors("f.csv").remarks
