"""Signals become exceptions where they can be raised, and are never lost."""

import signal
import sys
import time
from typing import Annotated

import pytest
from pydantic import BaseModel, Discriminator, Tag

from eqt_cli import cli
from eqt_cli.base import process
from eqt_cli.base.errors import ResultError
from eqt_cli.base.process import STOP_SIGNALS, Interrupted, as_exceptions
from eqt_cli.cli import app


@pytest.fixture(autouse=True)
def handlers():
    """Signals mean again what they meant before: who was told to stop ignores more."""
    before = {number: signal.getsignal(number) for number in STOP_SIGNALS}
    yield
    for number, handler in before.items():
        signal.signal(number, handler)


class Told:
    """Receives a signal while it is finalised, where Python ignores exceptions."""

    def __del__(self):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0)


def told_while_finalised():
    with as_exceptions(lambda: None):
        Told()
        for _ in range(1000):  # until it is told, or 10 s
            time.sleep(0.01)


def test_a_signal_in_a_finaliser_is_not_lost(capsys):
    hook = sys.unraisablehook
    with pytest.raises(Interrupted) as raised:
        told_while_finalised()
    assert raised.value.exit_code == 143
    assert capsys.readouterr().err == ""
    assert sys.unraisablehook is hook


def kind(value):
    """Of a section of `Asking`: pydantic swallows what it raises while a model is dumped."""
    if not isinstance(value, dict):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0)
    return "pair"


class Asking(BaseModel):
    value: Annotated[
        Annotated[tuple[int, int], Tag("pair")] | Annotated[int, Tag("one")], Discriminator(kind)
    ]


def test_a_signal_that_a_library_swallows_is_raised_again(capsys):
    model, waited = Asking.model_construct(value=(1, 2)), []

    def dump_and_wait():
        with as_exceptions(lambda: None):
            dumped = model.__pydantic_serializer__.to_python(model, warnings="none")
            assert dumped == {"value": (1, 2)}
            time.sleep(10)
            waited.append("to the end")

    with pytest.raises(Interrupted) as raised:
        dump_and_wait()
    assert raised.value.exit_code == 143
    assert waited == []
    assert capsys.readouterr().err == ""


def test_an_error_that_a_library_makes_of_a_signal_is_an_interruption(monkeypatch):
    """As HDF5 where it calls back, and Python where a class is made."""

    def read():
        try:
            signal.raise_signal(signal.SIGTERM)
            time.sleep(0)
        except BaseException:
            raise ResultError("out/results.h5: is damaged") from None

    monkeypatch.setattr(app, "app", read)
    with pytest.raises(Interrupted) as raised, as_exceptions(lambda: None) as stop:
        cli._app(stop)
    assert raised.value.exit_code == 143


def test_a_later_signal_ends_at_once(monkeypatch):
    ended = []
    monkeypatch.setattr(process, "ONE_MOMENT", 0.1)
    monkeypatch.setattr(process, "_end_now", ended.append)
    with as_exceptions(lambda: ended.append("told")):
        try:
            signal.raise_signal(signal.SIGTERM)
        except Interrupted:
            signal.raise_signal(signal.SIGINT)  # of the same moment
            time.sleep(0.2)
            signal.raise_signal(signal.SIGINT)
    assert ended == ["told", signal.SIGINT]


def test_other_ignored_exceptions_are_told_as_before():
    class Broken:
        def __del__(self):
            raise ValueError("told")

    sys_hook, told = sys.unraisablehook, []
    sys.unraisablehook = told.append
    try:
        with as_exceptions(lambda: None):
            Broken()
    finally:
        sys.unraisablehook = sys_hook
    assert [str(ignored.exc_value) for ignored in told] == ["told"]
