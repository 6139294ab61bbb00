"""`eqt config new --from x500.sdf`: the configuration of a vehicle that is a file already."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.bodies import Vehicle
from eqt_cli.extensions.vehicles.configuration import configuration
from eqt_cli.extensions.vehicles.elements import Element, content, read
from eqt_cli.extensions.vehicles.plugins import equipped
from eqt_cli.extensions.vehicles.request import Request


def configuration_of(path: Path, **options: Any) -> tuple[str, list[str]]:
    """Return a configuration as text, and lines on the vehicle.

    Parameters
    ----------
    path
        An SDF, URDF, xacro or MJCF file.
    options
        Those of `Request`.

    Raises
    ------
    EqtError
        With file, line and remedy, for a file that is none of a vehicle.
    """
    request = Request(path, **options)
    if not path.is_file():
        raise EqtError(f"{path}: not found; give an SDF, URDF, xacro or MJCF file")
    if path.suffix == ".xacro" or b"ros.org/wiki/xacro" in content(path):
        from eqt_cli.extensions.vehicles.macros import read_xacro

        vehicle = _of_urdf(read_xacro(request), request)
    else:
        root = read(path)
        if root.tag == "sdf":
            from eqt_cli.extensions.vehicles.sdf import read_sdf

            vehicle = equipped(read_sdf(request), request)
        elif root.tag == "robot":
            vehicle = _of_urdf(root, request)
        elif root.tag == "mujoco":
            from eqt_cli.extensions.vehicles.mjcf import read_mjcf

            vehicle = read_mjcf(request)
        else:
            raise EqtError(
                f"{root.place}: <{root.tag[:40]}>: expected <sdf>, <robot> or <mujoco>; give an "
                "SDF, URDF, xacro or MJCF file"
            )
    request.check_left_out()
    return configuration(vehicle, request)


def _of_urdf(root: Element, request: Request) -> Vehicle:
    from eqt_cli.extensions.vehicles.urdf import read_urdf

    return equipped(read_urdf(root, request), request)
