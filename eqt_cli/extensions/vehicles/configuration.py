"""A configuration of a vehicle, as a person would write it, with the place of every number."""

from __future__ import annotations

import json
import re
import textwrap
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, printable
from eqt_cli.extensions.vehicles.bodies import G0, Rotor, Vehicle, Wheel, skew
from eqt_cli.extensions.vehicles.gains import attitude_gains, block, written
from eqt_cli.extensions.vehicles.plugins import check_thrusts
from eqt_cli.extensions.vehicles.request import Request

WIDTH = 100
MOST_LINKS = 60
LIFTS = np.cos(np.radians(45))
"""Cosine of the largest tilt of a rotor that lifts."""

BALANCED = 1e-6
"""Torque over the weight, m, that the digits of a file explain."""

WEAK = 0.05
"""Singular values of torque and lift, each row divided by its norm, below which one is missing."""

ROUND = 1e-9
"""Numbers below it, relative to the largest beside them, are roundings of 0."""


@dataclass
class Body:
    """A vehicle about the origin of its configuration.

    Attributes
    ----------
    kind
        `quadrotor`, `auv` or `satellite`.
    mass, centre, tensor
        kg; centre of mass from the base link, m; tensor about it, without that of the wheels'
        spin, kg m².
    origin
        From the base link, m.
    B : (6, k)
        Torque and force of 1 N of each rotor.
    main : (3,)
        The direction in which its rotors lift.
    lifting
        The rotors that lift.
    """

    kind: str
    mass: float
    centre: Array
    tensor: Array
    origin: Array
    B: Array
    main: Array
    lifting: Array

    @property
    def weight(self) -> float:
        """N."""
        return self.mass * G0

    @property
    def hovers(self) -> bool:
        """Whether the rotors that lift also turn the body about all axes, as of a multirotor."""
        if self.kind != "quadrotor":
            return False
        if self.lifting.all():
            return True
        rows = np.vstack([self.B[:3], self.main @ self.B[3:]])[:, self.lifting]
        sizes = np.linalg.svd(rows / np.linalg.norm(rows, axis=1, keepdims=True).clip(1e-12))[1]
        return len(sizes) == 4 and bool(sizes[-1] > WEAK * sizes[0])

    @property
    def thrusts(self) -> Array:
        """The thrusts that hold the weight at rest, N."""
        if self.hovers:
            rows = np.vstack([self.B[:3], self.main @ self.B[3:]])
            return np.linalg.pinv(rows) @ [0.0, 0.0, 0.0, self.weight]
        return np.linalg.pinv(self.B) @ [0.0, 0.0, 0.0, 0.0, 0.0, self.weight]


def body_of(v: Vehicle, request: Request) -> Body:
    """Return the body of a vehicle.

    Raises
    ------
    EqtError
        If nothing says what kind of vehicle it is.
    """
    mass, centre, tensor = v.composed()
    check_thrusts(v, request, mass)
    kind = request.kind or ("auv" if v.is_marine else "satellite" if v.floats else "")
    kind = kind or ("quadrotor" if v.rotors or v.lifts else "")
    if not kind:
        raise EqtError(
            f"{request.path}: no rotor, thruster or water is in the file, so that nothing says how "
            "the body moves; give --vehicle satellite, quadrotor or auv"
        )
    if v.floats and kind != "satellite":
        v.notes.append(
            f"{request.path}: no gravity acts in the file, but the vehicle is weighed, since it is "
            f"called {kind}; where no gravity acts, set plant.restoring to null"
        )
    origin = np.zeros(3) if kind == "auv" else centre
    along = np.array([rotor.along for rotor in v.rotors]).reshape(-1, 3)
    total = along.sum(axis=0)
    size = np.linalg.norm(total)
    main = total / size if size > 0.1 else np.array([0.0, 0.0, 1.0])
    nearest = np.eye(3)[np.abs(main).argmax()] * np.sign(main[np.abs(main).argmax()])
    main = nearest if main @ nearest > LIFTS else main
    for wheel in v.wheels:
        tensor = tensor - wheel.inertia * np.outer(wheel.axis, wheel.axis)
    if np.linalg.eigvalsh(tensor)[0] <= 0:
        raise EqtError(f"{request.path}: the wheels have more inertia than the body; correct it")
    B = v.allocation(origin)
    body = Body(kind, mass, centre, tensor, origin, B, main, along @ main > LIFTS)
    if body.hovers and v.rotors:
        # Without a torque, tilted rotors may push sideways: they lift along their sum.
        for _ in range(3):
            force = B[3:] @ body.thrusts
            tilted = force / np.linalg.norm(force)
            body.main = body.main if np.abs(tilted - body.main).max() < ROUND else tilted
    return body


