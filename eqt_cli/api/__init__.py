"""The Python API, which the commands use too: a module for each purpose.

Its functions are also attributes of `eqt_cli` itself. Each name is imported when it is first used,
so that running an experiment does not load the code that verifies or compares results.
"""

from eqt_cli import lazily

__all__, __getattr__, __dir__ = lazily(__name__)
