"""The configuration of a small experiment, and others that differ in some sections."""

LINES = {
    "group": "SO3",
    "inertia": "[2, 1, 3]",
    "gains": "{kp: 1.0, kd: 0.5}",
    "reference": '{torque: ["cos(t)", "sin(t)", "0"]}',
    "controllers": "[eqt, gt]",
    "initial": "{pose: haar, velocity: normal}",
    "ensemble": "{runs: 3, seed: 1}",
    "time": "{duration: 1.0, samples: 11}",
    "solver": "{rtol: 1.0e-6, cross_check: 0}",
}
"""A configuration that is fine: one section a line, from line 1 on."""


def configuration(**changes: str | None) -> str:
    """`LINES` with sections replaced, left out (None) or, where new, added at the end."""
    lines = {**LINES, **changes}
    return "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None)
