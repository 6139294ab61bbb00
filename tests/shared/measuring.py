"""What each test costs and which functions of eqt it calls, from which `make tiers` chooses."""

from __future__ import annotations

import json
import os
import sys
import time
from collections.abc import Iterator
from pathlib import Path
from types import CodeType
from typing import Any

import pytest
from tiers import processor_time

ROOT = Path(__file__).parents[2]
PACKAGE = str(ROOT / "eqt_cli") + os.sep


class Measuring:
    """Writes seconds and called functions of all tests of a process into a file of a folder.

    By `sys.monitoring` (Python 3.12), which tells of the first call of a function and then costs
    nothing, so that one session measures both.
    """

    def __init__(self, folder: Path) -> None:
        if sys.version_info < (3, 12):
            raise pytest.UsageError(
                f"expected Python 3.12 or newer, got {sys.version.split()[0]}; for example, "
                "make tiers VENV=.venv-tiers PYTHON=/path/to/python3.12"
            )
        self.folder = folder
        self.names: dict[str, int] = {}
        self.tests: dict[str, dict[str, Any]] = {}
        self.called: set[CodeType] = set()
        self.tool = sys.monitoring.PROFILER_ID
        sys.monitoring.use_tool_id(self.tool, "tiers")
        start = sys.monitoring.events.PY_START
        sys.monitoring.register_callback(self.tool, start, self._starts)
        sys.monitoring.set_events(self.tool, start)

    def _starts(self, code: CodeType, offset: int) -> object:
        if PACKAGE and code.co_filename.startswith(PACKAGE):  # none while Python ends
            self.called.add(code)
        return sys.monitoring.DISABLE

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> Iterator[None]:
        self.called.clear()
        sys.monitoring.restart_events()
        is_marked = bool(item.get_closest_marker("ci"))
        test = self.tests[item.nodeid] = {"is_marked": is_marked, "seconds": [0.0, 0.0, 0.0]}
        result = yield
        test["calls"] = sorted({self._number(code) for code in self.called})
        return result

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_setup(self, item: pytest.Item) -> Iterator[None]:
        yield from self._timed(item, 0)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_call(self, item: pytest.Item) -> Iterator[None]:
        yield from self._timed(item, 1)

    @pytest.hookimpl(wrapper=True, tryfirst=True)
    def pytest_runtest_teardown(self, item: pytest.Item) -> Iterator[None]:
        yield from self._timed(item, 2)

    def _timed(self, item: pytest.Item, phase: int) -> Iterator[None]:
        start = processor_time()
        try:
            yield
        finally:
            self.tests[item.nodeid]["seconds"][phase] = round(processor_time() - start, 5)

    def pytest_runtest_logreport(self, report: pytest.TestReport) -> None:
        if report.failed and report.nodeid in self.tests:
            self.tests[report.nodeid]["failed"] = True

    def _number(self, code: CodeType) -> int:
        path = Path(code.co_filename).relative_to(ROOT).as_posix()
        return self.names.setdefault(f"{path}:{code.co_qualname}", len(self.names))

    def pytest_sessionfinish(self) -> None:
        sys.monitoring.free_tool_id(self.tool)
        if self.tests:
            self.folder.mkdir(parents=True, exist_ok=True)
            measured = {"names": list(self.names), "tests": self.tests}
            path = self.folder / f"{time.time_ns()}-{os.getpid()}.json"
            path.write_text(json.dumps(measured), encoding="utf-8")
