"""Reads the zip of a pack within bounds of what is read, whatever the zip says of itself.

The sizes in a zip are claims: a member of some kilobytes may hold gigabytes. So members are read
piece by piece, and what they hold is counted.
"""

from __future__ import annotations

import io
import struct
import zipfile
import zlib
from pathlib import Path

from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.base.files import content_of, refusals

MOST_BYTES = 16_000_000
"""Largest size of a file, and of all that it holds, bytes."""

MOST_MEMBERS = 10_000
"""Largest number of parts; the archive of 12 laws on 6 tasks has 71."""

_PIECE = 2**16
_ENTRY = b"PK\1\2"
"""What stands before the name of each part in the directory of a zip."""

_METHODS = (zipfile.ZIP_STORED, zipfile.ZIP_DEFLATED)
"""Methods that give no more at a time than was asked for; Python's bzip2 gives all it has."""

_ENCRYPTED = 1
"""Bit of the flags of a part."""


def members(path: Path) -> dict[str, bytes]:
    """Return the parts of a zip by their names.

    Raises
    ------
    EqtError
        If the file cannot be read.
    InputError
        If it is no zip, damaged, or holds more or others than a pack may.
    """
    with refusals(path, "read", "give the archive or a pack of a suite"):
        content = content_of(path, MOST_BYTES)
    if content.count(_ENTRY) > MOST_MEMBERS:
        raise InputError(f"it has more than {MOST_MEMBERS:,} parts")
    try:
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            return _read(packed)
    except EqtError:
        raise
    except (zipfile.BadZipFile, EOFError, NotImplementedError):
        raise InputError("it is no zip, or damaged") from None
    except (zlib.error, struct.error, OSError, ValueError, RuntimeError, IndexError):
        raise InputError("it is damaged") from None


def _read(packed: zipfile.ZipFile) -> dict[str, bytes]:
    parts, left = dict[str, bytes](), MOST_BYTES
    for info in packed.infolist():
        name = info.filename
        if name in parts:
            raise InputError(f"it has two parts {name!r}")
        if info.flag_bits & _ENCRYPTED:
            raise InputError(f"{name!r} is encrypted")
        if info.compress_type not in _METHODS:
            raise InputError(f"{name!r} is compressed by another method than deflate")
        pieces = list[bytes]()
        with packed.open(info) as stream:
            while piece := stream.read(_PIECE):
                left -= len(piece)
                if left < 0:
                    raise InputError(f"it holds more than {MOST_BYTES / 1e6:g} MB")
                pieces.append(piece)
        parts[name] = b"".join(pieces)
    return parts
