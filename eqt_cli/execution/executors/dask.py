"""Computes items on a Dask cluster: a running one, or a temporary one on this machine."""

import logging
import pickle
from collections import deque
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from functools import lru_cache
from importlib.util import find_spec
from pathlib import Path
from typing import Any, ClassVar

from threadpoolctl import threadpool_limits

from eqt_cli.core.errors import EqtError, Remedy
from eqt_cli.core.reporting import reporter
from eqt_cli.execution.executors.base import MOST_TRIES, Executor, Outcome, Task, TaskContext

CONNECT_WITHIN = 20.0
"""Time limit for connecting to a scheduler, s."""

NEEDED = {"distributed": "2026.7", "cryptography": "50.0"}
"""The packages of the extra dask, and their oldest versions."""

OF_WORKER = "from eqt_cli.core import interruptions\ninterruptions.of_worker()\n"
"""Code that each worker of a local cluster runs first."""


@dataclass(frozen=True)
class Dask(Executor):
    """Workers of Dask.distributed, which must see the same result folder as this process.

    Attributes
    ----------
    scheduler
        Address of a running scheduler; None starts a cluster of `workers` processes here, which
        talk to each other by TLS with a certificate of their own.
    tls_ca, tls_cert, tls_key
        PEM files for a scheduler at tls://HOST:PORT: of its authority, and your certificate and
        key. Default: those of Dask's own configuration.
    """

    name: ClassVar[str] = "dask"
    scheduler: str | None = None
    tls_ca: str | None = None
    tls_cert: str | None = None
    tls_key: str | None = None

    def outcomes(self, task: Task, items: Sequence[int]) -> Iterator[Outcome]:
        if not items:
            return
        if missing := [name for name in NEEDED if not find_spec(name)]:
            raise EqtError(
                f"executor dask needs {' and '.join(missing)} (extra dask): pip install "
                + " ".join(f"'{name}>={NEEDED[name]}'" for name in missing)
            )
        from distributed import KilledWorker, as_completed

        payload = pickle.dumps(task)
        waiting = deque(items)
        with ExitStack() as stack:
            client = self._client(stack)
            futures: dict[Any, int] = {}
            finished = as_completed(loop=client.loop)

            def submit() -> None:
                # Submit only what can run now, so that a lost worker loses no waiting items.
                room = max(1, sum(client.nthreads().values())) - len(futures)
                for _ in range(min(room, len(waiting))):
                    item = waiting.popleft()
                    future = client.submit(_do, payload, item, pure=False)
                    futures[future] = item
                    finished.add(future)

            submit()
            for future in finished:
                item = futures.pop(future)
                submit()
                try:
                    failed = future.result()
                except KilledWorker:
                    yield Outcome(item, None)
                else:
                    reporter().advance(task.runs_of(item))
                    yield Outcome(item, failed)

    def _client(self, stack: ExitStack) -> Any:
        import dask
        from distributed import Client

        if self.scheduler:
            try:
                return stack.enter_context(
                    Client(
                        self.scheduler,
                        timeout=CONNECT_WITHIN,
                        set_as_default=False,
                        security=self._security(),
                    )
                )
            # RuntimeError: TLS files for an address without TLS; TypeError: the reverse.
            except (OSError, ValueError, RuntimeError, TypeError) as error:
                raise EqtError(
                    f"scheduler {self.scheduler}: cannot be reached: {error}",
                    Remedy("start one with `dask scheduler`"),
                    Remedy("leave {} out", "scheduler"),
                ) from error
        settings = {
            "distributed.scheduler.allowed-failures": MOST_TRIES - 1,
            # The terminal sends Ctrl-C to all processes; only this one handles it.
            "distributed.worker.preload": [OF_WORKER],
            # Their web servers cannot be turned off; these answer nothing.
            "distributed.scheduler.http.routes": [],
            "distributed.worker.http.routes": [],
        }
        stack.enter_context(dask.config.set(settings))
        cluster = stack.enter_context(self._local_cluster())
        return stack.enter_context(Client(cluster, set_as_default=False))

    def _security(self) -> Any:
        """Return how this process shows a scheduler who it is; None: as Dask is configured."""
        from distributed import Security

        files = {name: getattr(self, name) for name in ("tls_ca", "tls_cert", "tls_key")}
        if not any(files.values()):
            return None
        for name, file in files.items():
            if not file or not Path(file).is_file():
                raise EqtError(
                    f"executor dask: {name}: expected a PEM file, got {file or 'none'}; "
                    f"TLS needs {', '.join(files)}"
                )
        return Security(
            require_encryption=True,
            tls_ca_file=self.tls_ca,
            tls_client_cert=self.tls_cert,
            tls_client_key=self.tls_key,
        )

    def _local_cluster(self) -> Any:
        """Start a cluster on this machine; try again if its workers die during the start.

        A scheduler executes what it is sent, in this process. Without the key of this certificate,
        which is in memory only, nobody else on this machine can send it anything.
        """
        from distributed import LocalCluster, Security

        security = Security.temporary()
        tries = 0
        while True:
            try:
                return LocalCluster(
                    n_workers=self.workers,
                    threads_per_worker=1,
                    processes=True,
                    security=security,
                    dashboard_address="127.0.0.1:0",  # any free port, for the empty web server
                    scheduler_kwargs={"dashboard": False},
                    silence_logs=logging.CRITICAL,
                )
            except RuntimeError as error:
                tries += 1
                if tries == MOST_TRIES:
                    raise EqtError(f"executor dask: no cluster can be started: {error}") from error


def _do(payload: bytes, item: int) -> int:
    """Compute one item in a worker."""
    with threadpool_limits(1):
        return _task(payload)(item, TaskContext())


@lru_cache(maxsize=4)
def _task(payload: bytes) -> Task:
    """Unpickle the task, once in each worker."""
    return pickle.loads(payload)
