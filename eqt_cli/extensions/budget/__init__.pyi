from eqt_cli.extensions.budget.api import error_budget as error_budget
