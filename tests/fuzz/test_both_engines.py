"""Accepted mutants of the shipped configurations give the same runs by both engines.

`python tests/fuzz/both_engines.py 0 2000` tries 2,000 of them; it may be divided into shares.
"""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from both_engines import compared

from eqt_cli.engines.native import Native

SESSION = Path(__file__).with_name("both_engines.py")
MUTANTS = 6


def test_a_difference_beyond_the_estimates_is_told():
    run = {
        "status": np.zeros(1, dtype=int),
        "error_estimate": np.array([1e-8]),
        "pose": np.eye(3)[None, None],
        "velocity": np.zeros((1, 1, 3)),
        "effort": np.ones(1),
    }

    def beside(**other):
        return compared(run, run | other)

    assert beside() == ("compared", None)
    assert beside(velocity=np.full((1, 1, 3), 2e-7)) == ("compared", None)
    told = ("differs", "velocity: 1e-06 apart, estimated 2e-08")
    assert beside(velocity=np.full((1, 1, 3), 1e-6)) == told
    assert beside(status=np.ones(1, dtype=int)) == ("status", "status ['OK'] and ['SOLVER_FAILED']")
    assert beside(effort=np.array([np.nan]))[0] == "missing"
    assert beside(error_estimate=np.ones(1), velocity=np.ones((1, 1, 3))) == ("no digits", None)


@pytest.mark.ci("runs mutants, and compiles their laws")
def test_mutants_differ_within_their_estimates():
    if missing := Native.unavailable():
        pytest.skip(missing)
    done = subprocess.run(
        [sys.executable, str(SESSION), "0", str(MUTANTS)],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    *wrong, summary = map(json.loads, done.stdout.splitlines())
    assert not wrong, wrong
    assert summary["compared"] >= MUTANTS / 2
