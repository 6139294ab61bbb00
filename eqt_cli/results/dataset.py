"""The numbers of a result as a tidy table."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from eqt_cli.base.errors import printable
from eqt_cli.base.reporting import pandas_frame
from eqt_cli.base.stored import POINT
from eqt_cli.results.result import Result

if TYPE_CHECKING:
    import pandas


def columns(result: Result, names: Sequence[str] | None = None) -> dict[str, np.ndarray[Any, Any]]:
    """Return the numbers of every run as columns: (point, swept keys,) controller, run, status, ….

    Parameters
    ----------
    names
        Names of metrics. Default: all that `Result.comparable` has.

    Returns
    -------
    dict
        Columns of equal length. A metric is NaN if the run failed or has no such number.
    """
    places = dict(zip(result.dims("status"), np.indices(result.status.shape), strict=True))
    arrays: dict[str, np.ndarray[Any, Any]] = {}
    if POINT in places:
        arrays[POINT] = places[POINT].ravel()
    for name in result.coordinates:
        if name != POINT and result.dims(name) == (POINT,):
            values = result.coordinate(name)[places[POINT]].ravel()
            if values.dtype == object:
                shown = [printable(v) if isinstance(v, str) else v for v in values]
                values = np.array(shown, dtype=object)
            arrays[name] = values
    arrays["controller"] = np.array(result.labels, dtype=object)[places["controller"]].ravel()
    arrays |= {"run": places["run"].ravel(), "status": result.status.ravel()}
    for name in result.comparable if names is None else names:
        arrays[name] = result.metric(name).ravel()
    return arrays


def frame(result: Result, names: Sequence[str] | None = None) -> pandas.DataFrame:
    """Return `columns` as a DataFrame, whose ``attrs["units"]`` has the unit of each metric.

    Raises
    ------
    EqtError
        If pandas is not installed, or there is no such metric.
    """
    table = pandas_frame(columns(result, names))
    wanted = result.comparable if names is None else names
    table.attrs["units"] = {name: result.units(name) for name in wanted}
    return table
