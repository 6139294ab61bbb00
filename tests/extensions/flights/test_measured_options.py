"""`eqt compare --measured` and `eqt plot --measured` as a user types them."""

import csv
import io
import json

import numpy as np
import pytest
from case_tables import from_yaml
from said import says

from eqt_cli.api.loading import open_at


@pytest.fixture
def log(paper_result, folder):
    """Run 1 of GT, with its clock 0.25 s ahead, and a column that nobody knows."""
    with open_at(paper_result) as result:
        k, t = result.labels.index("gt"), result.times
        Q, V, tau = (result.trajectory(name, 1)[k] for name in ("pose", "velocity", "torque"))
    header = [f"Q{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
    header = ",".join(["t", *header, "wx,wy,wz,tx,ty,tz,battery"])
    rows = np.c_[t + 0.25, Q.reshape(-1, 9), V, tau, 12 + 0 * t]
    np.savetxt("flight.csv", rows, delimiter=",", header=header, comments="")
    return "flight.csv"


def test_the_table(invoke, paper_result, log):
    found = invoke("compare", paper_result, "--measured", log, "--run", 1, "--against", "GT")
    lines = found.stdout.splitlines()
    assert lines[0] == "How much of the measured error run 1 of GT explains"
    assert lines[2].split() == (
        "error of axis unit measured simulated difference explained".split()
    )
    rows = [line.split() for line in lines[4:16]]
    assert [row[:3] for row in rows[:4]] == [
        ["pose,", "rotation", axis] for axis in ("all", *"xyz")
    ]
    assert [row[0] for row in rows] == ["pose,"] * 4 + ["velocity,"] * 4 + ["wrench,"] * 4
    assert {tuple(row[-2:]) for row in rows} == {("100.0", "%")}
    text = " ".join(lines[16:])
    assert "flight.csv: 201 rows from 0 to 20 s of run 1; clock offset −0.2500 s" in text
    assert "flight.csv: column battery is not used." in text


def test_all_controllers_by_their_parts_and_as_plain_data(invoke, paper_result, log):
    options = "compare", paper_result, "--measured", log, "--run", 1
    found = invoke(*options)
    lines = found.stdout.splitlines()
    assert lines[0] == "How much of the measured error run 1 of each law explains"
    assert [line for line in lines[4:20] if not line.startswith(" ")] == [
        "EqT",
        "GT",
        "nog",
        "asym",
    ]
    assert sum(line.split()[1:3] == ["rotation", "all"] for line in lines) == 12
    assert found.stderr == "next: --verbose prints every axis, --against LAW one law\n"
    found = json.loads(invoke(*options, "--json").stdout)
    assert found["measured"] == "flight.csv"
    assert [one["controller"] for one in found["controllers"]] == ["eqt", "gt", "nog", "asym"]
    of_gt = invoke(*options, "--against", "gt", "--format", "csv").stdout
    rows = list(csv.DictReader(io.StringIO(of_gt)))
    assert {"controller", "run", "offset", "quantity", "part", "axis", "unit"} < set(rows[0])
    assert float(rows[0]["offset"]) == pytest.approx(-0.25, abs=1e-3)
    flown = next(row for row in rows if row["controller"] == "gt")
    assert float(flown["explained"]) == pytest.approx(1.0, abs=1e-6)


def test_the_figure_is_drawn_by_default(invoke, paper_result, log, folder, unarranged):
    found = invoke(
        *("plot", paper_result, "--measured", log, "--option", "run=1", "--option"),
        *("controllers=[gt]", "--format", "json", "--out", "figures"),
    )
    assert found.stdout == "figure   figures/measured.json\n"
    assert found.stderr == "eqt: warning: flight.csv: column battery is not used\n"
    names = {curve["name"] for curve in json.loads((folder / "figures/measured.json").read_text())}
    assert names == {
        f"{kind} ω{axis}" for kind in ("measured", "simulated", "difference") for axis in "xyz"
    }


@from_yaml
def test_what_is_refused(command, options, said, invoke, paper_result, log):
    found = invoke(command, paper_result, *options, code=2)
    assert says(found.stderr.replace(str(paper_result), "RESULT"), f"eqt: error: {said}\n")


@pytest.mark.ci("runs a sweep")
def test_a_sweep_needs_a_point(invoke, swept_result, log):
    found = invoke("compare", swept_result, "--measured", log, code=2)
    assert says(
        found.stderr.replace(str(swept_result), "RESULT"),
        "eqt: error: RESULT/results.h5: a comparison with a recording needs a…\n",
    )
