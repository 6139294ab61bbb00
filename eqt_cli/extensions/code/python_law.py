"""The program that calls a law of the user's own, in a process that it cannot leave.

It imports nothing of eqt. `Guest` in `guests.py` starts it, and writes a line of JSON: the law. Of
a law in Python, lines with rows of numbers, memory and inputs follow; of one in C, single bytes,
whose rows both processes see. Each is answered by a line.
"""

from __future__ import annotations

import ctypes
import inspect
import json
import mmap
import os
import select
import signal
import struct
import sys
import time
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from copy import deepcopy
from math import nan, prod
from types import ModuleType, SimpleNamespace
from typing import Any

import numpy as np

CHANGES = ("os.", "shutil.", "socket.", "subprocess.", "ctypes.", "sqlite3.", "signal.", "pty.")
HARMLESS = ("os.listdir", "os.scandir", "os.putenv", "os.unsetenv")  # the last two: of this process
CAST = getattr(ctypes, "_cast_addr", None)
"""The address of `ctypes.cast`, which the import of SciPy calls; hooks hear of it from 3.14 on."""

WRITES = os.O_WRONLY | os.O_RDWR | os.O_CREAT | os.O_TRUNC | os.O_APPEND


READ = dict[str, None]()
"""Paths of the files that a law has opened."""

OURS: list[str] = []
"""Events of this program itself, while it starts or ends the process of a run."""


@contextmanager
def allowed(event: str) -> Iterator[None]:
    """Do what a law may not."""
    OURS.append(event)
    try:
        yield
    finally:
        OURS.remove(event)


def refuse(event: str, about: tuple[Any, ...]) -> None:
    """Raise a `PermissionError` for what a law may not do; an audit hook, which nothing removes."""
    if event in OURS:
        return
    opens = event == "open" and (set(str(about[1])) & set("wax+") or about[2] & WRITES)
    changes = event.startswith(CHANGES) and event not in HARMLESS
    casts = event == "ctypes.call_function" and about[0] == CAST
    if opens or (changes and not casts) or "_posixsubprocess" in about[:1]:
        raise PermissionError(f"{event} {about[0] if about else ''}".strip())
    if event == "open" and isinstance(about[0], str | bytes | os.PathLike):
        READ[os.path.abspath(os.fsdecode(about[0]))] = None  # noqa: PTH100  # as in code_files


def files_of_law() -> dict[str, Any]:
    """Return the files that a law has loaded as modules, by their names, and those that it read."""
    files = {name: getattr(module, "__file__", None) for name, module in [*sys.modules.items()]}
    loaded = {name: str(file) for name, file in files.items() if file and name not in BEFORE}
    return {"loaded": loaded, "read": [*READ]}


def lock() -> None:
    """Let Linux refuse the same, and signals to others, whatever Python lets through (Landlock)."""
    if sys.platform == "linux":
        libc, size = ctypes.CDLL(None), ctypes.c_size_t(24)
        abi = libc.syscall(444, None, ctypes.c_size_t(0), 1)
        # All but to read files and folders; TCP; signals and sockets beyond this process.
        files = (1 << (0, 13, 14, 15, 15, 16)[min(abi, 5)]) - 1 & ~0b1100
        rules = struct.pack("3Q", files, 3 * (abi > 3), 3 * (abi > 5))
        libc.unshare(0x50000000)  # a network of its own, without any other
        if abi > 0 and libc.prctl(38, 1, 0, 0, 0) == 0:
            libc.syscall(446, libc.syscall(444, rules, size, 0), 0)


def shut_in() -> None:
    """Refuse from here on what a law may not do."""
    # Python's own way to start processes, of which no hook is told.
    sys.modules["_posixsubprocess"] = SimpleNamespace(fork_exec=None)  # type: ignore[assignment]
    lock()
    sys.addaudithook(refuse)


BEFORE = frozenset(sys.modules)
"""Modules that this program needs itself."""

TRIAL_SECONDS = 3.0
"""Time after which no further state is tried, s."""

OBJECT, FEWEST = ".object", 16
"""The memory of a law with an object for each run: its number, and its calls; and how many objects
are kept at least."""

