"""Tries mutants on tests that are collected once: every trial is a fork, which plants one fault.

No file is changed. The code of the function with the fault takes the place of the function's own,
wherever it is held; a fault in what is executed on import is planted while a new interpreter reads
the file. A trial ends with the first test that fails.
"""

from __future__ import annotations

import gc
import hashlib
import importlib.machinery
import inspect
import json
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Iterable, Iterator
from functools import partial
from pathlib import Path
from types import CodeType, FrameType, FunctionType
from typing import Any

import pytest

from mutants.mutations import Mutant, mutated

SLOW = 5.0
"""s of processor time; tests that take longer are left out."""

BUDGET = 30.0
"""s of processor time in tests of a mutant that nothing tells, measured without the fault.

Less than 20 leaves out tests that tell some; a machine that is busy measures more than it takes.
"""

AGAIN = 400.0
"""The same for what survives: a law in a class is read by thousands of tests, and told by one."""

WAIT = 900
"""s after which a trial that does nothing ends."""

BROKEN = 70
"""What a child returns that could not even plant its fault."""

ROOT = Path(__file__).parents[3]
KNOWN = ROOT / "build" / "mutants"

Done = Callable[[Mutant, str, str], None]
"""What is told of a mutant that was tried: how it ended, and the first test that failed."""

KILLED, SURVIVED, TIMEOUT, UNTESTED = "killed", "survived", "timeout", "untested"


class Trials:
    """A plugin of pytest that runs mutants instead of the tests that it has collected."""

    def __init__(self, mutants: Iterable[Mutant], workers: int, done: Done) -> None:
        self.mutants, self.workers, self.done = list(mutants), workers, done
        self.on_import: set[tuple[str, str]] = set()
        sys.settrace(_watch(self.on_import))  # before pytest reads the first file of tests

    def pytest_sessionstart(self) -> None:
        """From here on tests are read: a failing example need not be a small one."""
        from hypothesis import Phase, settings  # pytest wants to see it imported first

        phases = (Phase.explicit, Phase.generate)
        settings.register_profile(
            "mutants", deadline=None, derandomize=True, database=None, phases=phases
        )
        settings.load_profile("mutants")

    def pytest_runtestloop(self, session: pytest.Session) -> bool:
        """Try all mutants, several at a time."""
        sys.settrace(None)
        if session.testsfailed:
            raise pytest.UsageError("the tests cannot be collected")
        self.items = {item.nodeid: item for item in session.items}
        self.tests = _what_tests_call(session, self.workers)
        gc.unfreeze()  # tests/conftest.py hides functions from the collector
        self.functions = _functions()
        for budget in (BUDGET, AGAIN):
            self.budget, self.survivors = budget, list[Mutant]()
            self._try(self.mutants)
            self.mutants = self.survivors
        return True

    def _try(self, mutants: list[Mutant]) -> None:
        running: dict[int, tuple[Mutant, int]] = {}
        for mutant in mutants:
            chosen = self.chosen(mutant)
            if not chosen:
                self.done(mutant, UNTESTED, "")
                continue
            while len(running) >= self.workers:
                self._wait(running)
            read, write = os.pipe()
            pid = os.fork()
            if not pid:
                os.close(read)
                _quietly(partial(self.trial, mutant, chosen, write))
            os.close(write)
            running[pid] = mutant, read
        while running:
            self._wait(running)

    def _wait(self, running: dict[int, tuple[Mutant, int]]) -> None:
        pid, status = os.wait()
        mutant, read = running.pop(pid)
        with os.fdopen(read) as pipe:
            told = pipe.read()
        if os.WIFSIGNALED(status):
            ended = os.WTERMSIG(status)
            by_limit = ended in (signal.SIGXCPU, signal.SIGKILL, signal.SIGALRM)
            self.done(mutant, TIMEOUT if by_limit else KILLED, told or f"signal {ended}")
        elif os.WEXITSTATUS(status) == BROKEN:
            raise RuntimeError(f"{mutant.key}: the trial itself has failed")
        elif os.WEXITSTATUS(status):
            self.done(mutant, KILLED, told)
        else:
            self.survivors.append(mutant)
            if self.budget == AGAIN:
                self.done(mutant, SURVIVED, told)

    def reads(self, mutant: Mutant) -> bool:
        """Whether the fault takes effect only when its file is read."""
        return mutant.on_import or (mutant.path, mutant.function) in self.on_import

    def chosen(self, mutant: Mutant) -> list[str]:
        """The tests to try: those that call the function, or, for one on import, its file.

        A test that reads a class, or is refused by it, calls nothing in its file. So for a fault on
        import those of the same folder are tried, too.
        """
        if not self.reads(mutant):
            return self._within_budget(n for n in self.tests if self._calls(n, mutant))
        callers = (n for n, known in self.tests.items() if mutant.path in known["calls"])
        folder = f"/{Path(mutant.path).parts[1]}"
        beside = (n for n in self.tests if folder in n.partition("::")[0])
        return list(dict.fromkeys([*self._within_budget(callers), *self._within_budget(beside)]))

    def _calls(self, nodeid: str, mutant: Mutant) -> bool:
        return mutant.function in self.tests[nodeid]["calls"].get(mutant.path, ())

    def _within_budget(self, nodeids: Iterable[str]) -> list[str]:
        """As many as the budget takes: the cheapest, and half of it for one case of every test."""
        seconds = {nodeid: self.tests[nodeid]["seconds"] for nodeid in nodeids}
        most = max(SLOW, self.budget / 10)  # what survives is tried on longer tests, too
        by_time = sorted((n for n in seconds if seconds[n] <= most), key=lambda n: seconds[n])
        first_cases = {nodeid.partition("[")[0]: nodeid for nodeid in reversed(by_time)}
        chosen: list[str] = []
        for order, budget in ((by_time, self.budget / 2), (first_cases.values(), self.budget)):
            spent = sum(seconds[nodeid] for nodeid in chosen)
            for nodeid in sorted(set(order) - set(chosen), key=lambda n: seconds[n]):
                spent += seconds[nodeid]
                if spent > budget:
                    break
                chosen.append(nodeid)
        return chosen

    def trial(self, mutant: Mutant, chosen: list[str], write: int) -> int:
        """In a child: plant the fault, and run tests until one fails."""
        expected = sum(self.tests[nodeid]["seconds"] for nodeid in chosen)
        limit = int(20 + 5 * expected)
        resource.setrlimit(resource.RLIMIT_CPU, (limit, limit + 5))
        signal.alarm(WAIT)  # what waits forever takes no processor time
        if self.reads(mutant) or not _plant(mutant, self.functions):
            os.set_inheritable(write, True)
            arguments = [mutant.path, str(mutant.line), mutant.key, str(write), *chosen]
            os.execv(sys.executable, [sys.executable, "-m", "mutants.on_import", *arguments])
        failed = first_failure(self.items[nodeid] for nodeid in chosen)
        os.write(write, failed.encode())
        return 1 if failed else 0


