"""How far the searches of `eqt tune` end from the best gains, and whether its verdicts hold.

    python -m benchmarks.searches misses --laws gt,eqt --tasks late --samples 3
    python -m benchmarks.searches misses --dense --laws gt,eqt --samples 1
    python -m benchmarks.searches same --plain --count 200
    python -m benchmarks.searches ratio --plain --count 100 --top 2.55
    python -m benchmarks.searches ratio --plain --count 100 --feedforward 0.48

`misses` compares the archive of `eqt suite` with the least error that any of its own searches finds
on the same training runs, at an effort of at most 1.001 of the bound: a search from other first
points, one that goes on from both best points, and a dense cloud about the best of all. By
`--dense`, a grid of two numbers, or a thousand points of three, are tried besides, and the cells of
its best points. `same`
tunes two copies of one law, whose ranges differ by 7 and 13 %, so that they try other points.
`ratio` does it for a law whose range of kp ends earlier, or whose feedforward is too small, so that
its error is 3 % larger in the mean over training samples. By `--plain`, a plain program flies the
runs, ten times as fast (`benchmarks/wheel.py`). Each line of the output is a JSON record.
"""

from __future__ import annotations

import argparse
import json
import os
import sys
import tempfile
from collections.abc import Generator, Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import qmc
from threadpoolctl import threadpool_limits

import eqt_cli
from benchmarks import wheel
from eqt_cli.api.running import choose_executor
from eqt_cli.base.arrays import Array
from eqt_cli.config.study import Study
from eqt_cli.extensions.search import training
from eqt_cli.extensions.search.exchanges import FINISHED
from eqt_cli.extensions.search.model_search import Best, ModelSearch, Tried, first_points
from eqt_cli.extensions.search.training import Training
from eqt_cli.extensions.suite.archive import shipped_archive
from eqt_cli.extensions.suite.entrants import shipped_laws
from eqt_cli.extensions.suite.judging import search_of
from eqt_cli.extensions.suite.tasks import all_tasks

OTHER = 11
"""First points of the own searches are those of the sample with so much larger a number."""

BUDGET, MORE, CLOUD, WIDTH = 80, 40, 48, 0.04
"""Points of an own search, of one that goes on, of the cloud, and half the width of the cloud."""

GRID, NET, VALLEYS, NEAR = 31, 1024, 6, 0.1
"""Points of a grid along each of two axes, of a net of more, cells searched, and least distance."""


