"""A small configuration in the current folder, and its result."""

import pytest
from small_experiment import configuration


@pytest.fixture
def config(folder, monkeypatch):
    monkeypatch.setenv("NO_COLOR", "1")
    (folder / "c.yaml").write_text(configuration(), encoding="utf-8")
    return "c.yaml"


@pytest.fixture
def result(eqt, config):
    eqt("run", config, "--out", "out", "--quiet")
    return "out"
