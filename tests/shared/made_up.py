"""Result files of made-up data, for what reads them."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from eqt_cli.base.store_writer import Variable, assemble


@dataclass(frozen=True, eq=False)
class Table:
    """Variables that share dimensions, with their coordinates and common attributes."""

    variables: Mapping[str, Variable]
    coordinates: Mapping[str, Variable] = field(default_factory=dict)
    attributes: Mapping[str, Any] = field(default_factory=dict)

    def __getitem__(self, name):
        return self.variables[name].data

    @property
    def dimensions(self):
        """The size of every dimension, those with coordinates first."""
        return {
            dim: size
            for variable in (*self.coordinates.values(), *self.variables.values())
            for dim, size in zip(variable.dims, variable.data.shape, strict=True)
        }


def write(path, table, compression=None):
    """Write a result file; equal tables give equal bytes."""
    sizes, coordinates = table.dimensions, table.coordinates
    with assemble(path, sizes, coordinates, table.variables, compression) as file:
        file.describe(table.attributes)
