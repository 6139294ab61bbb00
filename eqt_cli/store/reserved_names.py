"""Names that the layout of a result file reserves."""

import re

NAME = re.compile(r"[A-Za-z_][A-Za-z0-9_.@+-]*")
"""Valid names of variables, dimensions and attributes, which all HDF5 tools accept."""

FORMAT = 1
"""Number of the file layout; a reader refuses every other number."""

FORMAT_ATTRIBUTE = "eqt_format"
"""The root attribute that marks a file as eqt's and holds its `FORMAT`."""

VERSION_ATTRIBUTE = "eqt_version"
"""The root attribute with the version of eqt that wrote the file, a string of fixed length."""

FILE_NAME = "results.h5"
"""The name of the result file in a result folder."""

PLACEHOLDER = "This is a netCDF dimension but not a netCDF variable."
"""Label of netCDF-4 for the scale of a dimension with a size but without coordinate values."""

POINT = "point"
"""The dimension of a sweep's points."""

POINT_GROUP = re.compile(r"point_(0|[1-9][0-9]*)")
"""Names of the groups of points, one for each, in a sweep whose points differ in shape."""

COORDINATES = "coordinates"
"""The CF attribute that names further coordinates of a variable, separated by blanks."""

_OF_HDF5 = "CLASS NAME DIMENSION_LABELS DIMENSION_LIST REFERENCE_LIST".split()
_OF_NETCDF = "_Netcdf4Dimid _Netcdf4Coordinates _NCProperties _nc3_strict".split()
RESERVED = {FORMAT_ATTRIBUTE, VERSION_ATTRIBUTE, COORDINATES, *_OF_HDF5, *_OF_NETCDF}
"""Attributes that hold the structure of the file, and are never a user's."""


def point_group(point: int) -> str:
    """Return the name of the group of a point."""
    return f"{POINT}_{point}"
