"""What users wait for: whole commands, with what their compiled code takes alone."""

from __future__ import annotations

import shutil
from collections.abc import Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import yaml

from benchmarks.process import ROOT, Spent, spent
from benchmarks.whole_command import BEFORE, FLOOR, NOW, Command

PAPER = "configs/paper.yaml"
NATIVE = ["--engine", "native"]
FLIES = "configs/se3_bluerov2_flies.yaml"


def _runs(count: int) -> list[str]:
    return ["--set", f"ensemble.runs={count}"]


METRICS = ["--set", "store.trajectories=none"]

JOBS = {
    "--version": ["--version"],
    "config check paper": ["config", "check", PAPER],
    "compare of 800 runs": ["compare"],
    "plot of 800 runs": ["plot"],
    "run paper, 1 run, the first": ["run", PAPER, *NATIVE, *_runs(1)],
    "run paper, 1 run": ["run", PAPER, *NATIVE, *_runs(1)],
    "run crazyflie, 1 run, the first": ["run", "configs/crazyflie.yaml", *NATIVE, *_runs(1)],
    "run paper, 20,000 runs, metrics only": ["run", PAPER, *NATIVE, *_runs(5000), *METRICS],
    "the same, law sampled": [
        *("run", PAPER, *NATIVE, *_runs(5000), *METRICS),
        *("--set", "control.period=0.1"),
    ],
    "run paper (by solve_ivp)": ["run", PAPER],
    "run crazyflie, 200 runs": ["run", "configs/crazyflie.yaml", *NATIVE, *_runs(200)],
    "run cubesat, 200 runs": ["run", "configs/cubesat.yaml", *NATIVE, *_runs(200)],
    "run flies, 200 runs": ["run", FLIES, *NATIVE, *_runs(200)],
    "run flies as it is": ["run", FLIES],
    "run cubesat as it is": ["run", "configs/cubesat.yaml"],
    "tune flies, budget 4": ["tune", "configs/tune_flies.yaml", *NATIVE, "--set", "tune.budget=4"],
    "worst of satellite_breaks, 100,000 runs": [
        *("worst", "configs/satellite_breaks.yaml", *NATIVE),
        *("--set", "worst.budget=1"),
    ],
    "sweep of 10,000 points": ["sweep", "SWEEP", *NATIVE],
    "report of 20,000 runs": ["report"],
}
"""Arguments by name. `SWEEP` is written for the job; `READ` has what some commands read. For the
first run, nothing is compiled yet."""

PAPERS = ["run", PAPER, *NATIVE]
READ = {"compare": PAPERS, "plot": PAPERS, "report": [*PAPERS, *_runs(5000)]}
COMPUTING = ("run", "sweep", "tune", "worst")
STARTING = {job for job in JOBS if "1 run" in job or "solve_ivp" in job or "as it is" in job}
"""Jobs that integrate little, or in Python: their floor is that of other commands."""

ALSO = {
    "run paper, 1 run, the first": ("the paper's law, 20 s", 1),
    "run paper, 1 run": ("the paper's law, 20 s", 1),
    "run paper, 20,000 runs, metrics only": ("the paper's law, 20 s", 10_000),
    "run crazyflie, 1 run, the first": ("a Crazyflie, 6 s at 500 Hz", 1),
}
"""Job and runs by which `others` compares nearly the same; no program does the rest."""


def waits(before: Path | None, chosen: Sequence[str], rounds: int) -> Iterator[Command]:
    """Every job, or the chosen ones, by this tree and, where it is given, by the one before.

    Each tree runs it so often, in turn, after a pass that fills the caches.

    The floor is what compiled integration takes alone, in this tree and by one thread; of what
    integrates little, what `FLOOR` takes.
    """
    trees = {NOW: ROOT} | ({BEFORE: before} if before else {})
    with TemporaryDirectory() as name:
        folder = Path(name)
        swept = _swept(folder / "sweep.yaml")
        for job, arguments in JOBS.items():
            if chosen and job not in chosen:
                continue
            given = [str(swept) if word == "SWEEP" else word for word in arguments]
            found: dict[str, list[Spent]] = {tree: [] for tree in trees}
            for _ in range(rounds + 1):
                for tree, where in trees.items():
                    if job.endswith("the first"):
                        shutil.rmtree(folder / tree / "cache", ignore_errors=True)
                    found[tree].append(_once(given, where, folder / tree))
            if arguments[0] in COMPUTING and job not in STARTING:
                floor = _alone(given, folder)
            else:
                floor = min(spent(["-c", FLOOR]).cpu for _ in range(rounds))
            best = {
                tree: min(each[1:], key=lambda spent: spent.cpu) for tree, each in found.items()
            }
            yield Command(job, best, None, floor)


def _once(arguments: Sequence[str], tree: Path, folder: Path) -> Spent:
    """With a cache of compiled code, and a result, that are the tree's own."""
    result, environment = folder / "result", {"XDG_CACHE_HOME": str(folder / "cache")}
    if ran := READ.get(arguments[0]):
        result = folder / f"read-{arguments[0]}"
        if not result.exists():
            spent(["-m", "eqt_cli", *ran, "--quiet", "--out", str(result)], tree, environment)
        return spent(["-m", "eqt_cli", *arguments, str(result)], tree, environment)
    if arguments[0] not in COMPUTING:
        return spent(["-m", "eqt_cli", *arguments], tree, environment)
    shutil.rmtree(result, ignore_errors=True)
    out = ["--quiet", "--out", str(result)]
    return spent(["-m", "eqt_cli", *arguments, *out], tree, environment)


def _alone(arguments: Sequence[str], folder: Path) -> float:
    out = ["--quiet", "--executor", "serial", "--force", "--out", str(folder / "alone")]
    command = ["-m", "benchmarks.alone", str(folder / "seconds"), *arguments, *out]
    spent(command, ROOT, {"XDG_CACHE_HOME": str(folder / NOW / "cache")})
    return float((folder / "seconds").read_text(encoding="utf-8"))


def _swept(path: Path) -> Path:
    """One run of one law at 10,000 points."""
    config = yaml.safe_load((ROOT / PAPER).read_text(encoding="utf-8"))
    gains = {f"gains.{gain}": [0.5 + 0.01 * k for k in range(100)] for gain in ("kp", "kd")}
    config |= {"name": "many_points", "controllers": ["eqt"], "ensemble": {"runs": 1, "seed": 1}}
    config |= {"store": {"trajectories": "none"}, "sweep": [{"grid": gains}]}
    path.write_text(yaml.safe_dump(config), encoding="utf-8")
    return path
