"""The Python API, which the commands use too: a module for each purpose.

All its names are also attributes of `eqt_cli` itself, whose table `STABLE` has those that stay;
the others are provisional. Each name is imported when it is first used, so that running an
experiment does not load the code that verifies or compares results.
"""

from eqt_cli.base.extensions import lazily

__all__, __getattr__, __dir__ = lazily(__name__)