MOST_WORDS = 1000
"""Most characters of an error that are passed on."""

TINY = 2.0**-1000
"""Factor of these two, so that they weigh nothing where states are compared."""

ONE_LIFE = 2**32
"""Most objects of a process; those of the one that takes its place have larger numbers."""


INT_AND_FLOAT: Any = ("q", "d")
"""Formats of the numbers on a board, of 8 bytes each."""


class Board:
    """What eqt sees while a law is called: the row that is being called, and rows in C."""

    def __init__(self) -> None:
        self.bytes = mmap.mmap(2, 0)
        os.dup2(os.open(os.devnull, os.O_WRONLY), 2)
        self.numbers, self.times = (memoryview(self.bytes).cast(kind) for kind in INT_AND_FLOAT)
        self.seconds = 0.0

    def begin(self, row: int) -> None:
        """Begin the call of a row, which may take so much time of the processor."""
        self.numbers[0] = row
        signal.setitimer(signal.ITIMER_PROF, self.seconds)  # whose signal ends the process

    def end(self) -> None:
        """End the calls."""
        self.numbers[0] = -1


RUNS, BEGINS, PERIOD, SPENT, FIRST = 1, 2, 3, 4, 8
"""Places in the board, each of 8 bytes: how many rows are called and how, the time that took, and
the first number of the arrays that follow each other."""


class Library:
    """A law in C, compiled, which may crash or never return."""

    memory, reason, files = (), "", ()
    seconds: list[float] = []  # noqa: RUF012  # calls of C are too short to time one by one

    def __init__(self, request: dict[str, Any], board: Board) -> None:
        library = ctypes.CDLL(request["library"])
        self.call, self.widths, self.board = library.eqt_code, request["widths"], board
        self.call.argtypes = [ctypes.c_long, ctypes.c_int, ctypes.c_double, *6 * [ctypes.c_void_p]]
        self.at = ctypes.addressof(ctypes.c_char.from_buffer(board.bytes))
        ctypes.c_void_p.in_dll(library, "eqt_row").value = self.at
        lock()

    def serve(self, requests: Any, answers: Any) -> None:
        """Call it with the rows on the board at each byte, until no more come."""
        board, numbers, times = self.board, self.board.numbers, self.board.times
        while requests.read(1):
            at, places = self.at + 8 * FIRST, list[int | None]()
            for width in self.widths:
                places.append(at if width else None)
                at += 8 * numbers[RUNS] * width
            board.begin(0)
            begun = time.thread_time()  # a limit makes that of processes coarse
            self.call(numbers[RUNS], numbers[BEGINS], times[PERIOD], *places)
            times[SPENT] = time.thread_time() - begun
            board.end()
            answers.write(b"\n")


