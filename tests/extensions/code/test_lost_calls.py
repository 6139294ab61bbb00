"""A call that does not come back costs its run, and nothing else."""

import os
import signal
import subprocess
import sys
import time
from contextlib import nullcontext
from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import EqtWarning
from eqt_cli.extend import Auto, Local, Serial, Status, Threads
from eqt_cli.extensions.code import guests, python_law

RUNS, LOST = 10, 3
OVER = {
    "reference": {"kind": "constant"},
    "ensemble": {"runs": RUNS, "seed": 1},
    "time": {"duration": 0.4, "samples": 5},
}
PYTHON = """
import os
import numpy as np
class Law:
    def __init__(self):
        self.calls, self.first = 0.0, 0.0
    def compute(self, velocity):
        self.calls += 1
        if self.calls == 1:
            self.first = velocity[0]
        if self.calls == 12 and abs(self.first - {first!r}) < 1e-12:
            {does}
        return -velocity
"""
C = """for (int k = 0; k < 3; k++) torque[k] = -in->velocity[k];
    (void)n;
    if (++m->calls == 1) m->first = in->velocity[0];
    real apart = m->first - ({first!r});
    if (m->calls == 12 && apart < 1e-12 && apart > -1e-12) {{ {does} }}
"""
OUT_OF_BOUNDS = "for (int k = 0; k < 10000000; k++) ((volatile real *)torque)[k] = 1;"
KEEPS = {
    "c": {"file": "lee.c", "memory": ["calls", "first"], "numbers": {}},
    "memory": {"file": "lee.py", "function": "Law().compute", "memory": ["calls", "first"]},
    "object": {"file": "lee.py", "function": "Law().compute", "object": "per run"},
}


@pytest.fixture
def flown(written, config):
    """Fly a law, of which one call in one run does something; return the results."""

    def fly(keeps, does, first=0.5, over=(), **how):
        if keeps == "c":
            written(("real unused;", "real calls, first;"), body="BODY")
            text = Path("lee.c").read_text(encoding="utf-8")
            Path("lee.c").write_text(text.replace("BODY", C.format(first=first, does=does)))
        else:
            Path("lee.py").write_text(PYTHON.format(first=first, does=does), encoding="utf-8")
        data = config(over=OVER | dict(over), **{"as": None, "numbers": None} | KEEPS[keeps])
        return eqt_cli.run(data, force=True, **how)

    return fly


@pytest.fixture
def costs_one_run(flown):
    """Check that what a call does costs one run, and return its message."""

    def check(keeps, does, over=(), **how):
        whole = flown(keeps, "" if keeps == "c" else "pass", over=over)
        first = float(whole["initial_velocity"][LOST, 0])
        is_here = not isinstance(how.get("executor"), Local)  # remarks of workers are not heard
        said = pytest.warns(EqtWarning, match="at t = 0.22, pose = .* call it with this input")
        with said if is_here else nullcontext():
            lost = flown(keeps, does, first, over, **how)
        others = np.arange(RUNS) != LOST
        assert lost["status"][0].tolist() == np.where(others, 0, Status.NO_ANSWER).tolist()
        for name in ("torque", "pose"):
            np.testing.assert_array_equal(lost[name][0][others], whole[name][0][others])
        [message] = lost["message"][0][~others]
        return str(message)

    return check


def test_a_law_that_ends_its_process(costs_one_run):
    said = costs_one_run("memory", "os._exit(3)")
    assert said == "t = 0.22 s: Law().compute in lee.py ended the process with code 3"


