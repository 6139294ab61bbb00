"""The Python API, which the commands use too: a module for each purpose.

Its functions are also attributes of `eqt_cli` itself. Each name is imported when it is first used,
so that running an experiment does not load the code that verifies or compares results.
"""

from functools import partial

from eqt_cli import imported, places

_PLACES = places(__name__)

__all__ = sorted(_PLACES)
__getattr__ = partial(imported, __name__, _PLACES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
