"""One run as a motion: body and reference poses, error and torque over time; it draws nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.config.source import source_of
from eqt_cli.core.arrays import Array
from eqt_cli.groups import Part, group_named
from eqt_cli.plots.drawing.style import house_style
from eqt_cli.plots.shown.controllers import Chosen, Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns
from eqt_cli.results.result import Result

MOST_CONTROLLERS = 6
"""Most bodies that are shown side by side."""


@dataclass(frozen=True)
class BodyPath:
    """Orientation and position over time.

    Attributes
    ----------
    rotation : (..., samples, 3, 3)
        Body to inertial frame; a planar motion turns about z; identity without rotations.
    position : (..., samples, 3)
        Inertial frame, m; zero on a group without translations.
    """

    rotation: Array
    position: Array


@dataclass(frozen=True)
class Motion:
    """One run of some controllers.

    Attributes
    ----------
    run
        Number of the run.
    times : (samples,)
        Sample times, s.
    ensembles
        The controllers, in the order of curves and bodies.
    body, reference
        Courses of the bodies, with a leading controller axis, and of the reference.
    has_translation
        Whether bodies move as well as turn.
    thrusts : (controllers, samples, thrusters, 2, 3)
        A line from each thruster along its thrust, in the body frame; the largest coordinate of a
        place and the largest thrust are 1.
    norms : dict of str to (controllers, samples)
        Norms of pose error and torque by name, per part where rotation and translation have
        different units.
    """

    run: int
    times: Array
    ensembles: Sequence[Ensemble]
    body: BodyPath
    reference: BodyPath
    has_translation: bool
    thrusts: Array
    norms: dict[str, Array]

    @property
    def extent(self) -> float:
        """Largest distance of a position from the midpoint of all, m; 0 where nothing moves."""
        middle = (self.places.min(axis=0) + self.places.max(axis=0)) / 2
        return float(np.linalg.norm(self.places - middle, axis=-1).max())

    @property
    def places(self) -> Array:
        """All positions of bodies and reference, ``(places, 3)``, m."""
        bodies = self.body.position.reshape(-1, 3)
        places = np.concatenate([bodies, self.reference.position])
        return places[np.isfinite(places).all(axis=-1)]


def motion(results: Result, run: int, controllers: Sequence[str] = ()) -> Motion:
    """Return the motion of one run of a result.

    Parameters
    ----------
    run
        Number of the run, as in the coordinate ``run``.
    controllers
        Labels of the controllers; the first `MOST_CONTROLLERS` if empty.

    Raises
    ------
    EqtError
        If the run is not stored, there is no such controller, or the group is not known here or
        moves no body.
    """
    with house_style():
        source = ShownRuns([results], "animation", Chosen(controllers))
    ensembles = source.ensembles if controllers else source.ensembles[:MOST_CONTROLLERS]
    shown = [ensemble.controller for ensemble in ensembles]
    parts = group_named(results.group_name).parts
    turning = next((part for part in parts if part.turns), None)
    moving = next((part for part in parts if part.pose_unit == "m"), None)
    if turning is None and moving is None:
        raise results.error(
            f"a pose of {results.group_name} is neither a rotation nor a place in metres, so no "
            "body can be shown; `eqt plot --figure runs` draws its runs"
        )
    ends = [f"_{part.name}" for part in (turning, moving) if part is not None]
    ends = [end for end in ends if results.has(f"pose_error{end}")] or [""]
    norms = [norm + end for norm in ("pose_error", "torque_norm") for end in ends]
    return Motion(
        run=run,
        times=results.times,
        ensembles=ensembles,
        body=_course(results.trajectory("pose", run)[shown], turning, moving),
        reference=_course(results["desired_pose"], turning, moving),
        has_translation=moving is not None,
        thrusts=_thrusts(results, run, shown),
        norms={name: results.trajectory(name, run)[shown] for name in norms},
    )


def _thrusts(results: Result, run: int, shown: list[int]) -> Array:
    actuators = source_of(results).data["actuators"] if results.has("thrust") else ()
    found = [each["thrusters"] for each in actuators if each.get("thrusters")]
    if not found:
        return np.empty((len(shown), len(results.times), 0, 2, 3))
    thrust = results.trajectory("thrust", run)[shown][..., None]
    at, along = (np.array([[*each[key], 0.0][:3] for each in found[0]]) for key in ("at", "along"))
    at, thrust = (each / (np.nanmax(np.abs(each)) or 1.0) for each in (at, thrust))
    along = along / np.linalg.norm(along, axis=-1, keepdims=True)
    return np.stack(np.broadcast_arrays(at, at + thrust * along), axis=-2)


def _course(poses: Array, turning: Part | None, moving: Part | None) -> BodyPath:
    rotation = np.broadcast_to(np.eye(3), (*poses.shape[:-2], 3, 3)).copy()
    position = np.zeros((*poses.shape[:-2], 3))
    if turning is not None:
        block = poses[(..., *turning.entries)]
        size = block.shape[-1]
        rotation[..., :size, :size] = block
    if moving is not None:
        column = poses[(..., *moving.entries)][..., 0]
        position[..., : column.shape[-1]] = column[..., :3]
    return BodyPath(rotation, position)
