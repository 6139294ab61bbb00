"""The filter on SE₂(3) against a plain program, which begins anew at t = 0 at every instant.

It takes exponentials of matrices, and all fixes of an instant together.
"""

from functools import partial

import numpy as np
import pytest
from case_tables import from_yaml
from ports import after_measuring
from said import error_of, says
from scipy.linalg import expm, logm

from eqt_cli.base.errors import ConfigError
from eqt_cli.components.forces import Drag, Restoring
from eqt_cli.components.groups import groups
from eqt_cli.components.initial_states import Stream, generator_at
from eqt_cli.components.sensors import Bias, Noise
from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Normal, Sampling
from eqt_cli.config import shipped
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import remarks
from eqt_cli.extensions.export.export_laws import exported_filter
from eqt_cli.extensions.navigation.navigation import Navigation
from eqt_cli.runs.description import loop_in_words

SE3 = groups.get("SE3")()
H, INSTANTS = 0.05, 24
G = np.array([0.0, 0.0, -9.80665])
DRAG, LIFT = np.array([0.0, 0, 0, 1.3, 2.1, 0.7]), 4.0
POSE, DEPTH, GYRO, FORCE = 0.02, 0.03, 0.01, 0.05
BIAS, WALK, SPEED = 0.1, 0.03, 0.2
SENSORS = {
    "pose_sensors": (
        Noise(std=POSE, of="rotation", period=4 * H, delay=1),
        Noise(std=POSE, of="translation", period=3 * H, delay=6, dropout=0.3),
    ),
    "velocity_sensors": (
        Noise(std=GYRO, of="rotation"),
        Bias(value=Normal([0.0, BIAS]), walk=WALK, of="rotation"),
    ),
    "more_sensors": (
        (),
        (
            Noise(std=FORCE, of="translation"),
            Bias(value=Normal([0.0, BIAS]), walk=WALK, of="translation"),
        ),
        (Noise(std=DEPTH, of="depth", period=2 * H, delay=3, dropout=0.2),),
    ),
}
"""Late by different times, so that later measurements arrive first; some are missing."""


BY_HEADING = pytest.mark.ci("takes the quick case again, with a compass")


def hat(w):
    x, y, z = w
    return np.array([[0, -z, y], [z, 0, -x], [-y, x, 0.0]])


def exp(xi):
    """The exponential of a turn and of columns."""
    columns = np.reshape(xi[3:], (-1, 3)).T
    X = np.zeros((3 + columns.shape[1],) * 2)
    X[:3, :3], X[:3, 3:] = hat(xi[:3]), columns
    return expm(X)


def log(X):
    L = logm(X).real
    return np.concatenate([[L[2, 1], L[0, 2], L[1, 0]], *L[:3, 3:].T])


def heading(R):
    return np.arctan2(R[1, 0], R[0, 0])


