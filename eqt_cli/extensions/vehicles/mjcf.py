"""MJCF: MuJoCo composes the bodies, and says where actuators push."""

from __future__ import annotations

import re
import warnings
from collections.abc import Iterator
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles import contained
from eqt_cli.extensions.vehicles.bodies import Link, Rotor, Vehicle, Wheel, pose_of
from eqt_cli.extensions.vehicles.elements import LARGEST, Element, read, shortened, shown
from eqt_cli.extensions.vehicles.mjcf_checks import Checks
from eqt_cli.extensions.vehicles.request import Request

BESIDE = 1e-6
"""Distance of the centre of mass of a wheel from its axis, m, that digits explain."""


def read_mjcf(request: Request) -> Vehicle:
    """Return the one free body of an MJCF file, with what hangs on it at joint angles 0.

    Raises
    ------
    EqtError
        Without the package mujoco, with what MuJoCo says of the file, and if not one body is free.
    """
    if find_spec("mujoco") is None:
        raise EqtError(
            f"{request.path}: MJCF needs the package mujoco; run pip install "
            "'.[mujoco]' in the checkout of eqt"
        )
    return _of_record(contained.answer("mjcf", request))


def _of_record(record: dict[str, Any]) -> Vehicle:
    """Return the vehicle of a record, whose lists are arrays."""
    links = [
        Link(**{**one, **{name: np.array(one[name]) for name in ("pose", "centre", "inertia")}})
        for one in record.pop("links")
    ]
    rotors = [
        Rotor(**{**one, "at": np.array(one["at"]), "along": np.array(one["along"])})
        for one in record.pop("rotors")
    ]
    wheels = [Wheel(**{**one, "axis": np.array(one["axis"])}) for one in record.pop("wheels")]
    return Vehicle(**record, links=links, rotors=rotors, wheels=wheels)


def vehicle_of(mujoco: Any, request: Request) -> Vehicle:
    """Return the vehicle as MuJoCo reads it, in this process; see `read_mjcf`."""
    where = shown(request.path)
    notes: list[str] = []
    is_whole = _check_files(request.path.resolve(), request) == 1
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(lambda _: None)  # else it writes a log into the folder
    try:
        with warnings.catch_warnings(record=True) as said_of_it:
            warnings.simplefilter("always")
            spec = mujoco.MjSpec.from_file(str(request.path))
            for body in spec.bodies:
                if body.name and request.leaves_out(body.name):
                    spec.delete(body)
                    notes.append(f"{where}: body {body.name} is left out, as --without asks")
            spec.compiler.usethread = 0  # threads reserve memory
            _without_files(mujoco, spec, request, notes)
            model = spec.compile()
        notes += dict.fromkeys(
            f"{where}: MuJoCo: {_line(warning.message)}" for warning in said_of_it
        )
    except (ValueError, RuntimeError, mujoco.FatalError) as error:
        if contained.memory_lacks(str(error)):
            raise MemoryError from None
        said = re.sub(r"^(XML )?Error:?\s*", "", _line(error))
        raise EqtError(f"{where}: MuJoCo: {said}; correct the file") from None
    finally:
        mujoco.set_mju_user_warning(before)
    data = mujoco.MjData(model)
    mujoco.mj_kinematics(model, data)
    mujoco.mj_comPos(model, data)
    lines = _lines(spec, where) if is_whole else {}
    reader = _Mjcf(mujoco, model, data, where, lines, notes)
    with np.errstate(all="ignore"):  # what is no number, or too large, is told below
        vehicle = reader.vehicle(spec.modelname, request, read(request.path))
    parts: tuple[Link | Rotor | Wheel, ...] = (*vehicle.links, *vehicle.rotors, *vehicle.wheels)
    for part in parts:
        numbers = [x for x in vars(part).values() if isinstance(x, float | np.ndarray)]
        if not (np.abs(np.concatenate([np.ravel(x) for x in numbers])) <= LARGEST).all():
            raise EqtError(
                f"{part.place}: {part.name}: expected numbers of at most {LARGEST:g}, got larger "
                "ones or NaN; correct the file"
            )
    return vehicle


