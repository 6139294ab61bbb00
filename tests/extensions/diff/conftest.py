"""The command line with a small configuration, as in the tests of commands."""

from tests.cli.conftest import _kept, eqt, folder, result  # noqa: F401