class Plain:
    """R, v and p with both biases, and the covariance of their errors in this order."""

    def __init__(self, Q, v):
        self.X, self.b = np.eye(5), np.zeros(6)
        self.X[:3, [0, 1, 2, 4]], self.X[:3, 3] = Q[:3], v
        self.S = np.diag(np.repeat([POSE, SPEED, POSE, BIAS, BIAS], 3) ** 2)

    def predict(self, u):
        w, f = np.split(u - self.b, 2)
        flow = np.zeros((9, 9))
        for k in (0, 3, 6):
            flow[k : k + 3, k : k + 3] = -hat(w)
        flow[3:6, :3], flow[6:, 3:6] = -hat(f), np.eye(3)
        L = (H * np.eye(9) + H**2 / 2 * flow + H**3 / 6 * flow @ flow)[:, :6]
        R, v, p = self.X[:3, :3], self.X[:3, 3], self.X[:3, 4]
        once = np.zeros((9, 9))  # its exponential holds that of the turn, and its integrals
        once[:3, :3], once[:3, 3:6], once[3:6, 6:] = hat(w), np.eye(3), np.eye(3)
        turn, first, second = np.split(expm(H * once)[:3], 3, axis=1)
        now = np.eye(5)
        now[:3, :3], now[:3, 3] = R @ turn, v + H * G + R @ first @ f
        now[:3, 4] = p + H * v + H**2 / 2 * G + R @ second @ f
        step = np.block([[expm(H * flow), -L], [np.zeros((6, 9)), np.eye(6)]])
        white = np.vstack([L, np.zeros((6, 6))]) * np.repeat([GYRO, FORCE], 3)
        drift = np.vstack([-L / 2, np.eye(6)]) * np.sqrt(H) * WALK
        self.X, self.S = now, step @ self.S @ step.T + white @ white.T + drift @ drift.T

    def correct(self, Q, depth, by_heading=False):
        """By the measured parts of a pose, and by a depth; None where there is none."""
        here = self.X[[0, 1, 2, 4]][:, [0, 1, 2, 4]]
        pose = here.copy()
        rows, std = [], []
        for entries, axes in ((slice(0, 3), slice(0, 3)), (3, slice(6, 9))):
            if Q[0 if axes.start == 0 else 1] is not None:
                pose[:3, entries] = Q[0 if axes.start == 0 else 1]
                rows += [*np.eye(15)[axes]]
                std += [POSE] * 3
        residual = log(np.linalg.inv(here) @ pose)
        r = [*residual[:3]] * (Q[0] is not None) + [*residual[3:]] * (Q[1] is not None)
        if by_heading and Q[0] is not None:  # instead of the attitude, by differences
            there, h = (lambda e: heading(self.X[:3, :3] @ expm(hat(e)))), 1e-4
            row = [
                (8 * (there(h * e) - there(-h * e)) - there(2 * h * e) + there(-2 * h * e)) / 12 / h
                for e in np.eye(3)
            ]
            turned = (heading(Q[0]) - there(np.zeros(3)) + np.pi) % (2 * np.pi) - np.pi
            rows, r = [np.concatenate([row, np.zeros(12)]), *rows[3:]], [turned, *r[3:]]
            std = [POSE * np.linalg.norm(row), *std[3:]]
            if Q[1] is not None:
                r[1:] = self.X[:3, :3].T @ (Q[1] - self.X[:3, 4])
        if depth is not None:
            rows += [np.concatenate([np.zeros(6), self.X[2, :3], np.zeros(6)])]
            r, std = [*r, depth - self.X[2, 4]], [*std, DEPTH]
        if not rows:
            return
        C, V = np.array(rows), np.diag(np.square(std))
        K = np.linalg.solve(C @ self.S @ C.T + V, C @ self.S).T
        by, left = K @ r, np.eye(15) - K @ C
        self.X, self.b = self.X @ exp(by[:9]), self.b + by[9:]
        self.S = left @ self.S @ left.T + K @ V @ K.T


def motion(k):
    """A pose and a velocity that do not fit each other; the filter knows no more of either."""
    t = k * H
    Q = SE3.exp(np.array([np.sin(t), 0.5 * t, 0.3, t, np.cos(2 * t), -t]))
    return Q, np.array([np.cos(t), 0.5, 0.2 * t, 1.0, np.sin(3 * t), 0.4])