@pytest.mark.ci("starts several processes")
@pytest.mark.parametrize("engine", ["native", "solve_ivp"])
@pytest.mark.parametrize(
    ("keeps", "does", "said"),
    [
        ("c", "*(volatile int *)0 = 1;", "lee_torque in lee.c crashed (SIGSEGV)"),
        ("c", OUT_OF_BOUNDS, "lee_torque in lee.c crashed (SIG"),
        ("c", "for (;;);", "lee_torque in lee.c did not return within 1 s"),
        ("memory", "while True: pass", "Law().compute in lee.py did not return within 1 s"),
        ("memory", "raise SystemExit('done')", "lee.py: line 12: SystemExit: done"),
        ("memory", "open('x', 'w')", "lee.py: line 12: PermissionError: open x"),
        ("object", "os._exit(0)", "Law().compute in lee.py ended the process with code 0"),
        ("object", "bytearray(2**45)", "lee.py: line 12: MemoryError"),
    ],
)
def test_what_a_call_may_do(keeps, does, said, engine, costs_one_run, monkeypatch):
    monkeypatch.setattr(guests, "SECONDS", 1.0)
    over = {"solver": {"engine": engine, "cross_check": 0}}
    assert said in costs_one_run(keeps, does, over)


@pytest.mark.ci("starts many processes")
@pytest.mark.parametrize("executor", [Threads(2), Local(2), Auto(2)], ids=lambda each: each.name)
@pytest.mark.parametrize("keeps", ["c", "object"])
def test_on_every_executor(keeps, executor, costs_one_run):
    does = {"c": "*(volatile int *)0 = 1;", "object": "os._exit(3)"}[keeps]
    over = {"solver": {"engine": "native", "cross_check": 0}}
    costs_one_run(keeps, does, over, executor=executor)


@pytest.mark.ci("starts several processes")
def test_without_a_period_the_run_fails_too(written, config):
    """A continuous law is called at any time, of many runs at once."""
    Path("lee.py").write_text(
        "import os\ndef law(t, velocity):\n"
        "    if 0.2 < t < 0.45 and velocity[0] > 0.1: os._exit(1)\n"
        "    return -velocity\n",
        encoding="utf-8",
    )
    over = OVER | {"control": None}
    options = {"file": "lee.py", "function": "law", "as": None, "numbers": None}
    result = eqt_cli.run(config(over=over, **options), executor=Serial())
    lost = result["status"][0] == Status.NO_ANSWER
    assert (result["status"][0][~lost] == 0).all() and 0 < lost.sum() < RUNS
    assert (result["initial_velocity"][lost, 0] > 0.1).all()
    said = "s: law in lee.py ended the process with code 1"
    assert all(str(message).endswith(said) for message in result["message"][0][lost])


WORKER = """
import os, signal, sys, time
from eqt_cli.runs.executors import _Processes
if __name__ == "__main__":
    pool = _Processes(1)
    pool.submit(time.sleep, 100)
    [child] = pool.pools[0]._processes.values()
    print(child.pid, flush=True)
    time.sleep({delay})
    os.kill(os.getpid(), signal.SIGKILL)
"""


@pytest.mark.skipif(sys.platform != "linux", reason="another way ends workers there")
@pytest.mark.ci("waits until a process has started")
@pytest.mark.parametrize("delay", [0.0, 0.1, 0.4])
def test_a_worker_ends_with_a_parent_that_is_killed_as_it_starts(delay, tmp_path):
    path = tmp_path / "parent.py"
    path.write_text(WORKER.format(delay=delay), encoding="utf-8")
    parent = subprocess.run([sys.executable, path], capture_output=True, text=True, check=False)
    assert parent.returncode == -signal.SIGKILL, parent.stderr
    pid, until = int(parent.stdout), time.monotonic() + 60
    while time.monotonic() < until and Path(f"/proc/{pid}").exists():
        time.sleep(0.05)
    with pytest.raises(ProcessLookupError):
        os.kill(pid, 0)


def test_an_error_whose_words_fail_has_its_name():
    class Silent(Exception):
        def __str__(self):
            return self.args[1]

    assert python_law.described(Silent(), "law.py") == "Silent: (without words)"
    assert len(python_law.described(KeyError("x" * 10**6), "law.py")) < 2000
