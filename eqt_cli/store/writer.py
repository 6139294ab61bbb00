"""Writing a table to an HDF5 file in one step that either happens or does not."""

from pathlib import Path
from typing import Literal

from eqt_cli.store.piecewise_writer import assemble
from eqt_cli.store.table import Table


def write(
    path: str | Path,
    table: Table,
    compression: Literal["gzip"] | None = None,
) -> None:
    """Write `table` to the HDF5 file `path`, replacing what is there; equal tables, equal bytes.

    Parameters
    ----------
    path
        The file; its folder must exist.
    table
        What to store.
    compression
        As for `eqt_cli.store.piecewise_writer.assemble`.

    Raises
    ------
    ResultError
        If the disk refuses; `path` is then as it was before.
    """
    sizes, coordinates = table.dimensions, table.coordinates
    with assemble(path, sizes, coordinates, table.variables, compression) as file:
        file.describe(table.attributes)
