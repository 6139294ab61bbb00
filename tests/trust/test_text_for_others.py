"""Text and numbers that other programs take for something else: names, cells, widths, shards."""

import csv
import io
from pathlib import Path

import pytest
from said import says

from eqt_cli.base.files import file_name, is_device
from eqt_cli.cli.app import MOST_COLUMNS
from eqt_cli.cli.tables import as_csv, csv_cell
from eqt_cli.runs.run_study import Shard, execute

FORMULA = "=cmd|' /C calc'!A0"


@pytest.mark.parametrize("begin", ["=", "+", "-", "@", "\t", "\r"])
def test_a_cell_is_no_formula(begin):
    assert csv_cell(f"{begin}SUM(A1)") == f"'{begin}SUM(A1)"


@pytest.mark.parametrize("cell", [-1.5, "-1.5", "-1e-300", "+2", "-inf", "a=b", "", None, 3])
def test_numbers_and_other_text_stay(cell):
    assert csv_cell(cell) == cell


def test_tables_of_comparisons_hold_no_formula():
    text = as_csv([{"=A": FORMULA, "x": -1.0}, {"=A": "eqt", "x": float("nan")}])
    assert list(csv.reader(io.StringIO(text))) == [
        ["'=A", "x"],
        [f"'{FORMULA}", "-1.0"],
        ["eqt", ""],
    ]


def test_the_table_of_runs_holds_no_formula(folder, run, invoke):
    run(controllers=f'[{{kind: eqt, label: "{FORMULA}"}}]', ensemble="{runs: 1, seed: 1}")
    text = invoke("show", "out", "--table", "metrics", "--format", "csv").stdout
    header, row = csv.reader(io.StringIO(text))
    assert row[header.index("controller")] == f"'{FORMULA}"
    assert all(not cell.startswith(("=", "+", "@")) for cell in row)


DEVICES = ["con", "CON", "nul", "aux.yaml", "com1", "LPT9.tar.gz", "prn"]


@pytest.mark.parametrize("name", DEVICES)
def test_the_name_of_a_device_is_refused(folder, experiment, invoke, name):
    with pytest.raises(Exception, match="device") as caught:
        experiment(name=name)
    assert says(
        str(caught.value), f"c.yaml:10:1: name: expected a name that Windows does not…got '{name}'"
    )


@pytest.mark.parametrize("name", ["console", "con-1", "com10", "nu", "xcon", "con_x"])
def test_names_like_those_of_devices_are_fine(name):
    assert not is_device(name)
    assert file_name(name, "law") == name


def test_a_name_that_follows_from_a_file_is_that_of_no_device():
    assert file_name("con", "experiment") == "experiment-con"


@pytest.mark.parametrize("columns", ["999999999", "9" * 5000, str(MOST_COLUMNS + 1)])
def test_the_width_of_a_terminal_is_bounded(invoke, monkeypatch, columns):
    monkeypatch.setenv("COLUMNS", columns)
    assert max(map(len, invoke("run", "--help").stdout.splitlines())) <= MOST_COLUMNS


def test_a_shard_without_parts_says_so(run, experiment, told):
    from eqt_cli.config.document import read_config
    from eqt_cli.config.study import study

    experiment()
    found = study(read_config(Path("c.yaml")))
    done = execute(found, Path("out"), shard=Shard(3, 4))
    assert (done.runs, done.failed) == (0, 0)
    assert told.remarks == [
        "out: shard 3 of 4 computes nothing, since the experiment has 2 parts; use at most 2 shards"
    ]
    execute(found, Path("out"), shard=Shard(2, 4))
    assert len(told.remarks) == 1
