"""What cannot fit into memory or onto the disk is refused before it is begun."""

import re
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from eqt_cli.api import choose_executor, load_experiment
from eqt_cli.base.errors import ConfigError
from eqt_cli.extend import Engine
from eqt_cli.runs import preflight


def refusal(run, *overrides):
    with pytest.raises(ConfigError) as caught:
        run(*overrides)
    assert not Path("out").exists()
    return str(caught.value)


def test_memory(run, monkeypatch):
    """25 states and 20 signals: 3 runs × 1e7 samples × 45 numbers × 8 bytes × 3 copies."""
    monkeypatch.setattr(preflight, "_memory", lambda: 16 * 10**9)
    assert refusal(run, "time.samples=10000000") == (
        "overrides[0]: time.samples: a part of the runs takes at least 32.4 GB of memory at once, "
        "and this machine has 16 GB; take fewer samples"
    )


@pytest.mark.ci("computes an experiment several times")
def test_disk(run, monkeypatch):
    monkeypatch.setattr(preflight, "_free_disk", lambda folder: 64 * 10**9)
    text = refusal(run, "ensemble.runs=100000000")
    match = re.fullmatch(
        r"overrides\[0\]: ensemble\.runs: (\d+) GB are needed on the disk \((\d+) GB for the "
        r"result, (\d+) GB for the parts from which it is packed\), and out has 64 GB left; "
        "take fewer runs, fewer samples, or store\\.trajectories: none",
        text,
    )
    assert match, text
    needed, result, parts = map(float, match.groups())
    assert needed == pytest.approx(result + parts, abs=2)  # each is rounded
    assert result > 2 * 0.1 * 8 * 11  # a signal of 11 samples for 1e8 runs of two controllers


def test_what_there_is(tmp_path):
    assert preflight._free_disk(tmp_path / "not" / "there") > 0
    assert (preflight._memory() or 10**9) > 10**8


def probed(monkeypatch, seconds):
    """Estimate 20 runs over 2000 s; every solve takes 0.3 s, and 0.05 s for each s of it."""
    now = [0.0]
    clocks = dict.fromkeys(("monotonic", "process_time"), lambda: now[0])
    monkeypatch.setattr(preflight, "time", SimpleNamespace(**clocks))
    monkeypatch.setattr(preflight, "PROBE_SECONDS", seconds)

    def solve(engine, problem, workers, progress):
        now[0] += 0.3 + 0.05 * np.ptp(problem.times)
        progress(1.0)

    def whole(*of):
        raise AssertionError("a probe computed a whole part")

    monkeypatch.setattr(Engine, "solve", solve)
    monkeypatch.setattr(preflight, "compute_part", whole)
    long = {"time.duration": 2000.0, "ensemble.runs": 20}
    found = load_experiment("configs/paper.yaml", long)
    return preflight.estimate(found, choose_executor(found, 2, "serial"), seconds)


@pytest.mark.parametrize("most", [2.0, 0.5])
def test_a_probe_of_a_long_horizon_times_its_beginning(monkeypatch, most):
    """100.3 s for each of four laws, of which 0.3 s are once."""
    assert probed(monkeypatch, most).seconds == pytest.approx(4 * 100.3, rel=1e-3)


def test_a_probe_of_what_takes_too_long_tells_no_time(monkeypatch):
    assert probed(monkeypatch, -1.0).seconds is None
