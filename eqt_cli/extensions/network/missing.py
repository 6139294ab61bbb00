"""A network that is not there: all else was checked, and no command flies it."""

from __future__ import annotations

from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.errors import Problems
from eqt_cli.extensions.network.steps import MISSING


@purposes.checks_of_an_experiment
def check_files(experiment: Any, problems: Problems) -> None:
    """Note files of networks that are not there."""
    document = experiment.document
    for file in (name for name, text in document.home.files.items() if text == MISSING):
        laws = enumerate(document.data.get("controllers") or ())
        places = [k for k, law in laws if isinstance(law, dict) and law.get("file") == file]
        at = problems.at("controllers", *places[:1], *(["file"] if places else []))
        at.add(
            f"{file}: not found, and all else of the law was checked; if it is not trained yet, "
            "train it by eqt_cli.gym.make, which needs no file"
        )
