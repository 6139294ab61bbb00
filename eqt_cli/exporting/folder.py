"""Writes exported laws into a folder, and replaces only files that eqt has exported before."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import refusals
from eqt_cli.core.own_files import check_within, is_eqts
from eqt_cli.core.replacement import replace_file


def check_folder(folder: Path) -> None:
    """Refuse a folder that cannot be made or written to, before any work is done.

    Raises
    ------
    EqtError
        If the folder cannot be made or written to; it says what is there instead.
    """
    with refusals(folder, "written to", OTHER_FOLDER):
        there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
        if not there.is_dir():
            raise NotADirectoryError("not a directory")
        if not os.access(there, os.W_OK | os.X_OK):
            raise PermissionError("permission denied")


def write_into(folder: Path, files: Mapping[str, str]) -> None:
    """Write files into a folder.

    Raises
    ------
    EqtError
        If one of these names is a link, a folder, or a file that eqt did not export; nothing is
        written then.
    """
    for name in files:
        path = folder / name
        with refusals(path, "written", OTHER_FOLDER):
            check_within(folder, path)
            if path.exists() and not is_eqts(path):
                raise EqtError(
                    f"{path}: exists, and was not exported by eqt",
                    Remedy("choose another folder with {}", "out"),
                )
    with refusals(folder, "written to", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        for name, text in files.items():
            replace_file(folder / name, text.encode())
