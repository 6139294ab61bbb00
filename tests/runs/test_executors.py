import multiprocessing
import os
import signal
import subprocess
import sys
import time
from concurrent.futures import Future, ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path

import pytest
from case_tables import from_yaml
from said import error_of, says

from eqt_cli import api
from eqt_cli.api import choose_executor, load_experiment
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.process import STOP_SIGNALS, Interrupted, as_exceptions
from eqt_cli.base.reporting import Reporter, reporting, step
from eqt_cli.cli.options import Setup
from eqt_cli.cli.run import executor_from
from eqt_cli.results.result import open_result
from eqt_cli.runs import executors as auto
from eqt_cli.runs.executors import MOST_TRIES, Auto, Local, Outcome, Pool, Pooled, Serial, executors

# In a file of its own, where spawned processes find it.
TASK = """
import os, signal, time
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
        with open(Path(self.folder) / f"{item}-{os.getpid()}-{time.monotonic_ns()}", "w"):
            pass
        if item in (13, 17) and (item == 13 or self._tries(item) == 1):
            os.kill(os.getpid(), signal.SIGKILL)
        if item == 99:
            raise EqtError("no")
        while item == 1000:
            ways.progress(0.001)
            time.sleep(0.001)
        ways.progress(4)
        return item % 2

    def _tries(self, item):
        return len(list(Path(self.folder).glob(f"{item}-*")))
"""

POSIX = pytest.mark.skipif(not hasattr(signal, "SIGKILL"), reason="has no SIGKILL")


@pytest.fixture
def task(tmp_path, monkeypatch):
    code = tmp_path / "code"
    code.mkdir()
    name = f"task_of_{tmp_path.name}"
    (code / f"{name}.py").write_text(TASK, encoding="utf-8")
    monkeypatch.syspath_prepend(code)
    monkeypatch.setenv("PYTHONPATH", str(code), prepend=":")
    done = tmp_path / "done"
    done.mkdir()
    return __import__(name).Task(str(done))


@pytest.fixture(autouse=True)
def ends():
    """A test that waits for ever fails, and again while it cleans up."""

    def fails(*_):
        raise TimeoutError("no end within two minutes")

    if hasattr(signal, "SIGALRM"):
        before = signal.signal(signal.SIGALRM, fails)
        signal.setitimer(signal.ITIMER_REAL, 120, 20)
    yield
    if hasattr(signal, "SIGALRM"):
        signal.setitimer(signal.ITIMER_REAL, 0)
        signal.signal(signal.SIGALRM, before)


@POSIX
def test_a_lost_worker_costs_its_item_only_which_is_tried_again(task, tmp_path):
    found = list(Local(2).outcomes(task, [1, 17, 3]))
    assert sorted(o.item for o in found) == [1, 3, 17]
    assert all(o.value == 1 for o in found)
    assert len(list((tmp_path / "done").glob("17-*"))) == 2
    assert len(list((tmp_path / "done").glob("1-*"))) == 1


@pytest.mark.ci("starts processes")
@POSIX
def test_an_item_that_loses_its_worker_again_and_again_is_given_up(task, tmp_path, told):
    with step("runs", 40):
        found = list(Local(1).outcomes(task, [13, 2]))
    assert sorted(found, key=lambda o: o.item) == [Outcome(2, 0), Outcome(13, None)]
    assert len(list((tmp_path / "done").glob("13-*"))) == MOST_TRIES
    assert told.total("runs") == 10  # of the good item alone


@POSIX
def test_a_worker_that_dies_between_items_is_replaced(task, tmp_path):
    with Local(1).opened(tmp_path) as opened:
        assert list(opened.outcomes(task, [2])) == [Outcome(2, 0)]
        [pool] = opened.pool.engine.pools.values()
        [worker] = pool._processes.values()
        worker.kill()
        pool._executor_manager_thread.join(10)  # which marks the pool as broken
        assert list(opened.outcomes(task, [4])) == [Outcome(4, 0)]


def test_workers_end_when_nobody_listens_any_more(task):
    outcomes = executors.get("local")(2).outcomes(task, list(range(1, 10)))
    next(outcomes)
    outcomes.close()
    deadline = time.monotonic() + 10
    while multiprocessing.active_children() and time.monotonic() < deadline:
        time.sleep(0.01)
    assert not multiprocessing.active_children()


