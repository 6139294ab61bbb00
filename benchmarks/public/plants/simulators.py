"""Calls the vehicle models of public repositories, which README.md says how to fetch, unchanged.

Each function gives the derivative, or the state after dt, of one vehicle: 1.2 kg, J = (0.02, 0.025,
0.04) kg m², rotors at (±0.12, ±0.12) m, k_η = 5.57e-6 and k_m = 1.36e-7. Its rotors are numbered
front left, front right, rear right, rear left.
"""

import importlib
import os
import re
import sys
from pathlib import Path
from types import ModuleType, SimpleNamespace

import numpy as np

# drone-models asks for it, and sets it otherwise, which a plant may not.
vars(os)["environ"] = {**os.environ, "SCIPY_ARRAY_API": "1"}
from scipy.spatial.transform import Rotation  # noqa: E402

MASS, J, ARM, K_ETA, K_M = 1.2, np.diag([0.02, 0.025, 0.04]), 0.12, 5.57e-6, 1.36e-7
RPM = (np.pi / 30) ** 2


def text(path):
    """Return the text of a fetched file."""
    return Path(path).read_text(encoding="utf-8")


def method(path, name, names):
    """Return a method, cut out of a fetched file as it stands, as a function."""
    lines = rf"^    def {name}\(.*?(?=^    def |^    ####|\Z)"
    names = names | {"np": np}
    exec("class Cut:\n" + re.search(lines, text(path), re.M | re.S)[0], names)
    return getattr(names["Cut"], name)


def module(name, **names):
    """Put a module with these names in place of one that is not installed."""
    made = sys.modules[name] = ModuleType(name)
    vars(made).update(names)
    return made


# RotorPy: rotorpy/vehicles/multirotor.py ----------------------------------------------------------

CORNERS = np.array([[ARM, ARM, 0], [ARM, -ARM, 0], [-ARM, -ARM, 0], [-ARM, ARM, 0]])


def rotorpy(s, speeds):
    """Call `Multirotor._s_dot_fn` without aerodynamics."""
    return rotorpy_vehicle()._s_dot_fn(0.0, s, speeds)


def rotorpy_vehicle(made=[]):  # noqa: B006  # made once
    """Return the object."""
    if not made:
        sys.path.insert(0, "rotorpy")
        numbers = dict(zip(("Ixx", "Iyy", "Izz"), np.diag(J), strict=True))
        numbers |= {"Ixy": 0.0, "Ixz": 0.0, "Iyz": 0.0, "mass": MASS, "num_rotors": 4}
        numbers |= {"rotor_pos": {f"r{k}": x for k, x in enumerate(CORNERS)}}
        numbers |= {"rotor_directions": np.array([1, -1, 1, -1]), "tau_m": 0.05}
        numbers |= {"rotor_speed_min": 0, "rotor_speed_max": 1500, "k_eta": K_ETA, "k_m": K_M}
        vehicles = importlib.import_module("rotorpy.vehicles.multirotor")
        made.append(vehicles.Multirotor(numbers, aero=False))
    return made[0]


# gym-pybullet-drones: gym_pybullet_drones/envs/BaseAviary.py --------------------------------------

AVIARY = "gym-pybullet-drones/gym_pybullet_drones/envs/BaseAviary.py"
MODELS = SimpleNamespace(RACE=0, CF2X=1, CF2P=2)


def gym_pybullet_drones(pos, quat, vel, rates, rpm, dt):
    """Call `BaseAviary._dynamics` with the numbers of a CF2X; rotors from the front right."""
    after = {}
    bullet = SimpleNamespace(
        getMatrixFromQuaternion=lambda q: Rotation.from_quat(q).as_matrix().ravel(),
        resetBasePositionAndOrientation=lambda _, pos, quat, **__: after.update(pos=pos, quat=quat),
        resetBaseVelocity=lambda _, vel, turn, **__: after.update(vel=vel),
    )
    names = {"p": bullet, "DroneModel": MODELS}
    world = SimpleNamespace(pos=pos[None], quat=quat[None], vel=vel[None], PYB_TIMESTEP=dt)
    vars(world).update(rpy_rates=np.array(rates)[None], KF=K_ETA * RPM, KM=K_M * RPM, J=J, M=MASS)
    vars(world).update(J_INV=np.linalg.inv(J), GRAVITY=9.81 * MASS, DRONE_MODEL=MODELS.CF2X)
    vars(world).update(L=ARM * np.sqrt(2), DRONE_IDS=[0], CLIENT=0)
    turned = method(AVIARY, "_integrateQ", names)
    world._integrateQ = lambda *args: turned(world, *args)
    method(AVIARY, "_dynamics", names)(world, rpm[[1, 2, 3, 0]], 0)
    return after["pos"], after["quat"], after["vel"], world.rpy_rates[0]


# Quadcopter_SimCon: Simulation/quadFiles/quad.py --------------------------------------------------


def simcon_ned(x, speeds):
    """Call `Quadcopter.state_dot` with axes forward, right, down."""
    return simcon("NED", x, speeds)


