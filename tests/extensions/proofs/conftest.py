"""Commands in a folder with a small configuration."""

import pytest
from small_experiment import configuration


@pytest.fixture
def folder(folder, monkeypatch):
    """The current folder, with a small configuration in it."""
    monkeypatch.setenv("NO_COLOR", "1")
    (folder / "c.yaml").write_text(configuration(), encoding="utf-8")
    return folder


@pytest.fixture
def eqt(eqt, folder):
    """Calls the command within this process, in this folder."""
    return eqt
