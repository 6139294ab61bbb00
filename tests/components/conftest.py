"""Experiments from text."""

import pytest

from eqt_cli.config.document import read_config
from eqt_cli.config.study import study


@pytest.fixture
def experiment_of(tmp_path):
    """The experiment of a configuration in text."""

    def build(text):
        path = tmp_path / "flight.yaml"
        path.write_text(text, encoding="utf-8")
        return study(read_config(path)).base

    return build
