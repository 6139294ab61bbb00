"""Files that are none, have no end, or hold something else: one message, without their content."""

import json
import os
import re
from pathlib import Path

import pytest
from said import says

from eqt_cli.base.files import TEXT_BYTES, content_of, open_regular, read_record, text_of
from eqt_cli.base.store_reader import open_results
from eqt_cli.extend import EqtError
from eqt_cli.runs.part_files import unfinished

SECRET = "hunter2 5f4dcc3b\nroot:x:0:0\nbase64 b3BlbnNzaC1rZXk\n"

# What is no file ---------------------------------------------------------------------------------

posix = pytest.mark.skipif(os.name != "posix", reason="has no pipes in folders")


def _pipe(path):
    os.mkfifo(path)
    return "a named pipe"


def _device(path):
    path.symlink_to("/dev/zero")
    return "a device"


def _socket(path):
    import socket

    with socket.socket(socket.AF_UNIX) as made:
        made.bind(path.name)  # a path may be too long
    return "a socket"


def _huge(path):
    with path.open("wb") as file:
        file.truncate(2**40)  # a sparse file, which takes no space
    return None


KINDS = {"pipe": _pipe, "device": _device, "socket": _socket, "huge": _huge}
NAMED = {
    "configuration": ("run {}.yaml", ".yaml", 4_000_000),
    "plugin": ("config check c.yaml --set plugins=[{}.py]", ".py", TEXT_BYTES),
    "plugin to list": ("list --plugin {}.py", ".py", TEXT_BYTES),
    "reference": (
        "config check c.yaml --set|reference={{kind: waypoints, file: {}.csv}}",
        ".csv",
        64_000_000,
    ),
    "starts": ("config check c.yaml --set|initial={{file: {}.csv}}", ".csv", 64_000_000),
    "recording": ("log check {}.csv", ".csv", 400_000_000),
    "mapping": ("log check {0}.csv --mapping {0}.csv", ".csv", TEXT_BYTES),
    "notes": ("report RESULT --notes {}.txt", ".txt", TEXT_BYTES),
    "style": ("plot RESULT --style {}.mplstyle --out f --format svg", ".mplstyle", TEXT_BYTES),
}


@pytest.mark.needs("logs", "report")
@posix
@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("named", NAMED)
def test_only_regular_files_of_a_moderate_size_are_read(sent, eqt, default_result, named, kind):
    words, suffix, most = NAMED[named]
    said = KINDS[kind](Path(f"x{suffix}"))
    first, *rest = words.format("x").split("|")
    done = eqt(*(w.replace("RESULT", str(default_result)) for w in first.split()), *rest)
    assert (done.code, done.out) == (2, "")
    expected = f"it is {said}; expected a regular file"
    if said is None:
        expected = f"expected at most {most:,} bytes, got 1,099,511,627,776"
    assert expected in done.err


@posix
@pytest.mark.parametrize("kind", ["pipe", "device", "socket"])
def test_a_result_is_a_regular_file(sent, kind):
    KINDS[kind](Path("results.h5"))
    with pytest.raises(EqtError, match=r"^results\.h5: is not a file; give a result folder"):
        open_results("results.h5")


@posix
def test_records_of_a_folder_are_no_links(sent, tmp_path):
    (tmp_path / "theirs.json").write_text('{"digest": "x"}', encoding="utf-8")
    Path("manifest.json").symlink_to(tmp_path / "theirs.json")
    with pytest.raises(OSError, match=r"manifest\.json: it is a symbolic link"):
        read_record(Path("manifest.json"))


def test_a_file_that_grows_is_not_read_beyond_its_bound(tmp_path, monkeypatch):
    path = tmp_path / "x"
    path.write_bytes(b"x" * 11)
    state = os.stat_result([0o100644, *[0] * 9])
    monkeypatch.setattr(os, "fstat", lambda handle: state)  # as files of /proc say
    with pytest.raises(OSError, match="expected at most 10 bytes, got 11"):
        content_of(path, 10)