def simcon_enu(x, speeds):
    """Call it with axes forward, left, up."""
    return simcon("ENU", x, speeds)


def simcon(orient, x, speeds, made={}):  # noqa: B006  # made once
    """Return the derivative without wind, rotors with their speeds."""
    if not made:
        made["config"] = module("config", orient=orient, usePrecession=False)
        module("utils")
        module("quadFiles.initQuad", sys_params=None, init_cmd=None, init_state=None)
        sys.path.insert(0, "Quadcopter_SimCon/Simulation")
        quad = importlib.import_module("quadFiles.quad")
        # NumPy 2.4 assigns no array of one number to an entry of an array, as the file does.
        quad.np = SimpleNamespace(**{**vars(np), "zeros": lambda shape: [0.0] * shape[0]})
        made["quad"] = quad.Quadcopter
    numbers = {"mB": MASS, "g": 9.81, "dxm": ARM, "dym": ARM, "IB": J, "kTh": K_ETA, "kTo": K_M}
    numbers |= {"Cd": 0.1, "tau": 0.015, "kp": 1.0, "damp": 1.0, "IRzz": 2.7e-5}
    numbers |= {"minWmotor": 75, "maxWmotor": 925}
    still = SimpleNamespace(randomWind=lambda t: [0.0, 0.0, 0.0])
    state = np.hstack([x, np.stack([speeds, 0 * speeds], axis=1).ravel()])
    return made["quad"].state_dot(SimpleNamespace(params=numbers), 0.0, state, speeds, still)[:13]


# Quadcopter_simulator: quadcopter.py, a plus frame ------------------------------------------------


def quadcopter_simulator(x, thrusts):
    """Call `Quadcopter.state_dot`; its propellers have these thrusts."""
    names = {}
    exec(text("Quadcopter_simulator/quadcopter.py"), names)
    one = {"state": x, "weight": MASS, "I": J, "invI": np.linalg.inv(J), "L": ARM}
    one |= {f"m{k + 1}": SimpleNamespace(thrust=f) for k, f in enumerate(thrusts)}
    quad = SimpleNamespace(quads={"q": one}, g=9.81, b=K_M / K_ETA)
    quad.rotation_matrix = lambda angles: names["Quadcopter"].rotation_matrix(quad, angles)
    return names["Quadcopter"].state_dot(quad, 0.0, x, "q")


# PythonRobotics: the lines of `quad_sim` that move the quadrotor ----------------------------------

FOLLOWING = "drone_3d_trajectory_following"
DRONE = f"PythonRobotics/AerialNavigation/{FOLLOWING}/{FOLLOWING}.py"


def python_robotics(x, u, dt, made=[]):  # noqa: B006  # made once
    """Run them for one dt, with this thrust and these torques."""
    if not made:
        code = text(DRONE)
        lines = re.search(r"^( +)roll_vel \+= .*?z_pos \+= z_vel \* dt$", code, re.M | re.S)
        matrix = re.search(r"^def rotation_matrix\(.*?(?=^def )", code, re.M | re.S)[0]
        made += [compile(re.sub(rf"(?m)^{lines[1]}", "", lines[0]), DRONE, "exec"), matrix]
    names = dict(zip(NAMES, x, strict=True)) | dict(zip(INPUTS, u, strict=True))
    names |= {"np": np, "cos": np.cos, "sin": np.sin, "m": MASS, "g": 9.81, "dt": dt}
    names |= dict(zip(("Ixx", "Iyy", "Izz"), np.diag(J), strict=True))
    names |= {name: np.array([names[name]]) for name in ("roll", "pitch")}  # as the file has them
    exec(made[1], names)
    exec(made[0], names)
    return [names[name] for name in NAMES]


NAMES = "x_pos y_pos z_pos roll pitch yaw x_vel y_vel z_vel roll_vel pitch_vel yaw_vel".split()
INPUTS = "thrust roll_torque pitch_torque yaw_torque".split()

# data_driven_mpc: ros_gp_mpc/src/quad_mpc/quad_3d.py ----------------------------------------------

MPC = "data_driven_mpc/ros_gp_mpc/src"


def data_driven_mpc(p, q, v, w, thrusts):
    """Call f_pos, f_att, f_vel and f_rate of `Quadrotor3D` without drag."""
    return data_driven(False, p, q, v, w, thrusts)


def data_driven_mpc_drag(p, q, v, w, thrusts):
    """Call them with drag."""
    return data_driven(True, p, q, v, w, thrusts)


