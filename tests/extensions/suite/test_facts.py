"""What the suite says and draws of judged laws, each fact by itself."""

import json
import math
import os
from dataclasses import replace

import numpy as np
import pytest

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.suite import actions, archive, figures, judging, tables, verdicts
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.entrants import shipped_laws
from eqt_cli.extensions.suite.judging import Judged
from eqt_cli.extensions.suite.tasks import all_tasks
from eqt_cli.figures.style import house_style, ink

pytestmark = pytest.mark.needs("suite", "search")

ATTITUDE, POSE = "quad_att", "robot"


def judged(factor, runs=200, samples=5):
    """A law whose error is a factor times that of the first one, in each run."""
    errors = factor * np.random.default_rng(1).uniform(1, 2, (samples, runs))
    spent = np.full(samples, 0.6)
    return Judged(({"gains.kp": 1.0},) * samples, errors, spent, spent, 2.0)


def archived(tasks=(ATTITUDE,), **factors):
    laws = {
        name: JudgedLaw(name, name.upper(), "shipped", "00", {t: judged(x) for t in tasks})
        for name, x in factors.items()
    }
    return Archive({name: all_tasks()[name].digest for name in tasks}, laws)


@pytest.fixture
def of_archive(monkeypatch):
    """The answer of `eqt suite` beside an archive of a good and a bad law."""
    monkeypatch.setattr(archive, "shipped_archive", lambda: archived(gt=1.0, good=0.5, bad=3.0))


def test_the_archive_is_shown_as_text_or_for_programs(of_archive, invoke):
    table = invoke("suite").stdout
    assert "archive  gt, good, bad" in table
    assert json.loads(invoke("suite", "--json").stdout)["laws"]["good"] == [ATTITUDE]
    shown = invoke("suite", "show").stdout
    assert "GOOD" in shown and "figure" not in shown and not shown.startswith("{")
    assert "overall" in json.loads(invoke("suite", "show", "--json").stdout)


def test_a_figure_is_drawn_where_one_is_named(of_archive, invoke, monkeypatch, tmp_path):
    drawn = []
    monkeypatch.setattr(figures, "forest", lambda rows, whole, path: drawn.append(path))
    said = invoke("suite", "show", "--figure", tmp_path / "forest.pdf")
    assert drawn == [tmp_path / "forest.pdf"]
    assert "forest.pdf" in said.stdout + said.stderr


@pytest.fixture
def forest(monkeypatch, tmp_path):
    """The drawing of a forest, without its file."""
    sheets = []
    monkeypatch.setattr(figures, "freeze", lambda drawing: None)
    monkeypatch.setattr(figures, "encode", lambda drawing, *more: sheets.append(drawing) or b"")

    def draw(whole):
        tasks = {name: all_tasks()[name] for name in whole.tasks}
        figures.forest(verdicts.verdicts(whole, tasks), whole, tmp_path / "forest.svg")
        return {axes.get_title(): axes for axes in sheets[-1].axes}

    return draw


def test_a_forest_has_a_row_for_each_law_at_its_ratio(forest):
    (axes,) = forest(archived(gt=1.0, near=0.95, above=1.08)).values()
    points = {line.get_label(): line for line in axes.lines if line.get_marker() == "D"}
    places = {name: (*line.get_xdata(), *line.get_ydata()) for name, line in points.items()}
    assert places["NEAR"] == pytest.approx((0.95, 0)) and places["ABOVE"] == pytest.approx(
        (1.08, 1)
    )
    assert [text.get_text() for text in axes.get_yticklabels()] == ["NEAR", "ABOVE"]
    assert axes.get_xticks() == pytest.approx([0.9, 1.0, 1.1])
    low, high = axes.get_xlim()
    assert low < 0.95 < 1.08 < high


def test_only_panels_of_the_last_row_name_what_all_show(forest):
    names = [*all_tasks()][:4]
    panels = forest(archived(tasks=names, gt=1.0, other=0.7))
    named = {title for title, axes in panels.items() if axes.get_xlabel()}
    last = min(axes.get_subplotspec().rowspan.start for axes in panels.values()) + 1
    assert named == {t for t, a in panels.items() if a.get_subplotspec().rowspan.start == last}


