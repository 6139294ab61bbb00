"""Computes the stability margins of the loops of an experiment."""

from __future__ import annotations

from eqt_cli.analysis.margins import Margins, margins_of
from eqt_cli.api.loading import Configuration, experiment_at
from eqt_cli.experiment.study import Study


def margins(
    target: Study | Configuration, *, point: int | None = None, trust_plugins: bool = False
) -> Margins:
    """Compute eigenvalues, delay margin and gain margins of the loop of every law.

    Loops are linearised about their reference, with the hold, the delay and the linear parts of the
    actuators. Limits, quantisation and noise are left out. No run is simulated.

    Parameters
    ----------
    target
        A `Study` from `load_experiment`, or a configuration as `load_experiment` takes it.
    point
        Point of a sweep, counted from 0. Default: the first.
    trust_plugins
        Whether to execute plugin sources that are stored in a result file.

    Returns
    -------
    Margins
        Each of its ``laws`` has ``growth``, ``delay``, ``gains`` and ``is_indicative``: whether the
        linearised loop depends on time, so that these numbers prove nothing.

    Raises
    ------
    ConfigError
        With all problems of the configuration and their places.
    EqtError
        If the file does not exist, or a loop cannot be differentiated.

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
    return margins_of(experiment_at(target, point, trust_plugins=trust_plugins))
