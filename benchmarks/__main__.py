"""`python -m benchmarks`: eqt against other ways to integrate, and against an earlier commit.

Writes benchmarks/results: bench.md, bench.json, work_precision, runs_per_second and growth as PNG
and SVG; after each part, so that an interruption loses the rest only.
"""

from __future__ import annotations

import argparse
import os
import sys
import tempfile
from collections.abc import Iterator
from contextlib import ExitStack
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from benchmarks.table import Results
    from benchmarks.whole_command import Command

RESULTS = Path(__file__).with_name("results")

PARTS = ("cases", "sampled", "crazyflie", "rotorpy", "estimates")
PARTS += ("commands", "waits", "others", "profile", "growth", "machinery")


def main() -> None:
    """Measure what is asked for, all of it by default, and write the results."""
    options = _options()
    # The first compilation is to be measured, not what an earlier run has left on the disk.
    with tempfile.TemporaryDirectory() as cache:
        os.environ["XDG_CACHE_HOME"] = cache
        for results in _stages(options):
            _write(results, options.out)
    print((options.out / "bench.md").read_text(encoding="utf-8"))


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m benchmarks", description=__doc__)
    parser.add_argument("--case", action="append", help="paper, se3, reviewers; default: all")
    parser.add_argument("--runs", type=int, help="runs per controller; default: as configured")
    parser.add_argument("--repeats", type=int, default=5, help="of each fast measurement")
    parser.add_argument("--only", help="contenders whose names contain this")
    parser.add_argument("--headlines", action="store_true", help="one tolerance per contender")
    parser.add_argument("--part", action="append", choices=PARTS, help="repeatable; default: all")
    parser.add_argument("--before", metavar="COMMIT", help="measure its commands in turn with ours")
    parser.add_argument(
        "--command", action="append", help="its name in the table, repeatable; default: all"
    )
    parser.add_argument(
        "--many",
        type=int,
        action="append",
        help="runs of a command that keeps metrics only, repeatable; default: 100000",
    )
    parser.add_argument(
        "--size", type=int, action="append", help="runs of a job of others, repeatable"
    )
    parser.add_argument("--others", metavar="PYTHON", help="that has Crazyflow and Basilisk")
    parser.add_argument("--out", type=Path, default=RESULTS, help="folder of the results")
    return parser.parse_args()


def _stages(options: argparse.Namespace) -> Iterator[Results]:
    """The results as they grow."""
    from benchmarks.contenders import contenders
    from benchmarks.machine import machine
    from benchmarks.measure import load
    from benchmarks.table import Results

    chosen = [each for each in contenders() if (options.only or "") in each.name]
    results = Results(
        machine(),
        datetime.now(UTC).strftime("%Y-%m-%d"),
        {each.name: each.headline for each in chosen},
        {each.name: reason for each in chosen if (reason := each.missing())},
    )
    for name, reason in results.skipped.items():
        _say(f"skipped {name}: {reason}")
    parts = {
        "cases": _cases,
        "sampled": _sample,
        "crazyflie": _fly,
        "rotorpy": _beside,
        "estimates": _estimate,
        "commands": _command,
        "waits": _wait,
        "others": _other,
        "profile": _profile,
        "growth": _grow,
        "machinery": _overhead,
    }
    results.load.append(load())
    for part in options.part or PARTS:
        for _ in parts[part](options, results):
            yield results
    results.load.append(load())
    yield results


def _cases(options: argparse.Namespace, results: Results) -> Iterator[None]:
    from benchmarks import laws

    for name in options.case or ["paper", "se3", laws.CASE]:
        if name == laws.CASE:
            results.laws = laws.laws(options.runs, options.repeats)
            _say(
                f"{name}: {laws.ratio(results.laws):.2f} times the paper's laws, per run and state"
            )
        else:
            _compare(name, options, results)
        yield


def _compare(name: str, options: argparse.Namespace, results: Results) -> None:
    """Every contender on one case."""
    from benchmarks import cases
    from benchmarks.contenders import contenders
    from benchmarks.measure import measure

    case = cases.load(name, options.runs)
    reference = cases.exact(case)
    chosen = [each for each in contenders() if each.name in results.headline]
    chosen = [each for each in chosen if each.name not in results.skipped and each.plays(case)]
    groups = [[(each, each.headline) for each in chosen]]
    if not options.headlines:  # by themselves, as all their solutions are large
        others = [(each, tolerance) for each in chosen for tolerance in each.tolerances]
        groups += [[pair] for pair in others if pair not in groups[0]]
    for group in groups:
        for found in measure(group, case, reference, options.repeats):
            results.measurements.append(found)
            _say(
                f"{name}  {found.contender:26} {found.tolerance:.0e}  {found.wall:9.3f} s  "
                f"error {found.largest_error:.1e}"
            )


