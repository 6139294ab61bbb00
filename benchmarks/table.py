"""The measurements as a Markdown page and as JSON."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from dataclasses import asdict, dataclass, field
from typing import Any

from benchmarks.estimates import EstimatorTime
from benchmarks.growth import Growth
from benchmarks.laws import LawTime, per_run_and_state, ratio
from benchmarks.machinery import Machinery
from benchmarks.measure import Measurement
from benchmarks.others import Beside, as_table
from benchmarks.profile import Profile
from benchmarks.quadrotor import Flight
from benchmarks.sampled import Sampled
from benchmarks.waits import ALSO
from benchmarks.whole_command import BEFORE, FLOOR, NOW, Command

ACCURATE = 2e-9
"""The largest error at which contenders are compared."""

TITLES = {"paper": "The paper's experiment, SO(3)", "se3": "configs/se3.yaml, SE(3)"}


@dataclass
class Results:
    """Everything that one `make bench` has measured.

    Attributes
    ----------
    headline
        The tolerance of each contender that stands in the tables.
    skipped
        What is not installed or not there, and why.
    load
        Load average of the machine at the start and at the end.
    """

    machine: dict[str, Any]
    started: str
    headline: dict[str, float]
    skipped: dict[str, str] = field(default_factory=dict)
    measurements: list[Measurement] = field(default_factory=list)
    laws: list[LawTime] = field(default_factory=list)
    sampled: list[Sampled] = field(default_factory=list)
    crazyflies: list[Sampled] = field(default_factory=list)
    flights: list[Flight] = field(default_factory=list)
    estimates: list[EstimatorTime] = field(default_factory=list)
    commands: list[Command] = field(default_factory=list)
    waits: list[Command] = field(default_factory=list)
    others: list[Beside] = field(default_factory=list)
    profiles: list[Profile] = field(default_factory=list)
    growth: list[Growth] = field(default_factory=list)
    machinery: Machinery | None = None
    load: list[float] = field(default_factory=list)

    def of(self, case: str) -> list[Measurement]:
        """All measurements of a case."""
        return [each for each in self.measurements if each.case == case]


def as_json(results: Results) -> str:
    """All numbers."""
    return json.dumps(asdict(results), indent=1) + "\n"


def as_markdown(results: Results) -> str:
    """The page, in the order in which one asks."""
    parts = ["# Benchmarks", _preface(results)]
    for case in dict.fromkeys(each.case for each in results.measurements):
        parts += [f"## {TITLES.get(case, case)}", _headlines(results, case)]
        parts += [f"With a largest error of at most {ACCURATE:g}:", _equal_error(results, case)]
    sections: list[tuple[str, Callable[[Any], str], Any]] = [
        ("The laws of other papers, native", _laws, results.laws),
        ("A sampled law, the paper's runs, one thread", _sampled, results.sampled),
        ("A sampled Crazyflie, one thread", _sampled, results.crazyflies),
        ("RotorPy's Crazyflie", _flights, results.flights),
        ("Estimators, one thread", _estimates, results.estimates),
        ("Whole commands", _commands, results.commands),
        ("What users wait for", lambda jobs: _waits(jobs, results.others), results.waits),
        ("Beside other programs", _others, results.others),
        ("Where the CPU time of `eqt run paper` goes", _profiles, results.profiles),
        ("Growth, metrics only, the paper's experiment", _growth, results.growth),
        ("Machinery and workers", _machinery, results.machinery),
    ]
    for title, told, found in sections:
        parts += [f"## {title}", told(found)] if found else []
    return "\n\n".join(parts) + "\n"


def _preface(results: Results) -> str:
    machine = results.machine
    packages = ", ".join(f"{name} {found}" for name, found in machine["packages"].items())
    lines = [
        f"{machine['processor']}, {machine['cores']} cores, {machine['system']}, Python "
        f"{machine['python']}, {packages}; {results.started}; load average "
        f"{' to '.join(f'{load:.1f}' for load in results.load)}.",
        "Written by `make bench`; all numbers are in bench.json.",
        "Times are wall times of the integration alone, the least of several, with compilation "
        "apart. Errors are max over the samples of max(‖ΔQ‖_F, ‖ΔV‖) for each run, against "
        "solve_ivp at its smallest tolerance, 2.2e-14.",
    ]
    lines += [f"Not measured: {name}: {reason}." for name, reason in results.skipped.items()]
    return "\n\n".join(lines)


def _headlines(results: Results, case: str) -> str:
    rows = [each for each in results.of(case) if each.tolerance == results.headline[each.contender]]
    plain = _first(rows, "plain")
    blocks = _first(rows, "blocks")
    table = _table(
        [
            "",
            "tolerance",
            "largest error",
            "median",
            "time, s",
            "runs/s",
            "× plain",
            "× blocks",
            "CPU, s",
            "compilation, s",
        ],
        (
            [
                each.contender + ("*" if each.timed_runs < each.runs else ""),
                f"{each.tolerance:.0e}",
                f"{each.largest_error:.1e}",
                f"{each.median_error:.1e}",
                f"{each.wall:.3g}",
                f"{each.runs / each.wall:,.0f}",
                _ratio(plain, each),
                _ratio(blocks, each),
                f"{each.cpu:.3g}",
                f"{each.compilation:.2g}" if each.compilation > 0.01 else "-",
            ]
            for each in rows
        ),
    )
    some = [each for each in rows if each.timed_runs < each.runs]
    notes = dict.fromkeys(
        f"\\* timed on {each.timed_runs} of {each.runs} runs and extrapolated; its errors are over "
        "those runs."
        for each in some
    )
    return "\n\n".join([table, *notes])


def _equal_error(results: Results, case: str) -> str:
    """Each contender at its cheapest measured tolerance that is accurate enough."""
    rows = results.of(case)
    best = {
        name: min(
            (each for each in rows if each.contender == name and each.largest_error <= ACCURATE),
            key=lambda each: each.wall,
            default=None,
        )
        for name in dict.fromkeys(each.contender for each in rows)
    }
    accurate = [each for each in best.values() if each]
    if not accurate:
        return "None is as accurate."
    fastest = min(accurate, key=lambda each: each.wall)
    return _table(
        ["", "tolerance", "largest error", "time, s", f"time / {fastest.contender}"],
        (
            [
                name,
                f"{each.tolerance:.0e}",
                f"{each.largest_error:.1e}",
                f"{each.wall:.3g}",
                _ratio(each, fastest),
            ]
            if each
            else [name, "none measured", "", "", ""]
            for name, each in best.items()
        ),
    )


def _laws(laws: list[LawTime]) -> str:
    """Every law, and the ratio of those of other papers to the paper's."""
    own = [each for each in laws if each.of_the_paper]
    others = [each for each in laws if not each.of_the_paper]
    runs = sum(each.runs for each in others)
    sentence = (
        f"CPU time of one thread, compiled before, all laws in turn. The {runs:,} runs of the "
        f"{len(others)} laws of other papers take {per_run_and_state(others):.2f} µs per run and "
        f"state, the {sum(each.runs for each in own):,} of the paper's {len(own)} "
        f"{per_run_and_state(own):.2f} µs: a ratio of {ratio(laws):.2f}."
    )
    rows = (
        [
            each.law,
            f"{each.states}",
            f"{each.comparisons}",
            f"{each.steps:.0f}",
            f"{each.microseconds:.2f}",
            f"{each.microseconds / per_run_and_state(own):.2f}",
        ]
        for each in laws
    )
    head = ["law", "states", "comparisons", "steps", "µs per run and state", "ratio"]
    return f"{sentence}\n\n" + _table(head, rows)


