"""File names that are valid on every operating system."""

import re

_DEVICE = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE | re.ASCII)
"""Names that Windows reserves for devices, with any suffix."""


def is_device(name: str) -> bool:
    """Whether a file of this name would be a device on Windows."""
    return _DEVICE.fullmatch(name) is not None


def file_name(text: str, otherwise: str) -> str:
    """Return a text as a file name, with a hyphen for each run of invalid characters.

    Parameters
    ----------
    otherwise
        The name where no valid character is left, and the prefix to the name of a device.
    """
    name = re.sub(r"[^A-Za-z0-9._-]+", "-", text).strip("-._") or otherwise
    return f"{otherwise}-{name}" if is_device(name) else name
