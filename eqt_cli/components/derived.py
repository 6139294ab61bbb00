"""Signals that follow from poses and velocities: those that people use, also of a Dataset."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.base.arrays import Array, apply_matrix
from eqt_cli.components.groups import MatrixLieGroup, Part

if TYPE_CHECKING:
    import xarray


@dataclass(frozen=True)
class Derived:
    """A signal that follows from poses and velocities.

    Attributes
    ----------
    name, units, long_name, frame
        As of a variable in a dataset; the frame is ``body`` or ``space``.
    axes
        Names of its coordinates, a letter each; empty for a number.
    values
        ``(pose (…, time, d, d), velocity (…, time, m)) -> (…, time, axes)``.
    """

    name: str
    units: str
    long_name: str
    frame: str
    axes: str
    values: Callable[[Array, Array], Array]


def derived(G: MatrixLieGroup, angles: str = "") -> Iterator[Derived]:
    r"""Yield the signals of a group that people use, where Q̇ = Q V^.

    Of each translation: its position p and ṗ. Of each rotation: its quaternion (w, x, y, z) or, in
    the plane, its heading, without jumps, and its angular velocities ω in the body and R ω.

    Parameters
    ----------
    angles
        Axes of Euler angles as SciPy names them, such as ``ZYX`` for yaw, pitch and roll.
    """
    for part in G.parts:
        alike = [other for other in G.parts if other.pose_unit == part.pose_unit]
        end = f"_{part.name.rpartition('_')[2]}" if len(alike) > 1 else ""
        for signal in _of_part(G, part, angles):
            yield replace(signal, name=signal.name + end)


def _of_part(G: MatrixLieGroup, part: Part, angles: str) -> Iterator[Derived]:
    rows = part.entries[0].stop - part.entries[0].start

    def block(Q: Array) -> Array:
        return Q[(..., *part.entries)]

    def rate(Q: Array, V: Array) -> Array:
        return block(Q @ G.hat(V))[..., 0]

    def heading(Q: Array, V: Array) -> Array:
        R = block(Q)
        return np.unwrap(np.arctan2(R[..., 1, 0], R[..., 0, 0]))

    def in_space(Q: Array, V: Array) -> Array:
        return apply_matrix(block(Q), V[..., part.axes])

    def euler(Q: Array, V: Array) -> Array:
        turns = coordinates_of(part, Q, lambda rotation: rotation.as_euler(angles))
        return np.unwrap(turns, axis=-2)

    omega, words = "angular_velocity", "angular velocity"
    if part.pose_unit == "m":
        axes = "xyz"[:rows]
        yield Derived("position", "m", "position", "space", axes, lambda Q, V: block(Q)[..., 0])
        yield Derived("linear_velocity", "m/s", "rate of the position", "space", axes, rate)
    elif part.turns and rows == 2:
        yield Derived("heading", "rad", "heading", "space", "", heading)
        yield Derived(omega, "rad/s", words, "body", "", lambda Q, V: V[..., part.axes.start])
    elif part.turns:
        attitude = "attitude, from body to space"
        yield Derived("quaternion", "1", attitude, "space", "wxyz", partial(_quaternion, part))
        yield Derived(omega, "rad/s", words, "body", "xyz", lambda Q, V: V[..., part.axes])
        yield Derived(f"{omega}_in_space", "rad/s", words, "space", "xyz", in_space)
        if angles:
            yield Derived("euler_angles", "rad", f"Euler angles {angles}", "space", "123", euler)


def _quaternion(part: Part, Q: Array, V: Array) -> Array:
    q = coordinates_of(part, Q, lambda rotation: np.roll(rotation.as_quat(), 1, axis=-1))
    turned = np.where((q[..., 1:, :] * q[..., :-1, :]).sum(axis=-1) < 0, -1.0, 1.0)
    q[..., 1:, :] *= np.cumprod(turned, axis=-1)[..., None]
    return q


def coordinates_of(part: Part, Q: Array, coordinates: Callable[[Any], Array]) -> Array:
    """Return coordinates of rotations by SciPy, which refuses the NaN of a run that failed."""
    from scipy.spatial.transform import Rotation

    R = Q[(..., *part.entries)]
    finite = np.isfinite(R.sum(axis=(-2, -1)))[..., None]
    whole = np.where(finite[..., None], R, np.eye(3)).reshape(-1, 3, 3)
    angles = coordinates(Rotation.from_matrix(whole)).reshape(*R.shape[:-2], -1)
    return np.where(finite, angles, np.nan)


# The dataset --------------------------------------------------------------------------------------


def with_derived(dataset: xarray.Dataset, G: MatrixLieGroup, angles: str = "") -> xarray.Dataset:
    """Add the signals of `derived` of the motion and of the reference, computed when they are read.

    Parameters
    ----------
    dataset
        The variables of a file.
    angles
        See `derived`.
    """
    from xarray import Variable

    added, axes = {}, {}
    for prefix in ("", "desired_"):
        pose, velocity = (dataset.variables.get(f"{prefix}{of}") for of in ("pose", "velocity"))
        if pose is None or velocity is None or "time" not in pose.dims:
            continue
        for quantity in derived(G, angles):
            dims = pose.dims[: pose.dims.index("time") + 1]
            if quantity.axes:
                axes[f"axis_{quantity.axes}"] = list(quantity.axes)
                dims = (*dims, f"axis_{quantity.axes}")
            about = {
                "units": quantity.units,
                "long_name": quantity.long_name,
                "frame": quantity.frame,
            }
            added[prefix + quantity.name] = Variable(dims, _lazily(quantity, pose, velocity), about)
    return dataset.assign_coords(axes).assign(added)


def _lazily(signal: Derived, pose: xarray.Variable, velocity: xarray.Variable) -> Any:
    """Return an array that computes a signal of the chosen runs over the whole time."""
    from xarray.backends import BackendArray
    from xarray.core.indexing import IndexingSupport, LazilyIndexedArray, explicit_indexing_adapter

    class Computed(BackendArray):
        """What is read of it is computed."""

        runs = pose.dims.index("time")
        shape = pose.shape[: runs + 1] + ((len(signal.axes),) if signal.axes else ())
        dtype = np.dtype(float)

        def __getitem__(self, key: Any) -> Any:
            return explicit_indexing_adapter(key, self.shape, IndexingSupport.OUTER, self.chosen)

        def chosen(self, key: tuple[Any, ...]) -> Array:
            runs, inner = key[: self.runs], key[self.runs :]
            values = signal.values(pose[runs].values, velocity[runs].values)
            for place, index in zip(range(-len(inner), 0), inner, strict=True):
                # An integer leaves out its axis, so that later ones, counted from the end, stay.
                values = values[(..., index, *[slice(None)] * (-1 - place))]
            return values

    return LazilyIndexedArray(Computed())
