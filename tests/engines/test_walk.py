"""A walk in C through many spans gives what it gives span by span."""

from pathlib import Path

import numpy as np
import pytest
import yaml

import eqt_cli
from eqt_cli.engines import native
from eqt_cli.extend import Integrator, Status
from eqt_cli.runs.batches import batches

pytestmark = pytest.mark.skipif(
    native.Native.unavailable() is not None, reason="needs a C compiler"
)

CONFIGS = Path(__file__).parents[2] / "configs"
FEW = {"ensemble.runs": 5, "solver.engine": "native", "solver.cross_check": 0}

OWN = """
typedef double real;
typedef struct { real k; } own_numbers;
typedef struct { real sum[3]; } own_memory;
typedef struct {
    real t, pose[9], velocity[3], desired_pose[9], desired_velocity[3], desired_acceleration[3];
} own_input;
void own_torque(const own_numbers *n, own_memory *m, const own_input *in, real *torque)
{
    int i;
    for (i = 0; i < 3; i++) {
        m->sum[i] += 0.1 * in->velocity[i];
        torque[i] = -n->k * in->velocity[i] - 0.1 * m->sum[i] + 0.05 * in->pose[i + 3];
    }
}
"""

WITH_CODE = yaml.safe_load("""
controllers: [{kind: code, file: own.c, numbers: {k: 0.7}, memory: [sum]}]
actuators: [{kind: limit, limit: 0.9}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors: {velocity: [{kind: noise, std: 0.01, period: 0.05}]}
""")
"""Its law acts at every other tick, with a memory; its actuators reach limits."""

LOOPS = {
    "wheels, and a reference that switches": ("satellite_wheels", {"time.duration": 4}),
    "more samples than spans": ("satellite_wheels", {"time.duration": 1, "time.samples": 101}),
    "all runs diverge": ("paper", {"control": {"period": 0.4}, "gains.kd": 6, "gains.kp": 9}),
    "some runs end by their steps": (
        "paper",
        {"control": {"period": 0.4}, "solver.max_steps": 80, "time.duration": 10},
    ),
}


FILTERED = "satellite_estimated", {"time.duration": 4}
ESTIMATED = pytest.param(
    FILTERED, id="an estimator, and sensors with clocks", marks=pytest.mark.needs("merging")
)
CODE = pytest.param(("paper", WITH_CODE), id="code of a user", marks=pytest.mark.needs("code"))


@pytest.fixture(
    params=[*(pytest.param(loop, id=name) for name, loop in LOOPS.items()), ESTIMATED, CODE]
)
def batch(request, tmp_path):
    name, changes = request.param
    (tmp_path / "own.c").write_text(OWN, encoding="utf-8")
    path = tmp_path / "loop.yaml"
    path.write_text((CONFIGS / f"{name}.yaml").read_text(encoding="utf-8"), encoding="utf-8")
    study = eqt_cli.load_experiment(path, FEW | changes)
    return next(batches(study, next(iter(study.base.loops)), np.arange(FEW["ensemble.runs"])))


def test_a_walk_gives_what_it_gives_span_by_span(batch, monkeypatch):
    ahead, spans = native.Lanes.walk_ahead, []

    def counted(lanes, place, states):
        found = ahead(lanes, place, states)
        spans.append(found[0] - place)
        return found

    monkeypatch.setattr(native.Lanes, "walk_ahead", counted)
    walked = batch.engine.solve(batch.problem)
    monkeypatch.setattr(native.Lanes, "walk_ahead", Integrator.walk_ahead)
    expected = batch.engine.solve(batch.problem)
    for name in ("states", "status", "steps"):
        assert getattr(walked, name).tobytes() == getattr(expected, name).tobytes(), name
    assert walked.messages == expected.messages
    ended = walked.status != Status.OK
    assert sum(spans) > (0.1 if ended.all() else 0.5) * len(batch.problem.spans)
