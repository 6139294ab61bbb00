"""Wheels and gravity gradient against Basilisk, which `make oracles` installs."""

import numpy as np
import pytest
from plain_satellite import pyramid
from scipy.integrate import solve_ivp

from eqt_cli.components.blocks import signals

REASON = "Basilisk (bsk) is not installed; make oracles installs it"
pytest.importorskip("Basilisk.utilities.SimulationBaseClass", reason=REASON, exc_type=ImportError)

INERTIA = np.array([[0.03, 0.001, 0.0], [0.001, 0.025, 0.0], [0.0, 0.0, 0.01]])
"""Without the spin of the wheels."""

SPIN, SPEEDS, TORQUES = 2e-5, np.array([200.0, -150.0, 100.0, 50.0]), [1e-4, -2e-4, 3e-4, 5e-5]
RATE, MU, RADIUS, DURATION = np.array([0.05, -0.04, 0.1]), 3.986004418e14, 7.0e6, 5.0


def by_basilisk(wheels, gradient, ratio=1.0):
    """R, from body to space, the body rate, and the speeds of the wheels at the end."""
    from Basilisk.architecture import messaging
    from Basilisk.simulation import (
        GravityGradientEffector,
        gravityEffector,
        reactionWheelStateEffector,
        spacecraft,
    )
    from Basilisk.utilities import RigidBodyKinematics, SimulationBaseClass, macros, simIncludeRW

    simulation = SimulationBaseClass.SimBaseClass()
    simulation.CreateNewProcess("p").addTask(simulation.CreateNewTask("t", macros.sec2nano(0.005)))
    body = spacecraft.Spacecraft()
    body.ModelTag = "body"
    whole = INERTIA + (SPIN * pyramid() @ pyramid().T if wheels else 0.0)
    body.hub.mHub, body.hub.IHubPntBc_B = 10.0, whole.tolist()
    body.hub.sigma_BNInit, body.hub.omega_BN_BInit = [[0.0]] * 3, RATE[:, None].tolist()
    simulation.AddModelToTask("t", body)
    kept = []
    if wheels:
        factory = simIncludeRW.rwFactory()
        for axis, speed in zip(pyramid().T, SPEEDS, strict=True):
            factory.create(
                "custom",
                axis.tolist(),
                Js=SPIN,
                Omega=speed / macros.RPM,
                u_max=1.0,
                useRWfriction=False,
                Omega_max=1e5,
                RWModel=messaging.BalancedWheels,
            )
        effector = reactionWheelStateEffector.ReactionWheelStateEffector()
        factory.addToSpacecraft("wheels", effector, body)
        motors = messaging.ArrayMotorTorqueMsgPayload(motorTorque=[-u for u in TORQUES])
        command = messaging.ArrayMotorTorqueMsg().write(motors)
        effector.rwMotorCmdInMsg.subscribeTo(command)
        simulation.AddModelToTask("t", effector)
        kept += [factory, effector, command]
    if gradient:
        earth = gravityEffector.GravBodyData()
        earth.planetName, earth.mu, earth.isCentralBody = "earth", MU, True
        body.gravField.gravBodies = spacecraft.GravBodyVector([earth])
        gradient = GravityGradientEffector.GravityGradientEffector()
        gradient.ModelTag = "gradient"
        gradient.addPlanetName(earth.planetName)
        body.addDynamicEffector(gradient)
        simulation.AddModelToTask("t", gradient)
        body.hub.r_CN_NInit = [[RADIUS], [0.0], [0.0]]
        body.hub.v_CN_NInit = [[0.0], [ratio * np.sqrt(MU / RADIUS)], [0.0]]
        kept += [earth, gradient]
    simulation.InitializeSimulation()
    simulation.ConfigureStopTime(macros.sec2nano(DURATION))
    simulation.ExecuteSimulation()
    end = body.scStateOutMsg.read()
    speeds = []
    if wheels:
        speeds = [out.read().Omega for out in kept[1].rwOutMsgs]
    R = np.array(RigidBodyKinematics.MRP2C(end.sigma_BN)).T
    return R, np.array(end.omega_BN_B), np.array(speeds)


TEXT = f"""
group: SO3
inertia: {INERTIA.tolist()}
gains: {{kp: 0.004, kd: 0.01}}
reference: {{kind: torque, torque: [0, 0, 0]}}
controllers: [lee2010]
control: {{period: 100}}
initial:
  pose: {{kind: exp_normal, std: 0.0}}
  velocity: {{kind: fixed, coordinates: {RATE.tolist()}}}
time: {{duration: {DURATION}, samples: 2}}
"""


def by_eqt(experiment_of, text, torques=()):
    """The same, by the vector field of eqt with the torques of the wheels as they are."""
    [loop] = experiment_of(text).loops.values()
    Q, Qd = np.eye(3)[None], np.eye(3)[None]
    y = loop.initial_state(Q, RATE[None], Qd, np.zeros((1, 3)))[0]
    if len(torques):
        y[loop.layout.slices["vehicle.actuators_0"]][:4] = torques
    field = lambda t, y: loop.vector_field(t, y[None])[0]  # noqa: E731
    end = solve_ivp(field, (0, DURATION), y, method="DOP853", rtol=1e-13, atol=1e-15).y[:, -1]
    s = loop.tracking(DURATION, end[None])
    return s.Q[0], s.V[0], signals(loop.now(s)).get("wheel_speed", [None])[0]


@pytest.mark.needs("spacecraft")
def test_a_free_body_with_wheels_turns_as_in_basilisk(experiment_of):
    """Basilisk takes steps of 5 ms by a Runge-Kutta method of fourth order."""
    start = (SPIN * (SPEEDS + pyramid().T @ RATE)).tolist()
    wheels = f"{{kind: wheels, pyramid: 54.7 deg, momentum: 1, inertia: {SPIN}, start: {start}}}"
    found = by_eqt(experiment_of, f"{TEXT}actuators: [{wheels}]\n", TORQUES)
    R, rate, speeds = by_basilisk(wheels=True, gradient=False)
    np.testing.assert_allclose(found[0], R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[1], rate, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[2], speeds, rtol=1e-9)
    assert np.abs(found[1] - RATE).max() > 0.01


@pytest.mark.parametrize("e", [0.0, 0.6])
def test_the_gravity_gradient_turns_a_body_as_in_basilisk(experiment_of, e):
    """Basilisk integrates the orbit, too: a circle, or an ellipse from its perigee."""
    n = np.sqrt(MU * (1 - e) ** 3 / RADIUS**3)
    force = f"{{kind: gravity_gradient, rate: {n}, eccentricity: {e}, inertia: {INERTIA.tolist()}}}"
    found = by_eqt(experiment_of, f"{TEXT}plant: {{forces: [{force}]}}\n")
    R, rate, _ = by_basilisk(wheels=False, gradient=True, ratio=np.sqrt(1 + e))
    np.testing.assert_allclose(found[0], R, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found[1], rate, rtol=0, atol=1e-9)
    free, _, _ = by_basilisk(wheels=False, gradient=False)
    assert np.abs(R - free).max() > 1e-6
