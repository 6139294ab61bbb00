"""Signals become exceptions where they can be raised, and are never lost."""

import importlib
import os
import signal
import subprocess
import sys
import time
from typing import Annotated

import h5py
import pytest
from pydantic import BaseModel, BeforeValidator, Discriminator, Tag, TypeAdapter

from eqt_cli.base import process, store_reader
from eqt_cli.base.errors import ResultError
from eqt_cli.base.process import STOP_SIGNALS, Interrupted, as_exceptions


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


def test_a_signal_during_an_import_ends_the_wait_after_it(tmp_path, monkeypatch):
    monkeypatch.syspath_prepend(tmp_path)
    name, waited = f"told_{tmp_path.name}", []
    (tmp_path / f"{name}.py").write_text("import signal; signal.raise_signal(signal.SIGTERM)")

    def load_and_wait():
        with as_exceptions(lambda: None):
            importlib.import_module(name)
            time.sleep(10)
            waited.append("to the end")

    with pytest.raises(Interrupted):
        load_and_wait()
    assert waited == []
    assert name in sys.modules


def test_a_signal_while_a_file_is_read_is_no_damage_of_it(tmp_path, monkeypatch):
    """HDF5 makes an error of its own of what is raised where it calls back."""
    path, waited = tmp_path / "small.h5", []
    h5py.File(path, "w").close()

    def told(file):
        try:
            signal.raise_signal(signal.SIGTERM)
            time.sleep(0)
        except BaseException:
            raise OSError("cannot read") from None

    monkeypatch.setattr(store_reader, "format_of", told)

    def open_and_wait():
        with as_exceptions(lambda: None):
            with pytest.raises(ResultError, match="is an HDF5 file, but not one of eqt's"):
                store_reader.ResultFile(path)
            time.sleep(10)
            waited.append("to the end")

    with pytest.raises(Interrupted) as raised:
        open_and_wait()
    assert (raised.value.exit_code, waited) == (143, [])


def test_a_second_signal_long_after_a_deferred_one_ends_at_once(tmp_path, monkeypatch):
    """What is sent again by itself does not count; a file may keep Python busy for minutes."""
    path, ended = tmp_path / "small.h5", []
    h5py.File(path, "w").close()
    monkeypatch.setattr(process, "PATIENCE", 0.1)
    monkeypatch.setattr(process, "_end_now", ended.append)

    def told(file):
        signal.raise_signal(signal.SIGTERM)
        time.sleep(0.3)
        assert ended == []
        signal.raise_signal(signal.SIGTERM)
        assert ended == [signal.SIGTERM]
        raise ValueError("read")

    monkeypatch.setattr(store_reader, "format_of", told)
    with as_exceptions(lambda: None), pytest.raises(ResultError):
        store_reader.ResultFile(path)
    assert ended == [signal.SIGTERM]


def told(value):
    signal.raise_signal(signal.SIGTERM)
    time.sleep(0)
    return value


def test_a_signal_while_a_value_is_checked_is_no_error_of_the_value():
    checked = []

    def check_and_wait():
        with as_exceptions(lambda: None):
            checked.append(TypeAdapter(Annotated[str, BeforeValidator(told)]).validate_json('"a"'))
            time.sleep(10)
            checked.append("to the end")

    with pytest.raises(Interrupted):
        check_and_wait()
    assert checked == ["a"]


def test_a_folder_called_pydantic_is_not_pydantic():
    code = compile("signal.raise_signal(signal.SIGTERM)", "/home/me/pydantic/mine.py", "exec")
    with pytest.raises(Interrupted), as_exceptions(lambda: None):
        exec(code, {"signal": signal, "__name__": "mine"})


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


DEAF = """
import signal, sys, time
from eqt_cli.base.process import ONE_MOMENT, Interrupted, as_exceptions
with as_exceptions(lambda: None):
    try:
        signal.raise_signal(signal.SIGTERM)
    except Interrupted:
        signal.raise_signal(signal.SIGTERM)  # of the same moment
        time.sleep(1.2 * ONE_MOMENT)
        assert signal.getsignal(signal.SIGTERM) != signal.SIG_DFL
        signal.raise_signal(signal.SIGTERM)
        assert signal.getsignal(signal.SIGTERM) == signal.SIG_DFL
        assert signal.getsignal(signal.SIGINT) == signal.SIG_DFL
        print("told", flush=True)
        signal.raise_signal(signal.SIGTERM)
        print("deaf", flush=True)
"""


@pytest.mark.skipif(os.name != "posix", reason="sends POSIX signals")
def test_after_a_second_signal_the_system_ends_the_process():
    done = subprocess.run([sys.executable, "-c", DEAF], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stdout, done.stderr) == (-signal.SIGTERM, "told\n", "")
