"""What pushes a model of Gazebo: motors, thrusters, the water, and what eqt has no model of.

Facts of the simulators' sources: MulticopterMotorModel pushes along z of the rotor's link, at its
centre of mass, whatever the axis of its joint; its torque on the parent is −direction · thrust ·
momentConstant. Thruster pushes along the axis of its joint.
"""

from __future__ import annotations

import re
from collections.abc import Callable

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.attributes import is_silent, left_out
from eqt_cli.extensions.vehicles.bodies import G0, Joint, Link, Rotor, Vehicle, Water
from eqt_cli.extensions.vehicles.elements import Element
from eqt_cli.extensions.vehicles.model import WATER, Model, is_plugin
from eqt_cli.extensions.vehicles.request import Request

MOST_WEIGHTS = 1000.0
"""Thrust of all rotors over the weight, from which a constant is no constant."""

MOTOR = r"multicopter.?motor.?model|gazebo_motor_model|GenericMotorModel"
THRUSTER = r"thruster.system|systems::Thruster"
UUV_THRUSTER = r"uuv_thruster"
UUV_WATER = r"uuv_underwater_object"
BUOYANCY = r"sim.buoyancy.system|systems::Buoyancy(?!Engine)|libBuoyancyPlugin"
WINGS = r"lift.?drag"
PX4_WATER = r"libgazebo_uuv_plugin"

NUMBERS = {
    MOTOR: "motor",
    THRUSTER: "thruster",
    UUV_THRUSTER: "uuv_thruster",
    UUV_WATER: "uuv_water",
    WATER: "water",
    BUOYANCY: "buoyancy",
}
"""Where the numbers of a plugin stand in the table of attributes."""

TO_EQT = [3, 4, 5, 0, 1, 2]
"""Torque before force."""

NED = np.diag([1.0, -1.0, -1.0, 1.0, -1.0, -1.0])
"""Forward-right-down to forward-left-up, of torques and forces."""

SEA_WATER, WATER_DENSITY = 1028.0, 1000.0
"""kg/m³; the defaults of uuv_simulator and of Gazebo."""

FOSSEN = [(a, b) for a in "xyzkmn" for b in "UVWPQR"]


def equipped(model: Model, request: Request) -> Vehicle:
    """Return the vehicle of a model: its links, and what its plugins do.

    Raises
    ------
    EqtError
        With file and line, for what is wrong, or what eqt has no model of.
    """
    links = list(model.links.values())
    heavy = [link for link in links if link.mass > 0 or link.inertia.any()]
    vehicle = Vehicle(model.name, model.form, model.base, heavy, notes=model.notes)
    vehicle.floats = model.floats or (bool(heavy) and all(link.weightless for link in heavy))
    _check_weights(model, vehicle, heavy, request)
    readers: list[tuple[str, Callable[[Model, Vehicle, Element, str, Request], None]]] = [
        (MOTOR, _motor),
        (THRUSTER, _thruster),
        (UUV_THRUSTER, _uuv_thruster),
        (UUV_WATER, _uuv_water),
        (WATER, _water),
        (WINGS, _wings),
        (PX4_WATER, _px4_water),
        (BUOYANCY, _buoyancy),
    ]
    for element, scope in model.plugins:
        if element.tag == "properties":
            _gym(model, vehicle, element)
            continue
        for kind, reader in readers:
            if is_plugin(element, kind):
                if gone := _carrier_left_out(element, scope, request):
                    vehicle.notes.append(
                        f"{element.place}: plugin {_title(element)} is left out with {gone}"
                    )
                    break
                reader(model, vehicle, element, scope, request)
                if kind in NUMBERS:
                    what = NUMBERS[kind]
                    vehicle.notes += left_out("plugins", element, f"the plugin {what}", root=what)
                break
        else:
            if not is_silent(element):
                vehicle.notes.append(f"{element.place}: plugin {_title(element)} is left out")
    _check_signs(vehicle)
    vehicle.rotors.sort(key=lambda rotor: rotor.number)
    _tell_joints(model, vehicle)
    if vehicle.is_marine or request.kind == "auv":
        _float(model, vehicle, request)
    return vehicle


def _carrier_left_out(element: Element, scope: str, request: Request) -> str | None:
    """Return what `--without` names that has the link or the joint of a plugin."""
    for key in ("linkName", "jointName", "link_name", "joint_name"):
        if (name := element.words(key)) and (gone := request.left_out(scope + name)):
            return gone
    return None


