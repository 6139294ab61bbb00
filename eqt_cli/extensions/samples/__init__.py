"""Samples of a result: how much its metrics err where samples are far apart."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.errors_of_a_result, "row_errors.row_errors")
    extension.add_function(purposes.remarks_on_a_result, "unjudged.remarks")
    extension.add_function(purposes.meaning_of_an_experiment, "skipped_ticks.skipped_ticks")
