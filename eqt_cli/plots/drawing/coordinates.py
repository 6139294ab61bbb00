"""Coordinates of poses, velocities and wrenches as curves: symbols, units and values."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.plots.drawing.labels import component, in_words, quantity


def axis_labels(G: MatrixLieGroup) -> list[str]:
    """Return the label of the k-th curve of a panel: a direction, or axis names in all parts.

    ``x`` stands for ωx and vx: the scales name the quantity.
    """
    names = [G.axis_names[part.axes] for part in G.parts]
    found = []
    for k in range(max(map(len, names))):
        here = [axes[k] for axes in names if k < len(axes)]
        directions = {axis[1:] for axis in here}
        shown = directions if len(directions) == 1 and "" not in directions else here
        found.append(", ".join(f"${component('', each).lstrip('_')}$" for each in shown))
    return found


def symbols(G: MatrixLieGroup, part: Part, index: str = "") -> tuple[str, str, str]:
    """Return the symbols of pose, velocity and force in a part, with an index if given."""
    vectors = [each for each in G.parts if not each.turns]
    if len(G.parts) == 1 or not (part.turns or part.pose_unit.startswith("m")):
        pose, velocity, force = ("p" if part.pose_unit == "m" else "Q"), "V", r"\tau"
    elif part.turns:
        pose, velocity, force = "R", r"\omega", r"\tau"
    elif len(vectors) == 1:
        pose, velocity, force = "p", "v", "f"
    else:
        initial = part.name[0]
        pose, velocity = initial, str(G.axis_names[part.axes][0])[0]
        return _indexed(pose, index), _indexed(velocity, index), _indexed("f", initial + index)
    return _indexed(pose, index), _indexed(velocity, index), _indexed(force, index)


def _indexed(symbol: str, index: str) -> str:
    return f"{symbol}_{{{','.join(index)}}}" if index else symbol


def pose_coordinates(
    G: MatrixLieGroup, part: Part, pose: Array, index: str = "", near: Array | None = None
) -> tuple[Array, str, str]:
    """Return a part of poses ``(n, d, d)`` as curves ``(n, coordinates)``, their symbol and unit.

    `near` holds curves of about the same poses, as for `without_jumps`.
    """
    block = pose[(..., *part.entries)].reshape(len(pose), -1)
    symbol = symbols(G, part, index)[0]
    if block.shape[1] == len(G.axis_names[part.axes]):
        return block, symbol, part.pose_unit
    with np.errstate(all="ignore"):
        logarithm = np.full((len(pose), G.dimension), np.nan)
        real = np.isfinite(pose).all(axis=(1, 2))
        logarithm[real] = G.log(pose[real])
    turns = logarithm[:, part.axes]
    if not part.turns:
        return turns, rf"\log {symbol}", ""
    return without_jumps(turns, near), rf"\log {_indexed('R', index)}", "rad"


def part_curves(
    G: MatrixLieGroup,
    part: Part,
    name: str,
    values: Array,
    *,
    degrees: bool,
    index: str = "",
    near: Array | None = None,
) -> tuple[Array, str]:
    """Return a part of poses, errors, velocities or wrenches as curves, and the label of its scale.

    Parameters
    ----------
    name
        ``pose``, ``error``, ``difference``, ``velocity``, or ``wrench`` or ``torque``.
    degrees
        Whether angles and rates of rotations are in degrees.
    index, near
        As of `pose_coordinates`.
    """
    degrees = degrees and part.turns
    if name == "pose":
        near = np.radians(near) if degrees and near is not None else near
        found, symbol, unit = pose_coordinates(G, part, values, index, near)
    elif name in ("error", "difference"):
        found, symbol, unit = values[:, part.axes], "", part.error_unit
    else:
        _, velocity, force = symbols(G, part, index)
        of_velocity = name == "velocity"
        found, symbol = values[:, part.axes], velocity if of_velocity else force
        unit = part.velocity_unit if of_velocity else part.force_unit
    if degrees and unit.startswith("rad"):
        found, unit = np.degrees(found), unit.replace("rad", "deg")
    return found, quantity(symbol, unit) if symbol else in_words(name, unit)


def without_jumps(vectors: Array, near: Array | None = None) -> Array:
    """Return rotation vectors ``(n, k)``, unwrapped by whole turns about their axes.

    Each is as close as possible to its counterpart in `near`; without `near`, to the one before.
    """
    found = vectors.copy()
    pairs = zip(found[1:], found[:-1], strict=True)
    for now, other in pairs if near is None else zip(found, near, strict=True):
        angle = np.linalg.norm(now)
        axis = now / angle if angle > 0 else other / max(np.linalg.norm(other), 1.0)
        turns = np.round((other @ axis - angle) / (2 * np.pi))
        if np.isfinite(turns):
            now += 2 * np.pi * turns * axis
    return found