def test_a_process_that_reports_counts_each_run_once(task, told):
    with step("runs", 40):
        found = list(Local(2).outcomes(task, [1, 2, 3, 4]))
    assert sorted(found, key=lambda o: o.item) == [Outcome(k, k % 2) for k in (1, 2, 3, 4)]
    assert told.total("runs") == 40


def test_an_error_in_a_process_ends_everything(task):
    with pytest.raises(EqtError, match="no"):
        list(Local(1).outcomes(task, [2, 99]))
    assert not multiprocessing.active_children()


def test_an_interruption_ends_a_process_in_the_middle_of_its_item(task):
    class Interrupting(Reporter):
        def advance(self, amount):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt), reporting(Interrupting()):  # else it would never end
        list(Local(1).outcomes(task, [1000]))
    assert not multiprocessing.active_children()


@POSIX
def test_a_signal_while_a_worker_is_started_leaves_none(task, monkeypatch):
    from multiprocessing.popen_spawn_posix import Popen

    launch = Popen._launch

    def launch_and_tell(process, what):
        launch(process, what)
        signal.raise_signal(signal.SIGTERM)

    monkeypatch.setattr(Popen, "_launch", launch_and_tell)
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    try:
        with pytest.raises(Interrupted), as_exceptions(lambda: None):
            list(executors.get("local")(2).outcomes(task, range(100, 10**6)))
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)
    assert not multiprocessing.active_children()


@POSIX
def test_a_worker_that_starts_ignores_ctrl_c(task, tmp_path, monkeypatch, capfd):
    from multiprocessing.popen_spawn_posix import Popen

    launch = Popen._launch

    def launch_and_tell(process, what):
        launch(process, what)
        os.kill(process.pid, signal.SIGINT)

    monkeypatch.setattr(Popen, "_launch", launch_and_tell)
    found = list(executors.get("local")(1).outcomes(task, [2]))
    assert found == [Outcome(2, 0)]
    assert len(list((tmp_path / "done").glob("2-*"))) == 1
    assert capfd.readouterr().err == ""


@pytest.mark.ci("starts processes")
@POSIX
def test_workers_that_nobody_has_ended_end_with_python(task):
    """As after an interruption of the very moment in which they are ended."""
    task = f"__import__({type(task).__module__!r}).Task({task.folder!r})"
    code = (
        "from eqt_cli.runs.executors import executors\n"
        "if __name__ == '__main__':\n"
        f"    open_ended = executors.get('local')(2).outcomes({task}, range(1, 1000))\n"
        "    next(open_ended)\n"
    )
    subprocess.run([sys.executable, "-c", code], stdout=subprocess.DEVNULL, timeout=60, check=True)


@POSIX
@pytest.mark.parametrize(
    "threads", [False, pytest.param(True, marks=pytest.mark.ci("starts processes"))]
)
def test_auto_takes_processes_only_where_they_are_worth_it(threads, task, tmp_path, monkeypatch):
    def processes():
        return {path.name.split("-")[1] for path in (tmp_path / "done").iterdir()}

    items = [1, 2, 3, 4, 5]
    list(Auto(2, threads).outcomes(task, items))
    assert processes() == {str(os.getpid())}
    monkeypatch.setattr(auto, "WORTH_LEAVING_THREADS" if threads else "WORTH_STARTING", 0.0)
    found = list(Auto(2, threads).outcomes(task, items))
    assert sorted(outcome.item for outcome in found) == items
    assert len(processes()) > 1


def test_auto_stays_in_threads_that_are_as_fast(task, tmp_path, monkeypatch):
    monkeypatch.setattr(auto, "WORTH_LEAVING_THREADS", 0.0)
    list(Auto(2, threads=True, stays=True).outcomes(task, [1, 2, 3]))
    names = {path.name.split("-")[1] for path in (tmp_path / "done").iterdir()}
    assert names == {str(os.getpid())}


CONFIGS = Path(__file__).parents[2] / "configs"


