"""Tells which files eqt has written, by the marks that it leaves in them."""

import re
from pathlib import Path

_HEAD = 4096
"""Bytes at the start of a file in which its mark stands; in a PDF file it may stand anywhere."""

_MARKS = (
    re.compile(rb'<!DOCTYPE html>.*?<meta name="generator" content="eqt ', re.DOTALL),
    re.compile(rb"<\?xml.*?<dc:title>eqt ", re.DOTALL),
    re.compile(rb"\x89PNG.*?Software\0eqt ", re.DOTALL),
    re.compile(rb"GIF8.*?!\xfe.eqt ", re.DOTALL),
    re.compile(rb'\[\n(\{"panel": |\n\])'),  # the numbers of a figure
)
_PDF, _PDF_MARK = b"%PDF", b"/Creator (eqt "


def is_eqts(path: Path) -> bool:
    """Whether a file is a picture, a page or the numbers of a figure that eqt has written.

    Raises
    ------
    OSError
        If it cannot be read.
    """
    if not path.is_file():
        return False
    with path.open("rb") as stream:
        head = stream.read(_HEAD)
        if head.startswith(_PDF):
            return _PDF_MARK in head + stream.read()
    return any(mark.match(head) for mark in _MARKS)
