"""Executors over engines of `concurrent.futures` that reach other machines."""

from __future__ import annotations

import atexit
import os
import runpy
import shutil
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, ClassVar
from urllib.parse import urlsplit

from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.reporting import reporter
from eqt_cli.runs.executors import AGAIN, MOST_TRIES, Pool, Pooled

MOST_JOBS = 10
"""Number of jobs that end while they compute an item, after which it is given up."""

AHEAD = 1000
"""Largest number of items that wait for workers in an engine."""

LAUNCH_SECONDS = 5.0
"""Longest wait for Parsl to send what it has begun to send, s; it sends within milliseconds, unless
its interchange has ended."""

CLOSE_SECONDS = 60.0
"""Longest wait for Parsl to close, s. It asks its interchange without a limit, so that one that is
stopped would keep it for ever."""

CANCEL_SECONDS = 20.0
"""Longest wait for a queue to cancel jobs after that, s."""

_HERE = ("127.0.0.1", "::1", "localhost")


def _close(kernel: Any, heads: Sequence[Any]) -> None:
    """Close Parsl, also after its interchange has ended with tasks that nobody receives."""
    # Else `cleanup` closes a socket in which the thread that launches tasks still sends, and ZeroMQ
    # aborts the process. Parsl ends this thread only after its sockets, and cancels and waits for
    # launches by nothing public.
    launches = kernel._task_launch_pool
    launches.shutdown(wait=False, cancel_futures=True)
    for thread in launches._threads:
        thread.join(LAUNCH_SECONDS)
    for head in heads:  # else closing waits for ever for these tasks
        if hasattr(head, "outgoing_q"):
            head.outgoing_q.zmq_socket.linger = 0
    if kernel.cleanup_called or _within(CLOSE_SECONDS, kernel.cleanup):
        return
    atexit.unregister(kernel.atexit_cleanup)  # which would wait as long
    import parsl

    parsl.clear()  # for the next session of this process
    for head in heads:
        if head.interchange_proc is not None:
            head.interchange_proc.kill()
    left = [words for head in heads if (words := _jobs_left(head))]
    advice = f"; {', '.join(left)} may still run: cancel them in the queue" if left else ""
    said = f"executor parsl: did not close within {CLOSE_SECONDS:g} s, and was ended{advice}"
    reporter().remark(EqtWarning(said))


def _jobs_left(head: Any) -> str:
    """Cancel the jobs of an executor, and return which of them may still run."""
    jobs, cancelled = list(head.blocks_to_job_id.values()), []
    if jobs:
        _within(CANCEL_SECONDS, lambda: cancelled.extend(head.provider.cancel(jobs)))
    done = dict(zip(jobs, cancelled, strict=False))
    left = [str(job) for job in jobs if not done.get(job)]
    return f"jobs {', '.join(left)} of {head.label}" if left else ""


def _within(seconds: float, action: Callable[[], object]) -> bool:
    """Whether an action returns in this time; else, it goes on in a thread that nobody awaits."""
    errors: list[Exception] = []

    def act() -> None:
        try:
            action()
        except Exception as error:
            errors.append(error)

    thread = threading.Thread(target=act, daemon=True)
    thread.start()
    thread.join(seconds)
    if errors:
        raise errors[0]
    return not thread.is_alive()


