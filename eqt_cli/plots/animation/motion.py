"""One run as a motion: body and reference poses, error and torque over time; it draws nothing."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.groups import Part, group_named
from eqt_cli.plots.shown.controllers import Chosen, Ensemble
from eqt_cli.plots.shown.trajectories import ShownRuns
from eqt_cli.results.result import Result

MOST_CONTROLLERS = 6
"""Bodies that are shown side by side."""


@dataclass(frozen=True)
class Course:
    """Orientation and place over time.

    Attributes
    ----------
    rotation : (..., samples, 3, 3)
        From body to space; a plane motion turns about z, and a group without rotations not at all.
    position : (..., samples, 3)
        m; zero on a group without translations.
    """

    rotation: Array
    position: Array


@dataclass(frozen=True)
class Motion:
    """One run of some controllers.

    Attributes
    ----------
    run
        Its number.
    times : (samples,)
        s.
    ensembles
        The controllers; curves and bodies have their order.
    body, reference
        Courses of the bodies, with a leading controller axis, and of the reference.
    has_translation
        Whether bodies move as well as turn.
    norms : dict of str to (controllers, samples)
        The norms of pose error and torque by name; those of rotation and translation where these
        have units of their own.
    """

    run: int
    times: Array
    ensembles: Sequence[Ensemble]
    body: Course
    reference: Course
    has_translation: bool
    norms: dict[str, Array]

    @property
    def centre(self) -> Array:
        """The middle of all places, (3,), m."""
        places = self.places
        return (places.min(axis=0) + places.max(axis=0)) / 2

    @property
    def extent(self) -> float:
        """The largest distance of a place from the middle, m; 0 where nothing moves."""
        return float(np.linalg.norm(self.places - self.centre, axis=-1).max())

    @property
    def places(self) -> Array:
        """Every place of every body and of the reference, (places, 3), m."""
        bodies = self.body.position.reshape(-1, 3)
        places = np.concatenate([bodies, self.reference.position])
        return places[np.isfinite(places).all(axis=-1)]


def motion(results: Result, run: int, controllers: Sequence[str] = ()) -> Motion:
    """One run of a result.

    Parameters
    ----------
    run
        Its number, as in the coordinate ``run``.
    controllers
        Labels; the first `MOST_CONTROLLERS` if empty.

    Raises
    ------
    EqtError
        If the run is not stored, there is no such controller, or the group is not known here.
    """
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


def _course(poses: Array, turning: Part | None, moving: Part | None) -> Course:
    rotation = np.broadcast_to(np.eye(3), (*poses.shape[:-2], 3, 3)).copy()
    position = np.zeros((*poses.shape[:-2], 3))
    if turning is not None:
        block = poses[(..., *turning.entries)]
        size = block.shape[-1]
        rotation[..., :size, :size] = block
    if moving is not None:
        column = poses[(..., *moving.entries)][..., 0]
        position[..., : column.shape[-1]] = column[..., :3]
    return Course(rotation, position)
