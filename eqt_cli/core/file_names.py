"""Names of files that every system takes."""

import re

_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE | re.ASCII)
"""What Windows keeps for its devices, with any ending."""


def is_device(name: str) -> bool:
    """Whether a file of this name would be a device on Windows."""
    return _DEVICE.fullmatch(name) is not None


def file_name(text: str, otherwise: str) -> str:
    """A text as the name of a file: what it must not have becomes a hyphen.

    Parameters
    ----------
    otherwise
        The name where nothing is left of the text, and what begins that of a device.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._") or otherwise
    return f"{otherwise}-{name}" if is_device(name) else name