def _check_files(path: Path, request: Request) -> int:
    """Check the names of all files that a file and its parts name; return how many parts it has.

    Raises
    ------
    EqtError
        With the place of a name that leads out of the folders.
    """
    left, met = [path], {path}
    while left:
        for element, there in _named_files(read(left.pop()), path.parent):
            part = request.check_inside(there, element.place)
            if not (part.is_file() or part.is_dir()):
                raise EqtError(f"{element.place}: {there.name} is no regular file")
            if element.tag in ("include", "model") and part.is_file() and part not in met:
                left.append(part)
                met.add(part)
            if len(met) > MOST_PARTS:
                raise EqtError(f"{element.place}: more than {MOST_PARTS} files")
    return len(met)


def _named_files(root: Element, folder: Path) -> Iterator[tuple[Element, Path]]:
    """Yield the files and folders that elements name, and that are there."""
    compilers = [element for element in root.walk() if element.tag == "compiler"]
    names = {text for of in compilers for name, text in of.attributes.items() if "dir" in name}
    folders = [folder / name for name in ("", *sorted(names))]
    for element in root.walk():
        for name, text in element.attributes.items():
            if name.startswith("file") or (name.endswith("dir") and element in compilers):
                if Path(text).is_absolute():
                    raise EqtError(
                        f"{element.place}: {name}: expected a name relative to the file, got "
                        f"'{shortened(text)}'"
                    )
                paths = dict.fromkeys(where / text for where in folders)
                yield from ((element, there) for there in paths if there.exists())


MOST_PARTS = 100
"""Most files that a file includes."""


def _without_files(mujoco: Any, spec: Any, request: Request, notes: list[str]) -> None:
    """Remove pictures, and meshes whose files are missing, unless a mass is theirs."""
    folder = request.path.parent
    at = [folder / (spec.meshdir or ""), folder]
    missing = {
        mesh.name or Path(mesh.file).stem
        for mesh in spec.meshes
        if mesh.file and not any((there / mesh.file).is_file() for there in at)
    }
    always, never = 1, 0
    from_shapes = int(spec.compiler.inertiafromgeom)
    for geom in list(spec.geoms):
        geom.material = ""
        if geom.type != mujoco.mjtGeom.mjGEOM_MESH or geom.meshname not in missing:
            continue
        stated = geom.parent.explicitinertial and from_shapes != always
        light = geom.mass == 0 or (np.isnan(geom.mass) and geom.density == 0)
        if not (stated or light or from_shapes == never):
            raise EqtError(
                f"{shown(request.path)}: body {geom.parent.name} has mass from the mesh "
                f"{geom.meshname}, whose file is missing; add it, or write <inertial>"
            )
        spec.delete(geom)
    for mesh in list(spec.meshes):
        if (mesh.name or Path(mesh.file).stem) in missing:
            spec.delete(mesh)
    for picture in [*spec.materials, *spec.textures]:
        spec.delete(picture)
    if missing:
        notes.append(f"{shown(request.path)}: {len(missing)} mesh files are missing: without mass")


def _lines(spec: Any, where: str) -> dict[tuple[str, int], str]:
    """Return the places of elements by their kinds and numbers."""
    places = {}
    for kind in ("body", "joint", "actuator", "tendon", "equality"):
        name = {"body": "bodies", "equality": "equalities"}.get(kind, f"{kind}s")
        for element in getattr(spec, name):
            line = re.search(r"line (\d+)", element.info or "")
            places[kind, element.id] = f"{where}:{line[1]}" if line else where
    return places


