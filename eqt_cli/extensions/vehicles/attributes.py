"""What eqt does with each element and attribute of a vehicle file, and with plugins of Gazebo.

`FORMATS` says of each: `used`; `many`, used and may stand there more than once; `without` effect
on the motion of a rigid body in flight; `noted`, left out with a note; `refused`. A value that
changes nothing, such as a damping of 0, is neither noted nor refused. The first row that fits
holds: in ``link: inertial/*``, ``*`` fits all that is below; ``@name`` is an attribute, and of MJCF
all names are.

Sources: the schemas of MuJoCo 4.0.0 and 3.3.7 (mj_printSchema), of SDF 1.4 to 1.12 and URDF
(urdf.xsd of urdfdom 4.0.1); sdformat's parser_urdf.cc for what a ``<gazebo>`` of a URDF holds, and
the sources of the plugins: gz-sim 11, PX4-SITL_gazebo-classic, rotors_simulator and uuv_simulator.
"""

from __future__ import annotations

import re
from collections import Counter
from collections.abc import Iterator
from fnmatch import translate
from functools import cache

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.vehicles.elements import Element, shortened

USED, MANY, WITHOUT, NOTED, REFUSED = "used", "many", "without", "noted", "refused"

SDF = """
many     sdf: model world include
used     sdf: @version @xmlns*
without  sdf: actor light
used     world: @name gravity
many     world: model include frame plugin joint
without  world: actor atmosphere audio gui light magnetic_field physics population road scene
without  world: spherical_coordinates state wind
used     model: @name @canonical_link @placement_frame @xmlns* static pose
many     model: link joint frame model include plugin
noted    model: enable_wind
without  model: @namespace allow_auto_disable self_collide gripper model_state
used     frame: @name @attached_to pose
used     include: @merge uri pose name static placement_frame
many     include: plugin
without  include: namespace model_state
refused  include: experimental:params
used     link: @name pose inertial gravity
used     link: inertial/@auto inertial/mass inertial/pose inertial/inertia inertial/inertia/*
noted    link: inertial/fluid_added_mass
without  link: inertial/density inertial/auto_inertia_params
many     link: collision
used     link: collision/pose collision/geometry
many     link: collision/geometry/*
without  link: collision/*
noted    link: velocity_decay enable_wind
refused  link: kinematic
without  link: audio_sink audio_source battery light must_be_base_link particle_emitter
without  link: projector self_collide sensor visual frame inertial/frame
used     joint: @name @type parent child pose axis axis/xyz axis/use_parent_model_frame
used     joint: axis/limit axis/limit/lower axis/limit/upper
used     joint: axis/mimic axis/mimic/@joint axis/mimic/@axis axis/mimic/multiplier
refused  joint: axis/mimic/offset axis/mimic/reference
noted    joint: axis/dynamics axis/initial_position
without  joint: axis/limit/* axis2 gearbox_ratio gearbox_reference_body thread_pitch
without  joint: screw_thread_pitch physics sensor frame
used     pose: @frame @relative_to @degrees @rotation_format
used     xyz: @expressed_in
"""
"""Rows of an `axis` hold for joints that can move, which are held at 0 with a note."""

URDF = """
used     robot: @name
many     robot: link joint gazebo properties
without  robot: @version @xmlns* material sensor
noted    robot: transmission
used     link: @name inertial
used     link: inertial/origin inertial/mass inertial/inertia
many     link: collision
used     link: collision/origin collision/geometry
many     geometry: box cylinder sphere capsule
without  geometry: mesh
without  link: @type visual collision/*
used     joint: @name @type origin parent child axis limit
used     joint: parent/@link child/@link axis/@xyz limit/@lower limit/@upper
used     joint: mimic mimic/@joint mimic/@multiplier
refused  joint: mimic/@offset
noted    joint: dynamics
without  joint: calibration safety_controller limit/@effort limit/@velocity
used     origin: @xyz @rpy
used     mass: @value
used     inertia: @ixx @ixy @ixz @iyy @iyz @izz
used     geometry/box: @size
used     geometry/cylinder: @radius @length
used     geometry/sphere: @radius
used     geometry/capsule: @radius @length
used     properties: @*
used     gazebo: @reference turnGravityOff gravity
many     gazebo: plugin
refused  gazebo: static kinematic inertial
noted    gazebo: dampingFactor maxVel velocity_decay initialJointPosition enable_wind
without  gazebo: material minDepth mu1 mu2 fdir1 kp kd selfCollide maxContacts laserRetro
without  gazebo: provideFeedback stopCfm stopErp fudgeFactor cfmDamping implicitSpringDamper
noted    gazebo: springReference springStiffness
without  gazebo: canonicalBody disableFixedJointLumping preserveFixedJoint visual collision sensor
"""