def test_files_are_opened_as_they_are(tmp_path):
    path = tmp_path / "x"
    path.write_bytes(b"1\r\n2\r3\n")
    with open_regular(path) as stream:
        assert stream.read() == b"1\r\n2\r3\n"
    assert text_of(path, "") == "1\n2\n3\n"
    with pytest.raises(EqtError, match=r"cannot be read: is a directory$"):
        text_of(tmp_path, "")


# What a message shows ----------------------------------------------------------------------------

SECRETS = {
    "reference": "config check c.yaml --set|reference={kind: waypoints, file: secret}",
    "reference in TUM": (
        "config check c.yaml --set|reference={kind: waypoints, file: secret, format: tum}"
    ),
    "reference in EuRoC": (
        "config check c.yaml --set|reference={kind: waypoints, file: secret, format: euroc}"
    ),
    "starts": "config check c.yaml --set|initial={file: secret}",
    "style": "plot RESULT --style ./secret --out f",
    "configuration": "run secret",
}
CONTENTS = {
    "lines": SECRET,
    "a header": "secret_a,secret_a\nhunter2,5f4dcc3b\n",
    "eight words": "hunter2 " * 8 + "\n" + "hunter2 " * 8,
    "eight entries": "hunter2," * 8 + "\n",
}


@pytest.mark.parametrize("content", CONTENTS)
@pytest.mark.parametrize("named", SECRETS)
def test_a_message_shows_nothing_of_a_file_of_another_kind(
    sent, eqt, default_result, named, content
):
    Path("secret").write_text(CONTENTS[content], encoding="utf-8")
    first, *rest = SECRETS[named].split("|")
    done = eqt(*(w.replace("RESULT", str(default_result)) for w in first.split()), *rest)
    assert done.code == 2
    for part in ("hunter2", "5f4dcc3b", "secret_a", "root", "b3Blbn"):
        assert part not in done.err.replace("./secret", "")


# What ended in a traceback -----------------------------------------------------------------------

TIMES = {
    (
        "0",
        "1.0e-320",
        "2.0",
    ): "expected at least 1e-09 s between two waypoints, got 1e-320 s after 0 s",
    ("0", "1.0", "1.5e+308"): "expected times from -1e+09 to 1e+09 s, got 1.5e+308 s",
    ("-1.0e+308", "0", "1.0e+308"): "expected times from -1e+09 to 1e+09 s, got -1e+308 s",
}


@pytest.mark.needs("logs", "report")
@pytest.mark.parametrize("times", TIMES)
def test_times_of_waypoints_have_bounds(sent, refused, times):
    points = ", ".join(f"{{t: {t}, pose: {{rotvec: [0, 0, {k}]}}}}" for k, t in enumerate(times))
    reference = f"reference={{kind: waypoints, points: [{points}]}}"
    assert TIMES[times] in refused("config", "check", "c.yaml", "--set", reference)
    rows = "".join(f"{float(t)!r},0,0,{k}\n" for k, t in enumerate(times))
    Path("w.csv").write_text("t,wx [rad],wy [rad],wz [rad]\n" + rows, encoding="utf-8")
    assert TIMES[times] in refused(
        "config", "check", "c.yaml", "--set", "reference={kind: waypoints, file: w.csv}"
    )


@pytest.mark.ci("computes what is at the bounds")
def test_times_at_the_bounds_are_taken(sent, eqt):
    # At 1 rad/s between the rows of a nanosecond: no run along 1 rad there would end.
    rows = "-1e9,0,0,0\n0,0,0,1\n1e-9,0,0,1.000000001\n1,0,0,1\n1e9,0,0,0\n"
    Path("w.csv").write_text("t,wx [rad],wy [rad],wz [rad]\n" + rows, encoding="utf-8")
    done = eqt("config", "check", "c.yaml", "--set", "reference={kind: waypoints, file: w.csv}")
    assert done.code == 0


