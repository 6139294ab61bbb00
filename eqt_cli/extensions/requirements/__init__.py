"""Requirements: whether each law keeps a bound in a share of runs or of time, and how sure."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_keys("keys.Keys")
    extension.add_function(purposes.checks_of_an_experiment, "reading.check")
    extension.add_function(purposes.errors_of_a_result, "margins.stored_margins")
    extension.add_function(purposes.answers_of_a_result, "answers.answers")
