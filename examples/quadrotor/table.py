"""Prints the table of the public comparison from results of line, circle and disturbed."""

import sys

import numpy as np

import eqt_cli

for folder in sys.argv[1:]:
    with eqt_cli.open_result(folder) as result:
        for law in result.labels:
            error, apart, thrust = (
                np.asarray(result.read(name, controller=law))[0]
                for name in ("position_error", "attitude_command_error", "thrust")
            )
            half = apart / 8**0.5  # sin of half the angle between R and R_c
            below = np.flatnonzero(error < 0.02)
            first = f"{result.times[below[0]]:.2f}" if len(below) else "never"
            e_R = (2 * half * np.sqrt(1 - half * half)).mean()
            size = np.linalg.norm(thrust, axis=-1).mean()
            print(f"{folder} {law}: {error.mean():.4f} {e_R:.4f} {size:.3f} {first}")
