"""heyoka, imported when first needed; no other module of eqt imports it."""

from __future__ import annotations

import os
import platform
from contextlib import suppress
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from types import ModuleType
from typing import Any

from eqt_cli.core.errors import EqtError
from eqt_cli.engines.taylor import crash_reports

CACHED_BYTES = 40_000_000
"""Limit on the compiled laws on disk, dozens of them. heyoka reads all of its file when a process
compiles or loads its first law, at 0.3 ms per MB, and by default lets the file grow to 21 GB."""


def missing() -> str | None:
    """Return how to install heyoka; None if it is installed."""
    if find_spec("heyoka"):
        return None
    return (
        "engine taylor needs heyoka: 'pip install heyoka' on Linux, 'conda install -c "
        "conda-forge heyoka.py' elsewhere "
        f"(this is {platform.system()} on {platform.machine()}); or use engine solve_ivp"
    )


@lru_cache(maxsize=1)
def heyoka_module() -> ModuleType:
    """Return heyoka, imported when first needed."""
    try:
        import heyoka
    except ImportError as error:
        raise EqtError(missing() or f"heyoka cannot be imported: {error}") from error
    heyoka.set_logger_level_error()  # its warnings are in the outcomes of the runs
    heyoka.set_nthreads(1)  # executors assign the cores; its own threads would wait busily
    _bound_the_cache(heyoka.llvm_state)
    module: ModuleType = heyoka
    return module


def _bound_the_cache(compiler: Any) -> None:
    """Keep compiled laws in eqt's own folder, with bounded size, unless the user has chosen one.

    The size of a folder that the user has chosen is left to the user and to other programs.
    """
    if "HEYOKA_CACHE_DIR" in os.environ:
        return
    folder = Path(compiler.get_diskcache_path()).parent / "eqt"
    crash_reports.watch(folder)
    compiler.set_diskcache_path(folder)
    with suppress(RuntimeError):  # without write access, nothing is kept
        compiler.set_diskcache_limit(CACHED_BYTES)
