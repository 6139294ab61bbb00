"""Writes a table to an HDF5 file, completely or not at all."""

from pathlib import Path
from typing import Literal

from eqt_cli.store.piecewise_writer import assemble
from eqt_cli.store.table import Table


def write(
    path: str | Path,
    table: Table,
    compression: Literal["gzip"] | None = None,
) -> None:
    """Write `table` to the HDF5 file `path`, and replace an old one; equal tables give equal bytes.

    Parameters
    ----------
    path
        The file; its folder must exist.
    table
        The data.
    compression
        As in `eqt_cli.store.piecewise_writer.assemble`.

    Raises
    ------
    ResultError
        If the file cannot be written; `path` is then unchanged.
    """
    sizes, coordinates = table.dimensions, table.coordinates
    with assemble(path, sizes, coordinates, table.variables, compression) as file:
        file.describe(table.attributes)
