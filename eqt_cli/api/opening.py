"""Opens a result for its numbers, in eqt's own reader or in xarray."""

from __future__ import annotations

import os
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Literal, overload

from eqt_cli.core.errors import EqtError
from eqt_cli.results.result import Result, open_result
from eqt_cli.store.reserved_names import point_group

if TYPE_CHECKING:
    import xarray


@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["xarray"], point: int | None = None
) -> xarray.Dataset: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: Literal["arrays"], point: int | None = None
) -> Result: ...
@overload
def open_results(
    path: str | os.PathLike[str], kind: None = None, point: int | None = None
) -> xarray.Dataset | Result: ...


def open_results(
    path: str | os.PathLike[str],
    kind: Literal["xarray", "arrays"] | None = None,
    point: int | None = None,
) -> xarray.Dataset | Result:
    """Open a result, after checking that its file is safe to read.

    Parameters
    ----------
    path
        The result folder, or the file in it.
    kind
        ``"xarray"`` for an `xarray.Dataset`, ``"arrays"`` for eqt's own reader, which needs nothing
        installed; if not given, the first where xarray is installed, and else the second.
    point
        Of a sweep, counted from 0: that one as the result of a single experiment. Without it, an
        `xarray.Dataset` of a sweep whose points differ in shape holds what they have in common.

    Returns
    -------
    xarray.Dataset or Result
        Both read values when they are asked for, and are closed by a ``with`` block.

    Raises
    ------
    ResultError
        If there is no such result or point, or its file is damaged or not safe.
    EqtError
        If an `xarray.Dataset` is asked for and the extra ``xarray`` is not installed.

    Examples
    --------
    >>> with eqt_cli.open_results("results/paper", "arrays") as result:
    ...     torque = result.read("torque_norm", controller="eqt")
    ...     print(result.labels, torque.shape[-1] == len(result.times))
    ['eqt', 'gt', 'nog', 'asym'] True
    """
    if kind not in (None, "xarray", "arrays"):
        raise EqtError(f"kind {kind!r}: expected 'xarray', 'arrays' or None")
    installed = find_spec("xarray") is not None and find_spec("h5netcdf") is not None
    if kind == "arrays" or (kind is None and not installed):
        return open_result(Path(path), point)
    if not installed:
        raise EqtError(
            "xarray is not installed: pip install xarray h5netcdf, or open with kind='arrays'"
        )
    import xarray

    with open_result(path) as checked:
        file, in_group = checked.path, checked.has_groups
        attributes = None if point is None else dict(checked.point(point).attributes)
    if point is None or attributes is None:
        return xarray.open_dataset(file, engine="h5netcdf")
    group = point_group(point) if in_group else None
    opened = xarray.open_dataset(file, engine="h5netcdf", group=group)
    found = (opened if in_group else opened.isel(point=point)).assign_attrs(attributes)
    found.set_close(opened.close)
    return found
