"""Whole commands, as a user runs them: by this tree and by an earlier commit in turn."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.process import ROOT, Spent, spent

NOW, BEFORE = "now", "before"

PAPER = 800
"""Runs of configs/paper.yaml."""

FLIGHTS = 10
"""Runs of each law of configs/se3_bluerov2_thrusters.yaml, of 10 s."""

FLOOR = "import numpy, h5py, yaml"
"""What nearly every command needs; the CPU time of commands is told as a multiple of this."""

READERS = ("show", "compare", "plot", "report")
"""Commands that read the result of the last run."""

MANY = (100_000,)
"""Runs of the commands that keep metrics only."""


@dataclass(frozen=True)
class Command:
    """One command, by one tree or by two.

    Attributes
    ----------
    name
        As a user would say it.
    spent
        By tree, `NOW` or `BEFORE`: the least time and the largest memory of several, after one that
        fills the caches.
    plain
        Wall time of the plain loop for the same runs, s; None of what integrates none of them.
    floor
        Least CPU time of `FLOOR`, measured in turn with the command, s.
    """

    name: str
    spent: dict[str, Spent]
    plain: float | None = None
    floor: float = float("nan")


@contextmanager
def earlier(commit: str) -> Iterator[Path]:
    """The tree of a commit, checked out as long as the context lasts.

    Raises
    ------
    LookupError
        If there is no git or no such commit, with the reason.
    """

    def git(*arguments: str) -> None:
        subprocess.run(["git", "-C", ROOT, *arguments], check=True, capture_output=True, text=True)

    with TemporaryDirectory() as folder:
        tree = Path(folder, "tree")
        try:
            git("worktree", "add", "--detach", str(tree), commit)
        except FileNotFoundError as error:
            raise LookupError("git is not installed") from error
        except subprocess.CalledProcessError as error:
            raise LookupError(error.stderr.strip().splitlines()[-1]) from error
        try:
            yield tree
        finally:
            git("worktree", "remove", "--force", str(tree))


def commands(
    before: Path | None, many: Sequence[int], chosen: Sequence[str], repeats: int
) -> Iterator[Command]:
    """Every command, or the chosen ones, by this tree and, where it is given, by the one before."""
    trees = {NOW: ROOT} | ({BEFORE: before} if before else {})
    plain = None if chosen else _plain_per_run(repeats)
    with TemporaryDirectory() as folder:
        for name, arguments, runs in _plan(many):
            if chosen and name not in chosen:
                continue
            # Many runs are run once; by then the paper's 800 have filled the caches.
            passes = 1 if runs > PAPER else repeats + 1
            found, floor = _in_turn(arguments, trees, Path(folder), passes)
            yield Command(name, found, plain * runs if plain and runs else None, floor)


def _plan(many: Sequence[int]) -> Iterator[tuple[str, list[str], int]]:
    """Names, arguments, and how many of the paper's runs they integrate."""
    paper = ["run", "configs/paper.yaml", "--engine"]
    yield "run se3 by native", ["run", "configs/se3.yaml", "--engine", "native"], 0
    few = ["--set", f"ensemble.runs={FLIGHTS}", "--set", "time.duration=10"]
    for engine in ("solve_ivp", "native"):
        thrusters = ["run", "configs/se3_bluerov2_thrusters.yaml", "--engine", engine, *few]
        yield f"run {FLIGHTS} runs of each law with eight thrusters by {engine}", thrusters, 0
    yield "run paper by solve_ivp", [*paper, "solve_ivp"], PAPER
    unchecked = [*paper, "native", "--set", "solver.cross_check=0"]
    yield "run paper by native without a cross-check", unchecked, PAPER
    yield "run paper by native", [*paper, "native"], PAPER
    for command in READERS:
        yield f"{command} paper", [command], 0
    for command in ("config check", "margins", "verify"):
        yield f"{command} paper", [*command.split(), "configs/paper.yaml"], 0
    yield "--help", ["--help"], 0
    for runs in many:
        settings = ["--set", f"ensemble.runs={runs // 4}", "--set", "store.trajectories=none"]
        name = f"run paper by native, {runs:,} runs, metrics only"
        yield name, [*paper, "native", *settings], runs


def _in_turn(
    arguments: Sequence[str], trees: dict[str, Path], folder: Path, passes: int
) -> tuple[dict[str, Spent], float]:
    """What each tree takes, and the floor; a tree that does not know the command is left out."""
    found: dict[str, list[Spent]] = {name: [] for name in trees}
    floors = []
    for _ in range(passes):
        floors.append(spent(["-c", FLOOR]).cpu)
        for name in list(found):
            try:
                found[name].append(_once(arguments, trees[name], folder / name))
            except RuntimeError:
                if name == NOW:
                    raise
                del found[name]
    return {name: _best(every[1:] or every) for name, every in found.items()}, min(floors)


def _once(arguments: Sequence[str], tree: Path, folder: Path) -> Spent:
    """With a cache of compiled code, and a result, that are the tree's own."""
    result, where = folder / "result", []
    if arguments[0] == "run":
        shutil.rmtree(result, ignore_errors=True)
        where = ["--quiet", "--out", str(result)]
    elif arguments[0] in READERS:
        where = [str(result)]
    command, cache = ["-m", "eqt_cli", *arguments, *where], str(folder / "cache")
    return spent(command, tree, {"XDG_CACHE_HOME": cache})


def _best(every: list[Spent]) -> Spent:
    return Spent(
        min(each.wall for each in every),
        min(each.cpu for each in every),
        max(each.peak_memory for each in every),
    )


def _plain_per_run(repeats: int) -> float:
    """Wall time of the plain loop for one of the paper's runs, s."""
    from benchmarks.cases import load
    from benchmarks.contenders.plain_loop import CONTENDERS, RUNS_PER_CONTROLLER
    from benchmarks.measure import fastest

    case, (plain, *_) = load("paper"), CONTENDERS
    _, wall, _, _ = fastest(plain.prepare(case, plain.headline), repeats)
    return wall / (RUNS_PER_CONTROLLER * len(case.problems))