# Numbers and words --------------------------------------------------------------------------------


def number(value: float, digits: int = 10, zero: float = 0.0) -> str:
    """Return a number as text; one that is at most `zero` is 0."""
    return "0" if abs(value) <= zero else f"{value:.{digits}g}"


def row(values: Iterable[float], digits: int = 10, zero: float | None = None) -> str:
    """Return a list of numbers as YAML."""
    numbers = np.asarray(list(values), dtype=float)
    small = ROUND * np.abs(numbers).max(initial=0.0) if zero is None else zero
    return f"[{', '.join(number(value, digits, small) for value in numbers.tolist())}]"


def common(values: Sequence[float]) -> str:
    """Return one number for all, or a list."""
    texts = [number(value) for value in values]
    return texts[0] if len(set(texts)) == 1 else f"[{', '.join(texts)}]"


def word(name: str) -> str:
    """Return a name as YAML."""
    plain = re.fullmatch(r"[A-Za-z_][\w./-]*", name) and name.lower() not in (
        "null",
        "true",
        "false",
    )
    return name if plain else printable(json.dumps(name, ensure_ascii=False))


@dataclass
class Text:
    """Lines of a configuration."""

    lines: list[str] = field(default_factory=list)

    def add(self, line: str = "", remark: str = "") -> None:
        """Add a line, with a remark behind it, or above it where the line gets too long."""
        if not remark:
            self.lines.append(line)
        elif len(line) + len(remark) + 3 <= WIDTH + 20:
            self.lines.append(f"{line} # {printable(remark)}")
        else:
            self.say(remark, len(line) - len(line.lstrip()))
            self.lines.append(line)

    def say(self, remark: str, indent: int = 0, hanging: str = "") -> None:
        """Add a comment of one line or more."""
        start = f"{' ' * indent}# "
        self.lines += textwrap.wrap(
            printable(remark),
            WIDTH,
            initial_indent=start,
            subsequent_indent=start + hanging,
            break_long_words=False,
            break_on_hyphens=False,
        )

    def rows(self, key: str, matrix: Array, indent: int, remark: str = "") -> None:
        """Add a matrix, a row a line."""
        self.add(f"{' ' * indent}{key}:", remark)
        small = ROUND * np.abs(matrix).max()
        for entries in matrix:
            self.lines.append(f"{' ' * (indent + 2)}- {row(entries, zero=small)}")

    def gain(self, key: str, matrix: Array, indent: int, remark: str = "") -> None:
        """Add a gain to four digits: the diagonal where that is enough, else a row a line."""
        shown = written(matrix)
        if not shown.startswith("[["):
            self.add(f"{' ' * indent}{key}: {shown}", remark)
            return
        self.add(f"{' ' * indent}{key}:", remark)
        self.lines += [f"{' ' * (indent + 2)}- [{text}]" for text in shown[2:-2].split("], [")]


# The sections -------------------------------------------------------------------------------------


def configuration(v: Vehicle, request: Request) -> tuple[str, list[str]]:
    """Return a configuration, and three lines that a user compares with what is known.

    Raises
    ------
    EqtError
        For numbers that are none of a vehicle.
    """
    body, text = body_of(v, request), Text()
    _heading(text, v, body, request)
    _inertia(text, v, body)
    _laws(text, v, body, request.bandwidth)
    _forces(text, v, body)
    if body.kind == "satellite" and v.wheels:
        _wheels(text, v.wheels)
    if v.rotors:
        _rotors(text, v, body)
    text.add()
    degrees = "rad" if body.kind == "satellite" and not v.rotors else "rad and m"
    text.add("initial: { pose: { kind: exp_normal, std: 0.05 } }", degrees)
    text.add("ensemble: { runs: 3, seed: 1 }")
    text.add(f"time: {{ duration: {number(60 / request.bandwidth, 4)}, samples: 401 }}", "s")
    return "\n".join(text.lines) + "\n", facts(v, body)


