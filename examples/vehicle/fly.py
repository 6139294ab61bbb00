"""Flies a stored run again with a program that was built of an exported law.

    python fly.py RESULT PROGRAM...

RESULT is of sampled control, with a sample at every instant. PROGRAM is started once for each run,
perhaps by an emulator: it is told the stored pose and velocity at every instant, and its torques
are compared with those that the law asked for in the stored run.
"""

import subprocess
import sys

import numpy as np

import eqt_cli


def fly(result: str, program: list[str]) -> float:
    """The largest difference to the stored torques, N m."""
    largest = 0.0
    with eqt_cli.open_result(result) as stored:
        pose, velocity, command = (stored[name][0] for name in ("pose", "velocity", "command"))
    for Q, V, asked in zip(pose, velocity, command, strict=True):
        rows = np.concatenate([Q.reshape(len(Q), -1), V], axis=1)[:-1]  # no instant is at the end
        lines = "\n".join(" ".join(f"{value:.9g}" for value in row) for row in rows)
        done = subprocess.run(program, input=lines, capture_output=True, text=True, check=True)
        print(done.stderr, end="", file=sys.stderr)
        torque = np.array([line.split() for line in done.stdout.splitlines()], dtype=float)
        largest = max(largest, float(np.abs(torque - asked[:-1]).max()))
    return largest


if __name__ == "__main__":
    print(f"largest difference of a torque: {fly(sys.argv[1], sys.argv[2:]):.1e} N m")
