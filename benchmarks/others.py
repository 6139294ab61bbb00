"""Jobs that other programs do, too, as processes from start to end: one run, and many.

All clocks start before the imports, and every process finds the compiled code of the ones before
it. The programs run in turn, and the least CPU time of each counts.

Crazyflow and Basilisk require other versions than the rest, so they are looked for by the Python
of an environment of their own: `make bench ARGS='--others PYTHON'`.
"""

from __future__ import annotations

import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.process import ROOT, spent

SIZES = (1, 1_000, 10_000)
"""Runs of a job."""

SETTINGS = ("solver.engine=native", "store.trajectories=none")

OWN = "eqt's own"
"""In arguments: a file for the seconds that a process spends for eqt, which do not count."""

MODULES = {"heyoka": "heyoka", "diffrax": "diffrax", "Crazyflow": "crazyflow", "Basilisk": "bsk"}
"""The distribution that a program is in."""


@dataclass(frozen=True)
class Job:
    """One job, by eqt and by others.

    Attributes
    ----------
    name
        As in the table.
    config, settings
        What eqt runs.
    others
        Arguments of a Python that does the same, by program; ``{}`` is the number of runs, `OWN`
        a file.
    note
        What differs.
    sizes
        Numbers of runs.
    """

    name: str
    config: str
    settings: tuple[str, ...]
    others: dict[str, list[str]]
    note: str = ""
    sizes: tuple[int, ...] = SIZES


def _jobs() -> list[Job]:
    from benchmarks.sampled import _undisturbed

    own = {name: ["-m", "benchmarks.others", name, "{}", OWN] for name in ("heyoka", "diffrax")}
    beside = {
        name: [str(ROOT / "benchmarks" / "beside.py"), name.lower(), "{}"]
        for name in ("Crazyflow", "Basilisk")
    }
    return [
        Job("the paper's law, 20 s", "paper", ("controllers=[eqt]",), own),
        Job(
            "an attitude law, 20 s",
            "paper",
            ("controllers=[eqt]",),
            {"Basilisk": beside["Basilisk"]},
            "its own law, steps of 50 ms by Runge-Kutta 4",
            SIZES[:2],  # it computes one run after the other
        ),
        Job(
            "a Crazyflie, 6 s at 500 Hz",
            "crazyflie",
            tuple(_undisturbed()),
            {"Crazyflow": beside["Crazyflow"]},
            "its own law, in single precision, by explicit Euler, without error estimates",
        ),
    ]


@dataclass(frozen=True)
class Beside:
    """One job of so many runs: the least CPU times of processes from start to end, s.

    Attributes
    ----------
    eqt
        With checks, error estimates, metrics and file.
    other
        Of `program`.
    first
        Those of the first processes, eqt's and the other's, when nothing was compiled; None where
        a smaller job has filled the caches.
    """

    job: str
    runs: int
    eqt: float
    program: str
    other: float
    first: tuple[float, float] | None
    note: str


def beside(
    python: str | None, repeats: int, names: Sequence[str] = (), sizes: Sequence[int] = ()
) -> Iterator[Beside]:
    """Every job of every size, or the chosen ones, by every program that is installed."""
    for job in (job for job in _jobs() if not names or job.name in names):
        where = {name: found for name in job.others if (found := _python(name, python))}
        with TemporaryDirectory() as folder:
            for runs in sizes or job.sizes if where else ():
                yield from _in_turn(job, runs, where, repeats, Path(folder))


def _in_turn(
    job: Job, runs: int, where: dict[str, str], repeats: int, folder: Path
) -> Iterator[Beside]:
    """One job by eqt and others in turn, after a pass that fills the caches."""
    is_first = not (folder / "cache").exists()
    took: dict[str, list[float]] = {name: [] for name in ("eqt", *where)}
    for number in range(repeats + 1):
        for name, times in took.items():
            if name == "eqt":
                times.append(_eqt(job, runs, folder))
            elif number or is_first:  # its compiled code is that of any number of runs
                times.append(_other(where[name], job.others[name], runs, folder))
    least = {name: min(times[-repeats:]) for name, times in took.items()}
    for name in where:
        first = (took["eqt"][0], took[name][0]) if is_first else None
        yield Beside(job.name, runs, least["eqt"], name, least[name], first, job.note)


def _python(program: str, python: str | None) -> str | None:
    """The Python that has a program; None if none has."""
    code = f"from importlib.metadata import version; version({MODULES[program]!r})"
    for where in (sys.executable, python):
        if where and not subprocess.run([where, "-c", code], capture_output=True).returncode:
            return where
    return None


def _eqt(job: Job, runs: int, folder: Path) -> float:
    settings = [f"--set={text}" for text in (*SETTINGS, *job.settings, f"ensemble.runs={runs}")]
    command = ["-m", "eqt_cli", "run", f"configs/{job.config}.yaml", *settings, "--quiet"]
    command += ["--out", str(folder / "out"), "--force"]
    return spent(command, ROOT, {"XDG_CACHE_HOME": str(folder / "cache")}).cpu


def _other(python: str, arguments: Sequence[str], runs: int, folder: Path) -> float:
    own = folder / "own"
    words = [str(own) if word == OWN else word.replace("{}", str(runs)) for word in arguments]
    total = spent(words, ROOT, {"XDG_CACHE_HOME": str(folder / "cache")}, python).cpu
    return total - float(own.read_text(encoding="utf-8")) if OWN in arguments else total


def _by(program: str, runs: int, own: Path) -> None:
    """Integrate the paper's first law by a contender; write the CPU time of eqt's part, s.

    That is what reads the configuration. What a contender imports itself comes before.
    """
    import numpy  # noqa: F401

    sys.modules["sympy"] = None  # type: ignore[assignment] # heyoka imports it where torch has it
    import_module(program)
    began = time.process_time()
    from benchmarks.cases import load
    from benchmarks.contenders import contenders

    case = load("paper", runs, ["controllers=[eqt]"])
    chosen = next(each for each in contenders() if program in each.name)
    own.write_text(str(time.process_time() - began), encoding="utf-8")
    chosen.prepare(case, chosen.headline)()


def as_table(found: list[Beside]) -> tuple[str, list[str], list[list[str]]]:
    """A sentence that says for whom eqt is slower, the head, and the rows."""
    slower = [
        f"{each.runs:,} × {each.job} ({each.program} takes {each.other / each.eqt:.2g} of its time)"
        for each in found
        if each.other < each.eqt
    ]
    said = f"eqt is slower for: {'; '.join(slower)}." if slower else "eqt is slower for none."
    rows = [
        [
            each.job,
            f"{each.runs:,}",
            each.program,
            f"{each.other / each.eqt:.2g}",
            f"{each.first[1] / each.first[0]:.2g}" if each.first else "",
            each.note or "the same equations; no metrics, no file",
        ]
        for each in found
    ]
    return said, ["job", "runs", "by", "other / eqt", "first process", "what differs"], rows


if __name__ == "__main__":
    _by(sys.argv[1], int(sys.argv[2]), Path(sys.argv[3]))