MJCF = """
used     mujoco: model
used     compiler: alignfree angle assetdir autolimits balanceinertia boundinertia boundmass
used     compiler: coordinate eulerseq fitaabb fusestatic inertiafromgeom inertiagrouprange meshdir
used     compiler: settotalmass strippath
without  compiler: conflict discardvisual passthrough savecanonical savecompiled saveinertial
without  compiler: texturedir usethread lengthrange/*
used     option: gravity actuatorgroupdisable
noted    option: density viscosity wind
used     option: flag/gravity flag/clampctrl
refused  option: flag/actuation
without  option: *
without  size: *
without  statistic: *
without  visual: *
used     default: class
without  extension: *
used     asset: mesh/* model/* hfield/*
without  asset: skin/* texture/* material/*
used     include: file prefix
used     frame: name childclass pos quat axisangle euler xyaxes zaxis
used     replicate: count offset sep euler
used     attach: body frame model prefix
used     body: axisangle childclass euler fuse mocap name pos quat xyaxes zaxis inertial/*
used     body: composite/*
refused  body: gravcomp plugin/*
without  body: simple sleep user camera/* light/*
used     freejoint: align name
without  freejoint: group
used     joint: axis class name pos ref type actuatorfrclimited actuatorfrcrange
noted    joint: armature damping frictionloss limited range springdamper springref
noted    joint: springyield stiffness
used     joint: kind
without  joint: actuatorgravcomp group margin solimpfriction solimplimit solreffriction solreflimit
without  joint: solimpfix solreffix user
used     geom: axisangle class density euler fitscale fromto group hfield mass mesh name pos quat
used     geom: shellinertia size type xyaxes zaxis plugin/*
noted    geom: fluidcoef fluidshape
without  geom: adhesion castshadow conaffinity condim contype friction gap margin material priority
without  geom: rgba solimp solmix solref surfacevel user
used     site: axisangle class euler fromto name pos quat size xyaxes zaxis
without  site: group material mesh rgba type user
refused  flexcomp: *
refused  deformable: flex/*
without  deformable: skin/*
without  contact: *
noted    tendon: *
noted    equality: *
used     general: actlimited actrange class ctrllimited ctrlrange dynprm dyntype forcelimited
used     general: forcerange gainprm gaintype gear joint name site
noted    general: armature biasprm biastype body cranklength cranksite damping delay ffrange
noted    general: inheritrange input jointinparent refsite slidersite tendon velrange
refused  general: actdim
without  general: actearly group interp lengthrange nsample user
used     motor: class ctrllimited ctrlrange forcelimited forcerange gear joint name site
noted    motor: armature cranklength cranksite damping delay jointinparent refsite slidersite
noted    motor: tendon
without  motor: group interp lengthrange nsample user
noted    actuator: position/* velocity/* intvelocity/* orientation/* pid/* damper/* cylinder/*
noted    actuator: muscle/* adhesion/* dcmotor/*
refused  actuator: plugin/*
without  sensor: *
without  custom: *
without  keyframe: *
"""
"""MuJoCo composes the bodies, and resolves classes and angles: `mjcf` asks its compiled model."""

