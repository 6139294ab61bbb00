"""Gives cases to the commands, in this process, and says of each what went wrong.

    python session.py configurations|results|plugins|options FIRST LAST FOLDER [BASE ...]

Prints one JSON line for each case that is not refused as it should be.
"""

from __future__ import annotations

import io
import json
import os
import re
import resource
import signal
import sys
import time
import traceback
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from pathlib import Path
from typing import Any

import typer.main
from command_options import command
from mutated_configurations import configuration
from mutated_results import result
from plugin_options import plugin

from eqt_cli.cli import main

typer.main.get_command = cache(typer.main.get_command)  # of which a process needs one

MOST_SECONDS = 5.0
SECONDS_TO_DRAW = 10.0
"""Reports and figures take seconds by themselves, more where cores are slow or shared."""
DRAWING = ("animate", "plot", "report")
MOST_BYTES = 1 << 30
CODES = {"configurations": {0, 2}, "results": {0, 2, 3, 4}, "plugins": {0, 2, 3, 4}}
CODES["options"] = {0, 1, 2, 3, 4}
CLOCK = time.process_time  # s of this process: the machine may be busy with others


class TooLong(BaseException):
    """A case that does not come to its end."""


def _stop(*_: object) -> None:
    raise TooLong


def attempt(kind: str, words: list[str]) -> str | None:
    """What is wrong with how a command ends; None if nothing is."""
    out, err = io.StringIO(), io.StringIO()
    sys.argv = ["eqt", *words]
    code: Any = 0
    started = CLOCK()
    most = SECONDS_TO_DRAW if words[0] in DRAWING else MOST_SECONDS
    signal.setitimer(signal.ITIMER_PROF, 2 * most)
    try:
        with redirect_stdout(out), redirect_stderr(err):
            main()
    except SystemExit as exit:
        code = exit.code or 0
    except TooLong:
        return "hang\n" + "".join(traceback.format_exc(limit=-6))
    except BaseException:
        return traceback.format_exc(limit=-6)
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0)
    seconds, told = CLOCK() - started, err.getvalue()
    if code not in CODES[kind]:
        return f"exit code {code}: {told}"
    if (
        code == 2
        and "--json" not in words
        and not re.search(r"(?m)^(eqt: error: |Usage:|(more than )?\d+ errors? in )", told)
    ):
        return f"no message: {told!r}"
    if code == 2 and out.getvalue() and "--json" not in words:
        return f"results of a failure: {out.getvalue()!r}"
    if not re.sub(r"[\n\t\xa0]", "", told + out.getvalue()).isprintable():
        return f"cannot be shown: {told + out.getvalue()!r}"
    if "Traceback" in told:
        return told
    return f"{seconds:.1f} s: {told[:300]}" if seconds > most else None


def peak() -> int:
    """The most memory that this process has taken, in bytes.

    What Linux counts as a resource includes the process that started this one, before it did.
    """
    status = Path("/proc/self/status")
    if status.exists():
        return int(re.search(r"VmHWM:\s*(\d+) kB", status.read_text())[1]) * 1024
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024


def run(kind: str, first: int, last: int, folder: Path, bases: list[Path]) -> None:
    """All cases from `first` on, before `last`."""
    os.chdir(folder)
    signal.signal(signal.SIGPROF, _stop)
    before = peak()
    for seed in range(first, last):
        if kind == "configurations":
            path = Path("case.yaml")
            path.write_bytes(configuration(seed))
            words = ["config", "check", str(path)]
        elif kind == "plugins":
            words = plugin(seed, Path())
        elif kind == "options":
            words = command(seed, bases)
        else:
            path = Path("case.h5")
            words = result(seed, bases, path)
        wrong = attempt(kind, words)
        after = peak()
        if after > MOST_BYTES > before:
            wrong = f"{after / MOST_BYTES:.1f} GiB; {wrong}"
        before = after
        if wrong:
            print(json.dumps({"seed": seed, "words": words, "wrong": wrong}), flush=True)
    print(json.dumps({"done": last - first, "bytes": peak(), "seconds": CLOCK()}))


if __name__ == "__main__":
    kind, first, last, folder, *bases = sys.argv[1:]
    run(kind, int(first), int(last), Path(folder), [Path(base).resolve() for base in bases])