@dataclass(frozen=True)
class Parsl(Pooled):
    """Workers that Parsl starts: here, or as jobs of SLURM, PBS, LSF, HTCondor or Kubernetes.

    Attributes
    ----------
    at
        A Python file that defines Parsl's ``config``. It is executed.
    """

    name: ClassVar[str] = "parsl"
    at: str = ""

    @contextmanager
    def started(self, folder: Path) -> Iterator[Pool]:
        try:
            import parsl
            from parsl.concurrent import ParslPoolExecutor
            from parsl.executors.high_throughput.errors import ManagerLost, WorkerLost
        except ImportError as error:
            raise EqtError(
                "executor parsl needs the package parsl; run pip install '.[cluster]' in the "
                "checkout of eqt"
            ) from error
        config = self._config(parsl.Config)
        heads = [executor for executor in config.executors if hasattr(executor, "interchange_proc")]
        scripts = Path(sys.executable).parent
        os.environ["PATH"] = f"{scripts}{os.pathsep}{os.environ['PATH']}"  # for workers here
        for head in heads:
            if not head.encrypted:
                reason = "whoever reaches its port can run code as you"
                raise EqtError(f"{self.at}: leave out encrypted=False of {head.label}: {reason}")
            if setpriv := shutil.which("setpriv"):  # else it outlives a process that is killed
                command = [setpriv, "--pdeathsig", "KILL", *head.interchange_launch_cmd]
                head.interchange_launch_cmd = command

        def check() -> None:
            for head in heads:
                if head.interchange_proc is not None and head.interchange_proc.poll() is not None:
                    # Parsl does not notice, and its cleanup would wait for ever.
                    head.set_bad_state_and_fail_all(RuntimeError("its interchange has ended"))
                    raise EqtError(f"executor parsl: {head.label} has ended; {AGAIN}")

        notice = max((head.heartbeat_threshold for head in heads), default=0)
        lost = {WorkerLost: MOST_TRIES, ManagerLost: MOST_JOBS}
        # Keys and logs, for this user alone; workers may still write there as it is removed.
        with TemporaryDirectory(dir=folder, prefix="parsl-", ignore_cleanup_errors=True) as place:
            config.run_dir, config.initialize_logging, config.retries = place, False, 0
            kernel = parsl.load(config)
            try:
                yield Pool(ParslPoolExecutor(dfk=kernel), lost, AHEAD, check, notice=notice)
            finally:
                _close(kernel, heads)

    def _config(self, kind: type) -> Any:
        """Return what the file defines."""
        if not Path(self.at).is_file():
            example = "such as --executor parsl:cluster.py"
            raise EqtError(f"executor parsl: expected a Python file, {example}, got '{self.at}'")
        try:
            config = runpy.run_path(self.at).get("config")
        except Exception as error:
            raise EqtError(f"{self.at}: {type(error).__name__}: {error}") from error
        if not isinstance(config, kind):
            raise EqtError(f"{self.at}: expected config = parsl.Config(…), got {config!r}")
        return config


@dataclass(frozen=True)
class Dask(Pooled):
    """Workers of a running Dask scheduler.

    Attributes
    ----------
    at
        Address of the scheduler: ``tls://host:8786``.
    insecure
        Whether the address may be a plain one on another machine: ``tcp://host:8786``. Whoever
        reaches such a scheduler can run code as you, on its workers and here.
    """

    name: ClassVar[str] = "dask"
    at: str = ""
    insecure: bool = False

    @contextmanager
    def started(self, folder: Path) -> Iterator[Pool]:
        address = urlsplit(self.at)
        if not (address.scheme and address.hostname):
            example = "such as --executor dask:tls://host:8786"
            raise EqtError(f"executor dask: expected an address, {example}, got '{self.at}'")
        if address.scheme != "tls" and address.hostname not in _HERE and not self.insecure:
            reason = "whoever reaches such a scheduler can run code as you"
            trusted = f"in a network that you trust --executor dask:{self.at},insecure=true"
            raise EqtError(f"executor dask: {self.at}: {reason}; use tls://, or {trusted}")
        try:
            from distributed import Client, KilledWorker
        except ImportError as error:
            raise EqtError("executor dask needs pip install distributed") from error
        try:
            client = Client(self.at, timeout=20, set_as_default=False)
        except Exception as error:
            raise EqtError(f"executor dask: {self.at}: no scheduler answers: {error}") from error
        with client:
            pool = client.get_executor(pure=False)
            try:
                # Dask itself tries an item on several workers before it raises.
                yield Pool(pool, {KilledWorker: 1}, AHEAD)
            finally:
                with suppress(Exception):
                    pool.shutdown(wait=False)