PLUGINS = """
used     motor: jointName linkName motorNumber motorType turningDirection motorConstant reversible
used     motor: momentConstant maxRotVelocity timeConstantUp timeConstantDown rotorDragCoefficient
used     motor: positiveThrustPolynomial negativeThrustPolynomial bidirectionalMotor
without  motor: robotNamespace *Topic actuator_number rotorVelocitySlowdownSim
without  motor: joint_control_pid rotor_velocity_units
used     thruster: joint_name max_thrust_cmd min_thrust_cmd
without  thruster: namespace topic battery_name power_load use_angvel_cmd velocity_control
without  thruster: thrust_coefficient propeller_diameter fluid_density
used     uuv_thruster: jointName linkName thrusterID thrustMax thrustMin conversion dynamics
used     uuv_thruster: conversion/type conversion/rotorConstant conversion/outputValues
used     uuv_thruster: dynamics/type dynamics/timeConstant
without  uuv_thruster: *Topic conversion/inputValues debug robotNamespace
used     uuv_water: fluid_density link link/@name link/neutrally_buoyant link/volume
used     uuv_water: link/center_of_buoyancy link/fluid_density link/hydrodynamic_model
used     uuv_water: link/hydrodynamic_model/type link/hydrodynamic_model/added_mass
used     uuv_water: link/hydrodynamic_model/linear_damping link/hydrodynamic_model/quadratic_damping
used     uuv_water: link/hydrodynamic_model/linear_damping_forward_speed
without  uuv_water: use_global_current flow_velocity_topic debug link/box link/height
without  uuv_water: link/bounding_box
used     water: link_name disable_added_mass [xyzkmn][UVWPQR] [xyzkmn]Dot[UVWPQR]
used     water: [xyzkmn][UVWPQR]abs[UVWPQR] [xyzkmn]UU [xyzkmn]VV [xyzkmn]WW [xyzkmn]PP
used     water: [xyzkmn]QQ [xyzkmn]RR
without  water: namespace water_density
used     buoyancy: uniform_fluid_density
"""
"""Numbers of the plugins that are read; others of them are noted."""

SILENT = """
acousticcomms airpressure airspeed altimeter breadcrumbs cameravideorecorder colladaworldexporter
commsendpoint contact cpulidar dvl entitysemantics environmentalsensor followactor forcetorque
freespaceexplorer imu jointstatepublisher kineticenergymonitor label led lensflare log
logvideorecorder logicalaudiosensor logicalcamera magnetometer modelphotoshoot navsat
odometrypublisher opticaltactile perfectcomms performerdetector physics posepublisher rfcomms
scenebroadcaster sensors shaderparam thermal touch triggeredpublisher usercommands websocketserver
multicoptervelocitycontrol multicoptercontrol
arucomarker aruco barometer cameramanager controllerinterface gps groundtruth gstcamera irlock lidar
mavlinkinterface opticalflow opticalflowmockup posesniffer sonar usercamera videostreamwidget vision
multirotorbase forcevisual geotaggedimages leepositioncontroller rollpitchyawratethrustcontroller
bag noisydepth octomap odometry pressure rosinterface interface hilinterface basesensor camera cpc
posegt rpt basemodel subseapressure imagesonar scrosinterface scinterface accelerationstest p3d
"""
"""Plugins without effect on the motion: sensors, messages, pictures, logs, and laws, for which eqt
has its own. Names as `plain_name` returns them."""

ROOTS = {
    "SDF": "sdf world model frame include link joint pose xyz",
    "URDF": "robot link joint gazebo origin mass inertia geometry properties",
    "MJCF": "mujoco compiler option size statistic visual default extension asset include frame "
    "replicate attach body freejoint joint geom site flexcomp deformable contact tendon equality "
    "general motor actuator sensor custom keyframe",
    "plugins": "motor thruster uuv_thruster uuv_water water buoyancy",
}
"""Elements at which a path begins anew, so that a row holds wherever they stand."""

FORMATS = {"SDF": SDF, "URDF": URDF, "MJCF": MJCF, "plugins": PLUGINS}


@cache
def rows(form: str) -> list[tuple[str, str, re.Pattern[str]]]:
    """Return the rows of a format: what eqt does, the path, and the pattern of it."""
    table = []
    for line in FORMATS[form].strip().splitlines():
        kind, place, names = line.split(maxsplit=2)
        for name in names.split():
            path = f"{place.rstrip(':')}/{name}"
            table.append((kind, path, re.compile(translate(path))))
    return table


@cache
def kind_of(form: str, path: str) -> str | None:
    """Return what eqt does with what is at a path such as ``link/inertial/mass``; None if unknown.

    An attribute of SDF and URDF is ``joint/@type``.
    """
    for kind, _, pattern in rows(form):
        if pattern.fullmatch(path):
            return kind
    return None


def shortest(form: str, path: str) -> str:
    """Return a path from the last element at which paths begin anew."""
    parts, roots = path.split("/"), ROOTS[form].split()
    starts = [k for k, part in enumerate(parts[:-1]) if part in roots]
    return "/".join(parts[starts[-1] if starts else 0 :])


