"""Everything that a plugin needs, from one place: base classes, shipped components, functions.

From version 0.1.0 on, these names stay, also for plugins whose source is kept in a result.
``extend.pyi`` lists them: the base class of each kind, the laws and other components that a plugin
may build on, array functions, numbers and errors.
"""

from functools import partial

from eqt_cli import imported, places

PLACES = places(__name__)
"""The modules of the names."""

__all__ = sorted(PLACES)
__getattr__ = partial(imported, __name__, PLACES)


def __dir__() -> list[str]:
    return __all__