class RunProcess:
    """The process of one run, which answers a line of JSON by another one.

    It is a fork of this process, and shares with it and with other runs nothing that a call
    changes: neither names of imported modules nor variables of compiled ones. Where forks cannot
    be had, as on Windows, there are none of these processes.

    Parameters
    ----------
    serve
        Called in that process with the pipes that it reads and writes: it answers to lines until
        no more come, or lets a program take its place.
    closes
        Ends of other pipes, which that process does not hold open.
    patience
        Time by the clock after which an answer is given up, s.
    """

    def __init__(
        self,
        serve: Callable[[int, int], None],
        closes: Iterable[int],
        patience: float,
        seconds: float,
    ) -> None:
        request_pipe, answer_pipe = os.pipe(), os.pipe()
        self.patience, self.seconds, self.calls = patience, seconds, 0
        random = sys.modules.get("random")
        state = random and random.getstate()
        with allowed("os.fork"):
            self.number = os.fork()
        if self.number == 0:
            code = 1
            try:
                if random:
                    random.setstate(state)  # in a fork, Python seeds it from the clock
                for end in (request_pipe[1], answer_pipe[0], *closes):
                    os.close(end)
                serve(request_pipe[0], answer_pipe[1])
                code = 0
            finally:
                os._exit(code)
        os.close(request_pipe[0])
        os.close(answer_pipe[1])
        self.ends, self.answer = (request_pipe[1], answer_pipe[0]), list[float]()
        self.latest: list[float] | None = None
        self.waiting = select.poll()
        self.waiting.register(answer_pipe[0], select.POLLIN)

    def ask(self, what: Any) -> Any:
        """Return its answer; raises a `RunEnded` that says how it ended instead."""
        said = b""
        try:
            line = json.dumps(what).encode() + b"\n"
            while line:
                line = line[os.write(self.ends[0], line) :]
            while not said.endswith(b"\n"):
                if not self.waiting.poll(1000 * self.patience):
                    self.end()
                    raise RunEnded(f"gave no answer within {self.patience:g} s")
                if not (more := os.read(self.ends[1], 2**16)):
                    raise BrokenPipeError
                said += more
        except BrokenPipeError:
            raise RunEnded(self.ending()) from None
        return json.loads(said)

    def ending(self) -> str:
        """End it; return in words how it ended."""
        code = os.waitstatus_to_exitcode(self.end(waits=1.0))
        if code == -signal.SIGPROF:
            return f"did not return within {self.seconds:g} s"
        if code == -signal.SIGKILL:
            return "was killed, perhaps for lack of memory"
        if code < 0:
            return f"crashed ({signal.Signals(-code).name})"
        return f"ended the process with code {code}"

    def end(self, waits: float = 0.0) -> int:
        """Return the status with which it ends; it may end by itself within some time, s."""
        for end in self.ends:
            os.close(end)
        until = time.monotonic() + waits
        while (ended := os.waitpid(self.number, os.WNOHANG))[0] == 0:
            if time.monotonic() >= until:
                with allowed("os.kill"):
                    os.kill(self.number, signal.SIGKILL)
                return os.waitpid(self.number, 0)[1]
            time.sleep(0.002)
        return ended[1]


class RunEnded(ValueError):
    """The process of a run ended in a call; its argument says how."""


class Runs:
    """The processes of runs, each of which is asked in the order of time.

    Parameters
    ----------
    begin
        Return the process of a run of these numbers.
    lives
        How many processes had these runs before this one.

    Attributes
    ----------
    there
        By the numbers of their runs, each with its calls, its last row and its answer.
    """

    def __init__(self, begin: Callable[[list[float]], RunProcess], lives: int) -> None:
        self.begin, self.started, self.most = begin, lives * ONE_LIFE, FEWEST
        self.there = dict[int, RunProcess]()

    def ask(self, row: list[float], at: int, how: dict[str, Any]) -> tuple[list[float], Any]:
        """Return what the process of a run answers to a row, and what else it says.

        Parameters
        ----------
        at
            How many numbers of the run the row begins with; the run and its calls follow.
        """
        number, calls = (round(x / TINY) for x in row[at : at + 2])
        if not number:
            self.started += 1
            number = self.started * how["processes"] + how["process"] + 1
            self.most = max(self.most, how["keeps"])
            for oldest in list(self.there)[: -self.most + 1]:
                self.there.pop(oldest).end()
            self.there[number] = self.begin(row[:at])
        if (run := self.there.pop(number, None)) is None:
            raise OutOfOrder
        said: Any = {}
        if run.latest is None or run.latest != row[at + 1 :]:
            if run.calls != calls:
                run.end()
                raise OutOfOrder
            said = run.ask({"row": row[at + 2 :], "period": how["period"]})
            if "lost" in said:
                run.end()
                return [], said
            run.calls, run.latest = calls + 1, row[at + 1 :]
            run.answer = [*said["torque"], number * TINY, run.calls * TINY]
        self.there[number] = run
        return list(run.answer), said

    def ends(self) -> list[int]:
        """Return the ends of the pipes to all."""
        return [end for run in self.there.values() for end in run.ends]