def _buoyancy(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Note the buoyancy of what is not in water; `_float` reads it where there is water."""
    water = f"{WATER}|{UUV_WATER}|{THRUSTER}|{UUV_THRUSTER}"
    if request.kind != "auv" and not any(is_plugin(plugin, water) for plugin, _ in m.plugins):
        v.notes.append(f"{element.place}: plugin {_title(element)} is left out")


def _check_weights(m: Model, v: Vehicle, heavy: list[Link], request: Request) -> None:
    """Refuse a body of which gravity acts on a part: eqt weighs the whole or nothing."""
    light = [link for link in heavy if link.weightless and link.mass > 0]
    if light and not v.floats and request.kind != "satellite":
        mass = sum(link.mass for link in light)
        raise EqtError(
            f"{light[0].weightless}: no gravity acts on {light[0].name}: {mass:g} kg of "
            f"{sum(link.mass for link in heavy):g} kg have no weight, but eqt weighs all links or "
            "none; let gravity act on all of them, or give --vehicle satellite"
        )


def _title(element: Element) -> str:
    return element.attributes.get("name") or element.attributes.get("filename", "?")


def _tell_joints(model: Model, vehicle: Vehicle) -> None:
    """Note joints that are held at 0, and those to the world; and what links and joints say."""
    turning = {rotor.name for rotor in vehicle.rotors}
    loose = [
        joint
        for joint in model.joints.values()
        if joint.kind != "fixed" and joint.child in model.links and joint.child not in turning
    ]
    if loose:
        names = ", ".join(joint.name for joint in loose)
        vehicle.notes.append(f"{loose[0].place}: joints that can move are held at 0: {names}")
        vehicle.notes += filter(None, map(_outside_limits, loose))
    form = model.form.split()[0]
    for part, label in model.parts:
        apart = ("link", "joint", "model", "include", "gazebo", "world")
        vehicle.notes += left_out(form, part, label, apart)
    for link in model.links.values():
        if link.element is not None:
            vehicle.notes += left_out(form, link.element, f"link {link.name}")
    for joint in model.joints.values():
        if joint.element is not None:
            notes = list(left_out(form, joint.element, f"joint {joint.name}"))
            vehicle.notes += notes if joint in loose else []
    for joint in model.joints.values():
        if "world" in (joint.parent, joint.child):
            vehicle.notes.append(f"{joint.place}: joint {joint.name} to the world is left out")


def _outside_limits(joint: Joint) -> str:
    """Return what to say of a joint that the limits of the file keep away from 0."""
    if (element := joint.element) is None or joint.kind == "continuous":
        return ""
    low, high = -np.inf, np.inf
    if (limits := element.one("limit")) is not None:
        low, high = (float(limits.numbers(1, end, "0")[0]) for end in ("lower", "upper"))
    elif (limits := element.one("axis/limit")) is not None:
        low, high = limits.number("lower", low), limits.number("upper", high)
    if limits is None or low <= 0 <= high or low > high:
        return ""
    what = f"joint {joint.name} is held at 0, outside its limits {low:g} to {high:g}"
    return f"{limits.place}: {what}"


# Rotors and thrusters -----------------------------------------------------------------------------


DEFAULTS = {
    "motorConstant": 8.54858e-06,
    "momentConstant": 0.016,
    "maxRotVelocity": 838.0,
    "timeConstantUp": 1 / 80,
    "timeConstantDown": 1 / 40,
    "rotorDragCoefficient": 1e-4,
}
"""What Gazebo takes for numbers of a motor that a file leaves out."""


def _or_default(v: Vehicle, element: Element, name: str) -> float:
    """Return a number of a motor; without it that of Gazebo, which is told."""
    if element.one(name) is None:
        v.notes.append(
            f"{element.place}: <{name}> is missing; assumed as Gazebo {DEFAULTS[name]:g}"
        )
    return element.number(name, DEFAULTS[name])


def _motor(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Add a motor of Gazebo, RotorS or PX4, by the name of its link."""
    kind = element.words("motorType") or "velocity"
    if kind == "position":
        return  # a servo, whose joint is held at 0
    link = m.links[m.named("link", scope, element.words("linkName"), element.place)]
    joint = m.joints[m.named("joint", scope, element.words("jointName"), element.place)]
    turns = {"ccw": -1.0, "cw": 1.0}.get(element.words("turningDirection"))
    if turns is None:
        got = element.words("turningDirection")[:20]
        raise EqtError(f"{element.place}: turningDirection: expected cw or ccw, got '{got}'")
    along = link.pose[:3, 2]
    if abs(abs(joint.axis @ along) - 1) > 1e-3:
        angle = np.degrees(np.arccos(np.clip(joint.axis @ along, -1, 1)))
        v.notes.append(
            f"{element.place}: {link.name} pushes along z of its link, as in Gazebo, not along the "
            f"axis of its joint, which is {angle:.0f}° off"
        )
    rotor = Rotor(
        link.name,
        element.place,
        link.centre,
        along,
        turns=turns * _or_default(v, element, "momentConstant"),
        up=_positive(v, element, "timeConstantUp"),
        down=_positive(v, element, "timeConstantDown"),
        drag=_or_default(v, element, "rotorDragCoefficient"),
    )
    _add_numbered(v, rotor, element, "motorNumber")
    if kind == "force_polynomial":
        _by_polynomial(v, rotor, element)
        return
    if kind != "velocity":
        raise EqtError(f"{element.place}: motorType: expected velocity, got '{kind[:20]}'")
    rotor.k = _or_default(v, element, "motorConstant")
    if rotor.k == 0:
        raise EqtError(f"{element.place}: motorConstant: expected a positive number, got 0")
    rotor.speed = _positive(v, element, "maxRotVelocity")
    rotor.high = abs(rotor.k) * rotor.speed**2
    rotor.low = -rotor.high if request.reversible or element.holds("reversible") else 0.0


def _add_numbered(v: Vehicle, rotor: Rotor, element: Element, tag: str) -> None:
    """Add a rotor; two of the same number get the same command, which eqt would allocate apart."""
    rotor.number = element.number(tag, float(len(v.rotors)))
    rotor.command = "" if element.one(tag) is None else f"{tag} {rotor.number:g}"
    for other in v.rotors:
        if rotor.command and rotor.command == other.command:
            raise EqtError(
                f"{element.place}: {rotor.name} has {rotor.command}, as {other.name} has "
                f"({other.place}); give each motor another number"
            )
    v.rotors.append(rotor)


def _check_signs(v: Vehicle) -> None:
    """Turn rotors with negative constants round; refuse constants of both signs."""
    down = [rotor for rotor in v.rotors if rotor.k is not None and rotor.k < 0]
    up = [rotor for rotor in v.rotors if rotor.k is not None and rotor.k > 0]
    if down and up:
        raise EqtError(
            f"{down[0].place}: motorConstant of {down[0].name} is {down[0].k:g}, but "
            f"{up[0].name} has {up[0].k:g} ({up[0].place}), so that they push against each other; "
            "correct the sign, or turn the link of a rotor that pushes down"
        )
    for rotor in down:
        rotor.k, rotor.along = abs(rotor.k or 0.0), -rotor.along
        v.notes.append(f"{rotor.place}: motorConstant is negative: {rotor.name} pushes along −z")


def _positive(v: Vehicle, element: Element, name: str) -> float:
    """Return a number of a motor that must be above 0."""
    value = _or_default(v, element, name)
    if not value > 0:
        raise EqtError(f"{element.place}: {name}: expected a positive number, got {value:g}")
    return value


def _by_polynomial(v: Vehicle, rotor: Rotor, element: Element) -> None:
    """Take the ends of thrust polynomials of the duty cycle, which is 1 at full thrust."""

    def end(name: str) -> float:
        there = element.one(name)
        words = re.sub(r"[\[\],]", " ", "" if there is None else there.text).split()
        if there is None or not words:
            raise EqtError(f"{element.place}: motorType force_polynomial needs <{name}>; add it")
        numbers = Element(name, {}, there.place, text=" ".join(words)).numbers(len(words))
        return float(numbers.sum())

    rotor.high = end("positiveThrustPolynomial")
    rotor.low = -end("negativeThrustPolynomial") if element.holds("bidirectionalMotor") else 0.0
    rotor.turns = 0.0
    v.is_marine = v.is_marine or rotor.low < 0
    v.notes.append(
        f"{element.place}: of the thrust polynomials of {rotor.name}, the ends are taken, "
        f"{rotor.low:.4g} to {rotor.high:.4g} N; its motorConstant and its torque are left out"
    )


def _thruster(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Add a thruster of Gazebo, along the axis of its joint."""
    joint = m.joints[m.named("joint", scope, element.words("joint_name"), element.place)]
    link = m.links[joint.child]
    rotor = Rotor(link.name, element.place, link.pose[:3, 3], joint.axis)
    if element.one("max_thrust_cmd") is not None or element.one("min_thrust_cmd") is not None:
        rotor.high = element.number("max_thrust_cmd", 1000.0)
        rotor.low = element.number("min_thrust_cmd", -1000.0)
    elif request.thrust is None:
        v.missing.append(
            f"{element.place}: {link.name} has no <max_thrust_cmd>, and Gazebo's 1000 N are no "
            "limit; give --thrust=LOW,HIGH"
        )
    v.is_marine = True
    rotor.number = float(len(v.rotors))
    v.rotors.append(rotor)


def _uuv_thruster(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Add a thruster of uuv_simulator, along the axis of its joint."""
    joint = m.joints[m.named("joint", scope, element.words("jointName"), element.place)]
    link = m.links[m.named("link", scope, element.words("linkName"), element.place)]
    rotor = Rotor(link.name, element.place, link.centre, joint.axis)
    kind = element.words("conversion/type")
    if kind == "Basic":
        rotor.k = element.number("conversion/rotorConstant")
        if rotor.k == 0:
            raise EqtError(f"{element.place}: rotorConstant: expected a number other than 0")
        # It pushes both ways, so that the sign is that of the command alone.
        rotor.k, rotor.along = abs(rotor.k), rotor.along * np.sign(rotor.k)
    elif kind == "LinearInterp" and (ends := element.one("conversion/outputValues")) is not None:
        thrusts = ends.numbers(len(ends.text.split()) or 1)
        rotor.low, rotor.high = float(thrusts.min()), float(thrusts.max())
    else:
        v.notes.append(f"{element.place}: conversion '{kind[:20]}' of {link.name} is left out")
    if element.one("thrustMax") is not None:
        rotor.high = element.number("thrustMax")
        rotor.low = element.number("thrustMin", -rotor.high)
    lag = element.words("dynamics/type")
    if lag == "FirstOrder":
        rotor.up = rotor.down = element.number("dynamics/timeConstant")
    elif lag == "ZeroOrder":
        rotor.up = rotor.down = 0.0
    elif lag:
        v.notes.append(f"{element.place}: dynamics '{lag[:20]}' of {link.name} are left out")
    if rotor.high is None and request.thrust is None:
        v.missing.append(
            f"{element.place}: no limit of the thrust of {link.name}; give --thrust=LOW,HIGH"
        )
    v.is_marine = True
    _add_numbered(v, rotor, element, "thrusterID")


YAW = {"racer": (1.0, -1.0, 1.0, -1.0)}
"""Signs of the torques in gym-pybullet-drones' code, by robot; of others, the opposite."""


def _gym(m: Model, v: Vehicle, element: Element) -> None:
    """Add the rotors of gym-pybullet-drones: constants per rpm², places of massless links."""

    def number(name: str, default: str | None = None) -> float:
        return float(element.numbers(1, name, default)[0])

    k, k_m = (number(name) * (60 / (2 * np.pi)) ** 2 for name in ("kf", "km"))
    if not (k > 0 and k_m > 0):
        raise EqtError(f"{element.place}: kf, km: expected positive numbers; correct <properties>")
    places = [link for name, link in m.links.items() if re.fullmatch(r"prop\d+_link", name)]
    if len(places) != 4:
        count = f"expected four links prop0_link to prop3_link, got {len(places)}"
        raise EqtError(f"{element.place}: {count}; add `actuators` by hand (docs/howto/rotors.md)")
    mass = sum(link.mass for link in v.links)
    high = number("thrust2weight") * 9.8 * mass / 4  # g of its code
    signs = YAW.get(m.name, (-1.0, 1.0, -1.0, 1.0))
    for link, sign in zip(places, signs, strict=True):
        rotor = Rotor(link.name, link.place, link.centre, link.pose[:3, 2], k, sign * k_m / k)
        rotor.low, rotor.high, rotor.speed = 0.0, high, float(np.sqrt(high / k))
        rotor.drag = number("drag_coeff_xy", "0")
        rotor.number = float(len(v.rotors))
        v.rotors.append(rotor)
    v.notes.append(
        f"{element.place}: the signs of `turns` are in the code of gym-pybullet-drones, not in the "
        "file: assumed are those of its robot of this name"
    )
    v.notes.append(f"{element.place}: kf and km are per rpm²; the largest thrust is for g = 9.8")


def check_thrusts(vehicle: Vehicle, request: Request, mass: float) -> None:
    """Apply `--thrust` and `--reversible`, and refuse constants that are none.

    Raises
    ------
    EqtError
        If all rotors push by more than `MOST_WEIGHTS` times the weight.
    """
    most = MOST_WEIGHTS * mass * G0
    for rotor in vehicle.rotors:
        top = sum(other.high or 0.0 for other in vehicle.rotors)
        dummy = rotor.k is not None and top > most
        if dummy and request.thrust is None:
            raise EqtError(
                f"{rotor.place}: the constant {rotor.k:g} N s²/rad² makes {rotor.high:.3g} N, and "
                f"all rotors {top / (mass * G0):.3g} times the weight: another plugin reads it "
                "otherwise; give --thrust=LOW,HIGH"
            )
        if dummy:
            rotor.k = None
    for rotor in vehicle.rotors:
        if request.limits is not None:
            rotor.low, rotor.high = request.limits
            rotor.speed = None
        elif request.reversible and rotor.high is not None and rotor.low == 0:
            rotor.low = -rotor.high
        if rotor.high is not None and not (rotor.low or 0.0) < rotor.high:
            raise EqtError(
                f"{rotor.place}: {rotor.name} pushes by {rotor.low or 0:g} N at least and "
                f"{rotor.high:g} N at most; correct its limits, or give --thrust=LOW,HIGH"
            )
        if rotor.high is not None and rotor.high > most:
            raise EqtError(f"{rotor.place}: {rotor.high:.3g} N is over 1000 weights; give --thrust")


# Water --------------------------------------------------------------------------------------------


def _water(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Add Gazebo's Hydrodynamics, in Fossen's notation: xU damps by −4, xDotU is −5.

    Before its sign was changed, added mass was positive; damping was negative in every version.
    """
    m.named("link", scope, element.words("link_name"), element.place)
    linear = np.array([element.number(a + b, 0.0) for a, b in FOSSEN]).reshape(6, 6)
    dot = np.array([element.number(f"{a}Dot{b}", 0.0) for a, b in FOSSEN]).reshape(6, 6)
    absolute = np.array([element.number(f"{a}{b}abs{b}", 0.0) for a, b in FOSSEN]).reshape(6, 6)
    square = np.array([element.number(f"{a}{b}{b}", 0.0) for a, b in FOSSEN]).reshape(6, 6)
    if square.any() and not absolute.any():
        v.notes.append(f"{element.place}: xUU and the like are taken as xUabsU, |U| U")
        absolute = square
    tags = {f"{a}{b}abs{b}" for a, b in FOSSEN}
    for child in element.children:
        name = re.fullmatch(r"[xyzkmn][UVWPQR]abs[UVWPQR]", child.tag)
        if name and child.tag not in tags and child.numbers(1).any():
            v.notes.append(f"{child.place}: <{child.tag}> is left out")
    damping = np.concatenate([np.diag(linear), np.diag(absolute)])
    _check_damping(element.place, damping, "xU = −4 damps")
    masses = np.diag(dot)
    if (masses > 0).any() and (masses < 0).any():
        raise EqtError(
            f"{element.place}: added mass of both signs; Fossen's xDotU is negative, in Gazebo "
            "before 8 it was positive: correct the file"
        )
    sign = 1.0 if (masses > 0).any() else -1.0
    if sign > 0:
        v.notes.append(
            f"{element.place}: added mass is positive, as in Gazebo before 8; its size is taken"
        )
    if element.holds("disable_added_mass"):
        v.notes.append(f"{element.place}: <disable_added_mass> is on")
        dot = 0.0 * dot
    order = np.ix_(TO_EQT, TO_EQT)
    v.water = Water(element.place, sign * dot[order], -linear[order], -absolute[order])
    _symmetric(v)
    v.is_marine = True


def _check_damping(place: str, damping: Array, example: str) -> None:
    """Refuse damping that drives, or that is of both signs."""
    if (damping > 0).any():
        both = (damping < 0).any()
        what = "damping of both signs" if both else "positive damping, which drives the body"
        raise EqtError(f"{place}: {what}; in this plugin {example}: correct the signs")


def _symmetric(v: Vehicle) -> None:
    """Make the added mass symmetric, and say where it was not."""
    assert v.water is not None
    A = v.water.added
    off = np.abs(A - A.T).max()
    if off > 0:
        v.notes.append(
            f"{v.water.place}: added mass is not symmetric by {off:.2g}; the mean is taken"
        )
    v.water.added = (A + A.T) / 2


def _uuv_water(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    """Add the water of uuv_simulator, whose matrices are in forward-right-down.

    Its added mass is positive, its damping negative.
    """
    of = list(element.all("link"))
    if len(of) != 1:
        raise EqtError(f"{element.place}: the water acts on {len(of)} links; of one link alone")
    name = m.named("link", scope, of[0].attributes.get("name", ""), of[0].place)
    if name != m.base and not np.allclose(m.links[name].pose, np.eye(4)):
        raise EqtError(
            f"{of[0].place}: the water acts on {name}, expected {m.base}; turn the model"
        )
    model = of[0].one("hydrodynamic_model")
    if model is None or model.words("type") != "fossen":
        kind = "" if model is None else model.words("type")
        raise EqtError(f"{of[0].place}: hydrodynamic_model '{kind[:20]}': fossen alone is read")

    def matrix(tag: str) -> Array:
        there = model.one(tag)
        if there is None:
            return np.zeros((6, 6))
        count = len(there.text.split())
        numbers = there.numbers(6 if count < 36 else 36)
        return np.diag(numbers) if count == 6 else numbers.reshape(6, 6)

    added, linear, quadratic = (
        matrix(tag) for tag in ("added_mass", "linear_damping", "quadratic_damping")
    )
    _check_damping(model.place, np.concatenate([np.diag(linear), np.diag(quadratic)]), "−74 damps")
    if (np.diag(added) < 0).any():
        raise EqtError(f"{model.place}: added mass is negative; in uuv_simulator it is positive")
    if matrix("linear_damping_forward_speed").any():
        v.notes.append(f"{model.place}: linear_damping_forward_speed is left out")
    order = np.ix_(TO_EQT, TO_EQT)
    added, linear, quadratic = (NED @ matrix[order] @ NED for matrix in (added, linear, quadratic))
    v.water = Water(model.place, added, -linear, -quadratic)
    _symmetric(v)
    density = of[0].number("fluid_density", element.number("fluid_density", SEA_WATER))
    if of[0].holds("neutrally_buoyant"):
        v.water.buoyancy = sum(link.mass for link in v.links) * G0
        v.water.why = f"{of[0].place}: neutrally_buoyant"
    elif of[0].one("volume") is not None:
        volume = of[0].number("volume")
        v.water.buoyancy = density * G0 * volume
        v.water.why = f"{of[0].place}: {volume:g} m³ of {density:g} kg/m³"
    centre = of[0].one("center_of_buoyancy")
    v.water.centre = np.zeros(3) if centre is None else centre.numbers(3)
    v.is_marine = True


def _float(m: Model, v: Vehicle, request: Request) -> None:
    """Give a vehicle in water its buoyancy: by collision shapes, as Gazebo's Buoyancy does."""
    v.is_marine = True
    if v.water is None:
        v.missing.append("no plugin of the file has drag or added mass of the water")
        none = np.zeros((6, 6))
        v.water = Water(request.path.name, none, none, none)
    if v.water.buoyancy is not None:
        return
    density = WATER_DENSITY
    for element, _ in m.plugins:
        if is_plugin(element, BUOYANCY):
            density = element.number("uniform_fluid_density", density)
    shapes = [shape for link in m.links.values() for shape in link.shapes]
    volumes = [shape for shape in shapes if shape is not None]
    total = sum(volume for volume, _ in volumes)
    if total > 0 and len(volumes) == len(shapes):
        v.water.buoyancy = density * G0 * total
        v.water.centre = sum((V * at for V, at in volumes), np.zeros(3)) / total
        v.water.why = f"{total:.6g} m³ of collision shapes in {density:g} kg/m³, as in Gazebo"
        return
    why = "a collision shape is a mesh" if shapes else "no link has a collision shape"
    v.missing.append(f"the buoyancy: {why}; assumed is the weight, at the centre of mass")


# What eqt has no model of -------------------------------------------------------------------------


def _wings(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    what = f"{element.place}: lift and drag of wings, fins or blades ({_title(element)})"
    if not request.wingless:
        raise EqtError(f"{what} are not in eqt; --wingless leaves them out")
    v.notes.append(f"{what} are left out, as --wingless asks")


def _px4_water(m: Model, v: Vehicle, element: Element, scope: str, request: Request) -> None:
    raise EqtError(
        f"{element.place}: PX4's own plugin {_title(element)} moves the body and reads the motor "
        "constants otherwise; eqt does not read it: give the file of Gazebo 8 or later, or a URDF"
    )
