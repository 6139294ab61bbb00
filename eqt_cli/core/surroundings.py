"""Keeps files in the current folder from being loaded by this process and its child processes.

The folder may belong to somebody else. Python would search it for the modules of a new process,
and Matplotlib for its settings, one of which some versions evaluate.
"""

import os
from collections.abc import Iterator
from contextlib import chdir, contextmanager, nullcontext
from pathlib import Path

_SAFE_PATH = "PYTHONSAFEPATH"

_is_excluded = False


@contextmanager
def without_current_folder() -> Iterator[None]:
    """Load no module and no setting from the current folder in the block; for commands."""
    global _is_excluded
    earlier, _is_excluded = _is_excluded, True
    is_new = _SAFE_PATH not in os.environ
    os.environ.setdefault(_SAFE_PATH, "1")
    try:
        yield
    finally:
        _is_excluded = earlier
        if is_new:
            os.environ.pop(_SAFE_PATH, None)


@contextmanager
def at_import() -> Iterator[None]:
    """Wrap the import of a library that searches the current folder."""
    must_leave = _is_excluded and _has_current_folder()
    with chdir(Path(__file__).parent) if must_leave else nullcontext():
        yield


def _has_current_folder() -> bool:
    try:
        os.getcwd()  # noqa: PTH109  # no path object is needed
    except FileNotFoundError:  # the folder was removed
        return False
    return True