class Law:
    """A text that was executed, and the object that it makes.

    Attributes
    ----------
    request
        Text, file and expressions; numbers and inputs with their shapes, and names of the memory.
    memory
        What goes on from call to call: shapes by name.
    error, reason
        The last error of a call, and its words.
    seconds
        CPU time of each call since the last answer, s.
    runs
        With an object for each run, their processes.
    """

    def __init__(self, request: dict[str, Any], board: Board, pipes: tuple[int, ...]) -> None:
        self.request, self.board, self.pipes = request, board, pipes
        self.numbers = [nan]  # with which the object was made: it is not made yet
        self.memory: dict[str, Any] = {}
        self.seconds = list[float]()
        self.error: Exception | None = None
        self.reason, self.files = "", dict[str, Any]()
        self.runs = Runs(self.process_of, request["lives"])

    def start(self) -> None:
        """Execute the text, which may change nothing outside this process, and try the law out."""
        shut_in()
        self.text = compile(self.request["text"], self.request["file"], "exec")
        self.board.begin(-1)
        self.execute()
        if self.request["per_run"]:
            self.try_in_run()
        else:
            self.begin(self.request["values"], self.request["trial"])
            self.files = files_of_law()

    def serve(self, requests: Any, answers: Any) -> None:
        """Answer to the rows of each request by a line, until no more come."""
        for how in requests:
            lost, said = dict[int, str](), dict[str, Any]()
            try:
                said["rows"] = [self.answer(k, row, how, lost) for k, row in enumerate(how["rows"])]
                said |= {"lost": lost, "seconds": self.seconds, "reason": self.reason}
                self.seconds = []
            except OutOfOrder as error:
                said = {"error": str(error)}
            self.board.end()
            answers.write(json.dumps(said).encode() + b"\n")

    def answer(self, place: int, row: Any, how: Any, lost: dict[int, str]) -> list[float] | None:
        """Return the answer to a row; None if it is lost, because the law did what it may not."""
        self.board.begin(place)
        try:
            return self.after(row, how)
        except OutOfOrder:
            raise
        except BaseException as error:  # such as SystemExit
            lost[place] = self.lost(error)
            return None

    def lost(self, error: BaseException) -> str:
        """Return in words what the law did."""
        name, file = self.request["function"], self.request["file"]
        if isinstance(error, RunEnded):
            return f"{name} in {file} {error}"
        return f"{name} in {file}: {described(error, file)}"

    def begin(self, values: list[float], trial: list[list[float]]) -> None:
        """Make the object, and try it out."""
        self.make(values)
        self.memory = {name: np.shape(value) for name, value in self.first.items()}
        self.try_out(trial, {"starts": False, "period": self.request["period"], "keeps": 1})

    def execute(self) -> None:
        """Execute the text as a module of its own."""
        module = sys.modules["eqt_law"] = ModuleType("eqt_law")
        self.names = vars(module)
        exec(self.text, self.names)

    def try_out(self, trial: list[list[float]], how: dict[str, Any]) -> None:
        """Call it at some inputs, and again in another order, which must change nothing."""
        memory = self.kept_numbers()
        before = [*self.request["values"], *np.concatenate([[], *memory])]
        rows, ends, errors = list[Any](), time.monotonic() + TRIAL_SECONDS, list[Exception]()
        for inputs in trial:
            if rows and time.monotonic() > ends:
                break
            self.error = None
            self.board.begin(-1)
            rows.append(([*before, *inputs], self.after([*before, *inputs], how)))
            errors += filter(None, [self.error])
        if rows and len(errors) == len(rows):
            raise errors[0]
        repeated = rows[::-1] if self.request["repeats"] else []
        again = [self.after(row, how) for row, _ in repeated]
        apart = hidden_state(again[::-1], [answer for _, answer in rows])
        if apart:
            raise ValueError(apart)

    def make(self, numbers: list[float]) -> None:
        """Make the object with these numbers, unless it is there."""
        if numbers != self.numbers:
            self.numbers, self.parameters = numbers, named(self.request["numbers"], numbers)
            self.function = eval(self.request["function"], self.names | self.parameters)  # noqa: S307
            self.object = getattr(self.function, "__self__", None)
            self.state: dict[str, Any] = getattr(self.object, "__dict__", self.names)
            for name in self.request["memory"]:
                if name not in self.state:
                    there = ", ".join(self.state) if self.object else "the names of the file"
                    raise ValueError(f"memory: it keeps {there or 'nothing'}, and no {name}")
            self.first = {name: deepcopy(self.state[name]) for name in self.request["memory"]}

    def torque(self, row: list[float], period: float) -> Any:
        """Return the torque of one call; NaN after an error that is of this input."""
        request, values = self.request, self.parameters | named(self.request["adapted"], row)
        values |= {"period": period, "self": self.object, "function": self.function, "flat": flat}
        begun = time.thread_time()  # a limit of CPU time makes that of processes coarse
        try:
            if request["call"]:
                result = eval(request["call"], self.names | values)  # noqa: S307
            else:
                takes = inspect.signature(self.function).parameters
                result = self.function(**{name: values[name] for name in takes if name in values})
            if result is None:
                raise ValueError(f"{request['function']} returned None")
            torque = eval(request["torque"], self.names | values | {"result": result})  # noqa: S307
            return self.output(torque)
        except (PermissionError, MemoryError):
            raise
        except Exception as error:  # whose words are of the law, and belong to this call
            self.error, self.reason = error, described(error, request["file"])
            return np.full(request["returns"], nan)
        finally:
            self.seconds.append(time.thread_time() - begun)

    def output(self, torque: Any) -> Any:
        """Return the output as a vector; raises a `ValueError` with the line of the function."""
        size, code = self.request["returns"], getattr(self.function, "__code__", None)
        line = f"line {code.co_firstlineno}: " if code and not self.request["call"] else ""
        try:
            numbers = real(torque, "the output")
        except (TypeError, ValueError) as error:
            raise ValueError(f"{line}{error}") from None
        if numbers.size != size:
            raise ValueError(f"{line}expected {size} numbers as output, got shape {numbers.shape}")
        return numbers.reshape(size)

    def after(self, row: list[float], how: dict[str, Any]) -> list[float]:
        """Return torque and memory after a call with numbers, memory and inputs."""
        at, torque = len(self.request["values"]), np.zeros(self.request["returns"])
        if OBJECT in self.memory:
            return self.after_in_run(row, at, how)
        self.make(row[:at])
        self.state |= deepcopy(self.first)
        if not how["starts"]:
            self.state |= named(self.memory.items(), row[at:])
            torque = self.torque(row[at + sum(map(prod, self.memory.values())) :], how["period"])
        return list(np.concatenate([torque, *self.kept_numbers()]))

    def kept_numbers(self) -> list[Any]:
        """Return the numbers of each part of the memory."""
        return [np.ravel(real(self.state[name], f"memory {name}")) for name in self.memory]

    def after_in_run(self, row: list[float], at: int, how: dict[str, Any]) -> list[float]:
        """Return what the object of a run answers, which its process makes at its first call."""
        answer, said = self.runs.ask(row, at, how)
        if "lost" in said:
            raise ValueError(said["lost"])
        self.seconds += said.get("seconds", ())
        self.reason = said.get("reason") or self.reason
        return answer

    def try_in_run(self) -> None:
        """Try it out in the process of a run, which takes what the import has left."""
        count = len([*os.scandir("/proc/self/task")]) - 1 if sys.platform == "linux" else 0
        if count:
            raise ValueError(
                f"its import starts {count} thread{'s' if count > 1 else ''}, which the process of "
                "a run does not have; start them where the object is made"
            )
        first = self.process_of(self.request["values"])
        said = first.ask({"trial": self.request["trial"]})
        first.end()
        if "lost" in said:
            raise ValueError(said["lost"])
        self.seconds, self.memory, self.files = said["seconds"], {OBJECT: (2,)}, said["files"]

    def process_of(self, values: list[float]) -> RunProcess:
        """Return a process for a run, whose object is made by its first request."""

        def serve(reads: int, writes: int) -> None:
            with allowed("open"):
                requests, answers = os.fdopen(reads, "rb"), os.fdopen(writes, "wb", 0)
            self.numbers, self.memory = [nan], {}
            for what in map(json.loads, requests):
                self.seconds, said = list[float](), dict[str, Any]()
                signal.setitimer(signal.ITIMER_PROF, self.board.seconds)
                try:
                    if "trial" in what:
                        self.begin(values, what["trial"])
                        said["files"] = files_of_law()
                    else:
                        self.make(values)
                        said["torque"] = list(self.torque(what["row"], what["period"]))
                except BaseException as error:  # such as SystemExit
                    said["lost"] = described(error, self.request["file"])
                signal.setitimer(signal.ITIMER_PROF, 0)
                said |= {"seconds": self.seconds, "reason": self.reason}
                answers.write(json.dumps(said).encode() + b"\n")

        ends, how = (*self.pipes, *self.runs.ends()), self.request
        return RunProcess(serve, ends, how["waits"], how["seconds"])


