"""Rotors from rest, noise of motors, failures at drawn times: closed forms and a plain program."""

import numpy as np
import pytest
import yaml
from case_tables import refusal
from said import mentions
from scipy.integrate import solve_ivp

from eqt_cli.base.errors import ConfigError

MASS, PUSH, K, LAG = 2.0, 3.0, 1e-4, 0.08
ROTORS = {
    "kind": "thrusters",
    "matrix": [[1.0, 1.0]],
    "thrust_constant": K,
    "high_speed": 400.0,
    "low_speed": 0.0,
    "time_constant": LAG,
}
TEXT = {
    "group": "R1",
    "inertia": MASS,
    "gains": {"kp": 1e-14, "kd": 1e-14},  # the law commands 3 N, of which each rotor gives half
    "reference": {"kind": "torque", "torque": [PUSH]},
    "controllers": ["eqt"],
    "initial": {"pose": {"kind": "identity"}},
    "time": {"duration": 1.0, "samples": 11},
    "ensemble": {"runs": 3, "seed": 3},
}
ENGINES = ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles"))]


def flown(solved, engine, **options):
    """Times, positions of all runs, and the numbers of all runs."""
    solver = {"engine": engine, "rtol": 1e-11, "atol": 1e-13}
    text = TEXT | {"actuators": [ROTORS | options], "solver": solver}
    problem, solution = solved(yaml.safe_dump(text))
    places = problem.loop.tracking(problem.times, solution.states).Q[..., 0, -1]
    return problem.times, places, problem.leaves_of_runs()


@pytest.mark.parametrize("engine", ENGINES)
def test_rotors_start_from_rest(solved, engine):
    """Speeds rise by 1 − e^(−t/T), so that thrusts do by its square."""
    t, places, _ = flown(solved, engine, start=0)
    E = np.exp(-t / LAG)
    rise = t**2 / 2 - 2 * LAG * (t - LAG * (1 - E)) + LAG / 2 * (t - LAG / 2 * (1 - E * E))
    np.testing.assert_allclose(places, np.tile(PUSH / MASS * rise, (3, 1)), rtol=0, atol=1e-10)
    running = flown(solved, engine)[1]  # by default they run
    np.testing.assert_allclose(running[0], PUSH / MASS * t**2 / 2, rtol=0, atol=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_a_thrust_without_rotors_starts_where_it_is_said(solved, engine):
    """f = 1.5 + (f_0 − 1.5) e^(−t/T) of each."""
    plain = {"thrust_constant": None, "high_speed": None, "low_speed": None}
    t, places, _ = flown(solved, engine, **plain, start=[0.5, 2.0])
    lost = (PUSH - 2.5) / MASS * LAG * (t - LAG * (1 - np.exp(-t / LAG)))
    np.testing.assert_allclose(places[0], PUSH / MASS * t**2 / 2 - lost, rtol=0, atol=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
@pytest.mark.parametrize("key", ["efficiency_from", "fails"])
def test_an_efficiency_begins_at_a_drawn_time(solved, engine, key):
    """From then on a rotor gives 0.4 of 1.5 N, behind its lag: of speeds √0.4."""
    when = {"uniform": [0.2, 0.7]}
    options = {key: when, "efficiency": [0.4, 1]}
    if key == "fails":
        options = {key: {"rotor": 1, "at": when, "to": 0.4}}
    t, places, numbers = flown(solved, engine, **options)
    begins = numbers["vehicle.actuators[0].presence.since"]
    assert np.ptp(begins) > 0.05
    s, a = np.clip(t - begins, 0, None), 1 - np.sqrt(0.4)
    # (1 − a (1 − E))² = (1 − a)² + 2 a (1 − a) E + a² E² with E = e^(−s/T)
    E = np.exp(-s / LAG)
    twice = [s**2 / 2, LAG * (s - LAG * (1 - E)), LAG / 2 * (s - LAG / 2 * (1 - E * E))]
    weights = (1 - a) ** 2 - 1, 2 * a * (1 - a), a * a
    lost = sum(w * x for w, x in zip(weights, twice, strict=True)) * PUSH / 2 / MASS
    np.testing.assert_allclose(places, PUSH / MASS * t**2 / 2 + lost, rtol=0, atol=1e-10)


@pytest.mark.parametrize("engine", ENGINES)
def test_noise_of_motors_is_added_to_the_speeds_of_rotors(solved, engine):
    """k (η + n)² by a plain program, n from the phases of the run; its variance is σ²."""
    t, places, numbers = flown(solved, engine, noise={"std": 20.0, "time_constant": 0.1})
    waves = {
        name: numbers[f"vehicle.actuators[0].waves.{name}"]
        for name in ("frequency", "sine", "cosine")
    }
    power = (waves["sine"] ** 2 + waves["cosine"] ** 2).sum(axis=1) / 2
    np.testing.assert_allclose(power, 400.0, rtol=1e-12)
    speed = np.sqrt(PUSH / 2 / K)
    for run in range(2):
        omega, sine, cosine = (waves[name][run] for name in ("frequency", "sine", "cosine"))

        def rate(time, x, omega=omega, sine=sine, cosine=cosine):
            n = np.sin(omega * time) @ sine + np.cos(omega * time) @ cosine
            return [x[1], (K * (speed + n) ** 2).sum() / MASS]

        found = solve_ivp(rate, (0, 1), [0, 0], method="DOP853", t_eval=t, rtol=1e-12, atol=1e-13)
        np.testing.assert_allclose(places[run], found.y[0], rtol=0, atol=1e-9)
    assert np.abs(places[0] - places[1]).max() > 1e-3


@pytest.mark.parametrize(
    ("options", "said"),
    [
        ({"start": [0, 0, 0]}, "start: expected 2 entries, one for each thruster, got 3"),
        ({"start": -5}, "start: expected a number within the limits, 0 to 400, got -5"),
        ({"start": 500}, "start: expected a number within…got 500"),
        ({"start": 0, "time_constant": None}, "start: needs time_constant…"),
        ({"noise": {"std": -1, "time_constant": 0.1}}, "noise.std: expected at least 0…got -1"),
        ({"noise": {"std": 1, "time_constant": 0}}, "noise.time_constant: expected a number gre…"),
        ({"noise": 20}, "noise: expected a mapping…"),
        ({"efficiency_from": 2}, "efficiency_from: needs efficiency…"),
        ({"fails": {"rotor": 1, "at": {"uniform": [2, 1]}}}, "fails.at.uniform: expected the sm…"),
        ({"fails": {"rotor": 1, "at": -1}}, "fails.at: expected at least 0 s, got -1 s"),
    ],
)
def test_what_is_no_motor_is_refused(experiment_of, options, said):
    text = yaml.safe_dump(TEXT | {"actuators": [ROTORS | options]})
    assert mentions(refusal(ConfigError, experiment_of, text), f"actuators[0].{said}")
