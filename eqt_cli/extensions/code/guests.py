"""The processes in which code of the user is called, and what becomes of a call that is lost."""

from __future__ import annotations

import json
import mmap
import os
import select
import signal
import subprocess
import sys
import tempfile
import threading
import weakref
from collections.abc import Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from threading import Lock
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtWarning, InputError
from eqt_cli.base.reporting import reporter
from eqt_cli.engines import compiler
from eqt_cli.engines.compiler import Limits
from eqt_cli.extensions.code import python_law

SECONDS = 10.0
"""Time of the processor that one call may take, s; a healthy law needs a thousandth of it.

It does not depend on what else a machine does, so that a run that fails does so everywhere.
"""

WAITS = 6.0
"""Multiple of that time after which a call is given up that computes nothing, as one that waits."""

MOST_WRITTEN = 2**26
"""Longest answer, bytes."""

MOST_GUESTS = 64
"""Most processes of one law."""

MOST_ROWS, MOST_SECONDS = 50, 2.0
"""Most calls of a law in Python that are asked for together, and their CPU time, s."""

MOST_IDLE = 3
"""How many processes may be lost that were in no call."""

STARTS, FILLS, SKIPS = 1, 2, 4
"""Of the second argument of ``eqt_code``, as user_code.h says."""

BOARD = 2**20
"""Size of what a process and eqt share, bytes: rows of inputs and answers of a law in C."""

_starter = ThreadPoolExecutor(1)
"""A thread that lasts: on Linux, a process ends with the thread that started it."""


class Lost(Exception):
    """A call that did not come back; its argument says in words what it did."""


class Guest:
    """A process in which a law is called; another one takes its place if it is lost in a call.

    Attributes
    ----------
    board
        What both processes see: the row that is being called, and rows of a law in C.
    row
        The row that is being called, or was when the process was lost; −1 before the first one.
    lives
        How many processes have been lost.
    files
        Of a law in Python, the files of its modules, and those that it read.
    lock
        Held in a request, by the threads that share it.
    """

    def __init__(self, law: Mapping[str, Any], limits: Limits, content: bytes | None) -> None:
        self.process: Any = None
        self.law, self.limits, self.content = law, limits, content
        self.lock, self.lives, self.name = Lock(), -1, f"{law['function']} in {law['file']}"
        first = self._start({})
        self.memory, self.files = first["memory"], first["files"]

    def _start(self, more: Mapping[str, Any]) -> Any:
        """Start the process; return its answer to the law."""
        self.lives += 1
        words = ["env", "OPENBLAS_NUM_THREADS=1", sys.executable, "-IB", python_law.__file__]
        with _shared() as file:
            self.board = mmap.mmap(file.fileno(), BOARD)
            streams = subprocess.PIPE, subprocess.PIPE, file
            starting = _starter.submit(compiler.started, words, self.limits, streams, None)
            self.process = starting.result()
        self.row, self.times = (
            memoryview(self.board).cast(kind) for kind in python_law.INT_AND_FLOAT
        )
        self.row[0], self._views = -1, dict[int, list[Array]]()
        self.end = weakref.finalize(self, _end, self.process)
        self._in, self._out = self.process.stdin.fileno(), self.process.stdout.fileno()
        os.set_blocking(self._in, False)
        self._answers = select.poll()
        self._answers.register(self._out, select.POLLIN)
        how: dict[str, Any] = {
            "seconds": SECONDS,
            "lives": self.lives,
            "waits": 0.9 * WAITS * SECONDS,
        }
        file = nullcontext(Path())
        with file if self.content is None else compiler.as_file(self.content) as library:
            if self.content is not None:
                how["library"] = str(library)
            try:
                return self.request({**self.law, **more, **how})
            except Lost as lost:
                raise InputError(f"{self.name} {lost}") from None

    def request(self, what: Mapping[str, Any]) -> Any:
        """Return the answer of a law in Python to a line.

        Raises
        ------
        Lost
            If it does not come.
        InputError
            If the law was asked for what it cannot do.
        """
        answer = json.loads(self.exchange(json.dumps(what).encode() + b"\n"))
        if "error" in answer:
            raise InputError(f"{self.name}: {answer['error']}")
        return answer

    def exchange(self, what: bytes) -> bytes:
        """Return the line by which the process answers; raises `Lost` if it does not come."""
        said = b""
        try:
            while what:
                what = self._write(what)
            row = self.row[0]
            while not said.endswith(b"\n") and len(said) < MOST_WRITTEN:
                while not self._answers.poll(1000 * WAITS * SECONDS):  # as long as calls go on
                    if row == self.row[0]:
                        self._give_up()
                    row = self.row[0]
                more = os.read(self._out, 2**16)
                if not more:
                    raise BrokenPipeError
                said += more
        except BrokenPipeError:
            raise Lost(self._ending()) from None
        return said

    def views(self, arrays: Sequence[Array]) -> list[Array]:
        """Return where the rows of a call of C are on the board, as arrays."""
        rows = len(arrays[0])
        if rows not in self._views:
            at, views = 8 * python_law.FIRST, []
            for array, width in zip(arrays, self.law["widths"], strict=False):
                view = np.frombuffer(self.board, array.dtype, array.size, at)
                views.append(view.reshape(array.shape))
                at += 8 * rows * width
            self._views[rows] = views
        return self._views[rows]

    def restart(self) -> int:
        """Let another process take the place of one that was lost; what it kept is lost, too.

        Returns
        -------
        int
            The row in whose call it was lost.
        """
        row = int(self.row[0])
        self._start({"trial": []})
        return row

    def _write(self, what: bytes) -> bytes:
        """Write as much as there is room for; return the rest."""
        try:
            return what[os.write(self._in, what) :]
        except BlockingIOError:
            room = select.poll()
            room.register(self._in, select.POLLOUT)
            if not room.poll(1000 * WAITS * SECONDS):
                self._give_up()
            return what

    def _give_up(self) -> None:
        raise Lost(self._ending(f"gave no answer within {WAITS * SECONDS:g} s"))

    def _ending(self, words: str = "") -> str:
        """End the process; return in words how it ended."""
        if not words:  # it has closed its pipe, and most often ends
            try:
                self.process.wait(1.0)
            except subprocess.TimeoutExpired:
                words = "closed the pipe of its process"
        self.end()
        code = self.process.wait()
        if words:
            return words
        if code == -signal.SIGPROF:
            return f"did not return within {SECONDS:g} s"
        if code == -signal.SIGKILL:
            return "was killed, perhaps for lack of memory"
        try:
            return f"crashed ({signal.Signals(-code).name})"
        except ValueError:  # of a code that is no signal
            return f"ended the process with code {code}"


