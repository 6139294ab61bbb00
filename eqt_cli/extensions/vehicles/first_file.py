"""`eqt config new --vehicle`: a first configuration, with gains that follow from the inertia."""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from json import loads
from math import pi
from pathlib import Path
from string import Template
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.cli.lookup import VEHICLE_FILES, VEHICLES
from eqt_cli.extensions.vehicles.gains import attitude_gains, block, written

NUMBERS = ("mass", "inertia")
"""Options that a file of a vehicle has itself."""


@purposes.configuration_of_a_vehicle
def configuration_of_a_vehicle(
    source: str | None, options: Mapping[str, Any]
) -> tuple[str, str, list[str]]:
    """Return the configuration of a vehicle from its numbers or its file, a name, and lines on it.

    Parameters
    ----------
    source
        The file, or what else `--from` names.
    options
        The other options of `eqt config new` that have a value, by name.

    Raises
    ------
    EqtError
        For options that do not go together, and for wrong numbers.
    """
    is_file = Path(source or "").suffix in VEHICLE_FILES
    vehicle, bandwidth = options.get("vehicle"), options.get("bandwidth")
    of_file = {x: options[x] for x in options if x not in ("vehicle", "bandwidth", *NUMBERS)}
    if of_file and not is_file:
        raise EqtError(f"--{next(iter(of_file))} is of a vehicle from a file; add --from FILE")
    if not is_file and vehicle is None:
        names = " | ".join(VEHICLES)
        raise EqtError(f"--{next(iter(options))} applies to vehicles only; add --vehicle {names}")
    if not is_file and source is not None:
        raise EqtError("--vehicle replaces --from; leave one of them out")
    if bandwidth is None:
        what = f"--from {source}" if is_file else f"--vehicle {vehicle}"
        raise EqtError(f"{what} needs --bandwidth, in rad/s, such as 5")
    if vehicle is not None and source is None:
        moments = _moments(options.get("inertia", ""))
        return first_file(vehicle, options.get("mass"), moments, bandwidth), vehicle, []
    if superfluous := next((name for name in NUMBERS if name in options), ""):
        raise EqtError(f"--{superfluous}: the file has these numbers; leave this option out")
    from eqt_cli.extensions.vehicles.vehicle_file import configuration_of  # slow to import

    file = Path(str(source))
    text, facts = configuration_of(file, bandwidth=bandwidth, kind=vehicle, **of_file)
    return text, file.name.partition(".")[0], facts


def _moments(text: str) -> list[float]:
    try:
        return [float(number) for number in text.split(",")] if text else []
    except ValueError:
        with suppress(ValueError, TypeError):
            (a, b, c), (_, d, e), (_, _, f) = loads(text)
            six = ",".join(f"{number:g}" for number in (a, b, c, d, e, f))
            raise EqtError(
                f"--inertia: expected ixx,ixy,ixz,iyy,iyz,izz, got '{text}'; write {six}"
            ) from None
        raise EqtError(
            "--inertia: expected numbers such as 0.1,0.2,0.25, or with products "
            f"ixx,ixy,ixz,iyy,iyz,izz, got '{text}'"
        ) from None


GRAVITY = 9.81
"""m/s²."""

MOMENTS = dict.fromkeys(VEHICLES, 3) | {"boat": 1}
"""The number of moments of inertia by vehicle."""

FOLDER = Path(__file__).with_name("templates")


def first_file(vehicle: str, mass: float | None, inertia: Sequence[float], poles: float) -> str:
    """Return a configuration as text, with gains by `attitude_gains`.

    Positions follow likewise, with the mass in the place of J; those of a quadrotor at ω/5.

    Parameters
    ----------
    vehicle
        One of `MOMENTS`.
    mass
        kg; None for a satellite.
    inertia
        Principal moments of inertia J, kg m²; of a boat the one about the vertical. In space also
        six numbers, ixx, ixy, ixz, iyy, iyz and izz.
    poles
        ω, rad/s.

    Raises
    ------
    EqtError
        For a number that is not positive or is missing, and for moments of no rigid body.
    """
    if vehicle not in MOMENTS:
        raise EqtError(f"--vehicle: expected {', '.join(MOMENTS)}, got '{vehicle}'")
    count, m, whole = MOMENTS[vehicle], mass or 0.0, len(inertia) == 6
    J = np.diag(inertia)
    if whole and count > 1:
        J = np.zeros((3, 3))
        J[np.triu_indices(3)] = inertia
        J += np.triu(J, 1).T
    moments = np.linalg.eigvalsh(J).tolist() if len(J) == count else [0.0]
    if not min(moments) > 0:
        example = "0.1,0.2,0.25, or ixx,ixy,ixz,iyy,iyz,izz" if count > 1 else "20"
        raise EqtError(f"--inertia: expected {count} positive kg m² of a {vehicle}, as {example}")
    if count > 1 and not 2 * max(moments) < sum(moments):
        raise EqtError("--inertia: each moment of a rigid body is less than the sum of the others")
    if vehicle != "satellite" and not m > 0:
        raise EqtError(f"--mass: expected the mass of the {vehicle} in kg, such as 1.2")
    if not poles > 0:
        raise EqtError(f"--bandwidth: expected a positive number in rad/s, got {poles:g}")
    weights, damping = attitude_gains(J, poles)
    slow = poles / 5 if vehicle == "quadrotor" else poles
    axes, end = len(weights), 12 * pi / slow
    of_body = f"{{ urdf: {written(inertia)}" if whole else ""
    numbers: dict[str, Any] = {
        "m": m,
        "weight": m * GRAVITY,
        "K": weights,
        "kp": block(weights, [m * slow**2]),
        "turn": damping,
        "kd": block(damping, [2 * m * slow] * axes),
        "kx": slow**2,
        "kv": 2 * slow,
        "path": slow / 3,
        "omega": poles,
        "start": end / 12,
        "duration": end / 2,
        "end": end,
    }
    texts = {name: written(number) for name, number in numbers.items()}
    texts["J"] = f"{of_body} }}" if whole else written(inertia)
    texts["all"] = f"{of_body}, mass: {m:.4g} }}" if whole else written([*inertia, *[m] * axes])
    template = Template((FOLDER / f"{vehicle}.yaml").read_text(encoding="utf-8"))
    return template.substitute(texts)
