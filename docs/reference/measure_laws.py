"""Measures every shipped law as C on three groups, for the table of the guide to vehicles.

    python docs/reference/measure_laws.py        writes exported_laws.json; needs `ziglang`

It takes some minutes, and what compilers make of a law changes with their version: so the numbers
are kept, and `generate.py` makes the table of them.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from eqt_cli.api.loading import source_from
from eqt_cli.base.errors import Problems
from eqt_cli.components.groups import group_named
from eqt_cli.components.laws import controllers
from eqt_cli.config.experiment import build
from eqt_cli.extensions.firmware.export import MISSING, files, measured
from eqt_cli.extensions.firmware.export_laws import exported
from eqt_cli.extensions.firmware.program_error import ARITHMETICS

KEPT = Path(__file__).with_name("exported_laws.json")

GROUPS = {
    "SO3": ([1.0, 2.0, 2.5], [1.0, 1.2, 0.8]),
    "SE3": ([1.0, 2.0, 2.5, 3.0, 3.0, 3.0], [1.0, 1.2, 0.8, 0.5]),
    "SE2": ([1.0, 2.0, 2.0], [1.0, 1.2, 0.5]),
}
"""Inertia and navigation weight."""


def configuration(group: str, law: str) -> dict[str, object]:
    """Runs of a law with unequal gains, with errors of any size."""
    inertia, kp = GROUPS[group]
    moving = {"kind": "rates", "rates": ["0.3*cos(t)"] * len(inertia)}
    tracks = "track" in controllers.get(law).tasks
    return {
        "name": "measured",
        "group": group,
        "inertia": inertia,
        "gains": {"kp": kp, "kd": 0.7},
        **(
            {"reference": moving}
            if tracks
            else {"task": "stabilise", "target": {"pose": "identity"}}
        ),
        "controllers": [law],
        "initial": {"pose": {"kind": "exp_normal", "std": 0.6}, "velocity": "normal"},
        "ensemble": {"runs": 20, "seed": 3},
        "time": {"duration": 5.0, "samples": 51},
        "control": {"period": 0.02},
        "solver": {"engine": "solve_ivp", "rtol": 1e-6, "atol": 1e-6, "cross_check": 0},
    }


def main() -> int:
    """Write the numbers."""
    found = []
    for law in controllers.names():
        if not controllers.get(law).tasks:  # code of a user's own is no formula
            continue
        for group in GROUPS:
            problems = Problems(str)
            controllers.get(law)().check(group_named(group), problems)
            if problems:
                continue
            experiment = build(source_from(configuration(group, law), {}))
            record: dict[str, object] = {"law": experiment.titles[law], "group": group}
            for real, by in ARITHMETICS.items():
                [one] = exported(experiment, [], by).laws
                cost = measured(one.name, files(one))
                if cost is None:
                    sys.exit(MISSING)
                record["operations"] = one.program.step.operations
                record[real] = {
                    "flash": cost.flash,
                    "stack": cost.stack,
                    "bound": float(one.torque_bound.max()),
                }
            found.append(record)
            print(record)
    KEPT.write_text(json.dumps(found, indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
