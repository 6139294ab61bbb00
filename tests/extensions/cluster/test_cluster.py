"""Workers of Parsl and Dask as a cluster has them: real processes, which are killed in all ways."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from concurrent.futures import ThreadPoolExecutor
from contextlib import suppress
from pathlib import Path
from types import SimpleNamespace

import h5py
import pytest
from plugin_sources import component

from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.extend import Status
from eqt_cli.extensions.cluster import executors
from eqt_cli.extensions.cluster.executors import Dask, Parsl
from eqt_cli.runs.executors import MOST_TRIES, Outcome

pytestmark = [
    pytest.mark.ci("starts clusters of processes"),
    pytest.mark.skipif(sys.platform != "linux", reason="reads /proc"),
]

CLUSTER = """
from parsl.config import Config
from parsl.executors import HighThroughputExecutor
from parsl.providers import LocalProvider

provider = LocalProvider(init_blocks=2, max_blocks=2)
head = HighThroughputExecutor(
    address="127.0.0.1", max_workers_per_node=1, provider=provider,
    heartbeat_period=1, heartbeat_threshold=4,
)
config = Config(executors=[head])
"""

TASK = """
import os, signal, time
from pathlib import Path
from types import SimpleNamespace

from eqt_cli.base.errors import EqtError, EqtWarning


class Task:
    def __init__(self, folder):
        self.folder = Path(folder)

    def runs_of(self, item):
        return 10

    def origin(self):
        return {"machine": "another"}

    def __call__(self, item, context):
        begun = self.folder / f"{item}-{os.getpid()}-{time.monotonic_ns()}"
        begun.write_text("")
        tries = len(list(self.folder.glob(f"{item}-*")))
        if item == 13:
            os._exit(1)
        if item == 17 and tries == 1:
            os.kill(os.getpid(), signal.SIGKILL)
        if item == 99:
            raise EqtError("no such item")
        if item >= 1000:
            time.sleep(3)
        return item % 2
