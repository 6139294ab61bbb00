"""What every executor must do, whoever wrote it; tests/config has what is particular to each."""

import pytest

from eqt_cli.base.reporting import step
from eqt_cli.extend import EqtError
from eqt_cli.runs.executors import Outcome

# In a file of its own, where spawned processes find it.
TASK = """
import os, time
from pathlib import Path

from eqt_cli.base.errors import EqtError


class Task:
    def __init__(self, folder):
        self.folder = folder

    def runs_of(self, item):
        return 10

    def origin(self):
        return {"machine": "here"}

    def __call__(self, item, ways):
        assert ways.threads >= 1
        Path(self.folder, f"{item}-{os.getpid()}-{time.monotonic_ns()}").touch()
        if item == 99:
            raise EqtError("no")
        ways.progress(4)
        ways.progress(6)
        return item % 2
"""


@pytest.fixture
def task(tmp_path, monkeypatch):
    code, done = tmp_path / "code", tmp_path / "done"
    code.mkdir()
    done.mkdir()
    name = f"contract_task_of_{tmp_path.name}"
    (code / f"{name}.py").write_text(TASK, encoding="utf-8")
    monkeypatch.syspath_prepend(code)
    monkeypatch.setenv("PYTHONPATH", str(code), prepend=":")
    return __import__(name).Task(str(done))


@pytest.fixture
def executor(executor_class):
    return executor_class(2)


def test_every_item_is_done_once_and_progress_sums_up(executor, task, tmp_path, told):
    items = [1, 2, 3, 4]
    with step("runs", 40):
        found = list(executor.outcomes(task, items))
    assert sorted(found, key=lambda o: o.item) == [Outcome(k, k % 2) for k in items]
    done = [path.name.partition("-")[0] for path in (tmp_path / "done").iterdir()]
    assert sorted(done) == ["1", "2", "3", "4"]
    assert told.total("runs") == 40


def test_nothing_to_do_is_done(executor, task):
    assert list(executor.outcomes(task, [])) == []


def test_an_error_of_the_task_ends_everything(executor, task):
    with pytest.raises(EqtError, match=r"^no$"):
        list(executor.outcomes(task, [99]))


@pytest.mark.parametrize("items", [1, 3, 8])
def test_it_takes_some_items_at_a_time(executor, items):
    assert 1 <= executor.at_once(items, 10.0) <= items
    assert executor.threads_for(items) >= 1
