"""One run as a motion: body and reference poses, error and torque over time; it draws nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

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
    norms: dict[str, Array]

    @property
    def centre(self) -> Array:
        """Midpoint of all positions, ``(3,)``, m."""
        places = self.places
        return (places.min(axis=0) + places.max(axis=0)) / 2

    @property
    def extent(self) -> float:
        """Largest distance of a position from the midpoint, m; 0 where nothing moves."""
        return float(np.linalg.norm(self.places - self.centre, axis=-1).max())

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
    poses = results.trajectory("pose", run)
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
        body=_course(poses[shown], turning, moving),
        reference=_course(results["desired_pose"], turning, moving),
        has_translation=moving is not None,
        norms={name: results.trajectory(name, run)[shown] for name in norms},
    )


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