def facts(v: Vehicle, body: Body) -> list[str]:
    """Return mass, moments, and how it holds its weight, in a line each."""
    at = row(body.centre, 4, 1e-9)
    lines = [f"mass {body.mass:.4g} kg, centre of mass at {at} m from {v.base}"]
    moments = np.linalg.eigvalsh(body.tensor)
    lines.append(f"principal moments {', '.join(f'{moment:.4g}' for moment in moments)} kg m²")
    highs = [rotor.high for rotor in v.rotors if rotor.high is not None]
    if v.water is not None and body.kind == "auv":
        B = "unknown" if v.water.buoyancy is None else f"{v.water.buoyancy:.4g} N"
        lines.append(f"weight {body.weight:.4g} N, buoyancy {B}")
        if highs and len(highs) == len(v.rotors):
            lows = [rotor.low or 0.0 for rotor in v.rotors]
            lines[-1] += f", thrusts from {min(lows):.4g} to {max(highs):.4g} N"
    elif body.kind == "quadrotor" and v.rotors:
        thrusts, factors = body.thrusts, [r.k for r in v.rotors if r.k is not None]
        if len(factors) == len(v.rotors):
            speeds = np.sign(thrusts) * np.sqrt(np.abs(thrusts) / np.array(factors))
            hover = f"hover at {_span(speeds)} rad/s"
        else:
            hover = f"hover by {_span(thrusts)} N"
        hover = _lack(v, body) or hover
        ratio = "unknown, as the file has no limits"
        if len(highs) == len(v.rotors):
            along = np.array([rotor.along @ body.main for rotor in v.rotors])
            ratio = f"{np.maximum(along * highs, 0).sum() / body.weight:.3g}"
        lines.append(f"{hover}, thrust to weight {ratio}")
    elif v.wheels:
        limits = {wheel.limit for wheel in v.wheels}
        limit_words = " or ".join(f"{limit:g}" for limit in limits if limit is not None)
        lines.append(f"{len(v.wheels)} wheels of {limit_words or 'unlimited'} N m")
    else:
        lines.append("no rotor or wheel is in the file: forces and torques have no limits")
    return lines


def _lack(v: Vehicle, body: Body) -> str:
    """Return why a vehicle cannot hover; empty where it can."""
    thrusts = body.thrusts
    torque = float(np.linalg.norm(body.B[:3] @ thrusts))
    if torque > BALANCED * body.weight:
        return f"cannot hover: with the weight, its rotors leave a torque of {torque:.3g} N m"
    slack = ROUND * np.abs(thrusts).max()
    for rotor, thrust in zip(v.rotors, thrusts, strict=True):
        low, high = -np.inf if rotor.low is None else rotor.low, rotor.high or np.inf
        if not low - slack <= thrust <= high + slack:
            limit = f"{low:.4g} N at least" if thrust < low else f"{high:.4g} N at most"
            hint = " (--reversible, if it can push backwards)" if thrust < 0 else ""
            return f"cannot hover: needs {thrust:.4g} N of {rotor.name}, which has {limit}{hint}"
    return ""


def _span(values: Array) -> str:
    low, high = f"{values.min():.4g}", f"{values.max():.4g}"
    return low if low == high else f"{low} to {high}"


def _heading(text: Text, v: Vehicle, body: Body, request: Request) -> None:
    text.say(
        f"{v.name}: the vehicle of {request.path.name} ({v.form}). Behind a number stand the file "
        "and line that have it."
    )
    where = f"Body axes: those of {v.base}."
    at = row(body.centre, zero=1e-12 + ROUND * np.abs(body.centre).max())
    if body.kind == "auv":
        text.say(
            f"{where} Origin: its origin, where the water acts; the centre of mass is at {at} m."
        )
    else:
        text.say(f"{where} Origin: the centre of mass, at {at} m in them.")
    text.say("Mass, kg, and centre of mass, m, of the links, of which the inertia is composed:")
    for link in v.links[:MOST_LINKS]:
        at = row(link.centre, zero=1e-12)
        where = link.place if link.name in link.place else f"{link.name}, {link.place}"
        text.say(f"  {number(link.mass)} at {at}: {where}", hanging="    ")
    if len(v.links) > MOST_LINKS:
        rest = sum(link.mass for link in v.links[MOST_LINKS:])
        text.say(f"  {number(rest)}: {len(v.links) - MOST_LINKS} links more")
    for note in _grouped(v.notes):
        text.say(f"Note: {note}", hanging="  ")
    for note in _grouped(v.missing):
        text.say(f"Not in the file: {note}", hanging="  ")
    if body.kind == "quadrotor" and not v.rotors:
        text.say("No rotor of the file is read; add `actuators`, see docs/howto/rotors.md")
    text.add()


