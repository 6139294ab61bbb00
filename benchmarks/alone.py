"""Times the compiled integration of a command alone: `python -m benchmarks.alone FILE run …`.

The seconds of CPU time go to the file. The command must compute in this process: pass it
`--executor serial`.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from eqt_cli.cli import main
from eqt_cli.engines.library import Walk
from eqt_cli.engines.native import Lanes

TIMED = ((Walk, "__call__"), (Lanes, "_advanced"))
"""What calls compiled code that integrates: a walk through many spans, and a span."""


def measured(arguments: list[str]) -> float:
    """Run a command; return the CPU time of all calls of compiled integration, s."""
    seconds = 0.0

    def timed(call: Callable[..., Any]) -> Callable[..., Any]:
        def called(*given: Any, **named: Any) -> Any:
            nonlocal seconds
            began = time.thread_time()
            try:
                return call(*given, **named)
            finally:
                seconds += time.thread_time() - began

        return called

    for owner, name in TIMED:
        setattr(owner, name, timed(getattr(owner, name)))
    sys.argv = ["eqt", *arguments]
    try:
        main()
    except SystemExit as ended:
        if ended.code:
            raise
    return seconds


if __name__ == "__main__":
    Path(sys.argv[1]).write_text(str(measured(sys.argv[2:])), encoding="utf-8")