def _shared() -> Any:
    """Return an empty file in memory, where there are such files."""
    if sys.platform == "linux":
        file = os.fdopen(os.memfd_create("eqt"), "r+b")
    else:
        file = tempfile.TemporaryFile()  # noqa: SIM115  # the caller closes it
    file.truncate(BOARD)
    return file


def _end(process: subprocess.Popen[bytes]) -> None:
    compiler.end(process)
    process.communicate()


class Pool:
    """The processes of a law, one for each thread that calls it.

    So runs are spread over cores as the engine spreads them.

    Attributes
    ----------
    guests
        The processes; the first one has tried the law out.
    lost
        What became of each call that was lost, by the bytes of its row: it is not called again.
    seconds, slowest
        CPU times of the calls until they are `drained`, and the longest one of the last request, s.
    spent
        CPU time of the calls of the last request in C, s.
    reason
        The last error of a call, in words.
    """

    def __init__(
        self, law: Mapping[str, Any], limits: Limits, content: bytes | None = None
    ) -> None:
        self.law, self.limits, self.content, self.lock = law, limits, content, Lock()
        self.guests, self.of_threads = [Guest(law, limits, content)], {0: 0}
        self.name, self.memory = self.guests[0].name, self.guests[0].memory
        self.lost, self._lost_here = dict[bytes, str](), threading.local()
        self.seconds, self.slowest = list[float](), 0.0
        self.reason, self.has_told, self.has_lost = "", False, False

    def drained(self) -> list[float]:
        """Return the CPU times of the calls since it was last asked, s."""
        with self.lock:
            seconds, self.seconds = self.seconds, []
        return seconds

    def tell(self) -> None:
        """Say once why a call in a run failed."""
        with self.lock:
            is_news, self.has_told = not self.has_told, True
        if is_news and self.reason:
            reporter().remark(EqtWarning(f"{self.name} failed at an instant: {self.reason}"))

    def forget(self) -> None:
        """Forget the calls that were lost in another experiment."""
        with self.lock:
            self.lost, self.has_lost = {}, False

    def is_first_loss(self) -> bool:
        """Whether this is asked for the first time."""
        with self.lock:
            is_first, self.has_lost = not self.has_lost, True
        return is_first

    def note(self, places: Mapping[int, str]) -> None:
        """Keep what became of lost calls of this thread, by their places among the rows."""
        if places:
            self._lost_here.places = {**self.taken(), **places}

    def taken(self) -> dict[int, str]:
        """Return what was noted in this thread since it was last asked."""
        places: dict[int, str] = getattr(self._lost_here, "places", {})
        self._lost_here.places = {}
        return places

    def of_thread(self) -> int:
        """Return the guest of this thread: its last one, or one of a thread that has ended."""
        thread = threading.get_ident()
        with self.lock:
            if thread not in self.of_threads:
                alive = {thread.ident for thread in threading.enumerate()}
                alive.discard(threading.main_thread().ident)
                idle = [ident for ident in self.of_threads if ident not in alive]
                if not idle and len(self.guests) < MOST_GUESTS:
                    law = {**self.law, "trial": []}
                    self.guests.append(Guest(law, self.limits, self.content))
                    idle = [-len(self.guests)]
                    self.of_threads[idle[0]] = len(self.guests) - 1
                self.of_threads[thread] = self.of_threads.pop(idle[0]) if idle else 0
            return self.of_threads[thread]

    def call_c(self, begins: int, period: float, arrays: Sequence[Array]) -> dict[int, str]:
        """Call a law in C for rows on one board; see `CodeFunction._answer`."""
        guest, calls = self.guests[self.of_thread()], _Calls(self, arrays[:3])
        with guest.lock:
            while True:
                views = guest.views(arrays)
                guest.row[1], guest.row[2], guest.times[3] = len(arrays[0]), begins, period
                for view, array in zip(views, arrays, strict=True):
                    view[...] = array  # of outcomes, too, to which calls add
                views[2][[*calls.lost]] = np.nan
                try:
                    guest.exchange(b".")
                    break
                except Lost as loss:
                    calls.lose(guest, range(len(arrays[0])), str(loss))
                    if not begins & SKIPS:
                        return calls.lost
            self.spent = guest.times[4]
            for view, array in [*zip(views, arrays, strict=True)][1:]:
                if array is not arrays[2]:
                    array[...] = view
        return calls.lost

    def call_python(
        self, rows: Array, memory: Array, places: Array, how: Mapping[str, Any]
    ) -> tuple[dict[int, list[float]], dict[int, str]]:
        """Call a law in Python for rows at some places.

        Returns
        -------
        answers
            Torque and memory of each, by place.
        lost
            What became of the others; "" of one whose object ended with another call.
        """
        answers, calls = dict[int, list[float]](), _Calls(self, [rows])
        owners, lives = self._owners(memory)
        for owner in np.unique(owners[places]).tolist():
            guest = self.guests[owner]
            how = {**how, "process": owner, "processes": MOST_GUESTS}
            waiting = places[owners[places] == owner].tolist()
            with guest.lock:
                while waiting:
                    if guest.lives:  # some may be lost, with their object or by themselves
                        waiting = [place for place in waiting if place not in calls.lost]
                        gone = [place for place in waiting if 0 <= lives[place] < guest.lives]
                        calls.lost |= dict.fromkeys(gone, "")
                        waiting = [place for place in waiting if place not in gone]
                    # One by one, where nobody knows which one ended the process after its call.
                    some = waiting[: 1 if calls.idle else self._most_rows(memory)]
                    if not some:
                        break
                    try:
                        said = guest.request({**how, "rows": rows[some].tolist()})
                    except Lost as loss:
                        calls.lose(guest, some, str(loss))
                        continue
                    waiting = waiting[len(some) :]
                    answers |= {k: row for k, row in zip(some, said["rows"], strict=True) if row}
                    for k, words in said["lost"].items():
                        calls.lost[some[int(k)]] = words
                    self._keep(said)
        return answers, calls.lost

    def _most_rows(self, memory: Array) -> int:
        """Return the most rows of a request: one where each makes its object, which may be slow."""
        if self.law["per_run"] and not memory[:, 0].all():
            return 1
        return max(1, min(MOST_ROWS, int(MOST_SECONDS / max(self.slowest, 1e-9))))

    def _owners(self, memory: Array) -> tuple[Array, Array]:
        """Return the guest of each row, and which of its processes has the object of its run.

        A row without an object, whose process is −1, is of the guest of this thread.
        """
        mine = np.full(len(memory), self.of_thread())
        if not self.law["per_run"]:
            return mine, np.full(len(memory), -1)
        numbers = np.rint(memory[:, 0] / python_law.TINY).astype(int)
        there, lives = (numbers - 1) % MOST_GUESTS, (numbers - 1) // MOST_GUESTS
        return np.where(numbers > 0, there, mine), np.where(
            numbers > 0, lives // python_law.ONE_LIFE, -1
        )

    def _keep(self, said: Mapping[str, Any]) -> None:
        with self.lock:
            self.seconds += said["seconds"]
            self.slowest = max(said["seconds"], default=0.0)
            self.reason = said["reason"] or self.reason


class _Calls:
    """The calls of some rows, and what became of those that were lost."""

    def __init__(self, pool: Pool, arrays: Sequence[Array]) -> None:
        self.pool, self.arrays, self.lost, self.idle = pool, arrays, dict[int, str](), 0
        if pool.lost:  # another call would be lost, too
            words = (pool.lost.get(self._row(place), "") for place in range(len(arrays[0])))
            self.lost = {place: word for place, word in enumerate(words) if word}

    def _row(self, place: int) -> bytes:
        return b"".join(array[place].tobytes() for array in self.arrays)

    def lose(self, guest: Guest, places: Sequence[int], words: str) -> None:
        """Note the row in whose call a process was lost, and let another one take its place.

        Raises
        ------
        InputError
            If that ends as well, or was lost between calls again and again.
        """
        at, words = guest.restart(), f"{guest.name} {words}"
        if len(places) == 1:
            at = 0
        if 0 <= at < len(places) and places[at] not in self.lost:
            self.lost[places[at]] = self.pool.lost[self._row(places[at])] = words
            return
        self.idle += 1
        if self.idle == MOST_IDLE:
            raise InputError(f"{words}, between calls")
