"""What Python users and the commands call, from loading to drawing: a module per purpose.

Its functions are also attributes of `eqt_cli` itself. A name is imported when it is asked for: what
runs an experiment loads nothing that verifies or compares results.
"""

from functools import partial

from eqt_cli.core.offered_names import asked, places

_PLACES = places(__name__)

__all__ = sorted(_PLACES)
__getattr__ = partial(asked, __name__, _PLACES)


def __dir__() -> list[str]:
    return [*globals(), *__all__]
