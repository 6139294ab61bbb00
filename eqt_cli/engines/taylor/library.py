"""heyoka, imported when first needed; nothing else of eqt imports it."""

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
"""Of compiled laws on disk, dozens of them. heyoka looks through all of its file when a process
compiles or loads its first law, at 0.3 ms per MB, and by itself lets the file grow to 21 GB."""


def missing() -> str | None:
    """Where heyoka is not installed: how to get it."""
    if find_spec("heyoka"):
        return None
    return (
        "engine taylor needs heyoka: 'pip install heyoka' on Linux, 'conda install -c "
        "conda-forge heyoka.py' elsewhere "
        f"(this is {platform.system()} on {platform.machine()}); or use engine solve_ivp"
    )


@lru_cache(maxsize=1)
def heyoka_module() -> ModuleType:
    """heyoka, imported when first needed."""
    try:
        import heyoka
    except ImportError as error:
        raise EqtError(missing() or f"heyoka cannot be imported: {error}") from error
    heyoka.set_logger_level_error()  # its warnings are in the outcome of the runs concerned
    heyoka.set_nthreads(1)  # executors share out the cores; its own threads wait busily for work
    _bound_the_cache(heyoka.llvm_state)
    module: ModuleType = heyoka
    return module


def _bound_the_cache(compiler: Any) -> None:
    """Keep compiled laws in a folder of eqt's own, unless the user has said where.

    Elsewhere the size is the user's affair, and that of other programs.
    """
    if "HEYOKA_CACHE_DIR" in os.environ:
        return
    folder = Path(compiler.get_diskcache_path()).parent / "eqt"
    crash_reports.watch(folder)
    compiler.set_diskcache_path(folder)
    with suppress(RuntimeError):  # where nothing can be written, nothing is kept
        compiler.set_diskcache_limit(CACHED_BYTES)
