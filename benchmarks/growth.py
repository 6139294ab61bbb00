"""How time and memory of `eqt run` grow with the number of runs, metrics only."""

from __future__ import annotations

from dataclasses import dataclass
from tempfile import TemporaryDirectory

from benchmarks.process import spent

SIZES = {
    "native": (1, 10, 100, 1_000, 10_000, 100_000, 1_000_000),
    "solve_ivp": (1, 10, 100, 1_000),  # linear by then; 1e5 runs would take some ten minutes
}


@dataclass(frozen=True)
class Growth:
    """One size.

    Attributes
    ----------
    runs
        Of one law.
    wall, cpu
        Of the command with its start, all metrics and, by compiled engines, error estimates, s.
    peak_memory
        Of its processes, bytes.
    show
        Wall time of `eqt show` on the result, the least of three, s.
    """

    engine: str
    runs: int
    wall: float
    cpu: float
    peak_memory: int
    show: float


def growth(engine: str, runs: int) -> Growth:
    """Run the paper's experiment with `runs` runs of its first law."""
    settings = ["--set", f"ensemble.runs={runs}", "--set", "store.trajectories=none"]
    settings += ["--set", "controllers=[eqt]"]
    eqt = ["-m", "eqt_cli"]
    with TemporaryDirectory() as folder:
        command = ["run", "configs/paper.yaml", "--engine", engine, *settings, "--out", folder]
        found = spent([*eqt, *command, "--quiet"])
        show = min(spent([*eqt, "show", folder]).wall for _ in range(3))
    return Growth(engine, runs, found.wall, found.cpu, found.peak_memory, show)
