"""Everything that a plugin needs, from one place: base classes, array functions, numbers, errors.

From version 0.1.0 on, these names stay, also for plugins whose source is kept in a result.
``extend.pyi`` lists them. A plugin that is built upon a component of eqt imports that from its own
file, which is called as the component is: ``from eqt_cli.controllers.eqt import EqT``.
"""

from functools import partial

from eqt_cli.core.offered_names import imported, places

PLACES = places(__name__)
"""The modules of the names."""

__all__ = sorted(PLACES)
__getattr__ = partial(imported, __name__, PLACES)


def __dir__() -> list[str]:
    return __all__
