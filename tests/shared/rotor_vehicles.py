"""A body under rotors, as a configuration."""

from typing import Any

import numpy as np

W, HIGH, ARM, TURNS = 14.715, 6.0, 0.25, 0.02
"""Its weight and the largest thrust of a rotor, N, the arms and the ratios of torque, m."""


def rotors(angles: list[float], spins: list[int], **options: Any) -> dict[str, Any]:
    """A body under rotors that push along z, on a circle."""
    places = [[ARM * np.cos(a), ARM * np.sin(a), 0.0] for a in np.radians(angles)]
    up = [0, 0, 1]
    each = [{"at": p, "along": up, "turns": TURNS * s} for p, s in zip(places, spins, strict=True)]
    return {
        "group": "SE3",
        "inertia": [0.02, 0.02, 0.04, 1.5, 1.5, 1.5],
        "model": {"forces": [{"kind": "restoring", "weight": W}]},
        "reference": {"kind": "flat", "position": ["0", "0", "1"], "heading": "0"},
        "controllers": [
            {
                "kind": "cascade",
                "attitude": "lee2010",
                "gains": {"kp": 1.0, "kd": 0.3},
                "position": {"kx": 4, "kv": 3},
                "along": up,
            }
        ],
        "actuators": [{"kind": "thrusters", "thrusters": each, "low": 0, "high": HIGH, **options}],
        "control": {"period": 0.01},
        "time": {"duration": 4.0},
    }
