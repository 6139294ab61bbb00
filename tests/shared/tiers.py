"""The quick tests, which `make test` runs, and those that only continuous integration runs.

A test is quick unless it is marked `ci` or stands in tests/tiers.tsv, which `make tiers` writes
from measured costs and called functions (choose_tiers.py). Costs are s of the processor on the
scale of that file: the median over files of tests says how much slower this machine is.
"""

from __future__ import annotations

import hashlib
import json
import os
import statistics
import sys
from collections import Counter, defaultdict
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cache
from pathlib import Path
from time import process_time  # by its own name, which no test replaces
from typing import Any, Literal

import pytest

LIST = Path(__file__).parents[1] / "tiers.tsv"

MOST_OF_ALL = 150.0
"""s of the processor for all quick tests: some 90 s of two cores, with what collecting takes."""

MOST = 0.3
"""s for a quick test."""

BUSY = 3.0
"""By which a test may take longer than listed: of two runs, 0.8 % of the tests differ by more."""

FIRST = 2.0
"""s more for a test that is the first to import a library or to compile a law."""

LEAST_LISTED = 0.2
"""s of a file of tests that counts for the scale."""

COMPLETE = 0.95
"""Share of the listed files that ran, from which on the sum is judged."""


def processor_time() -> float:
    """The s of the processor of this process and, but on Windows, its children that have ended."""
    if sys.platform == "win32":
        return process_time()
    from resource import RUSAGE_CHILDREN, getrusage

    children = getrusage(RUSAGE_CHILDREN)
    return process_time() + children.ru_utime + children.ru_stime


@dataclass(frozen=True)
class Tiers:
    """What tests/tiers.tsv says."""

    files: dict[str, float]
    """s of the quick tests of a file."""

    longer: dict[str, float]
    """s of quick tests that take more than `MOST`: alone they call some function."""

    functions: dict[str, str]
    """Functions of tests that only CI runs, and why."""

    cases: dict[str, str]
    """Cases that only CI runs, and why."""

    def reason(self, nodeid: str) -> str:
        """Why only CI runs a test; empty if it is quick."""
        return self.functions.get(nodeid.partition("[")[0]) or self.cases.get(nodeid, "")


@cache
def tiers() -> Tiers:
    """Read tests/tiers.tsv; without it, all tests without a mark are quick."""
    found = Tiers({}, {}, {}, {})
    lines = LIST.read_text(encoding="utf-8").splitlines() if LIST.exists() else []
    for line in lines:
        if line.startswith("#"):
            continue
        tier, seconds, name, cases = line.split("\t")
        if tier == "file":
            found.files[name] = float(seconds)
        elif tier == "longer":
            found.longer[name] = float(seconds)
        elif cases:
            found.cases.update({f"{name}[{case}]": tier for case in json.loads(cases)})
        else:
            found.functions[name] = tier
    return found


def mark(items: list[pytest.Item]) -> None:
    """Mark with `ci` what the list leaves to CI."""
    for item in items:
        if reason := tiers().reason(item.nodeid):
            item.add_marker(pytest.mark.ci(reason))


def is_quick(item: pytest.Item) -> bool:
    return item.get_closest_marker("ci") is None


def draw(items: list[pytest.Item], share: str) -> list[pytest.Item]:
    """Of the tests of CI leave a share: "3/8" is the third of eight.

    A function of one case, which no quick test is like, is drawn by every second share. Of a
    function with cases in CI alone, one remains in any case. Eight draws try all.
    """
    first, _, last = share.partition("/")
    if not (first.isdecimal() and last.isdecimal() and 1 <= int(first) <= int(last)):
        raise pytest.UsageError(f"SHARE: expected 1/N to N/N, such as 3/8, or full; got {share!r}")
    number, count = int(first), int(last)
    quick = {_function(item) for item in items if is_quick(item)}
    cases: dict[str, list[pytest.Item]] = defaultdict(list)
    for item in items:
        if not is_quick(item):
            cases[_function(item)].append(item)
    left_out: set[pytest.Item] = set()
    for function, several in cases.items():
        is_like_quick_ones = function in quick or bool(tiers().reason(several[0].nodeid))
        parts = count if is_like_quick_ones else min(count, max(len(several), 2))
        for place, item in enumerate(sorted(several, key=_digest)):
            is_alone = is_like_quick_ones or len(several) == 1
            offset = _digest(several[0]) if is_alone else 0  # or all would meet in one share
            if (place + offset) % parts != number % parts:
                left_out.add(item)
    return [item for item in items if item not in left_out]


