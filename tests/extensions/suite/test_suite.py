"""The suite: its tasks, the laws that it takes, its files, and what it says of laws."""

import numpy as np
import pytest

from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.extensions.suite import archive, verdicts
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.judging import Judged
from eqt_cli.extensions.suite.laws import read_law, shipped_laws
from eqt_cli.extensions.suite.tasks import TASKS, all_tasks, read_task

pytestmark = pytest.mark.needs("suite", "search")

C = """\
/* tunes: {layer: {log: [0.01, 4]}} */
typedef struct { real kp, kd, layer, J[9]; } my_numbers;
void my_torque(const my_numbers *n, my_memory *m, const my_input *in, real torque[3]) {}
"""


def judged(factor, runs=40, samples=3, **more):
    """A law whose error is a factor times that of the first one, in each run."""
    errors = factor * np.random.default_rng(1).uniform(1, 2, (samples, runs))
    none = np.full(samples, 0.6)
    return Judged(({"gains.kp": 1.0},) * samples, errors, none, none, 2.0, **more)


def archived(**factors):
    laws = {
        name: JudgedLaw(name, name.upper(), "shipped", "00", {"quad_att": judged(factor)})
        for name, factor in factors.items()
    }
    return Archive({"quad_att": "digest"}, laws)


def test_every_task_has_the_reference_law_in_the_place_of_the_law():
    for name, task in all_tasks().items():
        assert task.name == name
        assert shipped_laws()["eqt"].in_task(task).data["controllers"][0] != "gt"


def test_a_wrong_task_is_refused_with_each_problem_at_its_place(tmp_path):
    text = (TASKS / "quad_att.yaml").read_text().replace("controllers: [gt]", "controllers: [eqt]")
    (tmp_path / "mine.yaml").write_text(text.replace("seed: 999", "seed: 12"))
    with pytest.raises(ConfigError) as refused:
        read_task(tmp_path / "mine.yaml")
    places = {problem.path for problem in refused.value.problems}
    assert places == {"controllers", "suite.name", "suite.judge.seed"}


def test_a_law_in_c_gets_gains_inertia_and_its_numbers(tmp_path):
    (tmp_path / "law.c").write_text(C)
    law, task = read_law(str(tmp_path / "law.c")), all_tasks()["quad_att"]
    (entry,) = law.in_task(task).data["controllers"]
    assert entry["numbers"]["J"] == [0.02, 0, 0, 0, 0.02, 0, 0, 0, 0.04]
    assert entry["numbers"]["layer"] == 0.2
    assert set(law.over(task)) == {f"controllers[0].numbers.{n}" for n in ("kp", "kd", "layer")}


def test_a_law_may_tune_four_numbers(tmp_path):
    ranges = ", ".join(f"n{k}: [0, 1]" for k in range(5))
    numbers = "kp, " + ", ".join(f"n{k}" for k in range(5))
    text = C.replace("layer: {log: [0.01, 4]}", ranges).replace("kp, kd, layer", numbers)
    (tmp_path / "law.c").write_text(text)
    with pytest.raises(EqtError, match="at most 4"):
        read_law(str(tmp_path / "law.c"))


def test_a_file_holds_what_was_written(tmp_path):
    whole = archived(gt=1.0, eqt=1.1)
    archive.write(tmp_path / "a.zip", whole)
    again = archive.read(tmp_path / "a.zip")
    one, other = (each.laws["eqt"].tasks["quad_att"] for each in (whole, again))
    assert np.array_equal(one.errors.astype(np.float32), other.errors)
    assert (one.values, one.start) == (other.values, other.start)
    archive.write(tmp_path / "b.zip", again)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def test_a_file_that_is_none_is_refused(tmp_path):
    (tmp_path / "a.zip").write_bytes(b"PK nothing")
    with pytest.raises(EqtError, match="no file of a suite"):
        archive.read(tmp_path / "a.zip")


def test_a_law_is_better_by_its_ratio_and_fails_without_one():
    tasks, whole = {"quad_att": all_tasks()["quad_att"]}, archived(gt=1.0, good=0.5, bad=3.0)
    whole.laws["bad"].tasks["quad_att"].errors[1, 2] = np.nan
    rows = verdicts.verdicts(whole, tasks)
    assert [row.verdict for row in rows] == ["no difference", "better", "fails"]
    assert rows[1].ratio.value == pytest.approx(0.5, rel=1e-12)
    assert rows[2].failure == "failed 1/120"
    means = {row.law: row.ratio.value for row in verdicts.overall(rows, whole, tasks)}
    assert means["good"] == pytest.approx(0.5, rel=1e-12)
    assert np.isnan(means["bad"])