class Runs:
    """The training runs of a law on a task, with what was tried of each sample."""

    def __init__(self, search: Any, samples: Iterable[int]) -> None:
        self.search, (self.law,) = search, search.laws
        self.keys = {sample: Training(self.law, sample) for sample in samples}
        self.executor = choose_executor(Study(None, search.base), 1)
        self.tried: dict[int, Tried] = {}

    def at(self, points: Mapping[int, Array]) -> dict[int, Tried]:
        """Run points by sample."""
        of_keys = {self.keys[sample]: x for sample, x in points.items()}
        answers = training._run(self.search, of_keys, self.executor, tried=bool(self.tried))
        judged = {sample: answers[self.keys[sample]] for sample in points}
        for sample, tried in judged.items():
            earlier = self.tried.get(sample)
            self.tried[sample] = tried if earlier is None else earlier.joined(tried)
        return judged

    def driven(self, steps: Mapping[int, Generator[Array, Tried, Best]]) -> dict[int, Best]:
        """Take searches to their ends."""
        course, answers = training._abreast(steps), None
        while True:
            try:
                points = course.send(answers)
            except StopIteration as stopped:
                return dict(stopped.value)
            answers = self.at(points)

    def least(self, sample: int) -> tuple[float, Array]:
        """Return the least error that keeps the bound, and its point."""
        tried = self.tried[sample]
        keeps = (tried.excess(self.search.bounds) <= 1e-3).all(axis=1) & (tried.lost == 0)
        costs = np.where(keeps & np.isfinite(tried.costs), tried.costs, np.inf)
        return float(costs.min()), tried.shares[costs.argmin()]

    def valleys(self, sample: int) -> Array:
        """Return the best points, none near another, of all that keep the bound within 5 %."""
        tried = self.tried[sample]
        close = (tried.excess(self.search.bounds) <= 0.05).all(axis=1) & (tried.lost == 0)
        found: list[Array] = []
        for index in np.argsort(np.where(close, tried.costs, np.inf)):
            point = tried.shares[index]
            if close[index] and all(abs(point - other).max() > NEAR for other in found):
                found.append(point)
            if len(found) == VALLEYS:
                break
        return np.array(found)

    def search_densely(self, axes: int) -> None:
        """Try a grid or a net of all gains, and a finer one about its best points."""
        if axes == 2:
            along = np.linspace(0, 1, GRID)
            points = np.stack(np.meshgrid(along, along), axis=-1).reshape(-1, 2)
            fine, half = np.linspace(-1, 1, 9), 1 / (GRID - 1)
        else:
            points = qmc.Sobol(axes, scramble=False).random(NET)
            fine, half = np.linspace(-1, 1, 5), 0.5 * NET ** (-1 / axes)
        self.at(dict.fromkeys(self.keys, points))
        for shrunk in (half, half / len(fine)):
            box = shrunk * np.stack(np.meshgrid(*axes * [fine]), axis=-1).reshape(-1, axes)
            cells = {s: (self.valleys(s)[:, None] + box).reshape(-1, axes) for s in self.keys}
            self.at({sample: np.clip(cell, 0, 1) for sample, cell in cells.items()})


def misses(
    laws: list[str], names: list[str], samples: int, dense: bool
) -> Iterable[dict[str, Any]]:
    """Yield how far the archived gains of a law on a task are from the best ones, in percent."""
    archive, tasks, shipped = shipped_archive(), all_tasks(), shipped_laws()
    for name in names or tasks:
        for label in laws or archive.laws:
            judged = archive.laws[label].tasks.get(name)
            if judged is None or not judged.with_gains.all():
                continue
            search = search_of(shipped[label], tasks[name])
            if search is None:
                continue
            runs, axes = Runs(search, range(1, samples + 1)), len(search.laws[0].axes)
            archived = {s: _shares(runs.law, judged.values[s - 1]) for s in runs.keys}
            stated = runs.at({s: x[None] for s, x in archived.items()})
            own = {s: ModelSearch(axes, BUDGET, search.bounds, 0.0, s + OTHER) for s in runs.keys}
            best = runs.driven({s: one.points() for s, one in own.items()})
            there = [one.tried.shares[one.point] for one in best.values() if one.point is not None]
            for s, one in own.items():
                points = np.array([*archived.values(), *there])
                best[s] = runs.driven({s: one.exchanged(points, MORE)})[s]
            if dense:
                runs.search_densely(axes)
            cloud = 2 * first_points(axes + 1, 10**6, 3)[:, :axes] - 1
            cloud = np.concatenate([cloud, cloud / 4, -cloud])[:CLOUD]
            around = {s: np.clip(runs.least(s)[1] + WIDTH * cloud, 0, 1) for s in runs.keys}
            runs.at(around)
            least = {s: runs.least(s)[0] for s in runs.keys}
            off = [100 * (float(stated[s].costs[0]) / least[s] - 1) for s in runs.keys]
            points = [len(runs.tried[s]) for s in runs.keys]
            yield {
                "law": label,
                "task": name,
                "miss_percent": [round(x, 3) for x in off],
                "finished": bool((np.nan_to_num(judged.gained, nan=1.0) <= FINISHED).all()),
                "points": points,
            }


def _shares(law: Any, values: Mapping[str, float]) -> Array:
    """Return the point of the unit cube at some values."""
    units = law.units(values)
    return np.array([law.axes[key].share(values[key] / units.get(key, 1.0)) for key in law.order])


