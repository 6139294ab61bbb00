"""Chooses the quick tests: `python tests/shared/choose_tiers.py build/tiers`, as `make tiers` does.

A weighted cover: every function of eqt that tests without a mark call is called by `TIMES` quick
tests, if so many of at most 0.3 s do, and by one in any case. Then the cheapest of the others are
quick, until the sum is reached. A fixture is paid for once in a file.
"""

from __future__ import annotations

import heapq
import json
import statistics
import sys
from collections import Counter, defaultdict
from collections.abc import Iterable
from pathlib import Path

import tiers

TIMES = 3
"""Quick tests that call a function: the more there are, the fewer faults go undetected."""

BUDGET = 0.8 * tiers.MOST_OF_ALL
"""s of all quick tests: the rest is for new tests, and for Python 3.11, which takes longer."""

SHARED = 0.1
"""s from which on the time before or after a test is that of a fixture of the file."""

HEAD = """\
# Written by `make tiers`; read by tests/shared/tiers.py. s of the processor, by tab:
#   file    the quick tests of a file, with its fixtures
#   longer  a quick test that takes more than 0.3 s, because no shorter one calls some function
#   cost    a function of tests that only CI runs: quick tests call what it calls
#   case    cases that only CI runs: others of the same function are quick
"""


class Measured:
    """Costs and called functions of tests, of one or several sessions; of two, the later counts."""

    def __init__(self, folder: Path) -> None:
        self.own: dict[str, float] = {}
        self.calls: dict[str, frozenset[str]] = {}
        self.fixtures: dict[str, float] = defaultdict(float)
        for path in sorted(folder.glob("*.json")):
            session = json.loads(path.read_text(encoding="utf-8"))
            for nodeid, test in session["tests"].items():
                if test["is_marked"] or test.get("failed"):
                    continue
                before, call, after = test["seconds"]
                small = [seconds for seconds in (before, after) if seconds <= SHARED]
                self.own[nodeid] = call + sum(small)
                self.fixtures[_file(nodeid)] += before + after - sum(small)
                self.calls[nodeid] = frozenset(session["names"][k] for k in test["calls"])

    def cost(self, chosen: Iterable[str]) -> float:
        """The s of these tests with their fixtures."""
        chosen = set(chosen)
        fixtures = sum(self.fixtures[file] for file in {_file(nodeid) for nodeid in chosen})
        return sum(self.own[nodeid] for nodeid in chosen) + fixtures

    def keep_scale(self, listed: tiers.Tiers) -> float:
        """Divide costs by the median over files of how much longer their quick tests took now.

        Otherwise a list that is written while the machine is busy would move all limits.
        """
        files: dict[str, set[str]] = defaultdict(set)
        for nodeid in self.own:
            if not listed.reason(nodeid):
                files[_file(nodeid)].add(nodeid)
        ratios = [
            self.cost(files[file]) / seconds
            for file, seconds in listed.files.items()
            if seconds >= tiers.LEAST_LISTED and file in files
        ]
        ratio = statistics.median(ratios) if ratios else 1.0
        for costs in (self.own, self.fixtures):
            for name in costs:
                costs[name] /= ratio
        return ratio

    def price(self, nodeid: str, paid: set[str]) -> float:
        """What it costs to add a test, where the fixtures of these files are paid for."""
        file = _file(nodeid)
        return self.own[nodeid] + (0.0 if file in paid else self.fixtures[file])


def _file(nodeid: str) -> str:
    return nodeid.partition("::")[0]


def _function(nodeid: str) -> str:
    return nodeid.partition("[")[0]