def _sampled(found: list[Sampled]) -> str:
    plain = {each.period: each for each in found if "plain" in each.way}
    return _table(
        ["period, s", "", "time, s", "CPU, s", "× plain", "timed runs", "difference"],
        (
            [
                f"{each.period:g}",
                each.way,
                f"{each.wall:.3g}",
                f"{each.cpu:.3g}",
                f"{plain[each.period].cpu / each.cpu:,.0f}",
                f"{each.timed_runs} of {each.runs}",
                f"{each.difference:.1e}",
            ]
            for each in found
            if each.period in plain
        ),
    )


def _flights(found: list[Flight]) -> str:
    """Every way to do every job, and what is timed."""
    sentence = (
        "Processes run from start to end; the other ways are calls in a Python that runs already. "
        "One thread. Times of more runs than were timed are extrapolated. Errors are those of the "
        "first runs, against solve_ivp at 1e-12."
    )
    head = ["duration, s", "runs", "", "time, s", "CPU, s", "timed runs", "error"]
    rows = (
        [
            f"{each.duration:g}",
            f"{each.runs:,}",
            each.way,
            f"{each.wall:.3g}",
            f"{each.cpu:.3g}",
            f"{each.timed_runs:,}",
            "" if each.error is None else f"{each.error:.1e}",
        ]
        for each in found
    )
    return f"{sentence}\n\n" + _table(head, rows)


