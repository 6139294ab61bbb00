"""The time of the processor that a test may take without being marked as slow.

A plugin of pytest, which conftest.py registers where `EQT_MOST_CPU` gives a bound, in s. It counts
the time of the process and of its children that have ended, and not the time on a clock: tests run
side by side, and machines have more to do. What a test pays for others is left out: fixtures that
live longer than a test, libraries, which are loaded before the first test, and the compilation of
a law, whose code is kept.

Cores differ, and share their power with others. A bound means seconds of a core that does `work`
in `USUAL` seconds; a test that seems to take longer is judged by how long `work` takes just then.
"""

from __future__ import annotations

import importlib
import os
import pkgutil
from collections.abc import Callable, Generator, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from importlib.util import find_spec
from time import process_time
from typing import Any

import numpy as np
import pytest

USUAL = 0.05
"""s that `work` takes on a fast core that has nothing else to do."""

LIBRARIES = (
    "distributed",
    "h5py",
    "heyoka",
    "jsonschema",
    "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_pdf",
    "matplotlib.backends.backend_svg",
    "matplotlib.figure",
    "scipy.integrate",
    "scipy.interpolate",
    "scipy.linalg",
    "scipy.optimize",
    "scipy.spatial.transform",
    "scipy.stats",
    "xarray",
    "yaml",
)

Result = Any


def spent() -> float:
    """s of the processor that this process has taken, and its children that have ended."""
    times = os.times()
    return times.user + times.system + times.children_user + times.children_system


def slowness() -> float:
    """How many times as long as usual a fixed computation takes just now, at the worst of three."""
    return max(1.0, *(work() / USUAL for _ in range(3)))


def work() -> float:
    """The s of the processor that a fixed computation takes, as of tests: steps, small arrays."""
    start = process_time()
    matrix, total = np.eye(3), 0
    for k in range(30_000):
        matrix = matrix @ matrix
        total += sum((k, k + 1, k + 2))
    return process_time() - start


def load_everything() -> None:
    """All modules of eqt, and the libraries that they load when they are needed."""
    import eqt_cli

    for name in LIBRARIES:
        if find_spec(name.partition(".")[0]):
            importlib.import_module(name)
    for module in pkgutil.walk_packages(eqt_cli.__path__, "eqt_cli."):
        if not module.name.endswith("__main__"):
            importlib.import_module(module.name)


class ProcessorTime:
    """A test that passes and takes more than `most` seconds fails, unless it is marked as slow."""

    def __init__(self, most: float, slowness: Callable[[], float] = slowness) -> None:
        self.most, self.slowness = most, slowness
        self.elsewhere = 0.0  # s of what is counted apart, since the start
        self.apart = False
        self.start = 0.0

    @contextmanager
    def counted_apart(self) -> Iterator[None]:
        """What is done here is not the test's that happens to need it first."""
        if self.apart:
            yield
            return
        self.apart, start = True, spent()
        try:
            yield
        finally:
            self.apart = False
            self.elsewhere += spent() - start

    def watch_compilers(self) -> None:
        """Count what engines compile apart: the first test that needs a law pays for all."""
        from eqt_cli.engines import taylor
        from eqt_cli.engines.native import compiler
        from eqt_cli.engines.taylor import compiling, evaluation

        library = compiler.library

        def built(source: str) -> Any:
            with self.counted_apart():
                return library(source)

        compiler.library = built

        def once(*law: Any) -> Any:
            with self.counted_apart():
                return compiling.once(*law)

        taylor.once = evaluation.once = once

    def pytest_runtest_logstart(self) -> None:
        """From here on it counts."""
        self.start = spent() - self.elsewhere

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, Result, Result]:
        """A fixture of more than one test belongs to none."""
        if fixturedef.scope == "function":
            return (yield)
        with self.counted_apart():
            return (yield)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_makereport(
        self, item: pytest.Item, call: pytest.CallInfo[None]
    ) -> Generator[None, pytest.TestReport, pytest.TestReport]:
        """The verdict, before anything is torn down."""
        report = yield
        if call.when != "call" or not report.passed or item.get_closest_marker("slow"):
            return report
        seconds = spent() - self.elsewhere - self.start
        if seconds > self.most and (usual := seconds / self.slowness()) > self.most:
            report.outcome = "failed"
            report.longrepr = (
                f"{item.nodeid} takes {seconds:.1f} s of the processor here, {usual:.1f} s on a "
                f"fast machine; expected at most {self.most:g} s. Let it do less, or mark it "
                '@pytest.mark.slow("why it must be")'
            )
        return report


judges: list[ProcessorTime] = []
"""The one of this process, where there is one."""


def for_others() -> AbstractContextManager[None]:
    """What is done here is kept for other tests, and counts as a fixture of several."""
    return judges[0].counted_apart() if judges else nullcontext()


def unexplained(items: list[pytest.Item]) -> list[str]:
    """The tests that are marked as slow, and do not say why."""
    return [
        item.nodeid
        for item in items
        for mark in item.iter_markers("slow")
        if len(mark.args) != 1 or not isinstance(mark.args[0], str) or not mark.args[0].strip()
    ]
