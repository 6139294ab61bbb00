"""A search for the worst run that is killed, three times, finds the very run of one that is not."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from faults_harness import CONFIG, Session

WORST = (
    CONFIG.replace("[eqt, gt]", "[eqt]").replace("cross_check: 1", "cross_check: 0")
    + "ensemble: {runs: 8, seed: 1}\n"
    + "worst: {over: {plant.inertia.relative: [-0.2, 0.2], gains.kd: {log: [0.1, 10]}},"
    + " objective: mean_pose_error, budget: 3, population: 6, seeds: 2}\n"
)
KILLS = 3

pytestmark = [
    pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="as in test_kills"),
    pytest.mark.slow("starts eqt five times"),
]


def generations(out: Path) -> int:
    return len(list(out.glob("generations/eqt/*/*/results.h5")))


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_sigkills_change_no_bit_of_what_is_found(tmp_path: Path, engine: str) -> None:
    config = tmp_path / "c.yaml"
    text = WORST.replace("rtol:", f"engine: {engine}, rtol:")
    config.write_text(text, encoding="utf-8")
    kept = {}
    for name, kills in (("whole", 0), ("killed", KILLS)):
        out = tmp_path / name
        for kill in range(kills):
            session = Session("worst", config, out, ["--executor", "serial"])
            while session.running and generations(out) < kill + 1:
                time.sleep(0.01)
            time.sleep(0.05 * kill)
            assert session.kill()
        Session("worst", config, out, ["--executor", "serial"]).finish()
        kept[name] = [(out / path).read_bytes() for path in ("worst.json", "worst/eqt.yaml")]
        assert json.loads(kept[name][0])["laws"][0]["value"] > 0
    assert kept["whole"] == kept["killed"]