def data_driven(drag, p, q, v, w, thrusts, made={}):  # noqa: B006  # made once
    """Return the derivative; its rotors begin at the front right."""
    if drag not in made:
        names = {"np": np}
        for name in ("v_dot_q", "q_to_rot_mat", "skew_symmetric", "quaternion_inverse"):
            lines = rf"^def {name}\(.*?(?=^def )"
            exec(re.search(lines, text(f"{MPC}/utils/utils.py"), re.M | re.S)[0], names)
        code = text(f"{MPC}/quad_mpc/quad_3d.py")
        exec(re.sub(r"^from src.*", "", code, flags=re.M), names)
        made[drag] = quad = names["Quadrotor3D"](drag=drag)
        quad.J, quad.mass, quad.c = np.diag(J), MASS, K_M / K_ETA
        scale = ARM / np.abs(quad.x_f[0])
        quad.x_f, quad.y_f = quad.x_f * scale, quad.y_f * scale
        quad.z_l_tau = np.sign(quad.z_l_tau) * K_M / K_ETA
    quad, x, u, none = made[drag], [p, q, v, w], thrusts[[1, 2, 3, 0]], np.zeros((3, 1))
    return quad.f_pos(x), quad.f_att(x), quad.f_vel(x, u, none), quad.f_rate(x, u, none)


# gym-rotor: gym_rotor/envs/quad.py ----------------------------------------------------------------


def gym_rotor(state, thrust, moments):
    """Call `QuadEnv.EoM`; axes forward, right, down."""
    names = {}
    exec(text("gym-rotor/gym_rotor/envs/quad_utils.py"), names)
    eom = method("gym-rotor/gym_rotor/envs/quad.py", "EoM", names | {"inv": np.linalg.inv})
    quad = SimpleNamespace(m=MASS, g=9.81, J=J, f=thrust, M=moments, e3=np.array([0.0, 0.0, 1.0]))
    return eom(quad, 0.0, state)


# udaan: udaan/models/quadrotor/base.py ------------------------------------------------------------


def udaan(p, R, v, w, thrust, torque, dt):
    """Call `QuadrotorBase._zoh`."""
    sys.path[:0] = ["udaan"] * ("udaan" not in sys.path)
    if "udaan" not in sys.modules:
        module("udaan").__path__ = ["udaan/udaan"]
    manif = importlib.import_module("udaan.manif")
    names = {"TSO3": manif.TSO3}
    state = SimpleNamespace(position=np.array(p), velocity=np.array(v), orientation=manif.SO3(R))
    state.angular_velocity = manif.TSO3(w)
    quad = SimpleNamespace(state=state, _mass=MASS, _inertia=J, _inertia_inv=np.linalg.inv(J))
    quad._e3, quad._ge3 = np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, 9.81])
    method("udaan/udaan/models/quadrotor/base.py", "_zoh", names)(quad, thrust, torque, dt)
    moved = (np.array(each) for each in (state.orientation, state.velocity, state.angular_velocity))
    return state.position, *moved


# drone-models: the package ------------------------------------------------------------------------


def drone_models(p, q, v, w, rpm):
    """Call `first_principles.dynamics` with J_r = 1e-6 kg m², which the vehicle has not."""
    sys.path[:0] = ["site"] * ("site" not in sys.path)
    model = importlib.import_module("drone_models.first_principles")
    down = np.array([0, 0, -9.81])
    numbers = {"mass": MASS, "L": ARM, "prop_inertia": 1e-6, "gravity_vec": down}
    numbers |= {"J": J, "J_inv": np.linalg.inv(J), "drag_matrix": np.zeros((3, 3))}
    numbers["rpm2thrust"], numbers["rpm2torque"] = ([0, 0, k * RPM] for k in (K_ETA, K_M))
    signs = np.array([[1.0, -1, -1, 1], [-1, -1, 1, 1], [1, -1, 1, -1]])
    numbers |= {"mixing_matrix": signs, "rotor_dyn_coef": np.ones(4)}
    return model.dynamics(p, q, v, w, rpm, **numbers)[:4]


# acados: examples/acados_python/quadrotor_nav/sys_dynamics.py -------------------------------------


def acados(x, krpm):
    """Call `SysDyn.SetupOde` before pull request 1783."""
    return acados_rate("acados_before", x, krpm)


def acados_now(x, krpm):
    """Call it after."""
    return acados_rate("acados", x, krpm)


def acados_rate(folder, x, krpm, made={}):  # noqa: B006  # made once
    """Return the derivative, without the coordinates of a track; rotors from the rear left."""
    sys.path[:0] = ["site"] * ("site" not in sys.path)
    if folder not in made:
        import casadi

        constants = dict(zip(("Ix", "Iy", "Iz"), np.diag(J).tolist(), strict=True))
        constants |= {"mq": MASS, "g0": 9.81, "l": ARM}
        constants |= {"Ct": K_ETA * RPM * 1e6, "Cd": K_M * RPM * 1e6}
        none = casadi.MX.zeros(3)
        track = (0.0, 0.0, none, none, none, 0.0, 0.0, none, none, none)
        module("common", ca=casadi, np=np, projFrenSerretBasis=lambda s: track, **constants)
        names = {}
        exec(text(f"{folder}/examples/acados_python/quadrotor_nav/sys_dynamics.py"), names)
        made[folder] = names["SysDyn"]().SetupOde()[4]
    state = np.hstack([x[:16], x[16:][[3, 0, 1, 2]]])
    return np.array(made[folder](state, np.zeros(4)), dtype=float).ravel()
