"""A search that is killed, twice, finds the very winners of one that is not."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from faults_harness import CONFIG, Session

TUNE = (
    CONFIG.replace("[eqt, gt]", "[eqt]").replace("cross_check: 1", "cross_check: 0")
    + "ensemble: {runs: 8, seed: 1}\n"
    + "tune: {over: {gains.kp: {log: [0.1, 10]}, gains.kd: {log: [0.1, 10]}},"
    + " objective: mean_pose_error, budget: 3, population: 6, seeds: 2, confirm: {runs: 8}}\n"
)
KILLS = 2

pytestmark = [
    pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="as in test_kills"),
    pytest.mark.slow("starts eqt four times"),
]


def generations(out: Path) -> int:
    return len(list(out.glob("generations/eqt/*/*/results.h5")))


def test_sigkills_change_no_bit_of_the_winners(tmp_path: Path) -> None:
    config = tmp_path / "c.yaml"
    config.write_text(TUNE, encoding="utf-8")
    kept = {}
    for name, kills in (("whole", 0), ("killed", KILLS)):
        out = tmp_path / name
        for kill in range(kills):
            session = Session("tune", config, out, ["--executor", "serial"])
            while session.running and generations(out) < kill + 1:
                time.sleep(0.01)
            time.sleep(0.05 * kill)
            assert session.kill()
        Session("tune", config, out, ["--executor", "serial"]).finish()
        files = [out / "tuning.json", *sorted((out / "tuned").glob("*.yaml"))]
        kept[name] = [path.read_bytes() for path in files]
        assert json.loads(kept[name][0])["laws"][0]["winners"]
    assert kept["whole"] == kept["killed"]