def _digest(item: pytest.Item) -> int:
    return int(hashlib.sha256(item.nodeid.encode()).hexdigest()[:8], 16)


def _function(item: pytest.Item) -> str:
    return item.nodeid.partition("[")[0]


@dataclass(eq=False)  # pytest keeps plugins by identity
class Costs:
    """Adds up what quick tests cost, and tells, or fails, if one or all take too long.

    The processes that run tests hand the seconds over in the reports.
    """

    strict: bool
    """Whether a test or a sum that takes too long fails the session."""

    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    """Of all that ran, by test."""

    calls: dict[str, float] = field(default_factory=dict)
    """The same without fixtures."""

    _start: float = 0.0

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self) -> Iterator[None]:
        self._start = processor_time()
        return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(self, item: pytest.Item) -> Iterator[None]:
        report: Any = yield
        now = processor_time()
        report.processor_seconds, self._start = now - self._start, now
        report.is_quick = is_quick(item)  # keywords hold names of folders, too
        return report

    def pytest_runtest_logreport(self, report: Any) -> None:
        if not getattr(report, "is_quick", False):  # as that of a process that has died
            return
        self.seconds[report.nodeid] += report.processor_seconds
        if report.when == "call":
            self.calls[report.nodeid] = report.processor_seconds

    def judged(self) -> tuple[list[str], list[str]]:
        """What to say at the end, and what is too long."""
        listed, files = tiers(), Counter[str]()
        for nodeid, seconds in self.seconds.items():
            files[nodeid.partition("::")[0]] += seconds
        ratios = [
            files[file] / seconds
            for file, seconds in listed.files.items()
            if seconds >= LEAST_LISTED and file in files
        ]
        if len(files.keys() & listed.files) < COMPLETE * len(listed.files) or not ratios:
            return [], []
        scale = statistics.median(ratios)
        total = sum(files.values()) / scale
        said = [
            f"{len(self.seconds):,} quick tests: {total:.0f} s of the processor, at most "
            f"{MOST_OF_ALL:.0f} (measured {total * scale:.0f} s; this run took {scale:.2f} times "
            f"what {LIST.name} lists)"
        ]
        too_long = [
            f"{nodeid}: takes {seconds / scale:.2f} s of the processor; expected at most "
            f'{MOST:g} s. Let it do less, or mark it @pytest.mark.ci("why it must be")'
            for nodeid, seconds in self.calls.items()
            if seconds > (BUSY * max(MOST, listed.longer.get(nodeid, 0.0)) + FIRST) * scale
        ]
        if total > MOST_OF_ALL:
            too_long.append(
                f"all quick tests take {total:.0f} s of the processor; expected at most "
                f"{MOST_OF_ALL:.0f} s. Let `make tiers` choose, or shorten what costs most"
            )
        return said, too_long

    def pytest_sessionfinish(self, session: pytest.Session) -> None:
        if self.strict and self.judged()[1] and not os.environ.get("PYTEST_XDIST_WORKER"):
            session.exitstatus = session.exitstatus or pytest.ExitCode.TESTS_FAILED

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        said, too_long = self.judged()
        kind: Literal["ERROR", "warning"] = "ERROR" if self.strict else "warning"
        for line in said + [f"{kind}: {line}" for line in too_long]:
            terminalreporter.write_line(line)
