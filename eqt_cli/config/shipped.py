"""Finds the configurations that are shipped with eqt, and writes first ones of vehicles."""

from collections.abc import Iterator, Sequence
from math import pi
from pathlib import Path
from string import Template
from typing import Any

from eqt_cli.base.errors import EqtError, suggestion


def folder() -> Path:
    """Return the folder of the shipped configurations."""
    package = Path(__file__).parents[1]
    in_wheel = package / "configs"
    return in_wheel if in_wheel.is_dir() else package.parent / "configs"


def names() -> list[str]:
    """Return the names of the shipped configurations."""
    return sorted(path.stem for path in folder().glob("*.yaml"))


def text(name: str) -> str:
    """Return the text of a shipped configuration."""
    if name not in names():
        hint = suggestion(name, names()) or f"; shipped are: {', '.join(names())}"
        raise EqtError(f"unknown configuration '{name}'{hint}")
    return (folder() / f"{name}.yaml").read_text(encoding="utf-8")


def summary(name: str) -> str:
    """Return the first sentence of a shipped configuration; of a long one, up to a colon."""
    from eqt_cli.base.yaml_source import heading  # slow to import, and most commands need no list

    return heading(text(name))


def using(kind: str) -> tuple[str, Any]:
    """Return a shipped configuration with a component, and its shortest part with it; or nothing.

    The part is a mapping as in the configuration, without other keys beside the component.
    """
    import yaml  # loaded by no help page

    examples = [
        (name, {key: part})
        for name in names()
        if kind in text(name)  # parsing all of them takes 0.3 s
        for key, value in yaml.safe_load(text(name)).items()
        for part in _parts(value, kind, by_key=key == "sweep")
    ]
    return min(examples, key=lambda pair: len(str(pair[1])), default=("", {}))


def _parts(data: Any, kind: str, *, by_key: bool) -> Iterator[Any]:
    """Yield the parts of a value with a component: by ``kind: NAME``, a name alone, or a key."""
    if data == kind:
        yield data
    elif isinstance(data, list):
        yield from ([part] for item in data for part in _parts(item, kind, by_key=by_key))
    elif isinstance(data, dict) and (data.get("kind") == kind or (by_key and kind in data)):
        yield data
    elif isinstance(data, dict):
        inner = ((key, _parts(value, kind, by_key=by_key)) for key, value in data.items())
        yield from ({key: part} for key, parts in inner for part in parts)


# A first configuration of a vehicle, with gains that follow from its inertia ----------------------


GRAVITY = 9.81
"""m/s²."""

VEHICLES = {"quadrotor": 3, "satellite": 3, "auv": 3, "boat": 1}
"""The vehicles, and how many moments of inertia each has."""

FOLDER = Path(__file__).with_name("templates")


def first_file(vehicle: str, mass: float | None, inertia: Sequence[float], poles: float) -> str:
    """Return a configuration as text, with gains by `attitude_gains`.

    Positions follow likewise, with the mass in the place of J; those of a quadrotor at ω/5.

    Parameters
    ----------
    vehicle
        One of `VEHICLES`.
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
    if vehicle not in VEHICLES:
        raise EqtError(f"--vehicle: expected {', '.join(VEHICLES)}, got '{vehicle}'")
    import numpy as np  # loaded by no help page

    count, m, whole = VEHICLES[vehicle], mass or 0.0, len(inertia) == 6
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


SPREAD = 0.98
"""Largest stiffness about a principal axis relative to the sum of the others, for K > 0."""


def attitude_gains(J: Any, poles: float) -> tuple[Any, Any]:
    """Return weights K and damping K_d by which small errors of an attitude have both poles at −ω.

    They obey J ε̈ + K_d ε̇ + k ε = 0 with k = J ω² and K_d = 2 J ω. The weights K of the navigation
    function give the stiffness tr(K) I − K, so that K = tr(k)/2 I − k; in a plane, where both turn
    the same axis, K_i = k/2. About an axis whose moment is that of the others together, or more, k
    and with it both poles are smaller.

    Parameters
    ----------
    J : (3, 3), or (1, 1) in a plane
        kg m².
    poles
        ω, rad/s.
    """
    import numpy as np  # loaded by no help page

    moments, axes = np.linalg.eigh(J)
    stiffness = moments * poles**2
    if len(J) == 1:
        return np.diag([stiffness[0] / 2] * 2), 2 * J * poles
    stiffness[-1] = min(stiffness[-1], SPREAD * stiffness[:-1].sum())
    weights, damping = stiffness.sum() / 2 - stiffness, 2 * np.sqrt(moments * stiffness)
    return axes * weights @ axes.T, axes * damping @ axes.T


def block(matrix: Any, diagonal: Sequence[float]) -> Any:
    """Return a matrix with more numbers on its diagonal."""
    import numpy as np  # loaded by no help page

    size = len(matrix)
    whole = np.diag([*np.diag(matrix), *diagonal])
    whole[:size, :size] = matrix
    return whole


NEGLIGIBLE = 1e-3
"""Numbers off the diagonal, relative to the largest, that a written matrix leaves out."""


def written(value: Any) -> str:
    """Return a number, a list or a symmetric matrix as YAML, to four digits."""
    import numpy as np  # loaded by no help page

    numbers = np.asarray(value, dtype=float)
    if numbers.ndim == 2:
        small = NEGLIGIBLE * np.abs(numbers).max()
        off = np.abs(numbers - np.diag(np.diag(numbers))).max(initial=0.0)
        numbers = np.diag(numbers) if off <= small else (numbers + numbers.T) / 2
    if numbers.ndim == 0:
        return f"{numbers:.4g}"
    return f"[{', '.join(map(written, numbers))}]"
