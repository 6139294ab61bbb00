"""MuJoCo's rigid body, which the benchmarks and the tests compare eqt's with."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import Rotation

from eqt_cli.base.arrays import Array


@dataclass(frozen=True)
class RigidBody:
    """A rigid body in the description of other programs.

    Attributes
    ----------
    mass
        Mass, kg.
    centre : (3,)
        Centre of mass in the body frame, m.
    inertia : (3, 3)
        Inertia about the centre of mass in the axes of the body frame, kg m^2.
    free
        Whether the body moves freely (SE3); else it rotates about the origin of its frame (SO3).
    """

    mass: float
    centre: Array
    inertia: Array
    free: bool

    @classmethod
    def of(cls, tensor: Array) -> RigidBody:
        """Return the rigid body with this inertia tensor, of SO3 or SE3.

        On SE3, with V = (ω, v), the tensor of a body is
        [[J − m c^× c^×, m c^×], [−m c^×, m I]].
        """
        if len(tensor) == 3:
            return cls(1.0, np.zeros(3), tensor, free=False)
        mass = float(tensor[3, 3])
        lever = tensor[:3, 3:] / mass
        centre = np.array([lever[2, 1], lever[0, 2], lever[1, 0]])
        return cls(mass, centre, tensor[:3, :3] + mass * lever @ lever, free=True)


class MuJoCo:
    """A free body, or one on a ball joint, integrated by MuJoCo's "RK4", without gravity.

    A free joint has q = (x, quaternion wxyz) and the velocities (ẋ in space, ω in the body); a ball
    joint has only the quaternion and ω. So v = Rᵀ ẋ and v̇ = Rᵀ ẍ − ω × v. Six motors at the origin
    of the body apply the forces, so that these rotate with the body within a step.
    """

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
        """Set the state of the body."""
        wxyz = np.roll(Rotation.from_matrix(R).as_quat(), 1)
        self.data.time = 0.0
        self.data.qpos[:] = [*x, *wxyz] if self.free else wxyz
        self.data.qvel[:] = [*(R @ V[3:]), *V[:3]] if self.free else V
        self.data.qacc_warmstart[:] = 0.0

    def acceleration(self, R: Array, x: Array, V: Array, force: Array) -> Array:
        """Return V̇ in eqt's coordinates: body frame, (ω, v) on SE3 and ω on SO3.

        Parameters
        ----------
        R, x
            Attitude (body to space) and position, m; the position is empty on SO3.
        V, force
            Velocity, and torque and force at the origin of the body frame, in body axes.
        """
        self.start(R, x, V)
        self._push(force)
        self.program.mj_forward(self.model, self.data)
        found = np.array(self.data.qacc)
        if not self.free:
            return found
        return np.concatenate([found[3:], R.T @ found[:3] - np.cross(V[:3], V[3:])])

    def steps(self, force: Array, step: float, count: int) -> tuple[Array, Array, Array]:
        """Return R, x and V after `count` steps of `step` s with a constant body-frame force."""
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
