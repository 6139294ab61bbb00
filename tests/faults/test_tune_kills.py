"""A search that is killed twice tries the points, and finds the winners, of one that is not."""

from __future__ import annotations

import json
import time
from pathlib import Path

import pytest
from faults_harness import CONFIG, Session

from eqt_cli.results.result import open_result

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


def generations(out: Path) -> list[Path]:
    return sorted(path.parent for path in out.glob("generations/eqt/*/*/results.h5"))


def tried(out: Path) -> dict[str, list[bytes]]:
    """The points of every generation, and how good their runs are.

    The winners alone may come from a search that no kill has met.
    """
    found = {}
    for folder in generations(out):
        with open_result(folder) as result:
            points = [result.coordinate(key).tobytes() for key in ("gains.kp", "gains.kd")]
            found[str(folder.relative_to(out))] = [*points, result["mean_pose_error"].tobytes()]
    return found


@pytest.mark.parametrize("engine", ["solve_ivp", "native"])
def test_sigkills_change_no_bit_of_a_search(tmp_path: Path, engine: str) -> None:
    config = tmp_path / "c.yaml"
    text = TUNE.replace("rtol:", f"engine: {engine}, rtol:")
    config.write_text(text, encoding="utf-8")
    kept = {}
    for name, kills in (("whole", 0), ("killed", KILLS)):
        out = tmp_path / name
        for kill in range(kills):
            session = Session("tune", config, out, ["--executor", "serial"])
            while session.running and len(generations(out)) < kill + 1:
                time.sleep(0.01)
            time.sleep(0.05 * kill)
            assert session.kill()
        Session("tune", config, out, ["--executor", "serial"]).finish()
        files = [out / "tuning.json", *sorted((out / "tuned").glob("*.yaml"))]
        winners = [path.read_bytes() for path in files]
        assert json.loads(winners[0])["laws"][0]["winners"]
        kept[name] = winners, tried(out)
        assert len(tried(out)) == 6
    assert kept["whole"] == kept["killed"]