def first_failure(items: Iterable[pytest.Item]) -> str:
    """The name of the first test that fails; empty if none does."""
    items = list(items)
    for item, following in zip(items, [*items[1:], None], strict=True):
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        if item.session.testsfailed:
            return item.nodeid
    return ""


def plant_on_reading(mutant: Mutant) -> None:
    """Let this interpreter read the file of the mutant with the fault in it."""
    original = importlib.machinery.SourceFileLoader.get_code

    def get_code(loader: Any, name: str) -> CodeType | None:
        if Path(loader.path) == ROOT / mutant.path:
            return compile(mutated(ROOT, mutant), loader.path, "exec")
        return original(loader, name)

    importlib.machinery.SourceFileLoader.get_code = get_code  # type: ignore[method-assign]


# What tests call ---------------------------------------------------------------------------------


def _watch(called: set[tuple[str, str]]) -> Any:
    """A trace function that notes every function of eqt that is called."""
    package = str(ROOT / "eqt_cli") + os.sep
    names: dict[CodeType, tuple[str, str] | None] = {}

    def trace(frame: FrameType, event: str, argument: Any) -> None:
        code = frame.f_code
        if code not in names:
            ours = code.co_filename.startswith(package) and code.co_name != "<module>"
            path = Path(code.co_filename).relative_to(ROOT).as_posix() if ours else ""
            names[code] = (path, code.co_qualname.partition(".<locals>")[0]) if ours else None
        if name := names[code]:
            called.add(name)

    return trace