def cover(
    measured: Measured, candidates: Iterable[str], wanted: Counter[str], chosen: set[str]
) -> None:
    """Add candidates until each function is called as often as wanted, most functions per s first.

    A price only falls, when a test of the same file is chosen, and so does the number of functions
    that still count; a test whose rank has changed goes back into the queue.
    """
    paid = {_file(nodeid) for nodeid in chosen}

    def rank(nodeid: str) -> float:
        gain = sum(wanted[name] > 0 for name in measured.calls[nodeid])
        return -gain / max(measured.price(nodeid, paid), 1e-3)

    queue = [(rank(nodeid), nodeid) for nodeid in candidates if nodeid not in chosen]
    heapq.heapify(queue)
    while queue:
        listed, nodeid = heapq.heappop(queue)
        now = rank(nodeid)
        if now == 0.0:
            continue
        if now > listed + 1e-9:
            heapq.heappush(queue, (now, nodeid))
            continue
        chosen.add(nodeid)
        paid.add(_file(nodeid))
        wanted.subtract(measured.calls[nodeid])


def quick_tests(measured: Measured) -> set[str]:
    """Choose."""
    calls = Counter(name for names in measured.calls.values() for name in names)
    short = [nodeid for nodeid, seconds in measured.own.items() if seconds <= tiers.MOST]
    chosen: set[str] = set()
    often = Counter({name: min(TIMES, count) for name, count in calls.items()})
    cover(measured, short, often, chosen)
    called = frozenset().union(*(measured.calls[nodeid] for nodeid in chosen))
    once = Counter(dict.fromkeys(calls.keys() - called, 1))
    cover(measured, measured.own, once, chosen)
    spent, paid = measured.cost(chosen), {_file(nodeid) for nodeid in chosen}
    for nodeid in sorted(short, key=lambda nodeid: measured.own[nodeid]):
        price = measured.price(nodeid, paid)
        if nodeid not in chosen and spent + price <= BUDGET:
            chosen.add(nodeid)
            paid.add(_file(nodeid))
            spent += price
    return chosen


def listing(measured: Measured, chosen: set[str]) -> str:
    """The text of tests/tiers.tsv."""
    files: dict[str, set[str]] = defaultdict(set)
    for nodeid in chosen:
        files[_file(nodeid)].add(nodeid)
    rows = [("file", measured.cost(tests), file, "") for file, tests in sorted(files.items())]
    longer = sorted(nodeid for nodeid in chosen if measured.own[nodeid] > tiers.MOST)
    rows += [("longer", measured.own[nodeid], nodeid, "") for nodeid in longer]
    left: dict[str, list[str]] = defaultdict(list)
    for nodeid in sorted(measured.own.keys() - chosen):
        left[_function(nodeid)].append(nodeid)
    quick = {_function(nodeid) for nodeid in chosen}
    for name, nodeids in sorted(left.items()):
        seconds = sum(measured.own[nodeid] for nodeid in nodeids)
        cases = [nodeid[len(name) + 1 : -1] for nodeid in nodeids]
        shown = json.dumps(cases, ensure_ascii=False)
        kind, shown = ("case", shown) if name in quick else ("cost", "")
        rows.append((kind, seconds, name, shown))
    lines = (f"{kind}\t{seconds:.2f}\t{name}\t{cases}\n" for kind, seconds, name, cases in rows)
    return HEAD + "".join(lines)


def main(folder: Path) -> None:
    """Write the list, and say what it holds."""
    measured = Measured(folder)
    ratio = measured.keep_scale(tiers.tiers())
    chosen = quick_tests(measured)
    tiers.LIST.write_text(listing(measured, chosen), encoding="utf-8")
    every, some = (
        frozenset().union(*(measured.calls[nodeid] for nodeid in tests))
        for tests in (measured.own, chosen)
    )
    print(
        f"quick: {len(chosen):,} of {len(measured.own):,} tests without a mark, "
        f"{measured.cost(chosen):.0f} of {measured.cost(measured.own):.0f} s; "
        f"they call {len(some):,} of {len(every):,} functions of eqt "
        f"(this run took {ratio:.2f} times what was listed)"
    )


if __name__ == "__main__":
    main(Path(sys.argv[1]))
