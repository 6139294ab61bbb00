"""`eqt_cli.error_budget`: the budget of a configuration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from eqt_cli.api.loading import Configuration, load_experiment
from eqt_cli.api.running import choose_executor
from eqt_cli.extensions.budget.budget import SHARES, Budget, budget
from eqt_cli.results.quantity import Window


def error_budget(
    config: Configuration,
    overrides: Mapping[str, Any] | None = None,
    *,
    error: str = "",
    window: str = "",
    shares: Sequence[float] = SHARES,
    total: bool = False,
    workers: int = 1,
) -> Budget:
    """Return what each imperfection of an experiment costs, alone and with the others.

    Parameters
    ----------
    config, overrides
        As for `load_experiment`.
    error
        ``attitude_angle``, ``pointing_error``, ``position_error`` or ``heading_error``. Default:
        the first of them that the loops have.
    window
        ``START:STOP`` in s. Default: that of `measure`, or the whole horizon.
    shares
        Quantiles to tell, such as 0.997.
    total
        Whether the whole loop alone is computed, without what each source costs.
    workers
        Number of processes.

    Returns
    -------
    Budget
        With `laws`, each with `rows`, `total` and `quantiles`.

    Raises
    ------
    EqtError
        If there is nothing to switch off, too few runs, or runs fail.

    Examples
    --------
    >>> few = {"ensemble.runs": 5, "controllers": ["gt"], "time.duration": 5, "time.samples": 51}
    >>> made = eqt_cli.error_budget("configs/satellite_wheels.yaml", few)
    >>> sorted(row.source.key for row in made.laws[0].rows if row.beside)[0]
    'actuators[0]'
    """
    base = load_experiment(config, overrides)
    executor = choose_executor(base, workers, "auto", {})
    over = Window.parse(window) if window else None
    return budget(base, executor, error=error, window=over, shares=shares, total=total)
