"""What commands that show a result say of its certificates; it knows no single command."""

from __future__ import annotations

from typing import TYPE_CHECKING

from eqt_cli.cli import options

if TYPE_CHECKING:
    from eqt_cli.analysis.certificates import Row
    from eqt_cli.store.reader import Results


def certificates(results: Results, trust_plugins: bool) -> list[Row]:
    """What the verification of an open result finds.

    Raises
    ------
    EqtError
        If the result cannot be verified.
    """
    from eqt_cli.experiment.build import build
    from eqt_cli.experiment.source import source_of
    from eqt_cli.experiment.verify import verify_results

    experiment = build(source_of(results), trust_plugins=trust_plugins)
    return verify_results(experiment, results, options.cores()).rows