def _sample(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """Laws that are evaluated at instants."""
    from benchmarks.sampled import missing, sampled

    results.skipped |= missing()
    for found in sampled():
        results.sampled.append(found)
        _say(f"every {found.period:g} s  {found.way:22} {found.cpu:9.3f} s")
    yield


def _fly(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """A quadrotor with two rates."""
    from benchmarks.sampled import crazyflies

    for found in crazyflies():
        results.crazyflies.append(found)
        _say(f"Crazyflie  {found.way:22} {found.cpu:9.3f} s")
    yield


def _beside(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """A quadrotor by RotorPy, too."""
    from benchmarks.quadrotor import flights, missing

    results.skipped |= missing()
    for found in flights(options.repeats):
        results.flights.append(found)
        _say(f"{found.runs} runs of {found.duration:g} s  {found.way:38} {found.wall:9.3f} s")
        yield


def _estimate(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """Laws that read an estimate."""
    from benchmarks.estimates import estimator_times

    for found in estimator_times():
        results.estimates.append(found)
        _say(f"{found.case}  {found.engine}  {found.kind:14} {1e3 * found.cpu:8.3f} ms a run")
    yield


def _command(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """Whole commands, alone or in turn with those of an earlier commit."""
    from benchmarks.whole_command import MANY, commands

    with ExitStack() as stack:
        before = _before(options, results, stack)
        for found in commands(before, options.many or MANY, options.command or (), options.repeats):
            results.commands.append(found)
            _say_command(found)
            yield


def _wait(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """What users wait for, alone or in turn with an earlier commit."""
    from benchmarks.waits import waits

    with ExitStack() as stack:
        before = _before(options, results, stack)
        for found in waits(before, options.command or (), options.repeats):
            results.waits.append(found)
            _say_command(found)
            yield


def _other(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """What other programs do, too."""
    from benchmarks.others import beside

    for found in beside(options.others, options.repeats, options.command or (), options.size or ()):
        results.others.append(found)
        took = f"eqt {found.eqt:.2f} s, {found.program} {found.other:.2f} s"
        _say(f"{found.runs} × {found.job}: {took}")
        yield


def _before(options: argparse.Namespace, results: Results, stack: ExitStack) -> Path | None:
    """The tree of the earlier commit, if one is asked for and there is one."""
    from benchmarks.whole_command import earlier

    if options.before:
        try:
            return stack.enter_context(earlier(options.before))
        except LookupError as error:
            results.skipped[f"the commit {options.before}"] = str(error)
            _say(f"skipped {options.before}: {error}")
    return None


def _say_command(found: Command) -> None:
    seconds = ", ".join(f"{tree} {each.cpu:.2f} s" for tree, each in found.spent.items())
    _say(f"eqt {found.name}: CPU {seconds}, floor {found.floor:.2f} s")


def _profile(options: argparse.Namespace, results: Results) -> Iterator[None]:
    from benchmarks.profile import profile

    for engine in ("native", "solve_ivp"):
        results.profiles.append(profile(engine))
        _say(f"profile of {engine}: {sum(results.profiles[-1].seconds.values()):.2f} s")
    yield


def _grow(options: argparse.Namespace, results: Results) -> Iterator[None]:
    """More and more runs."""
    from benchmarks.growth import SIZES, growth

    for engine, sizes in SIZES.items():
        for runs in sizes:
            results.growth.append(growth(engine, runs))
            _say(f"{runs} runs by {engine}: {results.growth[-1].wall:.2f} s")
    yield


def _overhead(options: argparse.Namespace, results: Results) -> Iterator[None]:
    from benchmarks.machinery import machinery

    results.machinery = machinery()
    _say(f"machinery: {100 * results.machinery.overhead.share:.1f} %")
    yield


def _write(results: Results, folder: Path) -> None:
    from benchmarks import figure, table

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "bench.json").write_text(table.as_json(results), encoding="utf-8")
    (folder / "bench.md").write_text(table.as_markdown(results), encoding="utf-8")
    figure.write(results, folder)


def _say(text: str) -> None:
    print(text, file=sys.stderr, flush=True)


if __name__ == "__main__":
    main()