class OutOfOrder(ValueError):
    """A law with an object for each run was asked for what it cannot answer."""

    def __init__(self) -> None:
        super().__init__(
            "`object: per run` answers in the order of time, from the start of a run on"
        )


def hidden_state(first: Any, second: Any) -> str:
    """Return what it means that equal rows have other answers; "" if they have the same."""
    pairs = (pair for pair in zip(first, second, strict=False))
    apart = [np.abs(np.subtract(a, b)) for a, b in pairs if not np.array_equal(a, b, True)]
    if not apart:
        return ""
    return (
        "it keeps something from call to call that `memory` does not name (difference "
        f"{np.nanmax(apart):.1g}); name it, or write `object: per run`"
    )


def described(error: BaseException, file: str) -> str:
    """Return an error in words, with its line in a file."""
    tb = traceback.extract_tb(error.__traceback__)
    lines = [f"line {frame.lineno}: " for frame in tb if frame.filename == file]
    plain = isinstance(error, ValueError) and not lines  # of this program
    try:
        words = str(error)
    except Exception:  # it is of the law
        words = "(without words)"
    words = words if len(words) <= MOST_WORDS else f"{words[:MOST_WORDS]}…"
    kind = f"{type(error).__name__}{': ' if words else ''}"
    return words if plain else f"{''.join(lines[-1:])}{kind}{words}"