"""


@pytest.fixture
def task(tmp_path, monkeypatch):
    name = f"task_of_{tmp_path.name}"
    (tmp_path / f"{name}.py").write_text(TASK)
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setenv("PYTHONPATH", str(tmp_path), prepend=":")
    done = tmp_path / "done"
    done.mkdir()
    return __import__(name).Task(str(done))


@pytest.fixture
def cluster(tmp_path):
    pytest.importorskip("parsl")
    path = tmp_path / "cluster.py"
    path.write_text(CLUSTER)
    return path


def processes(*words, of="cmdline"):
    """The processes whose command lines, or variables at their start, hold all words."""
    found = []
    for entry in Path("/proc").iterdir():
        try:
            line = (entry / of).read_bytes().replace(b"\0", b" ").decode()
        except OSError:
            continue
        if entry.name.isdecimal() and all(word in line for word in words):
            found.append(int(entry.name))
    return sorted(found)


def wait_for(condition, seconds=60):
    deadline = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < deadline
        time.sleep(0.05)


def test_parsl_outlives_all_that_is_killed_but_its_head(task, cluster, tmp_path):
    folder, done = tmp_path / "result", tmp_path / "done"
    folder.mkdir()
    with Parsl(at=str(cluster)).opened(folder) as opened:
        found = list(opened.outcomes(task, [1, 17, 13, 4]))  # a worker is lost, one again and again
        assert sorted(found, key=lambda x: x.item) == [
            Outcome(1, 1),
            Outcome(4, 0),
            Outcome(13, None),
            Outcome(17, 1),
        ]
        assert {outcome.origin.get("machine") for outcome in found} == {"another", None}
        assert len(list(done.glob("13-*"))) == MOST_TRIES
        with pytest.raises(EqtError, match="no such item"):
            list(opened.outcomes(task, [99]))
        outcomes = opened.outcomes(task, [1000, 1001, 1002])
        before = [next(outcomes)]
        manager = processes("process_worker_pool", str(folder))[-1]
        os.killpg(os.getpgid(manager), signal.SIGKILL)  # as a job that is cancelled
        assert len([*before, *outcomes]) == 3
        outcomes, begun = opened.outcomes(task, [2000, 2001]), time.monotonic()
        [head] = [p for p in processes("interchange") if parent(p) == os.getpid()]
        os.kill(head, signal.SIGKILL)
        with pytest.raises(EqtError, match="has ended; run the same command again to continue"):
            list(outcomes)
        assert time.monotonic() < begun + 5
    assert not list(folder.iterdir())
    wait_for(lambda: not processes(str(folder)) + processes(str(tmp_path), of="environ"), 20)


def parent(process):
    return int(Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[1])


CONFIG = """
name: c
group: SO3
inertia: [1, 2, 3]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "0"], pose: identity, velocity: [0, 0, 0]}
controllers: [eqt, gt]
initial: {pose: haar, velocity: {kind: normal, std: 1.0}}
ensemble: {runs: 50, seed: 1}
time: {duration: 3.0, samples: 31}
solver: {engine: solve_ivp, rtol: 1.0e-6, cross_check: 0, block: 50}
"""
SWEEP = CONFIG + "sweep: [{grid: {gains.kp: [1, 2, 3]}}]\n"
TUNE = CONFIG.replace("runs: 50", "runs: 4") + (
    "tune: {over: {gains.kp: [0.5, 2]}, objective: effort, budget: 10, samples: 2, "
    "confirm: {runs: 4}}\n"
)


@pytest.fixture
def eqt(tmp_path, cluster):
    """Start a command in a folder with a cluster and an experiment of six parts."""
    (tmp_path / "c.yaml").write_text(SWEEP)
    (tmp_path / "t.yaml").write_text(TUNE)

    def start(*words):
        command = [sys.executable, "-P", "-m", "eqt_cli", *map(str, words)]
        return subprocess.Popen(
            command, cwd=tmp_path, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )

    return start


def numbers(folder):
    """Every dataset of a result, as bytes; texts and times of the machine are none."""
    with h5py.File(folder / "results.h5") as file:
        return {name: file[name][()].tobytes() for name in file if file[name].dtype.kind in "fi"}


def ended(process, code, seconds=120):
    """What a command has said, once it ends with a code."""
    said, _ = process.communicate(timeout=seconds)
    assert process.returncode == code, said
    return " ".join(said.split())


def test_an_interrupted_sweep_goes_on_and_has_the_bits_of_one_process(eqt, tmp_path):
    ended(eqt("sweep", "c.yaml", "--executor", "serial", "--out", "alone"), 0)
    command = "sweep", "c.yaml", "--executor", "parsl:cluster.py", "--out", "many"
    first, many = eqt(*command), tmp_path / "many"
    wait_for(lambda: list((many / "parts").glob("0*.npy")))
    begun = time.monotonic()
    first.send_signal(signal.SIGINT)
    assert "runs are kept in many: run the same command again to continue" in ended(first, 130)
    assert time.monotonic() < begun + 10  # 2 s where nothing else runs
    assert list((many / "parts").glob("0*.npy"))
    assert " runs were already computed" in ended(eqt(*command), 0)
    assert numbers(many) == numbers(tmp_path / "alone")
    left = {path.name for path in tmp_path.iterdir() if path.suffix not in (".py", ".yaml")}
    assert left - {"__pycache__"} == {"alone", "many"}
    assert {path.name for path in many.iterdir()} == {"config.yaml", "manifest.json", "results.h5"}
    wait_for(lambda: not processes(str(tmp_path)), 20)


def test_a_search_on_a_cluster_has_the_bits_of_one_process(eqt, tmp_path):
    for name, executor in (("alone", "serial"), ("many", "parsl:cluster.py")):
        ended(eqt("tune", "t.yaml", "--executor", executor, "--out", name), 0)
    assert numbers(tmp_path / "many") == numbers(tmp_path / "alone")


DYING = component("""
import os
import numpy as np
dying(eqt_cli.components.laws.Controller):
    def torque(self, s):
        if np.any((np.abs(s.V_tilde) > 0.1).any(axis=-1) & (s.t > 1)):
            os._exit(1)
        return 0 * s.V_tilde
