"""Simulators whose requirements contradict those of the others, in an environment of their own.

`python benchmarks/beside.py crazyflow RUNS` after `pip install crazyflow==0.4.0`, or
`python benchmarks/beside.py basilisk RUNS` after `pip install bsk==2.12.1`.
"""

from __future__ import annotations

import sys

import numpy as np

FLIGHT = 6.0
"""Duration of a flight by Crazyflow, s, at 500 Hz, as `configs/crazyflie.yaml`."""

TURN, STEP = 20.0, 0.05
"""Duration of a turn by Basilisk, and its step, s."""


def crazyflow(runs: int) -> None:
    """Fly so many Crazyflies by Mellinger's law and first principles on a circle, in floats."""
    import jax
    from crazyflow.sim import Sim

    sim = Sim(n_worlds=runs, control="state", dynamics="first_principles", device="cpu")
    sim.reset()
    command, period = np.zeros((runs, 1, 16), np.float32), 5  # the law of position runs at 100 Hz
    command[..., 12] = 1.0  # a unit quaternion
    for k in range(int(FLIGHT * sim.freq) // period):
        angle = k * period / sim.freq
        command[..., :3] = np.cos(angle), np.sin(angle), 1.0
        command[..., 3:6] = -np.sin(angle), np.cos(angle), 0.0  # and accelerations of 0
        sim.state_control(command)
        sim.step(period)
    jax.block_until_ready(sim.data)
    assert np.isfinite(np.asarray(sim.data.states.pos)).all()


def basilisk(runs: int) -> None:
    """Turn so many spacecraft by modified Rodrigues parameters' feedback, one after the other."""
    from Basilisk.architecture import messaging
    from Basilisk.fswAlgorithms import attTrackingError, inertial3D, mrpFeedback
    from Basilisk.simulation import extForceTorque, simpleNav, spacecraft
    from Basilisk.utilities import SimulationBaseClass, macros

    inertia = [0.824, 0.0, 0.12, 0.0, 1.135, 0.0, 0.12, 0.0, 1.759]  # of configs/paper.yaml, kg m²
    for run in range(runs):
        random = np.random.default_rng(run)
        simulation = SimulationBaseClass.SimBaseClass()
        task = simulation.CreateNewTask("task", macros.sec2nano(STEP))
        simulation.CreateNewProcess("process").addTask(task)
        body, torque = spacecraft.Spacecraft(), extForceTorque.ExtForceTorque()
        body.hub.mHub, body.hub.IHubPntBc_B = 1.0, np.reshape(inertia, (3, 3)).tolist()
        body.hub.sigma_BNInit = random.normal(0.0, 0.2, (3, 1)).tolist()
        body.hub.omega_BN_BInit = random.normal(0.0, 1.0, (3, 1)).tolist()
        body.addDynamicEffector(torque)
        sensed, desired = simpleNav.SimpleNav(), inertial3D.inertial3D()
        error, law = attTrackingError.attTrackingError(), mrpFeedback.mrpFeedback()
        desired.sigma_R0N, law.K, law.Ki, law.P = [0.0] * 3, 1.0, -1.0, 0.5
        sensed.scStateInMsg.subscribeTo(body.scStateOutMsg)
        error.attNavInMsg.subscribeTo(sensed.attOutMsg)
        error.attRefInMsg.subscribeTo(desired.attRefOutMsg)
        law.guidInMsg.subscribeTo(error.attGuidOutMsg)
        vehicle = messaging.VehicleConfigMsg().write(
            messaging.VehicleConfigMsgPayload(ISCPntB_B=inertia)
        )
        law.vehConfigInMsg.subscribeTo(vehicle)
        torque.cmdTorqueInMsg.subscribeTo(law.cmdTorqueOutMsg)
        for part in (body, torque, sensed, desired, error, law):
            simulation.AddModelToTask("task", part)
        simulation.InitializeSimulation()
        simulation.ConfigureStopTime(macros.sec2nano(TURN))
        simulation.ExecuteSimulation()
        rate = body.scStateOutMsg.read().omega_BN_B
        assert np.linalg.norm(rate) < 1.0


if __name__ == "__main__":
    {"crazyflow": crazyflow, "basilisk": basilisk}[sys.argv[1]](int(sys.argv[2]))
