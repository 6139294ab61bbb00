"""Pinocchio's rigid body. The package is loaded only when it is used."""

from typing import Any, ClassVar

import numpy as np

from eqt_cli.analysis.oracles.base import Oracle, RigidBody
from eqt_cli.core.arrays import Array


class Pinocchio(Oracle):
    """A free-flyer, or a body on a spherical joint, by the articulated body algorithm.

    A free-flyer has q = (x, quaternion xyzw) and the velocity (v, ω) in the body frame; its
    accelerations are the rates of these components. In eqt, V is (ω, v).
    """

    name: ClassVar[str] = "pinocchio"
    remedy: ClassVar[str] = "install it with pip install pin"
    title: ClassVar[str] = "Pinocchio"

    def __init__(self, body: RigidBody) -> None:
        import pinocchio

        self.program: Any = pinocchio
        self.free = body.free
        joint = pinocchio.JointModelFreeFlyer() if body.free else pinocchio.JointModelSpherical()
        self.model = pinocchio.Model()
        self.model.gravity = pinocchio.Motion.Zero()
        place = pinocchio.SE3.Identity()
        number = self.model.addJoint(0, joint, place, "body")
        inertia = pinocchio.Inertia(body.mass, body.centre, body.inertia)
        self.model.appendBodyToJoint(number, inertia, place)
        self.data = self.model.createData()

    def acceleration(self, R: Array, x: Array, V: Array, force: Array) -> Array:
        from scipy.spatial.transform import Rotation  # slow to import

        xyzw = Rotation.from_matrix(R).as_quat()
        order = [3, 4, 5, 0, 1, 2] if self.free else [0, 1, 2]
        q = np.array([*x, *xyzw])
        found = self.program.aba(self.model, self.data, q, V[order], force[order])
        return np.array(found)[order]
