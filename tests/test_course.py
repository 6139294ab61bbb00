"""The lab sheet works as it stands, with and without its solutions, and these are right."""

import re
import shutil
from functools import partial
from pathlib import Path

import docs_runner
import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.errors import EqtWarning

COURSE = Path(__file__).parents[1] / "examples" / "course"
SHEET = (COURSE / "README.md").read_text(encoding="utf-8")
SOLUTIONS = (COURSE / "solutions" / "README.md").read_text(encoding="utf-8")


@pytest.fixture
def desk(tmp_path, monkeypatch):
    """A copy without the solutions, as students get it."""
    shutil.copytree(COURSE, tmp_path / "desk", ignore=shutil.ignore_patterns("solutions"))
    monkeypatch.chdir(tmp_path / "desk")
    monkeypatch.setenv("EQT_ENGINE", "solve_ivp")
    with docs_runner.without_plugins():
        yield Path()


def rows(text, *names):
    """The numbers of a table, by its first cell."""
    lines = re.findall(r"^ *\| (.*) \|$", text, re.MULTILINE)
    cells = [line.split(" | ") for line in lines]
    return {row[0].strip("`"): [float(x) for x in row[1:]] for row in cells if row[0] in names}


def test_the_sheet_is_short_and_has_a_question_for_each_exercise():
    assert len(SHEET.split()) <= 900
    assert SHEET.count("**Questions**") == SHEET.count("**See**") == 4
    assert SOLUTIONS.count("\n## ") == 4


@pytest.mark.parametrize("name", ["gains", "inertia", "delay", "own"])
def test_every_exercise_has_its_configuration(desk, name):
    assert f"`{name}.yaml`" in SHEET
    eqt_cli.load_experiment(f"{name}.yaml")


@pytest.mark.ci("carries out the whole sheet")
@pytest.mark.usefixtures("unarranged")
def test_the_sheet_runs_as_it_stands(desk):
    docs_runner.carry_out(SHEET)


@pytest.mark.ci("computes 20 runs of many laws")
def test_numbers_of_the_first_two_exercises(desk):
    result = eqt_cli.run("gains.yaml", "first")
    settled = result.metric("settling_time").mean(axis=1)
    table = rows(SOLUTIONS, *(f"`{label}`" for label in result.labels))
    # To the digits that the solutions have.
    for label, mean in zip(result.labels, settled, strict=True):
        assert mean == pytest.approx(table[label][1], rel=5e-3)
    factors = [1, 1.5, 0.25]
    swept = eqt_cli.sweep(
        "inertia.yaml", {"plant.inertia": [[2 * f, 3 * f, 4 * f] for f in factors]}, "second"
    )
    errors = swept.metric("final_attitude_error").mean(axis=-1)
    for factor, row in zip(factors, errors, strict=True):
        stated = rows(SOLUTIONS, f"{factor:g}")[f"{factor:g}"]
        np.testing.assert_allclose(row[: len(stated)], stated, atol=0.006)


@pytest.mark.ci("linearises a loop")
def test_the_delay_margin_of_the_third_exercise(desk):
    """In closed form, less half a period of the hold, in whole periods."""
    J, kp, kd, period = 2.0, 1.0, 2.0, 0.05
    squared = (kd**2 + np.sqrt(kd**4 + (4 * J * kp) ** 2)) / (2 * J**2)
    crossover = np.sqrt(squared)
    margin = np.arctan(kd * crossover / (2 * kp)) / crossover
    assert f"{crossover:.2f}$ rad/s" in SOLUTIONS and f"{margin:.3f} s" in SOLUTIONS
    (law,) = eqt_cli.margins("delay.yaml").laws
    assert law.delay == int((margin - period / 2) / period) * period


@pytest.mark.ci("computes 20 runs of two laws")
def test_the_law_of_the_solutions_tracks(desk):
    shutil.copytree(COURSE / "solutions", desk / "solutions")
    of = partial(eqt_cli.load_experiment, "own.yaml")
    with pytest.warns(EqtWarning, match="so that the body leaves it"):
        unsolved = eqt_cli.run(of(), "unsolved")
    np.testing.assert_allclose(*unsolved.metric("final_attitude_error"), rtol=1e-9)
    solved = eqt_cli.run(of({"plugins": ["solutions/law.py"]}), "solved")
    assert solved.metric("final_attitude_error")[1].max() < 1e-6
    assert solved["energy_residual"].max() < 1e-7 < unsolved["energy_residual"].max()
