"""Finds the line of a plugin in which an exception was raised."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType

from eqt_cli.core.errors import ComponentError, EqtError
from eqt_cli.core.registry import is_foreign


def place_of(error: BaseException, is_component: Callable[[str], bool] = is_foreign) -> str | None:
    """Return the innermost line of a plugin, ``law.py:9: return 1 / 0``; None if there is none.

    Lines of libraries are skipped, because a library may fail by what a component passes to it.

    Parameters
    ----------
    is_component
        Whether the lines of a module count.
    """
    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        if is_component(str(frame.f_globals.get("__name__", ""))):
            code = frame.f_code
            source = traceback.FrameSummary(code.co_filename, line, code.co_name).line
            found = f"{Path(code.co_filename).name}:{line}" + (f": {source}" if source else "")
    return found


def place_of_function(function: object) -> str:
    """Return where a function is defined, ``law.py:8``."""
    if not isinstance(function, FunctionType):
        return repr(function)
    return f"{Path(function.__code__.co_filename).name}:{function.__code__.co_firstlineno}"


def described(error: BaseException) -> str:
    """Return type and message of an error on one line, ``ZeroDivisionError: division by zero``."""
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")


@contextmanager
def blamed() -> Iterator[None]:
    """Turn an exception in a plugin into an error with its line.

    Raises
    ------
    ComponentError
        In place of the exception.
    """
    try:
        yield
    except EqtError:
        raise
    except Exception as error:
        place = place_of(error)
        if place is None:
            raise
        raise ComponentError(f"{described(error)} at {place}") from error
