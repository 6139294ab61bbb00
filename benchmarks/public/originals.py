"""Calls the attitude laws of public repositories, which README.md says how to fetch, unchanged.

Each function takes what a law reads, and gives its torque with k_R = 8, k_Ω = 4, J = (1, 2, 3).
"""

import math
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np
from scipy.spatial.transform import Rotation

K_R, K_W, J = 8.0, 4.0, np.diag([1.0, 2.0, 3.0])


def module(name, **names):
    """Put a module with these names in place of one that is not installed."""
    made = sys.modules[name] = ModuleType(name)
    vars(made).update(names)
    return made


def text(path):
    """Return the text of a fetched file."""
    return Path(path).read_text(encoding="utf-8")


def method(path, name):
    """Return a method, cut out of a fetched file as it stands, as a function."""
    found = re.search(rf"^    def {name}\(.*?(?=^    def |^class |\Z)", text(path), re.M | re.S)
    names = {"np": np, "math": math, "Rotation": Rotation, "p": pybullet()}
    exec("class Cut:\n" + found[0], names)
    return getattr(names["Cut"], name)


def pybullet():
    """Return the two functions of PyBullet that the laws call."""
    return SimpleNamespace(
        getMatrixFromQuaternion=lambda q: Rotation.from_quat(q).as_matrix().ravel(),
        getEulerFromQuaternion=lambda q: Rotation.from_quat(q).as_euler("xyz"),
    )


# FDCL: uav_geometric_control/python/controller.py -------------------------------------------------


def hat_map(x):
    """Return the matrix of x ×, as the package `kinematics` of the repository does."""
    return np.array([[0, -x[2], x[1]], [x[2], 0, -x[0]], [-x[1], x[0], 0]])


def fdcl(pose, velocity, desired_pose, desired_velocity, desired_acceleration):
    """Call `Dumbbell.attitude_controller`."""
    law = fdcl_law()
    desired = desired_pose, desired_pose @ hat_map(desired_velocity)
    law.desired_attitude = lambda time: (*desired, desired_velocity, desired_acceleration)
    return law.attitude_controller(0, np.hstack([np.zeros(6), pose.ravel(), velocity]), np.zeros(3))


def fdcl_law(made=[]):  # noqa: B006  # made once
    """Return the object, with these gains."""
    if not made:
        attitude = module("kinematics.attitude", hat_map=hat_map)
        attitude.vee_map = lambda S: np.array([S[2, 1], S[0, 2], S[1, 0]])
        module("kinematics", attitude=attitude)
        names = {}
        exec(text("fdcl/python/controller.py"), names)
        made.append(names["Dumbbell"]())
        vars(made[0]).update(kR=K_R, kW=K_W, J=J)
    return made[0]


# VisFly: envs/base/dynamics.py, the lines of the attitude law of ACTION_TYPE.VELOCITY -------------


def visfly(pose, velocity, desired_pose, desired_velocity):
    """Run its lines; they know a yaw rate only, and one gain for both errors, so that k_R = k_Ω."""
    lines = re.search(r"( +)pose_err = .*?(?=\n\n +thrusts_des)", text(VISFLY), re.S)
    torch = SimpleNamespace(
        zeros_like=np.zeros_like,
        as_tensor=lambda x, device: np.array(x),
        tensor=lambda x, device: np.array(x, dtype=float),
    )
    law = SimpleNamespace(num=1, device=None, _inertia=J, _position=np.zeros((3, 1)))
    law._angular_velocity, law._BODYRATE_PID = (
        velocity[:, None],
        SimpleNamespace(p=K_W * np.linalg.inv(J)),
    )
    names = {"self": law, "th": torch, "cross": lambda a, b: np.cross(a, b, axis=0)}
    names |= {"R": pose[..., None], "R_des": desired_pose[..., None]}
    names["yaw_spd_des"] = desired_velocity[2:]
    exec(re.sub(rf"(?m)^{lines[1]}", "", lines[0]), names)
    return names["body_torque_des"].ravel()


VISFLY = "visfly/envs/base/dynamics.py"

# safe-control-gym and gym-pybullet-drones: PID of the same group ----------------------------------