@pytest.mark.parametrize(("verdict", "is_open"), [("undecided", True), ("better", False)])
def test_an_undecided_ratio_is_an_open_mark(verdict, is_open):
    from matplotlib.figure import Figure

    whole = archived(gt=1.0, other=0.7)
    (_, row) = verdicts.verdicts(whole, {ATTITUDE: all_tasks()[ATTITUDE]})
    row = replace(row, ratio=_Ratio(row.ratio, verdict))
    with house_style():
        axes = Figure().add_subplot()
        figures._draw(axes, 0, row, "OTHER")
        mark = next(line for line in axes.lines if line.get_marker() == "D")
        assert (mark.get_markerfacecolor() == ink(0)) is is_open


class _Ratio:
    """A ratio with another verdict."""

    def __init__(self, ratio, verdict):
        self.value, self.low, self.high, self.verdict = ratio.value, ratio.low, ratio.high, verdict


def test_a_law_that_failed_says_so_in_its_row(forest):
    whole = archived(gt=1.0, bad=2.0)
    whole.laws["bad"].tasks[ATTITUDE].errors[0, 0] = np.nan
    (axes,) = forest(whole).values()
    assert [text.get_text() for text in axes.texts] == ["failed 1/1000"]


def test_a_set_of_tasks_is_named_where_there_is_more_than_one_kind():
    tasks = all_tasks()
    kinds = {task.section.laws for task in tasks.values()}
    sets = verdicts.sets_of(tasks)
    assert set(sets) == {"all", *kinds} and len(kinds) > 1
    assert sorted(name for kind in kinds for name in sets[kind]) == sorted(sets["all"])
    assert set(verdicts.sets_of({ATTITUDE: tasks[ATTITUDE]})) == {"all"}


def test_a_law_is_left_out_of_a_task_that_it_does_not_fit_with_a_remark(
    tmp_path, monkeypatch, told
):
    monkeypatch.setattr(actions, "tuned", lambda *arguments, **options: judged(1.0))
    law, tasks = replace(shipped_laws()["quaternion"], only=()), all_tasks()
    both = {name: tasks[name] for name in (ATTITUDE, POSE)}
    assert set(actions.judge_law(law, both, tmp_path, 1).tasks) == {ATTITUDE}
    (remark,) = told.remarks
    assert f"quaternion does not fit {POSE}" in remark
    with pytest.raises(EqtError, match="SO3 only"):
        actions.judge_law(law, {POSE: tasks[POSE]}, tmp_path, 1)


def test_a_sample_without_gains_keeps_its_place(monkeypatch):
    def held_out(document, task, points, workers):
        rows = [values["gains.kp"] for values in points]
        return np.array([[row] * task.section.judge.runs for row in rows]), 0.1 * np.array(rows)

    monkeypatch.setattr(judging, "held_out", held_out)
    points = [{"gains.kp": 1.0, "gains.kd": 1.0}, None, {"gains.kp": 3.0, "gains.kd": 1.0}]
    found = judging.judged(shipped_laws()["gt"], all_tasks()[ATTITUDE], points, 1)
    assert np.isnan(found.errors[1]).all()
    assert found.errors[[0, 2], 0].tolist() == [1.0, 3.0]
    assert found.spent == pytest.approx([0.1, math.nan, 0.3], nan_ok=True)
    assert found.is_stated


def test_the_time_of_a_law_has_that_of_its_processes(monkeypatch):
    times = os.times_result((1.0, 2.0, 4.0, 8.0, 99.0))
    monkeypatch.setattr(judging.os, "times", lambda: times)
    assert judging._cpu_seconds() == 15


def test_a_pack_of_one_run_is_read(tmp_path):
    whole = archived(gt=1.0)
    whole.laws["gt"].tasks[ATTITUDE] = judged(1.0, runs=1, samples=1)
    archive.write(tmp_path / "a.zip", whole)
    again = archive.read(tmp_path / "a.zip").laws["gt"].tasks[ATTITUDE]
    assert again.errors.shape == (1, 1)


def test_the_answer_says_on_which_tasks_a_law_is_better_or_that_there_is_none():
    rows = verdicts.verdicts(archived(gt=1.0, good=0.5), {ATTITUDE: all_tasks()[ATTITUDE]})
    assert tables.answer("good", rows, [], "GOOD")[0].startswith(
        f"GOOD against GT: better on {ATTITUDE} ("
    )
    (none,) = tables.answer("other", rows, [], "OTHER")
    assert "judged on no task" in none
