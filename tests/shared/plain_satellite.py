"""The attitude of a body and the axes of wheels, of plain NumPy; it shares no line with eqt."""

import numpy as np
from plain import hat


def exp(v):
    """Rodrigues' formula for the rotation about v by its length."""
    angle = np.linalg.norm(v)
    axis = hat(np.array(v) / angle)
    return np.eye(3) + np.sin(angle) * axis + (1 - np.cos(angle)) * axis @ axis


def pyramid():
    """The axes of four wheels at 54.7° from z, as columns."""
    angle = np.radians(54.7)
    rows = [
        [sx * np.sin(angle) / np.sqrt(2), sy * np.sin(angle) / np.sqrt(2), np.cos(angle)]
        for sx, sy in ((1, 1), (-1, 1), (-1, -1), (1, -1))
    ]
    return np.array(rows).T