def _estimates(found: list[EstimatorTime]) -> str:
    """CPU time of a run and of one of its instants."""
    head = ["configuration", "engine", "estimator", "ms per run", "µs per instant", "timed runs"]
    rows = (
        [
            each.case,
            each.engine,
            each.kind,
            f"{1e3 * each.cpu:.3g}",
            f"{each.microseconds:.3g}",
            f"{each.runs}",
        ]
        for each in found
    )
    return _table(head, rows)


def _commands(commands: list[Command]) -> str:
    """Now, before where it was measured, and the ratios."""
    head = ["", "time, s", "CPU, s", "peak memory, MB", "before: time, s", "CPU, s", "MB"]
    head += ["before / now: time", "CPU", "plain loop / now", "CPU / imports", "before"]
    sentence = (
        "`eqt`, a process from start to end with warm caches; the memory is that of all its "
        "processes. Before: the same by an earlier commit, measured in turn. The plain loop "
        f"integrates only. Imports: `{FLOOR}`, measured in turn."
    )
    return f"{sentence}\n\n" + _table(head, (_command(each) for each in commands))


def _waits(jobs: list[Command], others: list[Beside]) -> str:
    """CPU time now and before, as ratios to the floor and to the best other program."""
    head = [
        "`eqt …`",
        "CPU, s",
        "before",
        "before / now",
        "floor",
        "now / floor",
        "now / best other",
        "peak memory, MB",
    ]
    sentence = (
        "CPU seconds of whole commands, the least of several in turn. The floor is the time in "
        f"compiled integration alone, by one thread; of commands that integrate little, `{FLOOR}`."
    )
    rows = []
    for job in jobs:
        now, before = job.spent[NOW], job.spent.get(BEFORE)
        row = [job.name, f"{now.cpu:.2f}"]
        row += [f"{before.cpu:.2f}", f"{before.cpu / now.cpu:.2f}"] if before else ["-"] * 2
        row += [f"{job.floor:.2f}", f"{now.cpu / job.floor:.1f}"]
        alike = [each for each in others if (each.job, each.runs) == ALSO.get(job.name)]
        best = min(alike, key=lambda each: each.other, default=None)
        row.append(f"{best.eqt / best.other:.2g} ({best.program})" if best else "-")
        rows.append([*row, f"{now.peak_memory / 1e6:.0f}"])
    return f"{sentence}\n\n" + _table(head, rows)