PLANT = {
    "name": "n",
    "group": "SO2",
    "inertia": 1.0,
    "gains": {"kp": 1.0, "kd": 1.0},
    "reference": {"torque": ["cos(t)"]},
    "controllers": [{"kind": "gt", "label": "a"}, {"kind": "gt", "label": "b"}],
    "initial": {"pose": {"kind": "angle", "angle": [0.5, 2.5]}, "velocity": "normal"},
    "control": {"period": 0.1},
    "time": {"duration": 3, "samples": 31},
    "store": {"trajectories": "none"},
    "solver": {"engine": "native", "error_estimate": False, "cross_check": 0},
}
"""A wheel that turns to a moving reference; cheap, so that there can be hundreds of experiments."""

EFFORT = 8.0


TUNE = {"objective": "mean_pose_error", "equal": {"effort": EFFORT}, "samples": 5, "budget": 60}


def ranges(scale: float, top: float | None) -> dict[str, Any]:
    """Return the ranges of a law; `top` is the end of that of kp."""
    kp = [0.2 * scale, 20.0 * scale if top is None else top]
    return {"gains.kp": {"log": kp}, "gains.kd": {"log": [0.1 * scale, 10.0 * scale]}}


def experiment(seed: int, scales: tuple[float, float], top: float | None) -> dict[str, Any]:
    """Tune two laws and return the verdict on the second against the first."""
    over = {
        f"controllers[{index}].{key}": ends
        for index, scale in enumerate(scales)
        for key, ends in ranges(scale, top if index else None).items()
    }
    confirm = {"runs": 60, "seed": 10**6 + seed}
    data = PLANT | {
        "ensemble": {"runs": 16, "seed": 10 * seed + 1},
        "tune": TUNE | {"over": over, "confirm": confirm},
    }
    from eqt_cli.extensions.search import ratios
    from eqt_cli.results.result import open_result

    with tempfile.TemporaryDirectory() as folder:
        done = eqt_cli.tune(data, Path(folder) / "t", workers=1)
        with open_result(Path(folder) / "t") as result:
            (pair,) = ratios.ratios(result, done.record, ["mean_pose_error"])
    return {
        "seed": seed,
        "verdict": pair.verdict,
        "ratio": pair.value,
        "low": pair.low,
        "high": pair.high,
        "points": [one["points"] for law in done.record["laws"] for one in law["searches"]],
    }


def main() -> None:
    """Print the records of one of the three experiments."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("what", choices=("misses", "same", "ratio"))
    parser.add_argument("--laws", default="")
    parser.add_argument("--tasks", default="")
    parser.add_argument("--samples", type=int, default=5)
    parser.add_argument("--dense", action="store_true", help="misses: by a grid, too")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--top", type=float, help="end of the range of kp of the second law")
    parser.add_argument("--feedforward", type=float, default=1.0, help="of the second law")
    parser.add_argument("--plain", action="store_true", help="a plain program flies the runs")
    chosen = parser.parse_args()
    laws, tasks = ([x for x in text.split(",") if x] for text in (chosen.laws, chosen.tasks))
    with threadpool_limits(1):
        if chosen.what == "misses":
            records = misses(laws, tasks, chosen.samples, chosen.dense)
        else:
            top = chosen.top if chosen.what == "ratio" else None
            scales = (1.07, 1.13) if chosen.what == "same" else (1.0, 1.0)
            seeds = range(chosen.first, chosen.first + chosen.count)
            records = (experiment(seed, scales, top) for seed in seeds)
            if chosen.plain:
                ends = (None, top)
                of = [ranges(*each) for each in zip(scales, ends, strict=True)]
                a, b = (wheel.search(PLANT, over, TUNE) for over in of)
                factor = chosen.feedforward
                records = (wheel.experiment(seed, (a, b), factor) for seed in seeds)
        for record in records:
            print(json.dumps(record), flush=True)
    print(f"CPU s: {sum(os.times()[:4]):.0f}", file=sys.stderr)


if __name__ == "__main__":
    main()
