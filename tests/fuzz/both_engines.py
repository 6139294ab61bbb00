"""Mutants of the shipped configurations that eqt accepts, by solve_ivp and by native.

    python both_engines.py FIRST LAST

tries the mutants of these seeds. It prints one JSON line for each difference that the error
estimates do not explain, and a summary. Each seed is always the same mutant.
"""

from __future__ import annotations

import json
import os
import random
import signal
import sys
import traceback
import warnings
from collections import Counter
from contextlib import suppress
from copy import deepcopy
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from mutated_configurations import _places, mistaken

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError
from eqt_cli.config.source import ConfigSource
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Status
from eqt_cli.runs.compute_part import NUMBERS, ROWS, compute_part, shared_reference
from eqt_cli.runs.executors import TaskContext

CONFIGS = Path(__file__).parents[2] / "configs"
SHORT = {
    "ensemble": {"runs": 2, "seed": 1},
    "time": {"duration": 2.0, "samples": 5},
    "store": {"trajectories": "all"},
}
SOLVER = {"rtol": 1e-8, "atol": 1e-11, "cross_check": 0, "error_estimate": True, "max_steps": 20000}
LEFT_OUT = {"name", "solver", "sweep", "tune", *SHORT}

FACTOR = 10.0
"""Times the sum of both error estimates: an estimate is the difference to a ten times smaller
tolerance, at samples, so that it is right to a small factor only."""

FLOOR = 1e-8
"""Of the size of a motion: differences of the order of rtol, the tolerance of one step."""

KNOWN = 1e-3
"""Largest estimate, relative to the motion, that says anything: beyond, a run has no digits."""

SECONDS = 10.0
"""Of the processor, for a mutant; one that takes longer is counted and left out."""


class TooLong(BaseException):
    """A mutant that is not compared."""


def accepted(seed: int) -> tuple[dict[str, Any], str]:
    """The first mutant of a seed that both engines accept, and the file that it was."""
    rng = random.Random(seed)
    while True:
        data, file = _mutant(rng)
        with suppress(EqtError):
            for engine in ("solve_ivp", "native"):
                _study(data, engine)
            return data, file


def _mutant(rng: random.Random) -> tuple[dict[str, Any], str]:
    file = rng.choice(sorted(CONFIGS.glob("*.yaml")))
    given = yaml.safe_load(file.read_text(encoding="utf-8"))
    data = {key: value for key, value in given.items() if key not in LEFT_OUT}
    data["controllers"] = [rng.choice(data["controllers"])]
    for _ in range(rng.randint(1, 2)):
        data = mistaken(data, rng) if rng.random() < 0.3 else _varied(data, rng)
    return data | deepcopy(SHORT), file.name


def _varied(data: Any, rng: random.Random) -> Any:
    """Another number at one or more places, by a factor that an engineer might try."""
    for path in _places(data):
        parent = data
        for step in path[:-1]:
            parent = parent[step]
        value = parent[path[-1]]
        if isinstance(value, int | float) and not isinstance(value, bool) and rng.random() < 0.3:
            with suppress(OverflowError):
                parent[path[-1]] = value * 10 ** rng.uniform(-1.5, 1.5)
    return data


def computed(data: dict[str, Any], engine: str) -> list[dict[str, Any]]:
    """What an engine computes, a table for each part."""
    found = _study(data, engine)
    shared = None if found.desired_varies else shared_reference(found)
    context, plan = TaskContext(lambda runs: None, 1), found.plan
    parts = [compute_part(found, plan.part(k), shared, context) for k in range(len(plan))]
    return [
        {name: each.data for name, each in part.variables.items()}
        | dict(zip(part.attributes[ROWS].split(), part.variables[NUMBERS].data, strict=True))
        for part in parts
    ]


def _study(data: dict[str, Any], engine: str) -> Study:
    text = yaml_source.dump(data | {"solver": SOLVER | {"engine": engine}})
    source = yaml_source.load(text, "mutant.yaml")
    return study(ConfigSource(source, source.data, CONFIGS))


def compared(one: dict[str, Any], other: dict[str, Any]) -> tuple[str, str | None]:
    """How the runs of two engines compare: a kind, and what is wrong."""
    if (one["status"] != other["status"]).any():
        said = [[Status(k).name for k in each["status"].ravel()] for each in (one, other)]
        estimate = _estimate(one, other)
        kind = "limit reached by one" if not (estimate < KNOWN).all() else ""
        return (kind, None) if kind else ("status", f"status {said[0]} and {said[1]}")
    good = one["status"] == Status.OK
    kind = "compared" if good.any() else "failed by both"
    for pose in ("pose", "velocity"):
        first, second = (each[pose][good] for each in (one, other))
        axes = tuple(range(1, first.ndim))
        size = 1.0 + np.abs(first).max(axis=axes, initial=0.0)
        apart = np.abs(first - second).max(axis=axes, initial=0.0)
        estimate = _estimate(one, other)[good]
        unknown = ~(estimate < KNOWN * size)
        if unknown.any():
            kind = "no digits"
        wrong = ~(apart <= FACTOR * estimate + FLOOR * size) & ~unknown
        if wrong.any():
            k = int(np.argmax(np.where(wrong, apart, -1.0)))
            return "differs", f"{pose}: {apart[k]:.2g} apart, estimated {estimate[k]:.2g}"
    for name in one:
        if one[name].dtype.kind == "f" and name not in (NUMBERS, "error_estimate"):
            missing = [np.isnan(each[name]) for each in (one, other)]
            differ = missing[0] != missing[1]
            if differ[good].any() if len(differ) == len(good) else differ.any():
                return "missing", f"{name}: is a number by one engine only"
    return kind, None


def _estimate(one: dict[str, Any], other: dict[str, Any]) -> Any:
    return one["error_estimate"] + other["error_estimate"]


def _stop(*_: object) -> None:
    raise TooLong


def tried(seed: int) -> tuple[str, str | None]:
    """What becomes of a mutant."""
    signal.setitimer(signal.ITIMER_PROF, SECONDS)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            data, _ = accepted(seed)
            first, second = (computed(data, engine) for engine in ("solve_ivp", "native"))
        found = [compared(*pair) for pair in zip(first, second, strict=True)]
        return next((each for each in found if each[1]), found[0])
    except TooLong:
        return "too long", None
    except Exception:
        return "error", traceback.format_exc(limit=-4)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)


if __name__ == "__main__":
    signal.signal(signal.SIGPROF, _stop)
    kinds: Counter[str] = Counter()
    for seed in range(*map(int, sys.argv[1:3])):
        kind, wrong = tried(seed)
        kinds[kind] += 1
        if wrong:
            line = {"seed": seed, "kind": kind, "wrong": wrong}
            print(json.dumps(line), flush=True)
    print(json.dumps({"seconds": round(sum(os.times()[:4])), **kinds}))
