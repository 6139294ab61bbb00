"""The mechanics against other programs' rigid bodies: MuJoCo, Pinocchio, and Euler's equations."""

from dataclasses import replace

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation
from small_experiment import mapping

from benchmarks.contenders.mujoco_body import MuJoCo, RigidBody
from eqt_cli import api
from eqt_cli.components.blocks import acting_force
from eqt_cli.components.mechanics import lie_poisson
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling
from eqt_cli.extend import Problem, SolveIvp, group_named

CONFIG = mapping(
    inertia=[[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]],
    reference={"torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"]},
    controllers=["eqt"],
    ensemble={"runs": 1, "seed": 1},
    time={"duration": 2.0, "samples": 5},
)
FLIES = yaml.safe_load("""
plant:
  inertia: {relative: 0.2}
  forces: [{kind: constant, force: [0.1, 0, 0], frame: spatial}]
actuators: [{kind: limit, limit: 0.5}, {kind: lag, time_constant: 0.1}]
""")
BODY = yaml.safe_load("""
# 10 kg, its centre of mass away from the origin of its frame
group: SE3
inertia: [[0.175, 0, 0.05, 0, -0.5, 0], [0, 0.295, 0, 0.5, 0, 1.0], [0.05, 0, 0.28, 0, -1.0, 0],
  [0, 0.5, 0, 10.0, 0, 0], [-0.5, 0, -1.0, 0, 10.0, 0], [0, 1.0, 0, 0, 0, 10.0]]
reference: {torque: [cos(t), sin(t), 0, 1, cos(t), 0]}
""")
CASES = {"SO3": CONFIG, "SE3": CONFIG | BODY, "flies": CONFIG | FLIES}


class Euler:
    """Euler's equations about a fixed point, J ω̇ = τ − ω × Jω, with steps of second order."""

    def __init__(self, body):
        self.J = body.inertia

    def acceleration(self, R, x, V, force):
        return np.linalg.solve(self.J, force - np.cross(V, self.J @ V))

    def start(self, R, x, V):
        self.R, self.V = R, V

    def steps(self, force, step, count):
        G = group_named("SO3")
        for _ in range(count):
            middle = self.V + step / 2 * self.acceleration(self.R, (), self.V, force)
            self.R = self.R @ G.exp(step * middle)
            self.V = self.V + step * self.acceleration(self.R, (), middle, force)
        return self.R, np.zeros(0), self.V


class Pinocchio:
    """A free-flyer, or a body on a spherical joint, by the articulated body algorithm.

    A free-flyer has q = (x, quaternion xyzw) and the velocity (v, ω) in the body frame; its
    accelerations are the rates of these components. In eqt, V is (ω, v).
    """

    def __init__(self, body):
        import pinocchio

        self.program, self.free = pinocchio, body.free
        joint = pinocchio.JointModelFreeFlyer() if body.free else pinocchio.JointModelSpherical()
        self.model = pinocchio.Model()
        self.model.gravity = pinocchio.Motion.Zero()
        place = pinocchio.SE3.Identity()
        number = self.model.addJoint(0, joint, place, "body")
        inertia = pinocchio.Inertia(body.mass, body.centre, body.inertia)
        self.model.appendBodyToJoint(number, inertia, place)
        self.data = self.model.createData()

    def acceleration(self, R, x, V, force):
        order = [3, 4, 5, 0, 1, 2] if self.free else [0, 1, 2]
        q = np.array([*x, *Rotation.from_matrix(R).as_quat()])
        found = self.program.aba(self.model, self.data, q, V[order], force[order])
        return np.array(found)[order]


PACKAGES = {
    "Euler": (Euler, "numpy"),
    "MuJoCo": (MuJoCo, "mujoco"),
    "Pinocchio": (Pinocchio, "pinocchio"),
}


def installed(name):
    oracle, package = PACKAGES[name]
    pytest.importorskip(package, reason=f"{name} is not installed; make oracles installs it")
    return oracle


def place(Q):
    """Attitude and position of a pose."""
    return Q[:3, :3], Q[:3, 3:].reshape(-1)