class _Mjcf:
    """Reads a compiled model, in the axes of its free body."""

    def __init__(
        self,
        mujoco: Any,
        model: Any,
        data: Any,
        where: str,
        lines: dict[tuple[str, int], str],
        notes: list[str],
    ) -> None:
        self.mujoco, self.model, self.data, self.lines = mujoco, model, data, lines
        self.where, self.notes = where, notes
        free = [int(model.jnt_bodyid[k]) for k in range(model.njnt) if model.jnt_type[k] == 0]
        if len(free) != 1:
            names = ", ".join(model.body(b).name or f"body {b}" for b in free)
            if not free:
                raise EqtError(
                    f"{where}: no body has a <freejoint/>, so that none moves; add a <freejoint/> "
                    "to the body of the vehicle"
                )
            raise EqtError(
                f"{where}: {len(free)} bodies are free ({names}); leave others out: --without"
            )
        self.base = free[0]
        self.to_body = data.xmat[self.base].reshape(3, 3).T
        self.origin = data.xpos[self.base]

    def place(self, kind: str, number: int) -> str:
        """Return the file and line of an element."""
        return self.lines.get((kind, number), self.where)

    def vehicle(self, name: str, request: Request, root: Element) -> Vehicle:
        """Return the vehicle."""
        model, base = self.model, self.base
        held = [b for b in range(1, model.nbody) if model.body_rootid[b] == model.body_rootid[base]]
        links = {b: self._link(b) for b in held}
        base_name = model.body(base).name or "the free body"
        heavy = [link for link in links.values() if link.mass > 0 or link.inertia.any()]
        v = Vehicle(name, "MJCF", base_name, heavy, notes=self.notes)
        checks = Checks(self.mujoco, model, base, held, self.place, root)
        self.clamps = not checks.flag("CLAMPCTRL")
        checks.check_world(v, request.kind)
        torques = [self._actuator(k, v, links, request) for k in range(model.nu)]
        if pure := [text for text in torques if text]:
            v.rotors.clear()
            v.notes += pure
            v.notes.append(
                f"{self.where}: actuators give torques about the body's axes: no rotor is in the "
                "file; add `actuators` (docs/howto/rotors.md)"
            )
            v.lifts = not v.floats
        checks.check_ties(v)
        return v

    def _link(self, b: int) -> Link:
        model, data = self.model, self.data
        name = model.body(b).name or f"body {b}"
        R = self.to_body @ data.ximat[b].reshape(3, 3)
        centre = self.to_body @ (data.xipos[b] - self.origin)
        J = R @ np.diag(model.body_inertia[b]) @ R.T
        pose = pose_of(self.to_body @ data.xmat[b].reshape(3, 3), np.zeros(3))
        return Link(name, self.place("body", b), pose, float(model.body_mass[b]), centre, J)

    def _range(self, k: int) -> tuple[float, float] | None:
        """Return the least and largest force of an actuator."""
        model, ends = self.model, []
        gain = model.actuator_gainprm[k, 0]
        if model.actuator_ctrllimited[k] and self.clamps:
            ends.append(np.sort(model.actuator_ctrlrange[k] * gain))
        if model.actuator_actlimited[k]:  # of the activation, which is the command after the lag
            ends.append(np.sort(model.actuator_actrange[k] * gain))
        if model.actuator_forcelimited[k]:
            ends.append(model.actuator_forcerange[k])
        if not ends:
            return None
        return max(float(low) for low, _ in ends), min(float(high) for _, high in ends)

    def _actuator(self, k: int, v: Vehicle, links: dict[int, Link], request: Request) -> str | None:
        """Add an actuator; return what it is if it gives a torque alone."""
        model, kinds = self.model, self.mujoco.mjtTrn
        place, kind = self.place("actuator", k), int(model.actuator_trntype[k])
        name = model.actuator(k).name
        if not name and kind == kinds.mjTRN_SITE:
            name = model.site(model.actuator_trnid[k, 0]).name
        name = name or f"actuator {k}"
        is_motor = model.actuator_gaintype[k] == 0 and model.actuator_biastype[k] == 0
        group = int(model.actuator_group[k])
        if 0 <= group <= 30 and model.opt.disableactuator >> group & 1:
            v.notes.append(f"{place}: actuator {name} is of a group that is switched off: left out")
            return None
        if kind == kinds.mjTRN_JOINT and is_motor and (v.floats or request.kind == "satellite"):
            self._wheel(k, place, v, links)
            return None
        if kind != kinds.mjTRN_SITE or not is_motor or model.actuator_trnid[k, 1] >= 0:
            v.notes.append(f"{place}: actuator {name} drives a joint, or by a law: left out")
            return None
        site = model.actuator_trnid[k, 0]
        if int(model.site_bodyid[site]) not in links:
            return None
        R = self.to_body @ self.data.site_xmat[site].reshape(3, 3)
        at = self.to_body @ (self.data.site_xpos[site] - self.origin)
        force, torque = (R @ part for part in np.split(model.actuator_gear[k], 2))
        size, ends = float(np.linalg.norm(force)), self._range(k)
        if size == 0:
            span = "" if ends is None else f", {ends[0]:g} to {ends[1]:g} N m"
            return f"{place}: {name}: torque along {_row(torque)}{span}"
        along = force / size
        turns = float(torque @ along) / size
        lever = np.cross(along, torque - (torque @ along) * along) / size
        rotor = Rotor(name, place, at + lever, along, turns=turns, number=float(k))
        if ends is not None:
            rotor.low, rotor.high = ends[0] * size, ends[1] * size
        rotor.up = rotor.down = self._lag(k, name, place, v)
        v.rotors.append(rotor)
        return None

    def _lag(self, k: int, name: str, place: str, v: Vehicle) -> float:
        """Return the time constant of an actuator, s; 0 where its force follows at once.

        Raises
        ------
        EqtError
            For other dynamics than a lag of first order.
        """
        model, dynamics = self.model, self.mujoco.mjtDyn
        if getattr(model, "actuator_delay", np.zeros(model.nu))[k]:
            delay = f"{model.actuator_delay[k]:g} s"
            v.notes.append(f"{place}: delay {delay} of {name} is left out; write control.delay")
        kind = int(model.actuator_dyntype[k])  # of NumPy, which is in no tuple of MuJoCo's words
        if kind in (int(dynamics.mjDYN_FILTER), int(dynamics.mjDYN_FILTEREXACT)):
            return float(model.actuator_dynprm[k, 0])
        if kind != int(dynamics.mjDYN_NONE) or model.actuator_plugin[k] >= 0:
            word = "plugin" if model.actuator_plugin[k] >= 0 else dynamics(kind).name[6:].lower()
            raise EqtError(
                f"{place}: actuator {name} has the dynamics '{word}'; eqt reads none, filter and "
                "filterexact: write one of them, or leave the actuator out"
            )
        return 0.0

    def _wheel(self, k: int, place: str, v: Vehicle, links: dict[int, Link]) -> None:
        """Add a reaction wheel: a body on a hinge, balanced about its axis."""
        model, j = self.model, self.model.actuator_trnid[k, 0]
        link, axis = links.get(int(model.jnt_bodyid[j])), self.to_body @ self.data.xaxis[j]
        name = model.joint(j).name or f"joint {j}"
        if link is None or int(model.jnt_type[j]) != self.mujoco.mjtJoint.mjJNT_HINGE:
            v.notes.append(f"{place}: {name} is no hinge of the vehicle: left out")
            return
        arm = link.centre - self.to_body @ (self.data.xanchor[j] - self.origin)
        if np.linalg.norm(np.cross(axis, arm)) > BESIDE:
            v.notes.append(f"{place}: {name}: the wheel is not balanced about its axis; held at 0")
            return
        ends = self._range(k)
        gear = abs(float(model.actuator_gear[k, 0]))
        limit = None if ends is None else gear * min(-ends[0], ends[1])
        if model.jnt_actfrclimited[j]:
            most = float(min(-model.jnt_actfrcrange[j, 0], model.jnt_actfrcrange[j, 1]))
            limit = most if limit is None else min(limit, most)
        lag, spin = self._lag(k, name, place, v), float(axis @ link.inertia @ axis)
        v.wheels.append(Wheel(name, place, axis, limit, spin, lag))
        for word in ("armature", "damping"):
            values = getattr(model, f"actuator_{word}", np.zeros(model.nu))
            if values[k]:
                v.notes.append(f"{place}: {word} {values[k]:g} of {name} is left out")


def _line(said: object) -> str:
    """Return what MuJoCo says in one line."""
    return " ".join(str(said).split())[:300]


def _row(values: Array) -> str:
    return f"[{', '.join(f'{value + 0.0:.4g}' for value in values)}]"
