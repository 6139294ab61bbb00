"""Configurations of vehicles from files, read as data."""

import pytest

from eqt_cli.base.yaml_source import load
from eqt_cli.extensions.vehicles import child, contained
from eqt_cli.extensions.vehicles.vehicle_file import configuration_of


@pytest.fixture
def imported(tmp_path):
    """Writes a file, and returns the text and the data of its configuration."""

    def read(text, name="model.sdf", **options):
        path = tmp_path / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
        written, _ = configuration_of(path, bandwidth=5.0, **options)
        return written, load(written, "mine.yaml").data

    return read


@pytest.fixture
def without_process(monkeypatch):
    """Let xacro and MuJoCo read files here: to start a process takes longer than a test may."""

    def answer(kind, request):
        read = child.expanded_by_xacro if kind == "xacro" else child.vehicle_by_mujoco
        return read(request)

    monkeypatch.setattr(child, "_limit_time_and_memory", lambda: None)
    monkeypatch.setattr(contained, "answer", answer)
