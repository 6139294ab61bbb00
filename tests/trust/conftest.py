"""A folder that a colleague sent, in which everything is hostile, and the commands that meet it."""

import pytest

CONFIG = """\
group: SO3
inertia: 1.0
gains: {kp: 1.0, kd: 0.5}
reference: {torque: [0, 0, 0]}
controllers: [eqt]
initial: {pose: haar}
ensemble: {runs: 2, seed: 1}
time: {duration: 0.1, samples: 2}
solver: {rtol: 1.0e-3, cross_check: 0}
"""


@pytest.fixture
def sent(tmp_path, monkeypatch):
    """The colleague's folder, which is the current one; beside it lies what is the user's."""
    folder = tmp_path / "sent"
    folder.mkdir()
    monkeypatch.chdir(folder)
    (folder / "c.yaml").write_text(CONFIG, encoding="utf-8")
    return folder


@pytest.fixture
def eqt(eqt):
    """Calls the command within this process; no error is a traceback."""

    def call(*arguments):
        done = eqt(*arguments)
        assert "Traceback" not in done.err
        return done

    return call
