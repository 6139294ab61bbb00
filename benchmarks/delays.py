"""`python -m benchmarks.delays`: false alarms and coverage of the delays of `eqt log errors`.

Each cell has 4,000 trials, whose true delay is known by construction: 20 s of a motion at 10 Hz.
Arguments choose cells by their names.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from scipy.signal import lfilter
from scipy.spatial.transform import Rotation
from scipy.stats import t as student

from eqt_cli.extensions.logs.delay import BLOCKS
from eqt_cli.extensions.logs.logs import Series, tracking_errors

TRIALS, SECONDS, LATE = 4000, 20.0, 0.05


def circle(t: Any) -> Any:
    """A circle of constant speed, which tells no delay from a turn of the frame."""
    return np.c_[np.cos(0.5 * t), np.sin(0.5 * t), 1 + 0 * t]


def wave(t: Any) -> Any:
    """A motion with several frequencies."""
    return np.c_[np.cos(0.8 * t), np.sin(1.3 * t), 1 + 0.3 * np.sin(0.9 * t)]


def turns(t: Any) -> Any:
    """An attitude that yaws, and rolls and pitches a little."""
    angles = np.c_[0.9 * t, 0.3 * np.sin(1.1 * t), 0.3 * np.cos(0.8 * t)]
    return Rotation.from_euler("ZYX", angles)


class Cell(NamedTuple):
    """A motion, its noise (of the wanted one, too), and what else is wrong with the frame."""

    name: str
    motion: Callable[[Any], Any]
    rate: float = 7.0
    """Of the wanted motion, Hz; at 10 Hz it has the instants of the measured one."""
    noise: float = 0.02
    memory: float = 0.0
    """Time constant of the noise, s."""
    wanted_noise: float = 0.0
    yaw: float = 0.0
    """Turn of the measured frame, deg."""
    offset: float = 0.0
    drift: float = 0.0


CELLS = [
    Cell("circle", circle),
    Cell("circle, same instants", circle, rate=10.0),
    Cell("wave", wave),
    Cell("wave, same instants", wave, rate=10.0),
    Cell("wave, noise of 0.3 s", wave, memory=0.3),
    Cell("wave, both noisy", wave, wanted_noise=0.02),
    Cell("wave, offset 0.2 m per axis, yaw 5 deg", wave, offset=0.2, yaw=5.0),
    Cell("wave, clock 0.1 % slow", wave, drift=1e-3),
    Cell("attitude, yaw 5 deg", turns, yaw=5.0),
]


def trial(cell: Cell, late: float, seed: int) -> tuple[float, float, bool]:
    """Return the delay and its standard error, NaN if none is named, and if it has alternatives."""
    draw = np.random.default_rng([seed, round(1e3 * late)])
    t = np.arange(0.0, SECONDS, 0.1) + draw.uniform(0, 0.1)
    s = t if cell.rate == 10.0 else np.arange(0.0, SECONDS, 1 / cell.rate) + draw.uniform(0, 0.1)
    flown = cell.motion(t - late - cell.drift * (t - SECONDS / 2))
    wanted, turn = cell.motion(s), Rotation.from_euler("z", cell.yaw, degrees=True)
    keep = np.exp(-0.1 / cell.memory) if cell.memory else 0.0
    first = draw.normal(size=(len(t) + 50, 3)) * np.sqrt(1 - keep**2)
    noise = cell.noise * lfilter([1.0], [1.0, -keep], first, axis=0)[50:]
    if cell.motion is turns:
        quantity = "attitude"
        flown = (turn * flown * Rotation.from_rotvec(noise)).as_quat(scalar_first=True)
        wanted = wanted.as_quat(scalar_first=True)
    else:
        quantity = "position"
        flown = turn.apply(flown) + cell.offset + noise
        wanted = wanted + cell.wanted_noise * draw.normal(size=wanted.shape)
    two = ({quantity: Series("", *each)} for each in ((t, flown), (s, wanted)))
    size = tracking_errors("", *two).sizes[0]
    return size.delay, size.delay_error, "does not tell" in size.remark


def shares(cell: Cell, late: float) -> str:
    """Return how often a delay is named, and how often its 95 % interval has the true one."""
    delay, error, doubt = np.array([trial(cell, late, seed) for seed in range(TRIALS)]).T
    is_named = np.isfinite(delay)
    covered = abs(delay - late) <= student.ppf(0.975, BLOCKS - 1) * error
    numbers = is_named.mean(), (doubt * is_named).mean(), covered.sum() / max(is_named.sum(), 1)
    return " | ".join(f"{100 * number:.1f}" for number in numbers)


if __name__ == "__main__":
    columns = "named %, as one of two causes %, true one in the 95 % interval %"
    print(f"cell | without a delay: {columns} | at {LATE} s: {columns}")
    for cell in CELLS:
        if not sys.argv[1:] or cell.name in sys.argv[1:]:
            print(" | ".join([cell.name, shares(cell, 0.0), shares(cell, LATE)]), flush=True)