def _what_tests_call(session: pytest.Session, workers: int) -> dict[str, dict[str, Any]]:
    """Seconds and called functions of every test; kept, until the text of the test changes."""
    KNOWN.mkdir(parents=True, exist_ok=True)
    by_file: dict[Path, list[pytest.Item]] = {}
    for item in session.items:
        by_file.setdefault(item.path, []).append(item)
    watching: dict[int, Path] = {}

    def wait() -> None:
        pid, status = os.wait()
        file = watching.pop(pid)
        if status:
            raise pytest.UsageError(f"without a fault, tests of {file} fail")

    for file, items in by_file.items():
        known = _known(file)
        new = [item for item in items if known.get(item.nodeid, {}).get("text") != _text(item)]
        if not new:
            continue
        while len(watching) >= workers:
            wait()
        print(f"watching {len(new)} tests of {file.relative_to(ROOT)}", flush=True)
        pid = os.fork()
        if not pid:
            _quietly(partial(_watched, new, known, _kept(file)))
        watching[pid] = file
    while watching:
        wait()
    return {
        item.nodeid: known[item.nodeid]
        for file, items in by_file.items()
        for known in [_known(file)]
        for item in items
    }


def _kept(file: Path) -> Path:
    """Where what tests of a file call is kept."""
    return KNOWN / f"{file.relative_to(ROOT).with_suffix('').as_posix().replace('/', '-')}.json"


def _known(file: Path) -> dict[str, Any]:
    kept = _kept(file)
    return json.loads(kept.read_text()) if kept.exists() else {}


def _text(item: pytest.Item) -> str:
    """A digest of the test's own text."""
    function = inspect.unwrap(getattr(item, "obj", None) or len)
    inner = getattr(getattr(function, "hypothesis", None), "inner_test", function)
    return hashlib.sha256(inspect.getsource(inner).encode()).hexdigest()[:16]


def _watched(items: list[pytest.Item], known: dict[str, Any], kept: Path) -> int:
    for item, following in zip(items, [*items[1:], None], strict=True):
        called: set[tuple[str, str]] = set()
        start = time.process_time()
        trace = _watch(called)
        threading.settrace(trace)
        sys.settrace(trace)
        item.config.hook.pytest_runtest_protocol(item=item, nextitem=following)
        sys.settrace(None)
        if item.session.testsfailed:
            return 1
        calls: dict[str, list[str]] = {}
        for path, function in sorted(called):
            calls.setdefault(path, []).append(function)
        seconds = time.process_time() - start
        known[item.nodeid] = {"text": _text(item), "seconds": seconds, "calls": calls}
    kept.write_text(json.dumps(known))
    return 0


# Planting ----------------------------------------------------------------------------------------


def _functions() -> dict[tuple[str, str], list[FunctionType]]:
    """All functions of eqt that live, by file and qualified name."""
    found: dict[tuple[str, str], list[FunctionType]] = {}
    package = str(ROOT / "eqt_cli") + os.sep
    for each in gc.get_objects():
        if isinstance(each, FunctionType) and each.__code__.co_filename.startswith(package):
            path = Path(each.__code__.co_filename).relative_to(ROOT).as_posix()
            found.setdefault((path, each.__code__.co_qualname), []).append(each)
    return found


def _plant(mutant: Mutant, functions: dict[tuple[str, str], list[FunctionType]]) -> bool:
    """Whether the code can be exchanged.

    It cannot where the fault takes away a variable from outside, nor where it is in the default of
    an argument, which is no part of the code, nor where no function of that name lives.
    """
    file = str(ROOT / mutant.path)
    code = _code_of(compile(mutated(ROOT, mutant), file, "exec"), mutant.function)
    found = functions.get((mutant.path, mutant.function), [])
    # Code that has run is no longer equal to itself as it was read.
    text = (ROOT / mutant.path).read_text(encoding="utf-8")
    unchanged = code == _code_of(compile(text, file, "exec"), mutant.function)
    if (
        not found
        or unchanged
        or any(each.__code__.co_freevars != code.co_freevars for each in found)
    ):
        return False
    for function in found:
        function.__code__ = code
    return True


def _code_of(module: CodeType, function: str) -> CodeType:
    return next(code for code in _codes(module) if code.co_qualname == function)


def _codes(code: CodeType) -> Iterator[CodeType]:
    for constant in code.co_consts:
        if isinstance(constant, CodeType):
            yield constant
            yield from _codes(constant)


def _quietly(work: Any) -> None:
    """In a child: do it without a word, and end with what it returns."""
    code = BROKEN
    try:
        nowhere = os.open(os.devnull, os.O_WRONLY)
        os.dup2(nowhere, 1)
        os.dup2(nowhere, 2)
        code = work()
    finally:
        os._exit(code)
