"""Recordings that eqt itself has made of a plant whose numbers are known."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation

import eqt_cli

RELATIVE, DRAG = 0.2, {"SO3": [0.05] * 3, "SE3": [0.05] * 3 + [2.0] * 3}
"""What is true of the plant, and what its model does not know."""

NOISE = {"rotation": 0.002, "place": 0.002, "rate": 0.004, "velocity": 0.01}
"""Standard deviations, rad, m, rad/s and m/s."""

NAMES = {"SO3": "t qx qy qz qw wx wy wz tx ty tz", "SE3": " x y z vx vy vz fx fy fz"}


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)


def model(group: str, **changes: Any) -> dict[str, Any]:
    """The configuration of a plant with a wrong inertia and no drag."""
    m = len(DRAG[group])
    return {
        "name": "model",
        "group": group,
        "inertia": [0.26, 0.26, 0.37, 18.0, 18.0, 18.0][:m],
        "gains": {"kp": 2.0, "kd": 1.5},
        "reference": {"kind": "constant"},
        "controllers": ["eqt"],
        "time": {"duration": 1.0, "samples": 2},
        "solver": {"engine": "native"},
        "plant": {"inertia": {"relative": 0.0}, "forces": [{"kind": "drag", "linear": [0.0] * m}]},
    } | changes


def true_plant(group: str) -> dict[str, Any]:
    return {"inertia": {"relative": RELATIVE}, "forces": [{"kind": "drag", "linear": DRAG[group]}]}


@cache
def flight(group: str, duration: float, period: float) -> dict[str, Any]:
    """Times, poses, velocities and commands of a run with sampled control, exact."""
    folder = Path("flights", f"{group}-{duration}-{period}")
    rates = ["0.6*cos(t)", "0.5*sin(1.3*t)", "0.4*cos(0.7*t)", "0.8*sin(t)", "0.6*cos(1.2*t)", "0"]
    config = model(
        group,
        reference={"kind": "rates", "rates": rates[: len(DRAG[group])]},
        plant=true_plant(group),
        control={"period": period},
        time={"duration": duration, "samples": round(duration / period) + 1},
        solver={"cross_check": 0, "error_estimate": False},
    )
    data = eqt_cli.run(config, folder).to_xarray()
    names = ("pose", "velocity", "torque")
    return {"time": data.time.values} | {name: data[name].values[0, 0] for name in names}


@pytest.fixture
def recorded(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Callable[..., Path]:
    """Writes a recording of a flight, with noise of a seed, as a CSV file without these rows.

    `slow` is the correlation of the noise from row to row. The wrench is `late` by so many rows.
    """
    monkeypatch.chdir(tmp_path)

    def write(
        group: str = "SO3",
        *,
        duration: float = 4.0,
        period: float = 0.04,
        noise: float = 1.0,
        slow: float = 0.0,
        late: int = 0,
        seed: int = 0,
        without: tuple[int, int] = (0, 0),
        named: str = "flight.csv",
        columns: str = "",
    ) -> Path:
        exact, random = flight(group, duration, period), np.random.default_rng(seed)

        def noisy(values: Any, size: float) -> Any:
            white = random.normal(size=values.shape)
            white[1:] *= np.sqrt(1 - slow**2)  # noise of one size, of the first order in time
            return values + noise * size * lfilter([1.0], [1.0, -slow], white, axis=0)

        Q, V, torque = exact["pose"], exact["velocity"], np.roll(exact["torque"], late, axis=0)
        turned = Rotation.from_rotvec(noisy(np.zeros((len(Q), 3)), NOISE["rotation"]))
        R = (Rotation.from_matrix(Q[:, :3, :3]) * turned).as_quat()
        parts = [exact["time"][:, None], R, noisy(V[:, :3], NOISE["rate"]), torque[:, :3]]
        names = NAMES["SO3"]
        if group == "SE3":
            places = noisy(Q[:, :3, 3], NOISE["place"])
            parts += [places, noisy(V[:, 3:], NOISE["velocity"]), torque[:, 3:]]
            names += NAMES["SE3"]
        rows = np.delete(np.hstack(parts), slice(*without), axis=0)
        kept = [name in (columns or names).split() for name in names.split()]
        header = ",".join(np.array(names.split())[kept])
        np.savetxt(named, rows[:, kept], delimiter=",", header=header, comments="", fmt="%.17g")
        return tmp_path / named

    return write


# Flights that are not read ----------------------------------------------------------------------


A, B = [0.21, 0.30, 0.22, 0.19, 0.25, 0.24], [0.28, 0.29, 0.37, 0.33, 0.31, 0.32]
T = np.arange(0.0, 15.0, 0.1)


@pytest.fixture
def fly(monkeypatch):
    """Makes flights of constant errors, as if they were read; returns the names of both sides."""
    from eqt_cli.extensions.flights import api
    from eqt_cli.extensions.logs.logs import Flight, Series, TrackingErrors
    from eqt_cli.extensions.logs.readers import Topic

    read = {}
    monkeypatch.setattr(api, "log_errors", lambda path, **how: read[path.name])

    def one(name, error=0.3, t=T, goal=T, settings=(), speed=1.0, topic="p − s", more=()):
        rows = np.outer(np.broadcast_to(error, t.shape), [1.0, 1, 0, 0])
        curves = {"position": (t, rows)} | {q: (t, np.outer(x + 0 * t, [1.0])) for q, x in more}
        goals = {"position": Series("s", goal, np.outer(goal, [speed, 0.0, 0.0]))}
        log = Flight(name, "ulog", [Topic("", "", 0, T, {}, "", [*settings])])
        read[name] = TrackingErrors([], curves, {"position": topic}, goals=goals, flight=log)
        Path(name).write_text(name)
        return name

    def many(a=A, b=B, in_a=(), in_b=(), **every):
        of_a = [one(f"a{k}.ulg", x, settings=in_a, **every) for k, x in enumerate(a)]
        return of_a, [one(f"b{k}.ulg", x, settings=in_b, **every) for k, x in enumerate(b)]

    many.one = one
    return many