@pytest.mark.parametrize(
    ("name", "case"),
    [(name, case) for name in PACKAGES for case in CASES if (name, case) != ("Euler", "SE3")],
)
def test_accelerations_of_plant_and_reference(name, case):
    """Relative to the largest or 1; both sides round."""
    oracle, [loop] = installed(name), api.load_experiment(CASES[case]).base.loops.values()
    G, random = loop.group, np.random.default_rng(3)
    Q, Qd = G.exp(random.standard_normal((2, 20, G.dimension)))
    V, Vd = random.standard_normal((2, 20, G.dimension))
    flat, t = loop.initial_state(Q, V, Qd, Vd, 0.4), 0.4
    beyond = flat[:, loop.layout.slices["work"].stop :]
    beyond[:] = random.standard_normal(beyond.shape)
    s = loop.tracking(t, flat)
    torque = acting_force(replace(loop.vehicle, inertia=None), s, loop.torque(s))
    true = s.inertia if loop.vehicle.inertia is None else loop.vehicle.inertia.at(s.inertia, t)
    _, rate = lie_poisson(G, s.Q, s.P, s.V, loop.acting_and_rates(s)[0])
    _, desired = lie_poisson(G, s.Qd, s.Pd, s.Vd, s.tau_d)
    for inertia, Q, V, force, P_dot in (
        (s.inertia, s.Qd, s.Vd, np.broadcast_to(s.tau_d, s.P.shape), desired),
        (true, s.Q, s.V, torque, rate),
    ):
        body = oracle(RigidBody.of(np.asarray(inertia.matrix).reshape(G.dimension, -1)))
        expected = s.inertia.velocity(P_dot)
        for k in range(20):
            found = body.acceleration(*place(Q[k]), V[k], force[k])
            size = max(1.0, np.abs(expected[k]).max())
            np.testing.assert_allclose(found, expected[k], rtol=0, atol=1e-12 * size)


@pytest.mark.parametrize(("name", "case"), [("Euler", "SO3"), ("MuJoCo", "SO3"), ("MuJoCo", "SE3")])
def test_a_sampled_loop_converges_to_that_of_the_other_program(name, case):
    """At least with the square of its steps: MuJoCo's "RK4" has this order in the attitude."""
    oracle, experiment = installed(name), api.load_experiment(CASES[case]).base
    [loop] = experiment.loops.values()
    period, loop = 0.05, replace(loop, vehicle=Vehicle(control=Sampling(0.05)))
    G, x = loop.group, np.random.default_rng(3).standard_normal((2, loop.group.dimension)) / 2
    first = loop.initial_state(G.exp(x[0]), x[1], G.identity, np.zeros(G.dimension))
    times = period * np.arange(21)
    exact = SolveIvp(rtol=1e-12, atol=1e-14).solve(Problem(loop, first[None], times)).states[0]
    body = oracle(RigidBody.of(loop.inertia.matrix))
    layout, off = loop.layout, []
    for count in (1, 2, 4):
        state, s = first, loop.tracking(0.0, first)
        body.start(*place(s.Q), s.V)
        for k, t in enumerate(times[:-1]):
            state = loop.after_instant(t, state)
            torque = loop.torque(loop.tracking(t, state))
            R, x, V = body.steps(torque, period / count, count)
            pose = np.eye(G.size)
            pose[:3, :3], pose[:3, 3:] = R, x.reshape(3, -1) if x.size else pose[:3, 3:]
            after = layout.split(exact[k + 1])
            moved = {name: after[name] for name in layout.lengths if name.startswith("desired")}
            moved |= {"pose": G.pack(pose), "momentum": loop.inertia.momentum(V)}
            state = layout.join(layout.split(state) | moved, state)
        found, expected = (loop.tracking(times[-1], each) for each in (state, exact[-1]))
        off.append(max(np.abs(found.Q - expected.Q).max(), np.abs(found.V - expected.V).max()))
    assert off[2] < 1e-3
    assert (np.log2(np.array(off[:-1]) / off[1:]) > 1.8).all()  # reached as steps become short
