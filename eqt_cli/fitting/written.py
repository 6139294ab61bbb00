"""Writes the configuration of a fit, with the fitted numbers, to a folder."""

from pathlib import Path

from eqt_cli.core.errors import OTHER_FOLDER
from eqt_cli.core.files import refusals
from eqt_cli.core.own_files import FOUND_BY, check_entries, check_within, foreign, is_eqts
from eqt_cli.execution.folder import OWN_COPIES, ResultFolder
from eqt_cli.experiment.read_study import study
from eqt_cli.fitting.plant_fit import PlantFit

FITTED = "fitted.yaml"


def check_folder(folder: Path) -> None:
    """Refuse a folder in which the configuration cannot be written, before any work.

    Raises
    ------
    EqtError
        If an entry is a link, or a file of this name that eqt did not write.
    """
    path = folder / FITTED
    with refusals(path, "written", OTHER_FOLDER):
        check_entries(folder, OWN_COPIES)
        check_within(folder, path)
        if path.exists() and not is_eqts(path):
            raise foreign(path, "another file", "a configuration")


def write_fitted(result: PlantFit, folder: Path) -> Path:
    """Write the complete configuration, and beside it the files it refers to; return its path."""
    path, mark = folder / FITTED, FOUND_BY.format("fit")
    with refusals(path, "written", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        ResultFolder(folder).write_config(
            study(result.source, trust_plugins=True), path.name, mark.encode()
        )
    return path
