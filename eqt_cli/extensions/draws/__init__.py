"""Draws that hang together: names whose numbers each run draws, for formulas of the plant."""

from eqt_cli.base import purposes
from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function(purposes.draws, "formulas.with_formulas")
    extension.add_function(purposes.starts_of_draws, "starts.drawn_start")
    extension.add_function(purposes.variables_of_a_result, "stored.variables")
    extension.add_function(purposes.checks_of_an_experiment, "checks.check_draws")
    extension.add_function(purposes.remarks_on_an_experiment, "remarks.remarks")
    extension.add_function(purposes.remarks_on_other_values, "remarks.remark_elsewhere")
