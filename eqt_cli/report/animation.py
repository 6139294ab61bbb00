"""Page that plays one run: bodies against the reference, tracking error and torque over time."""

from collections.abc import Sequence
from typing import Any

import numpy as np

from eqt_cli.core.arrays import Array
from eqt_cli.plots.animation.scene import (
    AXES,
    AZIMUTH,
    CORNERS,
    ELEVATION,
    FACES,
    INERTIAL,
    TRAIL,
    Motion,
    Scene,
    motion,
    scene_of,
)
from eqt_cli.plots.drawing.labels import norm_symbol
from eqt_cli.report.environment import page
from eqt_cli.report.summary import columns, looks
from eqt_cli.results.quantity import plain
from eqt_cli.results.result import Result

SAMPLES = 401
"""Maximum number of samples of the run in the page, which interpolates between them."""


def animation(result: Result, run: int, controllers: Sequence[str] = ()) -> str:
    """Return the page that plays a run; it needs no network and no other file.

    Parameters
    ----------
    run, controllers
        Run and controllers, as in `motion`.

    Raises
    ------
    EqtError
        If the run cannot be shown; see `motion`.
    """
    shown = motion(result, run, controllers)
    return page(
        "animation.html.j2",
        ["report.css", "animation.css"],
        "animation.js",
        title=result.title,
        group=result.group_name,
        labels=[ensemble.title for ensemble in shown.ensembles],
        run=run,
        samples=len(shown.times),
        data=_document(scene_of(shown), result),
    )


def _document(scene: Scene, result: Result) -> dict[str, Any]:
    shown = scene.motion
    kept = np.unique(np.linspace(0, len(shown.times) - 1, SAMPLES).round().astype(int))
    styles, heads = looks(result), columns(result, list(shown.norms))
    return {
        "run": shown.run,
        "times": _rounded(shown.times[kept]),
        "controllers": [styles[ensemble.controller] for ensemble in shown.ensembles],
        "bodies": [_course(*body, kept, shown) for body in zip(*shown.body, strict=True)],
        "thrusts": [[_rounded(now.ravel()) for now in each[kept]] for each in shown.thrusts],
        "reference": _course(*shown.reference, kept, shown),
        "moves": shown.has_translation,
        "length": scene.length,
        "columns": scene.columns,
        "centre": [_places(track[kept], shown) for track in scene.centre],
        "reach": _rounded(scene.reach[kept]),
        "ground": [[_rounded(end) for end in line] for line in scene.ground],
        "trail": TRAIL,
        "axes": AXES,
        "inertial": list(INERTIAL),
        "view": [float(AZIMUTH), float(ELEVATION)],
        "corners": CORNERS.tolist(),
        "faces": [list(face) for face in FACES],
        "panels": [
            {
                **head,
                "name": plain(norm_symbol(result, result.quantity(name))),
                "curves": [_rounded(curve[kept]) for curve in values],
            }
            for head, (name, values) in zip(heads, shown.norms.items(), strict=True)
        ],
    }


def _course(rotation: Array, position: Array, kept: Array, shown: Motion) -> dict[str, Any]:
    rotations = [_rounded(matrix.ravel()) for matrix in rotation[kept]]
    return {"rotation": rotations, "position": _places(position[kept], shown)}


def _places(track: Array, shown: Motion) -> list[list[float | None]]:
    """Return positions over time; none if nothing translates, since all are the origin."""
    return [_rounded(place) for place in track] if shown.has_translation else []


def _rounded(values: Array) -> list[float | None]:
    """Round to four significant digits, enough for the eye; None for NaN and infinity."""
    return [float(f"{v:.4g}") if np.isfinite(v) else None for v in values]