def _grouped(notes: Iterable[str]) -> list[str]:
    """Return notes, of those that differ in numbers and names alone the first."""
    groups: dict[str, list[str]] = {}
    for note in notes:
        key = re.sub(r"[\w./-]+:\d+|[\w:/]*\d[\w:/]*", "", note)
        groups.setdefault(key, []).append(note)
    return [
        group[0] if len(group) == 1 else f"{group[0]} (and {len(group) - 1} more such)"
        for group in groups.values()
    ]


def _inertia(text: Text, v: Vehicle, body: Body) -> None:
    J = body.tensor
    upper = row(J[np.triu_indices(3)], zero=ROUND * np.abs(J).max())
    units = "kg m^2 and kg: ixx, ixy, ixz, iyy, iyz, izz about the centre of mass"
    if body.kind == "satellite" and not v.rotors:
        text.add("group: SO3", "V = ω in the body frame")
        spin = "; without the spin of the wheels" if v.wheels else ""
        text.add(f"inertia: {{ urdf: {upper} }}", f"kg m^2: ixx, ixy, ixz, iyy, iyz, izz{spin}")
    elif v.water is None or body.kind != "auv":
        text.add("group: SE3", "V = (ω, v) in the body frame")
        text.say(units)
        text.add(f"inertia: {{ urdf: {upper}, mass: {number(body.mass)} }}")
    else:
        text.add("group: SE3", "V = (ω, v) in the body frame")
        M = rigid(body)
        if v.water.added.any():
            text.add("inertia:", "kg m^2, kg m and kg, about the origin")
            text.rows("rigid", M, 2)
            text.rows("added", v.water.added, 2, v.water.place)
        else:
            text.rows("inertia", M, 0, "kg m^2, kg m and kg, about the origin")
    low, middle, high = np.linalg.eigvalsh(J)
    if low + middle < high * (1 - ROUND):
        text.add("rigid: false", f"as in the file: {low:.4g} + {middle:.4g} < {high:.4g} kg m^2")
    text.add()


def rigid(body: Body) -> Array:
    """Return the inertia of the body about the origin, ``(6, 6)``."""
    m, S = body.mass, skew(body.centre - body.origin)
    top = body.tensor - m * S @ S
    return np.block([[top, m * S], [-m * S, m * np.eye(3)]])


def _laws(text: Text, v: Vehicle, body: Body, w: float) -> None:
    """Write the reference, and a law whose small errors have both poles at −ω."""
    if body.hovers:
        K, K_d = attitude_gains(body.tensor, w)
        s, along = w / 5, row(body.main, zero=1e-9)
        text.add("reference: { kind: flat, position: [0, 0, 0], heading: 0 }", "hover")
        text.add("controllers:")
        text.add("  - kind: cascade")
        text.add("    attitude: lee2010")
        poles = f"both poles at −{number(s, 4)} rad/s: 1/s^2, 1/s; m/s^2"
        text.add(f"    position: {{ kx: {s * s:.4g}, kv: {2 * s:.4g}, limit: 6 }}", poles)
        text.say(f"both poles of the attitude at −{number(w, 4)} rad/s: N m, N m s", 4)
        text.add("    gains:")
        text.gain("kp", K, 6)
        text.gain("kd", K_d, 6)
        text.add(f"    along: {along}", "the direction in which its rotors lift")
        return
    text.add("reference: { kind: constant }", "at the origin")
    if body.kind == "satellite" and not v.rotors:
        K, K_d = attitude_gains(body.tensor, w)
        text.add("controllers: [lee2010, bullo_murray]", "their gains act in the body")
        text.say(f"both poles at −{number(w, 4)} rad/s: N m, N m s")
        text.add("gains:")
        text.gain("kp", K, 2)
        text.gain("kd", K_d, 2)
        return
    M = rigid(body) + (v.water.added if v.water is not None and body.kind == "auv" else 0.0)
    K, K_d = attitude_gains(M[:3, :3], w)
    masses = np.diag(M)[3:]
    spring = w * w * masses.max()
    kp, kd = block(K, [spring]), block(K_d, [*(2 * np.sqrt(spring * masses))])
    text.add("controllers: [eqt, gt]")
    text.say(f"both poles of each small error at −{number(w, 4)} rad/s or faster")
    text.add("gains:")
    text.gain("kp", kp, 2, "rotation weights, N m; spring of the position, N/m")
    text.gain("kd", kd, 2, "N m s, N s/m")