""")


@pytest.mark.parametrize("executor", ["parsl:cluster.py", "local"])
def test_a_law_that_ends_its_process_costs_its_own_runs(eqt, tmp_path, executor):
    (tmp_path / "dying.py").write_text(DYING)
    laws = CONFIG.replace("[eqt, gt]", "[eqt, dying]") + "plugins: [dying.py]\n"
    (tmp_path / "d.yaml").write_text(laws)
    words = "run", "d.yaml", "--executor", executor, "--out", "d", "--trust-plugins"
    assert "worker lost 3 times (killed, or out of memory)" in ended(eqt(*words), 3)
    with h5py.File(tmp_path / "d/results.h5") as file:
        assert (file["status"][()] == [[Status.OK], [Status.WORKER_LOST]]).all()


@pytest.fixture
def scheduler(task, tmp_path):
    """A scheduler of Dask with two workers; yields its process and its address."""
    pytest.importorskip("distributed")
    file, quiet, started = tmp_path / "scheduler.json", subprocess.DEVNULL, []
    for words in (
        ("scheduler", "--host", "127.0.0.1", "--port", "0"),
        ("worker", "--nworkers", "2", "--nthreads", "1", "--death-timeout", "20"),
    ):
        module = f"distributed.cli.dask_{words[0]}"
        places = "--scheduler-file", str(file), "--dashboard-address", "127.0.0.1:0"
        command = [sys.executable, "-m", module, *words[1:], *places]
        started.append(
            subprocess.Popen(command, stdout=quiet, stderr=quiet, start_new_session=True)
        )
        wait_for(file.exists)
    yield started[0], json.loads(file.read_text())["address"]
    for process in started:
        with suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
        process.wait()


def test_dask_takes_items_and_its_death_is_told(task, scheduler, tmp_path):
    head, address = scheduler
    with Dask(at=address).opened(tmp_path) as opened:
        found = sorted(opened.outcomes(task, [1, 17, 4]), key=lambda outcome: outcome.item)
        assert found == [Outcome(1, 1), Outcome(4, 0), Outcome(17, 1)]
        with pytest.raises(EqtError, match="no such item"):
            list(opened.outcomes(task, [99]))
        outcomes = opened.outcomes(task, [2, *range(1000, 1010)])
        assert next(outcomes) == Outcome(2, 0)
        head.kill()
        begun = time.monotonic()
        with pytest.raises(EqtError, match="run the same command again to continue"):
            list(outcomes)
        assert time.monotonic() < begun + 10


@pytest.mark.parametrize(
    ("asked", "said"),
    [
        (
            "dask:tcp://10.0.0.1:8786",
            "tcp://10.0.0.1:8786: whoever reaches such a scheduler can run code as you; ",
        ),
        ("dask:here", "expected an address, such as --executor dask:tls://host:8786, got 'here'"),
        ("parsl", "executor parsl: expected a Python file, such as --executor parsl:cluster.py"),
        ("parsl:no.py", "got 'no.py'"),
        ("parsl:empty.py", "empty.py: expected config = parsl.Config(…), got None"),
        ("parsl:wrong.py", "wrong.py: NameError: name 'x' is not defined"),
    ],
)
def test_what_is_wrong_with_a_cluster_is_said(asked, said, eqt, tmp_path):
    (tmp_path / "empty.py").write_text("")
    (tmp_path / "wrong.py").write_text("x")
    assert said in ended(eqt("sweep", "c.yaml", "--executor", asked), 2)


def test_templates_of_the_page_are_accepted(tmp_path):
    """They are only submitted by a machine that has such a queue."""
    parsl = pytest.importorskip("parsl")
    page = Path(__file__).parents[3] / "docs/howto/clusters.md"
    first, *others = re.findall(r"```python\n(.*?)```", page.read_text(), re.DOTALL)
    head, workers = first.split("jobs = ")[0], first[first.index("workers = ") :]
    assert len(others) == 4
    for text in (first, *(head + jobs + workers for jobs in others)):
        path = tmp_path / "cluster.py"
        path.write_text(text)
        config = Parsl(at=str(path))._config(parsl.Config)
        assert config.executors[0].provider.max_blocks == 2


def test_closing_ends_where_the_interchange_is_stopped(task, cluster, tmp_path, monkeypatch):
    monkeypatch.setattr(executors, "CLOSE_SECONDS", 6.0)
    folder = tmp_path / "result"
    folder.mkdir()
    said = pytest.warns(EqtWarning, match="did not close within 6 s, and was ended")
    with said, Parsl(at=str(cluster)).opened(folder) as opened:
        assert list(opened.outcomes(task, [4])) == [Outcome(4, 0)]
        [head] = [p for p in processes("interchange") if parent(p) == os.getpid()]
        os.kill(head, signal.SIGSTOP)
        begun = time.monotonic()
    assert time.monotonic() < begun + 30
    wait_for(lambda: not processes(str(folder)) + processes(str(tmp_path), of="environ"), 20)


@pytest.mark.parametrize(("cancelled", "left"), [((True, False), "11"), ((), "10, 11")])
def test_jobs_that_are_not_cancelled_are_named(monkeypatch, cancelled, left):
    monkeypatch.setattr(executors, "CLOSE_SECONDS", 0.01)
    monkeypatch.setattr(executors, "CANCEL_SECONDS", 0.01)
    cancel = (lambda jobs: cancelled) if cancelled else lambda jobs: time.sleep(0.2)
    head = SimpleNamespace(
        label="queue",
        blocks_to_job_id={"0": "10", "1": "11"},
        interchange_proc=None,
        provider=SimpleNamespace(cancel=cancel),
    )
    kernel = SimpleNamespace(
        cleanup_called=False,
        cleanup=lambda: time.sleep(0.2),
        atexit_cleanup=print,
        _task_launch_pool=ThreadPoolExecutor(),
    )
    with pytest.warns(EqtWarning, match=f"jobs {left} of queue may still run: cancel them"):
        executors._close(kernel, [head])
