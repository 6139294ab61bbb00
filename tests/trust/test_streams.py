"""Streams that are closed, full or of few characters stop no command, and cause no traceback."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from ci_cases import mostly_ci

pytestmark = pytest.mark.skipif(os.name != "posix", reason="streams as a POSIX shell has them")

FULL = pytest.mark.skipif(not Path("/dev/full").exists(), reason="has no /dev/full")


def shell(words, redirection, **environment):
    """The command in a process whose streams a shell has redirected; its code, stdout, stderr."""
    program = f'"{sys.executable}" -m eqt_cli {words} {redirection}'
    done = subprocess.run(
        ["sh", "-c", program], capture_output=True, env={**os.environ, **environment}, check=False
    )
    assert b"Traceback" not in done.stderr
    assert b"Exception ignored" not in done.stderr
    return done.returncode, done.stdout, done.stderr


ENDS = {
    "stdout closed": ("list groups", ">&-", 0, b""),
    "stderr closed": ("run nope.yaml", "2>&-", 2, b""),
    "both closed": ("run nope.yaml --json", ">&- 2>&-", 2, b""),
    "all closed": ("list groups", "<&- >&- 2>&-", 0, b""),
    "an error on a full stderr": ("run nope.yaml", "2>/dev/full", 2, b""),
    "wrong usage on a full stderr": ("run --nope", "2>/dev/full", 2, b""),
    "the version on a full stdout": (
        "--version",
        ">/dev/full",
        2,
        b"eqt: error: standard output: cannot be written: no space left on device\n",
    ),
    "a document on a full stdout": (
        "config schema",
        ">/dev/full",
        2,
        b"eqt: error: standard output: cannot be written: no space left on device\n",
    ),
}


@FULL
@mostly_ci("case", ENDS, ["a document on a full stdout"], "starts a process for each")
def test_closed_and_full_streams(sent, case):
    words, redirection, code, told = ENDS[case]
    found, _, error = shell(words, redirection)
    assert (found, error) == (code, told)


RUNS = {
    "stdout closed": (">&-", b""),
    "stderr closed": ("2>&-", b""),
    "stderr full": ("2>/dev/full", b""),
    "all closed": ("<&- >&- 2>&-", b""),
    "stdout full": (
        ">/dev/full",
        b"standard output: cannot be written: no space left on device; the result is complete\n",
    ),
}


@FULL
@pytest.mark.ci("starts a process for each case, which simulates")
@pytest.mark.parametrize("case", RUNS)
def test_a_run_that_is_done_says_0(sent, case):
    redirection, told = RUNS[case]
    found, _, error = shell("run c.yaml --out ../out", redirection)
    assert found == 0
    assert error.endswith(told)
    assert json.loads((sent.parent / "out/manifest.json").read_text())["failed"] == 0


def test_no_file_takes_the_place_of_a_closed_stream(sent):
    """What libraries write on stderr would be written into it."""
    code = (
        "import os, sys\n"
        "from eqt_cli.base import process\n"
        "process.make_safe()\n"
        "with open('kept', 'w') as file:\n"
        "    assert file.fileno() > 2, file.fileno()\n"
        "    os.write(2, b'harm')\n"
        "    print('harm', file=sys.stderr)\n"
    )
    subprocess.run(["sh", "-c", f'"{sys.executable}" -c "{code}" 2>&-'], check=True)
    assert (sent / "kept").read_bytes() == b""


ENCODINGS = {
    "ascii": {"PYTHONIOENCODING": "ascii"},
    "the locale C": {"LC_ALL": "C", "PYTHONUTF8": "0", "PYTHONCOERCECLOCALE": "0"},
    "Windows": {"PYTHONIOENCODING": "cp1252"},
    "Windows of old": {"PYTHONIOENCODING": "cp437"},
}


@pytest.mark.ci("starts two processes for each encoding")
@pytest.mark.parametrize("case", ENCODINGS)
def test_characters_that_cannot_be_written_are_replaced(sent, case):
    text = (sent / "c.yaml").read_text(encoding="utf-8")
    label = "controllers: [{kind: eqt, label: '\u8a66\u9a13'}]"
    (sent / "d.yaml").write_text(text.replace("controllers: [eqt]", label), encoding="utf-8")
    code, out, error = shell("config check d.yaml --resolved", "", **ENCODINGS[case])
    assert code == 0, error
    assert b"label: ??" in out
    code, out, _ = shell("config check d.yaml --json", "", **ENCODINGS[case])
    assert code == 0
    assert json.loads(out.decode("ascii"))["controllers"] == ["\u8a66\u9a13"]
