"""Everything that a plugin needs, from one place: base classes, shipped components, functions.

From version 0.1.0 on, these names stay, also for plugins whose source is kept in a result.
``extend.pyi`` lists them: the base class of each kind, the laws and other components that a plugin
may build on, array functions, numbers and errors.
"""

from eqt_cli.base.extensions import lazily

__all__, __getattr__, __dir__ = lazily(__name__)
