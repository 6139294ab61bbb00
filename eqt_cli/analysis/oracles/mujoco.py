"""MuJoCo's rigid body. The package is loaded only when it is used."""

from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.oracles.base import RigidBody, SteppingOracle
from eqt_cli.core.arrays import Array


class MuJoCo(SteppingOracle):
    """A free body, or one on a ball joint, integrated by MuJoCo's "RK4".

    A free joint has q = (x, quaternion wxyz) and the velocities (ẋ in space, ω in the body); a ball
    joint has only the quaternion and ω. So v = Rᵀ ẋ and v̇ = Rᵀ ẍ − ω × v. Six motors at the origin
    of the body apply the forces, so that these rotate with the body within a step.
    """

    name: ClassVar[str] = "mujoco"
    remedy: ClassVar[str] = "install it with pip install mujoco"
    title: ClassVar[str] = "MuJoCo"

    def __init__(self, body: RigidBody) -> None:
        import mujoco

        self.program: Any = mujoco
        self.free = body.free
        J = body.inertia
        spec = mujoco.MjSpec()
        spec.option.gravity = [0.0, 0.0, 0.0]
        spec.option.integrator = mujoco.mjtIntegrator.mjINT_RK4
        part = spec.worldbody.add_body(name="body")
        part.mass, part.ipos, part.explicitinertial = body.mass, body.centre, True
        part.fullinertia = [J[0, 0], J[1, 1], J[2, 2], J[0, 1], J[0, 2], J[1, 2]]
        kinds = mujoco.mjtJoint
        part.add_joint(type=kinds.mjJNT_FREE if body.free else kinds.mjJNT_BALL)
        part.add_site(name="origin")
        for gear in np.eye(6)[[3, 4, 5, 0, 1, 2]]:  # eqt's order: torque, force
            # An actuator is a motor by default: its force equals its control input.
            spec.add_actuator(target="origin", trntype=mujoco.mjtTrn.mjTRN_SITE, gear=gear)
        self.model = spec.compile()
        self.data = mujoco.MjData(self.model)

    def start(self, R: Array, x: Array, V: Array) -> None:
        from scipy.spatial.transform import Rotation  # slow to import

        wxyz = np.roll(Rotation.from_matrix(R).as_quat(), 1)
        self.data.time = 0.0
        self.data.qpos[:] = [*x, *wxyz] if self.free else wxyz
        self.data.qvel[:] = [*(R @ V[3:]), *V[:3]] if self.free else V
        self.data.qacc_warmstart[:] = 0.0

    def acceleration(self, R: Array, x: Array, V: Array, force: Array) -> Array:
        self.start(R, x, V)
        self._push(force)
        self.program.mj_forward(self.model, self.data)
        found = np.array(self.data.qacc)
        if not self.free:
            return found
        return np.concatenate([found[3:], R.T @ found[:3] - np.cross(V[:3], V[3:])])

    def steps(self, force: Array, step: float, count: int) -> tuple[Array, Array, Array]:
        from scipy.spatial.transform import Rotation  # slow to import

        self.model.opt.timestep = step
        self._push(force)
        self.program.mj_step(self.model, self.data, nstep=count)
        q, rates = np.array(self.data.qpos), np.array(self.data.qvel)
        R = Rotation.from_quat(np.roll(q[-4:], -1)).as_matrix()
        if not self.free:
            return R, q[:0], rates
        return R, q[:3], np.concatenate([rates[3:], R.T @ rates[:3]])

    def _push(self, force: Array) -> None:
        self.data.ctrl[:] = 0.0
        self.data.ctrl[: len(force)] = force
