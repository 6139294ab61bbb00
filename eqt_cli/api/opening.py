"""Opens a result with eqt's reader or with xarray."""

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
        ``"xarray"`` for an `xarray.Dataset`, ``"arrays"`` for eqt's reader, which needs no other
        package. Default: ``"xarray"`` if xarray is installed, else ``"arrays"``.
    point
        Point of a sweep, counted from 0, to open as the result of a single experiment. Without a
        point, an `xarray.Dataset` of a sweep whose points differ in shape holds only the metrics
        that all points have.

    Returns
    -------
    xarray.Dataset or Result
        Both read values from the file only when you use them. Use a ``with`` block to close them.

    Raises
    ------
    ResultError
        If the result or the point does not exist, or the file is damaged or unsafe.
    EqtError
        If ``kind`` is ``"xarray"`` and the extra ``xarray`` is not installed.

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
            "xarray is not installed (extra xarray): pip install xarray h5netcdf, or open with "
            "kind='arrays'"
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