def real(value: Any, name: str) -> Any:
    """Return an array of floats, which would lose the imaginary part of complex numbers."""
    if np.iscomplexobj(array := np.asarray(value)):
        size = np.abs(array.imag).max(initial=0.0)
        raise ValueError(
            f"{name} is complex, with imaginary parts up to {size:.3g}; expected real numbers, "
            "such as np.real(…)"
        )
    return np.asarray(array, dtype=float)


def flat(value: Any, size: int) -> list[float]:
    """Return so many numbers, of arrays and lists of them."""
    parts = list(value) if isinstance(value, list | tuple) else [value]
    numbers: list[float] = np.hstack([np.ravel(real(x, "the output")) for x in parts]).tolist()
    if len(numbers) != size:
        raise ValueError(f"expected {size} numbers, as the state has, got {len(numbers)}")
    return numbers


def named(shapes: Any, row: list[float]) -> dict[str, Any]:
    """Return the numbers of a row by their names: floats, and arrays of their own."""
    values, at = {}, 0
    for name, shape in shapes:
        part, at = row[at : at + prod(shape)], at + prod(shape)
        values[name] = np.array(part).reshape(shape) if shape else part[0]
    return values


def main() -> None:
    """Answer until nothing more is asked."""
    requests, answers = os.fdopen(os.dup(0), "rb"), os.fdopen(os.dup(1), "wb", 0)
    board, nothing = Board(), os.open(os.devnull, os.O_RDWR)
    for stream in (0, 1):  # what a law reads and prints
        os.dup2(nothing, stream)
    lines = (json.loads(line) for line in iter(requests.readline, b""))
    first = next(lines)
    board.seconds = first["seconds"]
    try:
        pipes = requests.fileno(), answers.fileno()
        law: Library | Law
        if "library" in first:
            law = Library(first, board)
        else:
            law = Law(first, board, pipes)
            law.start()
        answers.write(json.dumps({"memory": law.memory, "files": law.files}).encode() + b"\n")
    except Exception as error:
        answers.write(json.dumps({"error": described(error, first["file"])}).encode() + b"\n")
        return
    if isinstance(law, Library):
        law.serve(requests, answers)
    else:
        law.serve(lines, answers)


if __name__ == "__main__":
    main()
