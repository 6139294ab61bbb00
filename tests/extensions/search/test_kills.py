"""Searches that are killed try the points, and find the winners and runs, of some that are not."""

import json
import time
from pathlib import Path

import pytest
from faults_harness import CONFIG, Session

SEARCHED = (
    CONFIG.replace("[eqt, gt]", "[eqt]").replace("cross_check: 1", "cross_check: 0")
    + "ensemble: {runs: 8, seed: 1}\n"
)
COMMON = "objective: mean_pose_error"
SEARCHES = {
    "tune": "tune: {over: {gains.kp: {log: [0.1, 10]}, gains.kd: {log: [0.1, 10]}}, "
    f"confirm: {{runs: 8}}, budget: 24, samples: 2, {COMMON}}}\n",
    "worst": "worst: {over: {plant.inertia.relative: [-0.2, 0.2], gains.kd: {log: [0.1, 10]}}, "
    f"budget: 3, population: 6, seeds: 2, {COMMON}}}\n",
}
KILLS = 2

pytestmark = [
    pytest.mark.skipif(not Path("/proc/self/task").is_dir(), reason="as in tests/faults"),
    pytest.mark.ci("starts eqt four times"),
]


def generations(out):
    return sorted(out.glob("generations/**/*.json"))


def tried(out):
    """How good the runs of every generation are.

    The winners alone may come from a search that no kill has met.
    """
    return {str(path.relative_to(out)): path.read_bytes() for path in generations(out)}


@pytest.mark.parametrize(("command", "engine"), [("tune", "solve_ivp"), ("worst", "native")])
def test_sigkills_change_no_bit_of_a_search(tmp_path, command, engine):
    config = tmp_path / "c.yaml"
    text = SEARCHED.replace("rtol:", f"engine: {engine}, rtol:") + SEARCHES[command]
    config.write_text(text, encoding="utf-8")
    kept = {}
    for name, kills in (("whole", 0), ("killed", KILLS)):
        out = tmp_path / name
        for kill in range(kills):
            session = Session(command, config, out, ["--executor", "serial"])
            while session.running and len(generations(out)) < kill + 1:
                time.sleep(0.01)
            time.sleep(0.05 * kill)
            assert session.kill()
        Session(command, config, out, ["--executor", "serial"]).finish()
        record = out / ("tuning.json" if command == "tune" else "worst.json")
        files = [record, *sorted(out.glob("tuned/*.yaml")), *sorted(out.glob("worst/*.yaml"))]
        assert len(files) > 1 and json.loads(record.read_text())["laws"]
        kept[name] = [path.read_bytes() for path in files], tried(out)
    assert len(kept["whole"][1]) >= 3
    assert kept["whole"] == kept["killed"]
