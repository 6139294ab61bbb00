"""Lee, Leok and McClamroch (2010), the attitude part, as somebody types it in."""

import numpy as np


def vee(M):
    return np.array([M[2, 1], M[0, 2], M[1, 0]])


def compute(pose, velocity, desired_pose, desired_velocity, desired_acceleration, kR, kW, J):
    E = desired_pose.T @ pose
    W = E.T @ desired_velocity
    A = E.T @ desired_acceleration
    eR = vee(E - E.T) / 2
    gyro = np.cross(velocity, J * velocity)
    return -kR * eR - kW * (velocity - W) + gyro - J * (np.cross(velocity, W) - A)


class Lee:
    def __init__(self, kR, kW, J, kI=0.0):
        self.kR, self.kW, self.J, self.kI = kR, kW, J, kI
        self.integral = np.zeros(3)

    def update(self, pose, velocity, desired_pose, desired_velocity, desired_acceleration, period):
        E = desired_pose.T @ pose
        torque = compute(
            *(pose, velocity, desired_pose, desired_velocity, desired_acceleration),
            *(self.kR, self.kW, self.J),
        )
        torque = torque - self.kI * self.integral
        self.integral = self.integral + period * (
            velocity - E.T @ desired_velocity + vee(E - E.T) / 2
        )
        return {"torque": torque}
