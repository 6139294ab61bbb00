"""Progress on stderr: plain lines where it is no terminal, nothing for short or quiet work."""

import io
import re
import sys
import threading
import time
from contextlib import contextmanager
from types import SimpleNamespace

import pytest

from eqt_cli.base.reporting import reporter, reporting, step
from eqt_cli.cli import output


class Clock:
    """A clock that stands still until it is set."""

    now = 100.0

    def __call__(self):
        return self.now


@pytest.fixture(autouse=True)
def not_quiet():
    """What a command of another test was told holds in its process until the next command."""
    output.be_quiet(False)


@pytest.fixture
def clock(monkeypatch):
    clock = Clock()
    monkeypatch.setattr(output, "SHOW_AFTER", 1.0)
    monkeypatch.setattr(output, "time", SimpleNamespace(monotonic=clock))
    return clock


@contextmanager
def shown(what, count):
    """A step, as a command shows it."""
    with reporting(output.meter()), step(what, count):
        yield reporter().advance


@pytest.mark.parametrize(
    ("what", "count", "done", "lines"),
    [
        pytest.param(
            "runs",
            800,
            ((0.5, 50), (1.5, 50), (2.0, 40), (6.4, 60), (6.6, 200)),
            ["100/800 runs, 67 runs/s, 10 s left", "400/800 runs, 61 runs/s, 7 s left"],
            id="rate and remaining time",
        ),
        pytest.param(
            "runs",
            800,
            ((2.0, 400), (40.0, 400)),
            ["400/800 runs, 200 runs/s, 2 s left", "800/800 runs: done in 40.0 s"],
            id="done",
        ),
        pytest.param(
            "points checked",
            100_000,
            ((2.0, 8), (10.0, 1992), (20.0, 97_999.999), (30.0, 0.002)),
            [
                "8/100000 points checked",
                "2000/100000 points checked, 200 points/s, 8.2 min left",
                "100000/100000 points checked: done in 30.0 s",
            ],
            id="a guess waits for more than the first",
        ),
    ],
)
def test_lines_tell_how_far_a_step_is(clock, capsys, what, count, done, lines):
    with shown(what, count) as advance:
        for second, amount in done:
            clock.now = 100.0 + second
            advance(amount)
    out, err = capsys.readouterr()
    assert (out, err.splitlines()) == ("", lines)


def test_short_work_shows_nothing(clock, capsys):
    with shown("runs", 8) as advance:
        clock.now += 0.9
        advance(8)
    assert capsys.readouterr() == ("", "")


class Terminal(io.StringIO):
    def isatty(self):
        return True


def test_a_terminal_has_a_bar(monkeypatch):
    monkeypatch.setattr(output, "SHOW_AFTER", 0.0)
    monkeypatch.setenv("TERM", "xterm")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with shown("runs", 8) as advance:
        advance(3)
        advance(2)
    assert "5/8 runs" in terminal.getvalue()


def test_a_terminal_that_cannot_move_its_cursor_has_lines(clock, monkeypatch):
    monkeypatch.setenv("TERM", "dumb")
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with shown("runs", 8) as advance:
        clock.now += 2
        advance(4)
    assert terminal.getvalue() == "4/8 runs, 2 runs/s, 2 s left\n"


def test_short_work_on_a_terminal_shows_nothing(monkeypatch):
    terminal = Terminal()
    monkeypatch.setattr(sys, "stderr", terminal)
    with shown("runs", 8) as advance:
        advance(8)
    assert terminal.getvalue() == ""


def test_a_run_tells_how_far_it_is(eqt, monkeypatch):
    monkeypatch.setattr(output, "SHOW_AFTER", 0.0)
    monkeypatch.setattr(output, "LINE_EVERY", 0.0)
    monkeypatch.setattr("eqt_cli.runs.executors.LOOK_EVERY", 0.01)
    longer = [
        "--set",
        "time.duration=40",
        "--set",
        "time.samples=401",
    ]  # than the time between two looks
    done = eqt("run", "c.yaml", "--set", "solver.block=1", "--set", "controllers=[eqt]", *longer)
    lines = done.err.splitlines()
    told = re.compile(r"\d/3 runs(, [\d.]+ runs/s)?(, [\d.]+ (s|min) left)?")
    runs = [line for line in lines if told.fullmatch(line)]
    assert any(line.startswith("1/3 runs, ") for line in runs)
    packed = [line for line in lines if "parts packed" in line]
    assert re.fullmatch(r"1/1 parts packed: done in \d+\.\d s", packed[-1])
    end = lines[len(runs)]
    assert re.fullmatch(r"3/3 runs: done in \d+\.\d s", end)
    assert lines == [*runs, end, *packed]
    assert "runs/s" not in done.out


@pytest.mark.needs("proofs")
def test_verify_tells_how_far_it_is_before_a_run_is_done(eqt, monkeypatch):
    """Of a body with unlike moments of inertia, the first run alone may take minutes."""
    monkeypatch.setattr(output, "SHOW_AFTER", 0.0)
    monkeypatch.setattr(output, "LINE_EVERY", 0.0)
    lines = eqt("verify", "c.yaml", "--set", "ensemble.runs=1").err.splitlines()
    early = r"0/2 runs, [\d.]+ runs/s, [\d.]+ (s|min) left"
    assert any(re.fullmatch(early, line) for line in lines)


def test_a_step_that_begins_counts_anew(clock, capsys):
    with reporting(output.meter()):
        with step("runs", 8):
            reporter().advance(8)
        with step("runs cross-checked", 12):
            clock.now += 2
            reporter().advance(6)
    assert capsys.readouterr().err == "6/12 runs cross-checked, 3 runs/s, 2 s left\n"


def test_a_quiet_run_tells_nothing(eqt, monkeypatch):
    monkeypatch.setattr(output, "SHOW_AFTER", 0.0)
    assert eqt("run", "c.yaml", "--quiet", "--set", "ensemble.runs=1").err == ""


def test_what_takes_long_and_cannot_be_counted_is_named(capsys, monkeypatch):
    monkeypatch.setattr(output, "SHOW_AFTER", 0.01)
    told, say = threading.Event(), output.say
    monkeypatch.setattr(output, "say", lambda text: (say(text), told.set()))
    with shown("runs", 8), reporter().busy("compiling the laws"):
        assert told.wait(10)
    assert capsys.readouterr().err == "compiling the laws\n"


def test_laws_that_are_compiled_side_by_side_are_named_once_each(capsys):
    lines = output.meter()
    for law in ("law 1 of 2", "law 2 of 2", "law 1 of 2"):
        with lines.busy(law):
            lines.remind()
    assert capsys.readouterr().err == "law 1 of 2\nlaw 2 of 2\n"


def test_what_cannot_be_counted_says_nothing_of_the_rate(clock, capsys):
    with shown("runs", 800) as advance:
        with reporter().busy("compiling the laws"):
            clock.now += 30.0
        clock.now += 2.0
        advance(100)
    assert capsys.readouterr().err == "100/800 runs, 50 runs/s, 14 s left\n"


def test_what_is_soon_done_is_not_named(capsys, monkeypatch):
    monkeypatch.setattr(output, "SHOW_AFTER", 0.2)
    with shown("runs", 8):
        with reporter().busy("compiling the laws"):
            pass
        time.sleep(0.3)
    with reporter().busy("compiling the laws"):  # which nobody watches
        pass
    assert capsys.readouterr().err == ""