def _forces(text: Text, v: Vehicle, body: Body) -> None:
    """Write the weight, the buoyancy, and the drag of the water or of the rotors."""
    if body.kind == "satellite":
        text.add()
        return
    text.add()
    weight = number(body.weight)
    water = v.water if body.kind == "auv" else None
    text.add("model:", "what the laws compensate")
    text.add("  forces:")
    if water is None:
        held = f"    - {{ kind: restoring, weight: {weight} }}"
        text.add(held, f"N; {number(body.mass)} kg · {G0}")
        D = rotor_drag(v, body) if body.hovers and v.rotors else None
        if D is None:
            return
        along = np.diag(D)[3:]
        if np.abs(D[3:, 3:] - np.diag(along)).max() <= ROUND * along.max():
            text.add(
                f"    - {{ kind: drag, linear: {row([0, 0, 0, *along])} }}", "N s/m, of the rotors"
            )
        text.add("plant:", "what acts")
        text.add("  forces:")
        text.add(held)
        text.say(
            "drag of the rotors at the speeds η of hover, Σ η k_d Bᵀ (I − a aᵀ) B, with rotorDrag"
            f"Coefficient k_d = {common([rotor.drag for rotor in v.rotors])} N s^2/(rad m), "
            f"{v.rotors[0].place}",
            4,
        )
        text.add("    - kind: drag")
        text.rows("linear", D, 6)
        return
    B = body.weight if water.buoyancy is None else water.buoyancy
    centre = body.centre if water.centre is None else water.centre
    text.say(f"N, m; {water.why or 'assumed: the buoyancy is the weight'}", 4)
    text.add("    - kind: restoring")
    text.add(f"      weight: {weight}")
    text.add(f"      buoyancy: {number(B)}")
    text.add(f"      centre_of_mass: {row(body.centre, zero=1e-12)}")
    text.add(f"      centre_of_buoyancy: {row(centre, zero=1e-12)}")
    if water.linear.any() or water.quadratic.any():
        text.add("    - kind: drag", water.place)
        for key, D in (("linear", water.linear), ("quadratic", water.quadratic)):
            if not (D - np.diag(np.diag(D))).any():
                text.add(f"      {key}: {row(np.diag(D))}")
            else:
                text.rows(key, D, 6)


def rotor_drag(v: Vehicle, body: Body) -> Array | None:
    """Return Σ η k_d Bᵀ (I − a aᵀ) B with B = [−r^, I] at the hubs, ``(6, 6)``; None without it."""
    if not all(rotor.k for rotor in v.rotors) or not any(rotor.drag for rotor in v.rotors):
        return None
    D = np.zeros((6, 6))
    for rotor, thrust in zip(v.rotors, body.thrusts, strict=True):
        across = np.eye(3) - np.outer(rotor.along, rotor.along)
        hub = np.hstack([-skew(rotor.at - body.origin), np.eye(3)])
        speed = np.sqrt(abs(thrust) / (rotor.k or 1.0))
        D += speed * rotor.drag * hub.T @ across @ hub
    return (D + D.T) / 2 if D.any() else None


def _wheels(text: Text, wheels: list[Wheel]) -> None:
    """Write the wheels, behind their lag.

    Raises
    ------
    EqtError
        If their lags differ.
    """
    first, *rest = wheels
    if other := next((wheel for wheel in rest if wheel.lag != first.lag), None):
        raise EqtError(
            f"{other.place}: {other.name} has a lag of {other.lag:g} s, but {first.name} has one "
            f"of {first.lag:g} s ({first.place}); eqt takes one lag of all wheels: give them the "
            "same"
        )
    text.add("actuators:")
    if first.lag:
        text.add(
            f"  - {{ kind: lag, time_constant: {number(first.lag)} }}",
            f"s, of all wheels, {first.place}; before their limit, in MuJoCo behind it",
        )
    text.add("  - kind: wheels")
    text.add("    axes:")
    for wheel in wheels:
        text.add(f"      - {row(wheel.axis, zero=1e-12)}", f"{wheel.name}, {wheel.place}")
    limits = [wheel.limit for wheel in wheels if wheel.limit is not None]
    if len(limits) == len(wheels):
        text.add(f"    limit: {common(limits)}", "N m")
    else:
        text.say("limit: … # N m, is not in the file", 4)
    text.add(
        f"    inertia: {common([wheel.inertia for wheel in wheels])}", "kg m^2, about the axes"
    )