def _others(found: list[Beside]) -> str:
    """For whom eqt is slower, and all jobs."""
    said, head, rows = as_table(found)
    sentence = (
        "CPU time of processes from start to end, also their imports, over eqt's; the least of "
        "several in turn, with the compiled code of earlier ones. First processes have none."
    )
    return f"{said} {sentence}\n\n" + _table(head, rows)


def _command(command: Command) -> list[str]:
    now, before = command.spent[NOW], command.spent.get(BEFORE)
    row = [command.name]
    for each in (now, before):
        row += (
            [f"{each.wall:.2f}", f"{each.cpu:.2f}", f"{each.peak_memory / 1e6:.0f}"]
            if each
            else ["-"] * 3
        )
    row += [f"{before.wall / now.wall:.2f}", f"{before.cpu / now.cpu:.2f}"] if before else ["-"] * 2
    row.append(f"{command.plain / now.wall:,.0f}" if command.plain else "-")
    row.append(f"{now.cpu / command.floor:.1f}")
    return [*row, f"{before.cpu / command.floor:.1f}" if before else "-"]


def _profiles(profiles: list[Profile]) -> str:
    """A column for each engine, the stages that take most at the top."""
    stages = dict.fromkeys(stage for each in profiles for stage in each.seconds)
    found = {stage: [each.seconds.get(stage, 0.0) for each in profiles] for stage in stages}
    rows = dict(sorted(found.items(), key=lambda row: -max(row[1])))
    rows["total"] = [sum(values) for values in zip(*found.values(), strict=True)]
    lost = dict.fromkeys(place for each in profiles for place in each.missing)
    sentence = "One process, one thread of integration, warm caches; s."
    if lost:
        sentence += f" Counted elsewhere, as their functions were not found: {', '.join(lost)}."
    return f"{sentence}\n\n" + _table(
        ["", *(each.engine for each in profiles)],
        ([stage, *(f"{value:.3f}" for value in values)] for stage, values in rows.items()),
    )


def _growth(growth: list[Growth]) -> str:
    return _table(
        ["engine", "runs", "time, s", "CPU, s", "CPU ms per run", "peak memory, MB", "eqt show, s"],
        (
            [
                each.engine,
                f"{each.runs:,}",
                f"{each.wall:.2f}",
                f"{each.cpu:.2f}",
                f"{1000 * each.cpu / each.runs:.2f}",
                f"{each.peak_memory / 1e6:.0f}",
                f"{each.show:.2f}",
            ]
            for each in growth
        ),
    )


def _machinery(machinery: Machinery) -> str:
    overhead, scaling = machinery.overhead, machinery.scaling
    sentence = (
        f"The paper's experiment by solve_ivp in one process, CPU time: {overhead.total:.2f} s, of "
        f"which integration {overhead.integration:.2f} s; writing the same arrays by plain h5py "
        f"takes {overhead.writing:.2f} s. Everything else adds {100 * overhead.share:.1f} % to "
        f"these two; starting the interpreter and importing libraries takes another "
        f"{overhead.imports:.2f} s."
    )
    rows = (
        [
            f"{each.workers}",
            f"{each.runs:,}",
            f"{each.seconds:.1f}",
            f"{each.rate:.1f}",
            f"{each.rate / scaling[0].rate:.2f}",
        ]
        for each in scaling
    )
    return f"{sentence}\n\n" + _table(["workers", "runs", "time, s", "runs/s", "gain"], rows)


def _first(rows: list[Measurement], word: str) -> Measurement | None:
    return next((each for each in rows if word in each.contender), None)


def _ratio(slow: Measurement | None, fast: Measurement) -> str:
    if slow is None:
        return "-"
    ratio = slow.wall / fast.wall
    return f"{ratio:,.0f}" if ratio >= 10 else f"{ratio:.2g}"


def _table(head: list[str], rows: Iterable[list[str]]) -> str:
    rule = ["---", *["---:"] * (len(head) - 1)]
    return "\n".join("| " + " | ".join(row) + " |" for row in [head, rule, *rows])
