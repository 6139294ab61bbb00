"""The coordinates of poses, velocities and wrenches as curves: their symbols, units and values."""

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import MatrixLieGroup, Part
from eqt_cli.plots.drawing.labels import component


def axis_labels(G: MatrixLieGroup) -> list[str]:
    """What the k-th curve of a panel shows: the names of that axis in all parts."""
    names = [G.axis_names[part.axes] for part in G.parts]
    return [
        ", ".join(f"${component('', axes[k]).lstrip('_')}$" for axes in names if k < len(axes))
        for k in range(max(map(len, names)))
    ]


def symbols(part: Part, parts: int) -> tuple[str, str]:
    """Of the velocity and the force in a part of so many."""
    if parts > 1 and part.turns:
        return r"\omega", r"\tau"
    return ("v", "f") if parts > 1 and part.pose_unit == "m" else ("V", r"\tau")


def pose_coordinates(
    G: MatrixLieGroup, part: Part, pose: Array, index: str = "", near: Array | None = None
) -> tuple[Array, str, str]:
    """A part of some poses ``(n, d, d)`` as curves ``(n, coordinates)``, their symbol and unit.

    `near` are curves of about the same poses, as of `without_jumps`.
    """
    block = pose[(..., *part.entries)].reshape(len(pose), -1)
    if block.shape[1] == len(G.axis_names[part.axes]):
        return block, f"x{index}" if part.pose_unit == "m" else f"Q{index}", part.pose_unit
    with np.errstate(all="ignore"):
        logarithm = np.full((len(pose), G.dimension), np.nan)
        real = np.isfinite(pose).all(axis=(1, 2))
        logarithm[real] = G.log(pose[real])
    turns = logarithm[:, part.axes]
    if not part.turns:
        return turns, rf"\log Q{index}", ""
    return without_jumps(turns, near), rf"\log R{index}", "rad"


def without_jumps(vectors: Array, near: Array | None = None) -> Array:
    """Rotation vectors ``(n, k)`` with whole turns about their axes added, so that none jumps.

    Each is as close as it can be to that in `near`; without these, to the one before.
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
