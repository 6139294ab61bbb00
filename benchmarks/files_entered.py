"""Which files of eqt a command enters: `python benchmarks/files_entered.py -- run paper.yaml`.

A file counts if a function in it is called, at import or later, in any thread of this process.
Bodies of modules and classes do not count: every import runs them.
"""

from __future__ import annotations

import argparse
import sys
import threading
from collections import Counter
from dataclasses import dataclass, field
from inspect import CO_OPTIMIZED
from pathlib import Path
from types import FrameType
from typing import Any

if sys.path[0] == str(Path(__file__).parent):  # run as a file; profile.py is not Python's own
    del sys.path[0]

PACKAGE = "eqt_cli"


@dataclass
class Calls:
    """Calls of functions in this process, by the files of their code.

    Attributes
    ----------
    of
        How many calls there were, by the name of the file.
    """

    of: Counter[str] = field(default_factory=Counter)

    def watch(self) -> None:
        """Count from here on, in this thread and in those that begin later."""
        threading.setprofile(self._seen)
        sys.setprofile(self._seen)

    def stop(self) -> None:
        """Count no longer."""
        sys.setprofile(None)
        threading.setprofile(None)

    def _seen(self, frame: FrameType, event: str, _: Any) -> None:
        if event == "call" and frame.f_code.co_flags & CO_OPTIMIZED:
            self.of[frame.f_code.co_filename] += 1

    def files(self, root: Path) -> dict[str, int]:
        """Calls in each file under a folder, by its path there."""
        found: Counter[str] = Counter()
        for name, calls in self.of.items():
            if Path(name).is_relative_to(root):
                found[Path(name).relative_to(root).as_posix()] += calls
        return dict(sorted(found.items()))


@dataclass(frozen=True)
class Entered:
    """What a command enters.

    Attributes
    ----------
    root
        Folder of the package that was run.
    calls
        Of functions, by file, in the order of names.
    modules
        How many modules of the package are loaded at the end.
    """

    root: Path
    code: int
    calls: dict[str, int]
    modules: int


def entered(arguments: list[str]) -> Entered:
    """Run `eqt` with these arguments in this process, which has not imported it yet.

    Raises
    ------
    RuntimeError
        If it is imported already, so that what the import calls would be missed.
    """
    if PACKAGE in sys.modules:
        raise RuntimeError(f"{PACKAGE} is imported already; start a new process")
    sys.argv, code, calls = ["eqt", *arguments], 0, Calls()
    calls.watch()
    try:
        from eqt_cli.cli import main

        main()
    except SystemExit as end:
        code = end.code if isinstance(end.code, int) else int(end.code is not None)
    finally:
        calls.stop()
    root = Path(str(sys.modules[PACKAGE].__file__)).parent
    modules = sum(name.partition(".")[0] == PACKAGE for name in list(sys.modules))
    return Entered(root, code, calls.files(root), modules)


def _options() -> argparse.Namespace:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--list", action="store_true", help="also the files, with their calls")
    parser.add_argument("command", nargs="+", help="what follows eqt, after --")
    return parser.parse_args()


def main() -> None:
    """Print how many files the command enters, after what it prints itself."""
    options = _options()
    found = entered(options.command)
    sys.stdout.flush()
    if options.list:
        for file, calls in found.calls.items():
            print(f"{calls:10,}  {file}")
    print(f"eqt {' '.join(options.command)}: exit code {found.code}")
    print(f"{len(found.calls)} files entered, {found.modules} modules loaded, of {found.root}")


if __name__ == "__main__":
    main()
