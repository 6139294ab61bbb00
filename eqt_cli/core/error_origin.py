"""Finds the line of a plugin that an exception came from."""

import traceback
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from types import FunctionType

from eqt_cli.core.errors import ComponentError, EqtError
from eqt_cli.core.registry import is_foreign


def place_of(error: BaseException, is_component: Callable[[str], bool] = is_foreign) -> str | None:
    """``law.py:9: return 1 / 0``, the innermost line that is not eqt's, or None if there is none.

    Libraries are not to blame for what they are given: only components are looked at.

    Parameters
    ----------
    is_component
        Whether a module is one of those that are looked at.
    """
    found = None
    for frame, line in traceback.walk_tb(error.__traceback__):
        if is_component(str(frame.f_globals.get("__name__", ""))):
            code = frame.f_code
            source = traceback.FrameSummary(code.co_filename, line, code.co_name).line
            found = f"{Path(code.co_filename).name}:{line}" + (f": {source}" if source else "")
    return found


def place_of_function(function: object) -> str:
    """``law.py:8``, where a function is defined."""
    if not isinstance(function, FunctionType):
        return repr(function)
    return f"{Path(function.__code__.co_filename).name}:{function.__code__.co_firstlineno}"


def described(error: BaseException) -> str:
    """``ZeroDivisionError: division by zero``, on one line."""
    return " ".join(f"{type(error).__name__}: {error}".split()).removesuffix(":")


@contextmanager
def blamed() -> Iterator[None]:
    """Turns an exception out of a component that is not eqt's own into a message with its line.

    Raises
    ------
    ComponentError
        Instead of the exception.
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
