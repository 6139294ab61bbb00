"""Lists of flights: written from a folder, read by all commands, wrong rows."""

import csv
from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import says

import eqt_cli
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.logs.flight_list import COLUMNS, flights_in, is_list, read_list

T = np.arange(0.0, 12.0, 0.05)
WANTED = np.c_[np.cos(T), np.sin(1.3 * T), 1 + 0.1 * np.sin(T)]


def fly(name, size=0.1, seed=0, late=0.0):
    """A flight whose error is of a size, with its own setpoints; returns its rms."""
    error = size * np.c_[np.sin(3 * T), np.cos(2 * T), 0 * T]
    error += 0.001 * np.random.default_rng(seed).normal(size=error.shape)
    Path(name).parent.mkdir(parents=True, exist_ok=True)
    rows = np.c_[T + late, WANTED + error, WANTED]
    np.savetxt(name, rows, "%.9f", ",", header="t,x,y,z,x_ref,y_ref,z_ref", comments="")
    return np.sqrt(np.mean(np.sum(error**2, axis=1)))


def rows_of(name):
    return list(csv.DictReader(Path(name).read_text().splitlines()))


def test_a_folder_becomes_a_list():
    rms = fly("all/pid/1.csv"), fly("all/lee/1.csv", 0.2, 1)
    fly("all/lee/copy.csv", 0.2, 1)
    fly("all/lee/late.csv", 0.2, 1, late=7.0)
    Path("all/notes.txt").write_text("no flight")
    check = eqt_cli.check_flights("all", out="list/flights.csv")
    by_name = {line.flight.file.as_posix(): line for line in check.lines}
    assert by_name["all/lee/copy.csv"].twice == "1.csv, the same file"
    assert says(by_name["all/lee/late.csv"].twice, "1.csv, the same motion, by a clock 7 s ahead…")
    one = by_name["all/pid/1.csv"]
    assert one.error == pytest.approx(rms[0], rel=1e-6)
    assert (one.seconds, one.rate) == pytest.approx((11.95, 20.0))
    assert (one.gaps, one.missing, one.unit) == (0, ("attitude",), "m")
    length = np.linalg.norm(np.diff(WANTED, axis=0), axis=1).sum() / 11.95
    assert one.speed == pytest.approx(length, rel=0.05)  # of the flown path, which is longer
    assert [(row["file"], row["law"]) for row in rows_of("list/flights.csv")] == [
        ("../all/lee/1.csv", "lee"),
        ("../all/pid/1.csv", "pid"),
    ]
    said = refusal(EqtError, eqt_cli.check_flights, "all", out="list/flights.csv")
    assert says(said, "list/flights.csv: exists; choose another name…")


def test_a_row_of_a_list_takes_a_part():
    fly("1.csv")
    Path("flights.csv").write_text("file,begin,end\n1.csv,+2,6\n1.csv,7,\n1.csv,20,\n")
    first, last, none = eqt_cli.check_flights("flights.csv").lines
    assert (first.seconds, last.seconds) == pytest.approx((4.0, 4.95))
    rows = (T >= 7) & (T <= 11.95)
    length = np.linalg.norm(np.diff(WANTED[rows], axis=0), axis=1).sum() / 4.95
    assert last.speed == pytest.approx(length, rel=0.05)
    assert says(none.problem, "1.csv: begin: no rows are left; the recording is from 0 to 11.95 s")


def test_a_folder_with_metadata_is_one_recording():
    Path("bag").mkdir()
    Path("bag/metadata.yaml").write_text("")
    assert [flight.file for flight in flights_in("bag")] == [Path("bag")]


def test_a_list_is_told_from_a_recording():
    fly("1.csv")
    Path("flights.csv").write_text("\ufefffile;law\n1.csv;pid\n")
    assert (is_list("1.csv"), is_list("flights.csv"), is_list("none.csv")) == (False, True, False)
    assert read_list(Path("flights.csv"))[0].law == "pid"


def test_a_row_gives_mapping_part_and_factors():
    fly("1.csv")
    Path("map.yaml").write_text("setpoint: {x: x_ref, y: y_ref, z: 9}")
    head = ",".join(COLUMNS)
    Path("flights.csv").write_text(f"{head},wind\n1.csv,pid,,calm,map.yaml,,+2,8.5,3 m/s\n")
    (flight,) = read_list(Path("flights.csv"))
    assert flight.settings == {"condition": "calm", "wind": "3 m/s"}
    errors = eqt_cli.log_errors(flight.file, **flight.how)
    assert errors.sizes[0].largest > 7.5
    t = errors.curves["position"][0]
    assert (t[0], t[-1]) == pytest.approx((2.0, 8.5))


WRONG = {
    "file\nnone.csv": "flights.csv:2: file: 'none.csv' was not found; expected a recording; paths…",
    "file\n1.cvs": "…:2: file: '1.cvs' was not found…",
    "file,law\n1.csv": "flights.csv:2: expected 2 cells, one for each column, got 1",
    "file,law\n1.csv,a,b": "…:2: expected 2 cells, one for each column, got 3; write a…",
    "file,begin\n1.csv,soon": "…:2: begin: expected seconds, as 12.5 by…or +5 from…, got 'soon'",
    "file,begin,end\n1.csv,5,4": "…:2: end: expected a time after begin, 5 s, got 4 s",
    "file,mapping\n1.csv,no.yaml": "…:2: mapping: 'no.yaml' was not found; expected a YAML file…",
    "file,setpoint\n1.csv,no.csv": "…:2: setpoint: 'no.csv' was not found; expected a recor…",
    "file\n1.csv\n1.csv": "flights.csv:3: file: '1.csv' is in line 2, too; a flight stands once;…",
    "file,laws\n1.csv,pid": "flights.csv:1: column 'laws'; did you mean 'law'?",
    "file,law,law\n1.csv,a,b": "flights.csv:1: columns 2 and others are named law; rename it",
    "file,\n1.csv,a": "flights.csv:1: column 2 has no name; rename it",
    "file,law\n,pid": "…:2: file: is empty; give the recording…",
    "file\n": "flights.csv: lists no flights;…",
}


@pytest.mark.parametrize("text", WRONG)
def test_wrong_rows_are_named_with_place_value_and_advice(text):
    fly("1.csv")
    Path("flights.csv").write_text(text)
    said = refusal(EqtError, read_list, Path("flights.csv"))
    assert says(said, WRONG[text]), said


def test_all_wrong_rows_are_named_at_once():
    Path("flights.csv").write_text("file,begin\na.csv,x\nb.csv,1\n")
    assert len(refusal(EqtError, read_list, Path("flights.csv")).splitlines()) == 3


def test_errors_of_a_list_are_a_table_and_a_file(invoke):
    rms = fly("1.csv"), fly("2.csv", 0.2, 1)
    Path("flights.csv").write_text("file,law,wind\n1.csv,pid,calm\n2.csv,lee,gusts\n")
    said = invoke("log", "errors", "flights.csv", "--out", "found").stdout
    assert "pid" in said
    mark, *lines = Path("found/errors.csv").read_text().splitlines()
    assert mark.startswith("#")
    rows = [*csv.DictReader(lines)]
    assert [(row["file"], row["law"], row["wind"]) for row in rows] == [
        ("1.csv", "pid", "calm"),
        ("2.csv", "lee", "gusts"),
    ]
    assert [float(row["position, m"]) for row in rows] == pytest.approx(rms, rel=1e-6)