def of_dsl(**more):
    """Return an object with these gains, and no mixer: what it returns is the torque."""
    still = {"integral_rpy_e": np.zeros(3), "I_COEFF_TOR": np.zeros(3), "last_rpy": np.zeros(3)}
    limits = {"MIXER_MATRIX": np.eye(3), "MIN_PWM": -1e9, "MAX_PWM": 1e9}
    gains = {"P_COEFF_TOR": K_R / 2 * np.ones(3), "D_COEFF_TOR": K_W * np.ones(3)}
    return SimpleNamespace(PWM2RPM_SCALE=1, PWM2RPM_CONST=0, **still, **limits, **gains, **more)


PERIOD = 0.05
FILES = {
    "safe": "safe-control-gym/safe_control_gym/controllers/pid/pid.py",
    "drones": "gym-pybullet-drones/gym_pybullet_drones/control/DSLPIDControl.py",
}
STATES = {"safe": of_dsl(control_timestep=PERIOD), "drones": of_dsl()}


def safe_control_gym(pose, desired_pose, desired_velocity):
    """Call `PID._dslPIDAttitudeControl`, with the desired velocity as the rates of the angles."""
    q, angles = Rotation.from_matrix(pose).as_quat(), Rotation.from_matrix(desired_pose)
    law = method(FILES["safe"], "_dslPIDAttitudeControl")
    return law(STATES["safe"], 0.0, q, angles.as_euler("XYZ"), desired_velocity)


def gym_pybullet_drones(pose, desired_pose, desired_velocity):
    """Call `DSLPIDControl._dslPIDAttitudeControl` in the same way."""
    q, angles = Rotation.from_matrix(pose).as_quat(), Rotation.from_matrix(desired_pose)
    law = method(FILES["drones"], "_dslPIDAttitudeControl")
    return law(STATES["drones"], PERIOD, 0.0, q, angles.as_euler("XYZ"), desired_velocity)


# RotorPy: rotorpy/controllers/quadrotor_control.py, a whole cascade -------------------------------

INERTIA = np.array([0.01, 0.01, 0.02])


def rotorpy(pose, velocity, position, heading):
    """Call `SE3Control.update` with k_R = 2, k_Ω = 0.2, a mass of 1 kg, and k_x = 6, k_v = 4."""
    R = pose[:3, :3]
    state = {"x": pose[:3, 3], "v": R @ velocity[3:], "w": velocity[:3]}
    state["q"] = Rotation.from_matrix(R).as_quat()
    flat = dict(zip(("x", "x_dot", "x_ddot", "x_dddot", "x_ddddot"), position, strict=True))
    flat |= {"yaw": heading[0], "yaw_dot": heading[1]}
    command = rotorpy_law().update(0, state, flat)
    return [*command["cmd_moment"], 0, 0, command["cmd_thrust"]]


def rotorpy_law(made=[]):  # noqa: B006  # made once
    """Return the object, with these gains."""
    if not made:
        names, numbers = {}, dict.fromkeys("c_Dx c_Dy c_Dz k_d k_z k_flap Ixy Ixz Iyz".split(), 0.0)
        exec(text("rotorpy/rotorpy/controllers/quadrotor_control.py"), names)
        numbers |= dict(zip(("Ixx", "Iyy", "Izz"), INERTIA, strict=True))
        numbers |= {"mass": 1.0, "num_rotors": 4, "tau_m": 0.0, "k_eta": 1.0, "k_m": 1.0}
        numbers |= {"rotor_speed_min": 0.0, "rotor_speed_max": 1e3}
        corners = ((1, 1, 0), (1, -1, 0), (-1, -1, 0), (-1, 1, 0))
        numbers["rotor_pos"] = dict(enumerate(map(np.array, corners)))
        numbers["rotor_directions"] = np.array([1, -1, 1, -1])
        made.append(names["SE3Control"](numbers))
        gains = {"kp_pos": 6.0, "kd_pos": 4.0, "kp_att": 2 / INERTIA, "kd_att": 0.2 / INERTIA}
        vars(made[0]).update(gains)
    return made[0]
