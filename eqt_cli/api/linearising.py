"""Computes how far the loops of an experiment are from instability."""

from __future__ import annotations

from eqt_cli.analysis.margins import Margins, margins_of
from eqt_cli.api.loading import Configuration, LoadedExperiment, at_point, load_experiment


def margins(
    target: LoadedExperiment | Configuration,
    *,
    point: int | None = None,
    trust_plugins: bool = False,
) -> Margins:
    """Compute eigenvalues, delay margin and gain margins of the loop of every law.

    Loops are linearised about their reference, with the hold, the delay and the linear parts of the
    actuators. Limits, steps and noise are left out. Nothing is run.

    Parameters
    ----------
    target
        From `load_experiment`, or what that takes.
    point
        Of a sweep, counted from 0; the first if not given.
    trust_plugins
        Execute plugin sources that are stored in a result file.

    Returns
    -------
    Margins
        Its ``laws`` have a `growth`, a `delay` and `gains` each, and ``is_indicative``: whether the
        loop, to first order, depends on the time, so that these numbers decide nothing.

    Raises
    ------
    ConfigError
        With every problem of the configuration, each at its place.
    EqtError
        If there is no such file, or a loop cannot be differentiated.

    Examples
    --------
    >>> [law] = eqt_cli.margins(
    ...     {
    ...         "group": "SO2",
    ...         "inertia": 0.4,
    ...         "gains": {"kp": 1.0, "kd": 0.8},
    ...         "reference": {"kind": "constant"},
    ...         "controllers": ["eqt"],
    ...         "time": {"duration": 10},
    ...     }
    ... ).laws
    >>> law.growth.is_stable, round(law.delay, 4)
    (True, 0.3043)
    """
    if not isinstance(target, LoadedExperiment):
        target = load_experiment(target, trust_plugins=trust_plugins)
    return margins_of(at_point(target, point))
