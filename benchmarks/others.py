"""Jobs that other programs do, too, as processes from start to end: one run, and many.

Crazyflow and Basilisk require other versions than the rest, so they are looked for by the Python
of an environment of their own: `make bench ARGS='--others PYTHON'`.
"""

from __future__ import annotations

import json
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from benchmarks.process import ROOT, spent

SIZES = (1, 1_000, 10_000)
"""Runs of a job."""

REPEATED = 1_000
"""Jobs of more runs are done once, by caches that the others have filled."""

SETTINGS = ("solver.engine=native", "store.trajectories=none")

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
        Arguments of a Python that does the same, by program; ``{}`` is the number of runs.
    note
        What differs.
    """

    name: str
    config: str
    settings: tuple[str, ...]
    others: dict[str, list[str]]
    note: str = ""


def _jobs() -> list[Job]:
    from benchmarks.sampled import _undisturbed

    own = {name: ["-m", "benchmarks.others", name, "{}"] for name in ("heyoka", "diffrax")}
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
            "steps of 50 ms by Runge-Kutta 4",
        ),
        Job(
            "a Crazyflie, 6 s at 500 Hz",
            "crazyflie",
            tuple(_undisturbed()),
            {"Crazyflow": beside["Crazyflow"]},
            "its own law, in single precision, without error estimates",
        ),
    ]


@dataclass(frozen=True)
class Beside:
    """One job of so many runs: CPU times of processes from start to end, s.

    Attributes
    ----------
    eqt
        With warm caches, checks, error estimates, metrics and file.
    other
        Of `program`, with its compilation.
    """

    job: str
    runs: int
    eqt: float
    program: str
    other: float
    note: str


def beside(python: str | None) -> Iterator[Beside]:
    """Every job by every program that is installed."""
    for job in _jobs():
        found = {name: _python(name, python) for name in job.others}
        with TemporaryDirectory() as folder:
            for runs in SIZES if any(found.values()) else ():
                eqt, times = _eqt(job, runs, Path(folder)), 2 if runs <= REPEATED else 1
                for name, arguments in job.others.items():
                    if where := found[name]:
                        words = [word.replace("{}", str(runs)) for word in arguments]
                        other = min(_seconds(where, words) for _ in range(times))
                        yield Beside(job.name, runs, eqt, name, other, job.note)


def _python(program: str, python: str | None) -> str | None:
    """The Python that has a program; None if none has."""
    code = f"from importlib.metadata import version; version({MODULES[program]!r})"
    for where in (sys.executable, python):
        if where and not subprocess.run([where, "-c", code], capture_output=True).returncode:
            return where
    return None


def _seconds(python: str, arguments: list[str]) -> float:
    """What a script says that it took, in its last line."""
    done = subprocess.run(
        [python, *arguments], capture_output=True, text=True, cwd=ROOT, check=True
    )
    return float(done.stdout.split()[-1])


def _eqt(job: Job, runs: int, folder: Path) -> float:
    """The least of two runs, after one that compiles; of many runs, one."""
    settings = [f"--set={text}" for text in (*SETTINGS, *job.settings, f"ensemble.runs={runs}")]
    command = ["-m", "eqt_cli", "run", f"configs/{job.config}.yaml", *settings, "--quiet"]
    environment = {"XDG_CACHE_HOME": str(folder / "cache")}
    command += ["--out", str(folder / "out"), "--force"]
    times = 3 if runs <= REPEATED else 1
    return min([spent(command, ROOT, environment).cpu for _ in range(times)][-2:])


def _by(program: str, runs: int) -> float:
    """CPU time of a contender for the paper's first law, from the start of the process, s.

    That of eqt, which reads the configuration, does not count.
    """
    import time

    import numpy  # noqa: F401  # which every contender needs, too

    began = time.process_time()
    from benchmarks.cases import load
    from benchmarks.contenders import contenders

    case = load("paper", runs, ["controllers=[eqt]"])
    chosen = next(each for each in contenders() if program in each.name)
    own = time.process_time() - began
    chosen.prepare(case, chosen.headline)()
    return time.process_time() - own


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
            f"{each.eqt:.2f}",
            each.program,
            f"{each.other:.2f}",
            f"{each.eqt / each.other:.2g}",
            each.note or "the same equations; no metrics, no file",
        ]
        for each in found
    ]
    return said, ["job", "runs", "eqt, s", "by", "CPU, s", "eqt / other", "what differs"], rows


if __name__ == "__main__":
    print(json.dumps(_by(sys.argv[1], int(sys.argv[2]))))
