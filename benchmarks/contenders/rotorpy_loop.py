"""RotorPy's Crazyflie under its law SE3Control on its circle, as in `benchmarks/quadrotor.yaml`.

RotorPy flies it by its `Environment`, which also computes sensors, by a plain loop over the steps
of its vehicle, or, with torch, all runs at once. Its rotor drag, which eqt has not, is off.
"""

from __future__ import annotations

from collections.abc import Mapping
from importlib.util import find_spec
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from eqt_cli.base.arrays import Array

PERIOD = 0.01
"""s: RotorPy's default, 100 Hz."""

CIRCLE = np.array([[0.0, 0.0, 1.0], [1.0, 1.0, 0.25], [0.2, 0.2, 0.4]])
"""Its centre, m, radius, m, and frequency, Hz, by axis."""


def missing() -> str | None:
    """How to install it; None where it is there."""
    return None if find_spec("rotorpy") else "install it with pip install rotorpy"


def missing_batches() -> str | None:
    """What its batches need; None where all of it is there."""
    lacks = [name for name in ("torch", "torchdiffeq", "roma") if not find_spec(name)]
    return f"install them with pip install {' '.join(lacks)}" if lacks else None


def program(duration: float, runs: int) -> str:
    """A whole program of a user, which flies its default start so often.

    RotorPy imports torch where it is installed, for seconds, and needs it for batches only.
    """
    return f"""
import sys
class WithoutTorch:
    def find_spec(self, name, path=None, target=None):
        if name in ("torch", "torchdiffeq", "roma"):
            raise ImportError(name)
sys.meta_path.insert(0, WithoutTorch())
import numpy as np
from rotorpy.controllers.quadrotor_control import SE3Control
from rotorpy.environments import Environment
from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
from rotorpy.vehicles.crazyflie_params import quad_params
from rotorpy.vehicles.multirotor import Multirotor
circle = ThreeDCircularTraj(*np.array({CIRCLE.tolist()}))
for _ in range({runs}):
    body, law = Multirotor(quad_params, aero=False), SE3Control(quad_params)
    Environment(body, law, circle, sim_rate={1 / PERIOD}).run(t_final={duration - PERIOD / 2})
"""


class RotorPy:
    """The vehicle, the law and the path of RotorPy.

    Parameters
    ----------
    integrator
        Keywords of `scipy.integrate.solve_ivp`, which RotorPy calls for each step; None are
        RotorPy's own: RK45 at SciPy's default tolerances.
    """

    def __init__(self, integrator: Mapping[str, Any] | None = None) -> None:
        from rotorpy.controllers.quadrotor_control import SE3Control
        from rotorpy.trajectories.circular_traj import ThreeDCircularTraj
        from rotorpy.vehicles.crazyflie_params import quad_params
        from rotorpy.vehicles.multirotor import Multirotor

        self.parameters = quad_params
        self.body = Multirotor(quad_params, aero=False, integrator_kwargs=integrator)
        self.law: Any = SE3Control(quad_params)
        self.path: Any = ThreeDCircularTraj(*CIRCLE)

    def start(self, Q: Array, V: Array) -> dict[str, Array]:
        """The state of RotorPy, with the rotors running as the first command asks."""
        R = Q[:3, :3]
        state = {"x": Q[:3, 3], "v": R @ V[3:], "q": Rotation.from_matrix(R).as_quat()}
        state |= {"w": V[:3], "wind": np.zeros(3)}
        asked = self.law.update(0.0, state, self.path.update(0.0))["cmd_motor_speeds"]
        low, high = self.body.rotor_speed_min, self.body.rotor_speed_max
        return state | {"rotor_speeds": np.clip(asked, low, high)}

    def environment(self, Q: Array, V: Array, duration: float) -> tuple[Array, Array]:
        """Fly by RotorPy's own loop, which also computes IMU, motion capture and an estimate."""
        from rotorpy.environments import Environment

        self.body.initial_state = self.start(Q, V)
        world = Environment(self.body, self.law, self.path, sim_rate=1 / PERIOD)
        # Its time is a sum of steps: without the half, it flies one step more.
        return motion(world.run(t_final=duration - PERIOD / 2)["state"])

    def loop(self, Q: Array, V: Array, duration: float) -> tuple[Array, Array]:
        """Fly by steps of the vehicle, without sensors."""
        states = [self.start(Q, V)]
        for k in range(round(duration / PERIOD)):
            t, now = k * PERIOD, states[-1]
            command = self.law.update(t, now, self.path.update(t))
            states.append(self.body.step(now, command, PERIOD))
        return motion({key: np.array([each[key] for each in states]) for key in states[0]})

    def batch(
        self, Q: Array, V: Array, duration: float, integrator: str = "dopri5"
    ) -> tuple[Array, Array]:
        """Fly all runs at once, by steps of the batched vehicle; `rk4` takes one in each period.

        One thread, because two took 4 to 15 times as long on two shared cores.
        """
        import torch
        from rotorpy.controllers.quadrotor_control import BatchedSE3Control
        from rotorpy.trajectories.circular_traj import BatchedThreeDCircularTraj
        from rotorpy.vehicles.multirotor import BatchedMultirotor, BatchedMultirotorParams

        torch.set_num_threads(1)
        runs, cpu = len(Q), torch.device("cpu")
        starts = [self.start(*each) for each in zip(Q, V, strict=True)]
        state = {key: torch.from_numpy(np.array([s[key] for s in starts])) for key in starts[0]}
        parameters = BatchedMultirotorParams([self.parameters] * runs, runs, cpu)
        body = BatchedMultirotor(parameters, runs, state, cpu, aero=False, integrator=integrator)
        law = BatchedSE3Control(parameters, runs, cpu)
        circle = (np.tile(each, (runs, 1)) for each in CIRCLE)
        path, states = BatchedThreeDCircularTraj(*circle, [False] * runs), [state]
        every = np.arange(runs)
        for k in range(round(duration / PERIOD)):
            t, now = k * PERIOD, states[-1]
            command = law.update(t, now, path.update(t), idxs=every)
            states.append(body.step(now, command, PERIOD, idxs=every))
        kept = {key: np.array([s[key].numpy() for s in states]).swapaxes(0, 1) for key in state}
        return motion(kept)


def motion(states: Mapping[str, Array]) -> tuple[Array, Array]:
    """Poses and body velocities of states over time."""
    R = Rotation.from_quat(states["q"].reshape(-1, 4)).as_matrix()
    R = R.reshape(*states["q"].shape[:-1], 3, 3)
    Q = np.zeros((*R.shape[:-2], 4, 4))
    Q[..., :3, :3], Q[..., :3, 3], Q[..., 3, 3] = R, states["x"], 1.0
    v = (np.swapaxes(R, -1, -2) @ states["v"][..., None])[..., 0]
    return Q, np.concatenate([states["w"], v], axis=-1)