def plain_name(name: str) -> str:
    """Return what is particular in the name of a plugin: ``libgazebo_imu_plugin.so`` is ``imu``."""
    stem = re.sub(r"\.so$", "", re.split(r"::|/", name)[-1]).lower()
    stem = re.sub(r"^lib|^(gz|ignition)[-_](sim|gazebo)\d*[-_]", "", stem)
    stem = re.sub(r"^(rotors|uuv)[-_]|gazebo[-_]|ros[-_]|[-_]ros(?=[-_]|$)", "", stem)
    return re.sub(r"[-_ ]|systems?$|plugin$", "", re.sub(r"([-_]?(system|plugin))+$", "", stem))


def is_silent(plugin: Element) -> bool:
    """Whether a plugin has no effect on the motion."""
    names = (plugin.attributes.get(key, "") for key in ("filename", "name"))
    return any(plain_name(name) in SILENT.split() for name in names if name)


def left_out(
    form: str, element: Element, label: str, apart: tuple[str, ...] = (), root: str = ""
) -> Iterator[str]:
    """Yield what an element says and eqt leaves out, with places.

    Parameters
    ----------
    form
        A key of `FORMATS`.
    element, label
        The element, and its name in messages.
    apart
        Tags within it that are looked at on their own.
    root
        Where its path begins. Default: its tag.

    Raises
    ------
    EqtError
        For what is refused, and what may stand there once and stands there twice.
    """
    open_elements = [(element, root or element.tag)]
    while open_elements:
        here, path = open_elements.pop()
        yield from _of_attributes(form, here, path, label)
        counts = Counter(child.tag for child in here.children)
        for child in here.children:
            there = shortest(form, f"{path}/{child.tag}")
            kind = kind_of(form, there)
            if kind == USED and counts[child.tag] > 1:
                first, second, *_ = here.all(child.tag)
                raise EqtError(
                    f"{second.place}: a second <{child.tag}> in <{here.tag}> of {label}, the first "
                    f"is at {first.place}; remove one"
                )
            if kind not in (USED, MANY):
                yield from _of_child(child, kind, label)
            elif child.tag not in (*apart, "plugin"):
                open_elements.append((child, there))


def _of_attributes(form: str, element: Element, path: str, label: str) -> Iterator[str]:
    """Yield what is left out of the attributes of an element; of plugins they are names."""
    for name, value in element.attributes.items():
        kind = kind_of(form, shortest(form, f"{path}/@{name}"))
        if kind in (USED, MANY, WITHOUT) or _is_nothing(value) or form == "plugins":
            continue
        if kind == REFUSED:
            raise _refusal(element, f"{name}='{shortened(value)}'", label)
        yield f"{element.place}: {name} of <{element.tag}> of {label} is left out"


def _of_child(child: Element, kind: str | None, label: str) -> Iterator[str]:
    """Yield what is left out with an element that is noted, refused or unknown."""
    values = list(_values(child))
    if kind == WITHOUT or all(_is_nothing(value) for _, value in values):
        return
    numbers = ", ".join(f"{name} {value}".strip() for name, value in values)
    if kind == REFUSED:
        raise _refusal(child, f"<{child.tag}> {numbers}", label)
    yield f"{child.place}: <{child.tag}> of {label} is left out ({numbers})"


def _refusal(element: Element, what: str, label: str) -> EqtError:
    return EqtError(
        f"{element.place}: {what} of {label} changes the motion, and eqt does not read it; remove "
        "it, or leave the element out with --without"
    )


def _values(element: Element) -> Iterator[tuple[str, str]]:
    """Yield the numbers and words of an element, with their names."""
    for here in element.walk():
        yield from ((name, shortened(value)) for name, value in here.attributes.items())
        if here.text.strip():
            yield ("" if here is element else here.tag), shortened(here.text)


def _is_nothing(text: str) -> bool:
    """Whether a value is 0, false or empty."""
    return all(word.lower() in ("false", "no") or _is_zero(word) for word in text.split())


def _is_zero(word: str) -> bool:
    return re.fullmatch(r"[-+]?0*\.?0*(e[-+]?\d+)?", word.lower()) is not None
