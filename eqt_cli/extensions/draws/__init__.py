"""Draws that hang together: names whose numbers each run draws, for formulas of the plant."""

from eqt_cli.base.extensions import Extension


def register(extension: Extension) -> None:
    """Name what the extension adds."""
    extension.add_function("draws", "formulas.with_formulas")
    extension.add_function("starts of draws", "starts.drawn_start")
    extension.add_function("variables of a result", "stored.variables")
    extension.add_function("checks of an experiment", "checks.check_draws")
    extension.add_function("remarks on an experiment", "checks.remarks")
    extension.add_function("remarks on other values", "checks.remark_elsewhere")
