"""The names that a result file reserves for itself; it must not know what the file is about."""

import re

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.@+-]*")
"""What variables, dimensions and attributes may be called; all tools that read HDF5 take these."""

FORMAT = 1
"""Number of the file layout; a reader refuses every other number."""

FORMAT_ATTRIBUTE = "eqt_format"
"""The root attribute that marks a file as one of eqt's, and holds its `FORMAT`."""

VERSION_ATTRIBUTE = "eqt_version"
"""The root attribute with the version of eqt that wrote the file, of a fixed length."""

FILE_NAME = "results.h5"
"""The name of the result file in a result folder."""

PLACEHOLDER = "This is a netCDF dimension but not a netCDF variable."
"""How netCDF-4 labels the scale of a dimension that has a size but no coordinate values."""

POINT = "point"
"""The dimension along which a sweep has its points."""

POINT_GROUP = re.compile(r"point_(0|[1-9][0-9]*)")
"""The groups of a sweep whose points differ in shape: one for each, and no others."""

COORDINATES = "coordinates"
"""The CF attribute that names the further coordinates of a variable, separated by blanks."""

RESERVED = frozenset(
    {
        FORMAT_ATTRIBUTE,
        VERSION_ATTRIBUTE,
        COORDINATES,
        "CLASS",
        "DIMENSION_LABELS",
        "NAME",
        "DIMENSION_LIST",
        "REFERENCE_LIST",
        "_Netcdf4Dimid",
        "_Netcdf4Coordinates",
        "_NCProperties",
        "_nc3_strict",
    }
)
"""Attribute names that carry the structure of the file; they are never a user's attributes."""


def point_group(point: int) -> str:
    """The name of the group of a point."""
    return f"{POINT}_{point}"