@pytest.mark.parametrize(
    ("engine", "workers", "stays"), [("native", 2, True), ("native", 3, False)]
)
def test_auto_stays_in_threads_where_that_was_measured(engine, workers, stays):
    found = choose_executor(
        load_experiment(CONFIGS / "paper.yaml", {"solver.engine": engine}), workers
    )
    assert found == Auto(workers, threads=True, stays=stays)


def test_what_is_asked_of_an_executor_rules():
    found = choose_executor(
        load_experiment(CONFIGS / "paper.yaml"), 2, "auto", options={"workers": 3, "stays": True}
    )
    assert found == Auto(3, threads=False, stays=True)


@from_yaml
def test_what_is_wrong_with_an_executor_is_said(asked, message):
    paper = load_experiment(CONFIGS / "paper.yaml")
    said = error_of(executor_from, paper, Setup(executor=asked, workers=2))
    assert says(said, message)


def test_threads_take_an_item_when_it_can_begin(task):
    """Whoever hands them out sees how long the earlier ones took."""
    done, seen = [], []

    def handed_out():
        for item in (2, 4, 6, 8):
            seen.append(len(done))
            yield item

    for outcome in executors.get("threads")(2).take(task, handed_out(), 1):
        done.append(outcome)
    assert sorted(outcome.item for outcome in done) == [2, 4, 6, 8]
    assert seen[:2] == [0, 0]
    assert seen == sorted(seen)


@pytest.mark.parametrize(
    ("name", "items", "each", "at_once"),
    [
        ("serial", 4, 10.0, 1),
        ("threads", 4, 10.0, 3),
        ("local", 4, 10.0, 3),
        ("auto", 4, 1.0, 1),  # not worth starting processes for
        ("auto", 2, 10.0, 1),  # the second is the last
        ("auto", 5, 10.0, 3),
        ("auto in threads", 5, 1.0, 3),
        ("auto in threads", 8, 10.0, 3),
    ],
)
def test_items_at_once(name, items, each, at_once, monkeypatch):
    monkeypatch.setattr(auto, "WORTH_STARTING", 3.0)
    executor = Auto(3, threads=True) if name == "auto in threads" else executors.get(name)(3)
    assert executor.at_once(items, each) == at_once


def test_threads_share_what_items_leave():
    assert executors.get("threads")(8).threads_for(3) == 2
    assert executors.get("serial")(8).threads_for(3) == 8
    assert Auto(8, threads=True).threads_for(3) == 2
    assert executors.get("local")(8).threads_for(3) == 1


class Silent(Pooled):
    """Its first item ends at once, and its others never do."""

    name = "silent"

    @contextmanager
    def started(self, folder):
        engine = ThreadPoolExecutor(1)
        begun = iter([0.0])
        yield Pool(Waiting(engine, begun), {}, 5, notice=0.0)
        engine.shutdown()


class Waiting:
    def __init__(self, engine, begun):
        self.engine, self.begun, self.left = engine, begun, []

    def submit(self, work, *arguments):
        if next(self.begun, None) is None:
            self.left.append(Future())
            return self.left[-1]
        return self.engine.submit(work, *arguments)


def test_silence_is_remarked_on(task):
    class Heard(Exception):
        pass

    class Listening(Reporter):
        def remark(self, remark):
            raise Heard(str(remark))

    said = r"no part has ended for .* end with Ctrl-C, and run the same"
    with reporting(Listening()), pytest.raises(Heard, match=said):
        list(Silent().outcomes(task, [2, 4]))


def test_a_worker_that_computes_otherwise_is_named_and_kept(tmp_path):
    class Elsewhere(Serial):
        def outcomes(self, task, items):
            for outcome in super().outcomes(task, items):
                yield replace(outcome, origin={**task.origin(), "numpy": "1.0"})

    study = load_experiment(CONFIGS / "paper.yaml", {"ensemble.runs": 2, "time.duration": 0.1})
    with pytest.warns(EqtWarning, match=r"^a worker has numpy 1.0 \(not .*\): its runs agree with"):
        api.run(study, tmp_path / "out", executor=Elsewhere())
    with open_result(tmp_path / "out") as result:
        [other] = result.provenance["other_sessions"]
        assert other["numpy"] == "1.0"