@pytest.mark.parametrize("by_heading", [False, pytest.param(True, marks=BY_HEADING)])
def test_each_instant_is_that_of_a_filter_that_begins_anew(by_heading):
    """Rounding of 24 steps, of expm and of logm is below 1e-13, that of differences 1e-12."""
    forces = Drag(linear=DRAG.tolist()), Restoring(weight=9.80665, buoyancy=LIFT)
    options = {"heading_only": True, "initial_pose_std": POSE, "initial_error": 0.1}
    estimator = Navigation(initial_velocity_std=SPEED, **(options if by_heading else {}))
    vehicle = Vehicle(forces=forces, control=Sampling(H), estimator=estimator, **SENSORS)
    random_of = partial(generator_at, 1, Stream.VEHICLE, 0)
    flying = vehicle.of_run(SE3, random_of)
    errors = flying.measurement_errors(SE3, INSTANTS, [random_of])
    states = {name: np.zeros(n) for name, n in flying.states(SE3).items()}
    felt, pose, depth = [], [], []
    due = {channel.name: k for k, channel in enumerate(flying.holding(SE3))}
    delays = {channel.name: channel.delay for channel in flying.holding(SE3)}

    def known(name, k, now):
        late = delays[name] if k else 0
        return errors.arrived[0, k, due[name]] > 0 and k + late <= now

    for now in range(INSTANTS):
        Q, V = motion(now)
        states |= after_measuring(flying, SE3, Q, V, errors.measured(SE3, 0, now), states)
        up = Q[:3, :3].T @ [0, 0, 1.0]
        # Of a mass of 1 kg; the weight is not felt.
        force = -DRAG[3:] * V[3:] + LIFT * up + errors.felt[0, now, 3:]
        felt.append(np.concatenate([V[:3] + errors.velocity[0, now, :3], force]))
        pose.append(Q @ exp(errors.pose[0, now]))
        depth.append(Q[2, 3] + errors.depth[0, now, 0])
        if now % 5 and now < INSTANTS - 1:
            continue
        Q0, V0 = motion(0)
        start = Q0 @ exp(np.full(6, -0.1)) if by_heading else pose[0]
        plain = Plain(start, Q0[:3, :3] @ (V0[3:] - flying.estimator.initial_velocity_error))
        for k in range(0 if by_heading else 1, now + 1):  # without a start, the first fix is one
            if k:
                plain.predict((felt[k - 1] + felt[k]) / 2)
            turn = pose[k][:3, :3] if known("measured_pose_rotation", k, now) else None
            place = pose[k][:3, 3] if known("measured_pose_translation", k, now) else None
            plain.correct(
                (turn, place),
                depth[k] if known("measured_depth_depth", k, now) else None,
                by_heading,
            )
        R, v = plain.X[:3, :3], plain.X[:3, 3]
        tell = SE3.unpack(states["estimator_pose"])[:3], states["estimator_velocity"]
        np.testing.assert_allclose(tell[0], plain.X[:3, [0, 1, 2, 4]], rtol=0, atol=1e-11)
        velocity = np.concatenate([felt[now][:3] - plain.b[:3], R.T @ v])
        np.testing.assert_allclose(tell[1], velocity, rtol=0, atol=1e-11)
        np.testing.assert_allclose(states["estimator_bias"], plain.b, rtol=0, atol=1e-11)
        order = [*range(3), *range(6, 9), *range(9, 15), *range(3, 6)]
        S = plain.S[order][:, order][np.triu_indices(15)]
        np.testing.assert_allclose(states["estimator_covariance"], S, rtol=0, atol=1e-11)


# What is wrong, and what is said of it ------------------------------------------------------------


def built(*changes):
    return build(read_config(shipped.folder() / "se3_bluerov2_navigation.yaml", changes))


def test_an_offset_in_mg_that_was_written_without_its_unit_is_remarked():
    found = built(
        "sensors.accelerometer=[{kind: noise, std: 0.1}, {kind: bias, value: [0, 30, 1]}]"
    )
    [said] = [str(x) for x in remarks(found, runs=False) if "accelerometer" in str(x)]
    assert says(said, "…sensors.accelerometer[1]: a bias of 30 m/s^2…write '30 mg'")


@from_yaml
def test_a_slip_is_told_with_the_way_out(changes, said):
    with pytest.raises(ConfigError) as caught:
        built(*changes)
    problems = " | ".join(f"{each.path}: {each.message}" for each in caught.value.problems)
    assert says(problems, said)


@from_yaml
def test_what_the_filter_cannot_know_is_remarked(changes, said):
    texts = [str(remark) for remark in remarks(built(*changes))]
    assert any(says(text, f"…{said}") for text in texts), texts


def test_the_signal_path_leads_every_measurement_through_the_filter():
    *_, sensors, behind, law = loop_in_words(built().resolved)[0].split(" → ")
    assert "accelerometer (" in sensors
    assert (behind, law) == ("estimate (navigation)", "law")


def test_no_c_is_written_of_the_filter():
    text = error_of(exported_filter, built().loop, "eqt", 1)
    assert says(text, "eqt: a filter that predicts by an accelerometer…remove the keys estimator…")