def _rotors(text: Text, v: Vehicle, body: Body) -> None:
    """Write the actuators: rotors by their speeds, propellers that reverse, or thrusters."""
    rotors = v.rotors

    def are(name: str) -> bool:
        return all(getattr(rotor, name) is not None for rotor in rotors)

    limited = are("low") and are("high")
    reverses = limited and any((rotor.low or 0.0) < 0 for rotor in rotors)
    fast = are("k") and limited and (not reverses or all(rotor.up for rotor in rotors))
    spins = fast and all(rotor.turns for rotor in rotors)
    text.add()
    text.add("actuators:")
    text.add(f"  - kind: {'propellers' if fast and reverses else 'thrusters'}")
    _places(text, rotors, body, spins)
    if are("k"):
        k = [rotor.k or 0.0 for rotor in rotors]
        if fast:
            text.add(f"    thrust_constant: {common(k)}", "N s^2/rad^2")
        else:
            text.say(f"thrust_constant: {common(k)} # N s^2/rad^2; needs limits", 4)
        if spins:
            k_m = [
                abs(rotor.turns) * coefficient for rotor, coefficient in zip(rotors, k, strict=True)
            ]
            text.add(f"    moment_constant: {common(k_m)}", "N m s^2/rad^2")
    if fast and are("speed"):
        speeds = [rotor.speed or 0.0 for rotor in rotors]
        text.add(f"    low_speed: {common([-speed * reverses + 0.0 for speed in speeds])}")
        text.add(f"    high_speed: {common(speeds)}", "rad/s")
    elif limited:
        text.add(f"    low: {common([rotor.low or 0.0 for rotor in rotors])}")
        text.add(f"    high: {common([rotor.high or 0.0 for rotor in rotors])}", "N")
    else:
        text.say("low: … # N, is not in the file; without limits, thrusts have none", 4)
        text.say("high: … # N, is not in the file", 4)
    _lags(text, rotors)
    if body.kind == "quadrotor" and not reverses and (body.thrusts < -1e-9 * body.weight).any():
        back = [rotor.name for rotor, f in zip(rotors, body.thrusts, strict=True) if f < 0]
        text.say(
            f"To hover, {', '.join(back)} would have to push backwards. If they can, write the "
            "file again with --reversible.",
            4,
        )


def _lags(text: Text, rotors: list[Rotor]) -> None:
    """Write the lags of the rotors, or that the file has none.

    Raises
    ------
    EqtError
        If some have a lag, and others have none.
    """
    lagging = [rotor for rotor in rotors if rotor.up]
    prompt = next((rotor for rotor in rotors if not rotor.up), None)
    if lagging and prompt:
        raise EqtError(
            f"{prompt.place}: {prompt.name} has no lag, but {lagging[0].name} has one of "
            f"{lagging[0].up:g} s ({lagging[0].place}); eqt takes a lag of all or of none: give "
            "all one"
        )
    if lagging:
        ups, downs = ([getattr(rotor, key) for rotor in rotors] for key in ("up", "down"))
        text.add(f"    time_constant: {common(ups)}", "s, as it speeds up")
        if ups != downs:
            text.add(f"    time_constant_down: {common(downs)}", "s, as it slows down")
    elif all(rotor.up is not None for rotor in rotors):
        text.say("time_constant: … # s; in the file, the thrusts follow at once", 4)
    else:
        text.say("time_constant: … # s, is not in the file", 4)


def _places(text: Text, rotors: list[Rotor], body: Body, spins: bool) -> None:
    """Write the place and the direction of each rotor; `turns` is a sign where they spin."""
    text.add("    thrusters:", "m, from the origin")
    taken: set[str] = set()
    for rotor in rotors:
        turns = ""
        if rotor.turns:
            share = f"{np.sign(rotor.turns):g}" if spins else number(rotor.turns)
            turns = f", turns: {share}"
        at, along = (row(vector, zero=1e-12) for vector in (rotor.at - body.origin, rotor.along))
        name = unique(rotor, taken)
        text.add(f"      - {{ at: {at}, along: {along}{turns}, name: {word(name)} }}", rotor.place)


def unique(rotor: Rotor, taken: set[str]) -> str:
    """Return the last part of the name of a rotor, or its whole name if another one has that."""
    short = re.split(r"::|/", rotor.name)[-1]
    name = short if short not in taken else rotor.name
    number = 2
    while name in taken:
        name, number = f"{rotor.name} {number}", number + 1
    taken.add(name)
    return name
