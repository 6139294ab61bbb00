"""The configuration of a small experiment, and others that differ in some sections."""

import yaml

from eqt_cli.config.document import read_config
from eqt_cli.config.study import add_grids, study

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


FEW_RUNS = ["--engine", "native", "--set", "ensemble.runs=20", "--set", "time.samples=51", "-q"]
"""Options of `eqt run` for a shipped configuration with fewer runs and samples."""


def configuration(**changes: str | None) -> str:
    """`LINES` with sections replaced, left out (None) or, where new, added at the end."""
    lines = {**LINES, **changes}
    return "".join(f"{key}: {value}\n" for key, value in lines.items() if value is not None)


def mapping(**changes):
    """`LINES` as a mapping, with sections replaced or new."""
    return yaml.safe_load(configuration()) | changes


WHEEL = {
    "name": "wheel",
    "task": "stabilise",
    "group": "SO2",
    "inertia": 1.0,
    "gains": {"kp": 0.5, "kd": 1.0},
    "target": {"pose": "identity"},
    "controllers": ["stabilising"],
    "initial": {"pose": {"kind": "exp_normal", "std": 0.5}},
    "control": {"period": 0.5},
}
"""A double integrator on a circle, without its ensemble and its times."""


def study_of(folder, text, *overrides, grids=(), name="config.yaml"):
    """The study of a configuration, written into a folder."""
    path = folder / name
    path.write_text(text, encoding="utf-8")
    blocks = {f"grids[{index}]": grid for index, grid in enumerate(grids)}
    return study(add_grids(read_config(path, overrides), blocks))