@pytest.mark.needs("logs", "report")
@pytest.mark.parametrize(
    ("kind", "text", "said"),
    [
        (
            "csv",
            "t,wx [rad],wy [rad],wz [rad]\n0,0,0," + "1" * 200_000,
            "w:2: expected a line of at most 100000 characters, got 200006",
        ),
        ("euroc", "9" * 5000 + ",0,0,0,1,0,0,0\n", "w:1: expected nanoseconds, got text"),
        ("euroc", "9" * 500 + ",0,0,0,1,0,0,0\n", "w:1: expected nanoseconds, got text"),
    ],
)
def test_long_entries_of_a_file(sent, refused, kind, text, said):
    Path("w").write_text(text, encoding="utf-8")
    reference = f"reference={{kind: waypoints, file: w, format: {kind}}}"
    assert refused("config", "check", "c.yaml", "--set", reference).endswith(f"{said}\n")


LONG = """
run N | run N.yaml | sweep N | pack N | show N | compare N | diff N N | verify N | plot N
plot N N | animate N | report N | config check N | run c.yaml --out N | config new N.yaml
"""


@pytest.mark.needs("proofs", "report")
@pytest.mark.parametrize("words", re.split(r" \| |\n", LONG.strip()))
def test_names_that_are_too_long(sent, refused, words):
    assert "file name too long" in refused(*words.replace("N", 300 * "n").split()).lower()


def test_a_record_that_is_nested_deeply_is_none(sent, refused):
    (sent / "out/parts").mkdir(parents=True)
    (sent / "out/manifest.json").write_text("[" * 50_000, encoding="utf-8")
    assert unfinished(sent / "out") is None
    assert says(
        refused("run", "c.yaml", "--out", "out"),
        "out: manifest.json is damaged, or not of eqt…choose another folder with --out\n",
    )


@pytest.mark.parametrize(
    "plan",
    [3, {}, [], {"points": 1}, {"points": "x", "runs": 1, "controllers": 1, "size": 1}]
    + [{"points": 1, "runs": 1, "controllers": 1, "size": size} for size in (0, -1, 0.5, None)],
    ids=str,
)
def test_a_plan_of_another_shape_is_none(sent, plan):
    (sent / "out/parts").mkdir(parents=True)
    (sent / "out/parts/000000.npy").touch()
    text = json.dumps({"plan": plan, "name": "x", "begun": "y"})
    (sent / "out/manifest.json").write_text(text, encoding="utf-8")
    assert unfinished(sent / "out") is None


WINNER = {"label": "eqt", "values": {}, "config": "x"}
SEARCH = {"seed": 0, "label": None, "objectives": [[1.0]]}
LAW = {"label": "eqt", "start": "eqt", "winners": [], "searches": [SEARCH]}
RECORDS = [
    {"laws": 3},
    {"laws": {}},
    {"laws": []},
    {"laws": [3]},
    {"laws": [{"winners": [{}]}]},
    {"laws": [{"start": [], "winners": [{"label": []}]}]},
    {"laws": [{"start": "eqt", "winners": []}]},
    {"laws": [LAW], "objectives": ["nope"]},
    {"laws": [LAW | {"winners": [WINNER]}], "objectives": ["effort"]},
    {"laws": [LAW], "objectives": ["effort"], "constraints": [{"metric": "effort"}]},
    {"laws": [LAW], "objectives": ["effort", "effort", "effort"], "constraints": []},
]


@pytest.mark.ci("computes what is at the bounds")
def test_a_search_of_another_shape_is_none(sent, eqt):
    eqt("run", "c.yaml", "--out", "own", "--quiet")
    expected = eqt("compare", "own").out
    for record in RECORDS:
        text = json.dumps({"digest": 1, **record})
        (sent / "own/tuning.json").write_text(text, encoding="utf-8")
        done = eqt("compare", "own")
        assert (done.code, done.out) == (0, expected), record


@pytest.mark.ci("starts processes")
def test_a_date_of_builds_that_is_none(sent, eqt, monkeypatch):
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "garbage")
    done = eqt("plot", "c.yaml", "--format", "pdf", "--out", "f")
    assert done.code == 0, done.err
    assert os.environ["SOURCE_DATE_EPOCH"] == "garbage"
