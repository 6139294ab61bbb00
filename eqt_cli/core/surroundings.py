"""Keeps what lies in the current folder out of this process, and of those that it starts.

The folder may be a colleague's. Python would look there for the modules of a process that starts,
and Matplotlib for its settings, of which some versions evaluate one.
"""

import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager, nullcontext
from pathlib import Path

_SAFE_PATH = "PYTHONSAFEPATH"

_is_left_out = False


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Load no module and no setting from the current folder; what a command does to its process."""
    global _is_left_out
    earlier, _is_left_out = _is_left_out, True
    is_new = _SAFE_PATH not in os.environ
    os.environ.setdefault(_SAFE_PATH, "1")
    try:
        yield
    finally:
        _is_left_out = earlier
        if is_new:
            os.environ.pop(_SAFE_PATH, None)


@contextmanager
def at_import() -> Iterator[None]:
    """Around the import of a library that looks into the current folder."""
    leaves = _is_left_out and _has_current_folder()
    with chdir(Path(__file__).parent) if leaves else nullcontext():
        yield


def _has_current_folder() -> bool:
    try:
        os.getcwd()  # noqa: PTH109  # of a path, nothing else is needed
    except FileNotFoundError:  # somebody has removed it
        return False
    return True
