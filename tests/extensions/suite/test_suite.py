"""The suite: its tasks, the laws that it takes, its files, and what it says of laws."""

import json
import math
import re
import warnings
from dataclasses import replace
from pathlib import Path
from zipfile import ZipFile

import numpy as np
import pytest

import eqt_cli
from eqt_cli.analysis.intervals import Interval
from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.extensions.suite import (
    actions,
    archive,
    checking,
    packs,
    proposals,
    repeats,
    tables,
    verdicts,
)
from eqt_cli.extensions.suite.archive import Archive, JudgedLaw
from eqt_cli.extensions.suite.entrants import Law, read_law, shipped_laws
from eqt_cli.extensions.suite.judging import Judged, tuned
from eqt_cli.extensions.suite.tasks import TASKS, VERSION, all_tasks, read_task
from eqt_cli.results.quantity import Plain

pytestmark = pytest.mark.needs("suite", "search")

C = """\
/* tunes: {layer: {log: [0.01, 4]}} */
typedef struct { real kp, kd, layer, J[9]; } my_numbers;
void my_torque(const my_numbers *n, my_memory *m, const my_input *in, real torque[3]) {}
"""


def judged(factor, runs=20, samples=3, **more):
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


PYTHON = """\
from dataclasses import dataclass
from typing import ClassVar

from eqt_cli.extend import Array, Controller, Tracking


@dataclass(frozen=True)
class Mine(Controller):
    name: ClassVar[str] = "mine_of_the_suite"
    tunes: ClassVar = {"layer": [0.1, 1]}

    layer: float = 0.5

    def torque(self, s: Tracking) -> Array:
        r = s.relative
        return r.cancelling_feedforward - r.body_damping - r.gradient
"""


RANGE = "layer: {log: [0.01, 4]}"
FIVE = {RANGE: "a: [0, 1], b: [0, 1], c: [0, 1], d: [0, 1], e: [0, 1]", "layer,": "a, b, c, d, e,"}


@pytest.mark.parametrize(
    ("text", "changes", "place", "expected"),
    [
        (C, FIVE, "tunes", "at most 4"),
        (C, {RANGE: "layer: 3"}, "tunes.layer", "log"),
        (C, {RANGE: ""}, "my_numbers.layer", "my_defaults"),
        (C, {"{layer": "{leyer"}, "tunes.leyer", "'layer'"),
        (C, {"my_torque": "my_force"}, "law.c", "_torque"),
        (C, {"/* tunes": '#include "more.h"\n/* tunes'}, "more.h", "one file"),
        (PYTHON, {'{"layer": [0.1, 1]}': '["layer"]'}, "tunes", "log"),
        (PYTHON, {"[0.1, 1]": "[1, 0.1]"}, "tunes.layer", "low < high"),
        (PYTHON, {'{"layer"': '{"leyer"'}, "tunes.leyer", "'layer'"),
        (PYTHON, {"(Controller)": ""}, "law.py", "derive a class"),
    ],
)
def test_a_wrong_law_is_refused_with_place_and_remedy(text, changes, place, expected, tmp_path):
    for old, new in changes.items():
        assert old in text
        text = text.replace(old, new)
    file = tmp_path / ("law.c" if "typedef" in text else "law.py")
    file.write_text(text)
    with pytest.raises(EqtError) as refused:
        read_law(str(file))
    assert place in str(refused.value)
    assert expected in str(refused.value)


def test_a_file_holds_what_was_written(tmp_path):
    whole = archived(gt=1.0, eqt=1.1)
    archive.write(tmp_path / "a.zip", whole)
    again = archive.read(tmp_path / "a.zip")
    one, other = (each.laws["eqt"].tasks["quad_att"] for each in (whole, again))
    assert np.array_equal(one.errors.astype(np.float32), other.errors)
    assert (one.values, one.start) == (other.values, other.start)
    archive.write(tmp_path / "b.zip", again)
    assert (tmp_path / "a.zip").read_bytes() == (tmp_path / "b.zip").read_bytes()


def rewritten(path, change):
    """Write a pack of GT whose parts a function changes, and return it."""
    archive.write(path, archived(gt=1.0))
    with ZipFile(path) as whole:
        parts = [(name, whole.read(name)) for name in whole.namelist()]
    with ZipFile(path, "w") as other, warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of two parts of one name
        for name, content in change(parts):
            other.writestr(name, content)
    return path


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda parts: [*parts, parts[0]], "two parts 'suite.json'"),
        (lambda parts: [*parts, ("../x", b"")], "a part '../x', which suite.json does not name"),
        (lambda parts: [(n, c.replace(b"2.0", b"1" + b"0" * 400)) for n, c in parts], "form"),
        (lambda parts: [(n, c.replace(b"0.6", b"-0.6")) for n, c in parts], "costs of at least 0"),
        (
            lambda parts: [(n, c.replace(b'"start": ', b'"start": -')) for n, c in parts],
            "at least 0",
        ),
        (lambda parts: [(n, c if ".json" in n else b"\0" * len(c)) for n, c in parts], "are 0"),
        (
            lambda parts: [(n, re.sub(rb'{\s*"gains.kp": 1.0\s*}', b"null", c)) for n, c in parts],
            "without gains",
        ),
    ],
)
def test_a_pack_of_another_shape_is_refused_in_a_line(change, expected, tmp_path):
    with pytest.raises(EqtError, match=expected):
        archive.read(rewritten(tmp_path / "a.zip", change))


def test_a_flipped_bit_of_a_pack_is_told_or_changes_nothing(tmp_path):
    """Times in the headers are flipped without harm."""
    archive.write(tmp_path / "a.zip", archived(gt=1.0))
    before = archive.read(tmp_path / "a.zip").laws["gt"].tasks["quad_att"]
    whole, refused = (tmp_path / "a.zip").read_bytes(), 0
    for at in range(0, len(whole), 29):
        flipped = bytes([whole[at] ^ 16])
        (tmp_path / "a.zip").write_bytes(whole[:at] + flipped + whole[at + 1 :])
        try:
            after = archive.read(tmp_path / "a.zip").laws["gt"].tasks["quad_att"]
            assert np.array_equal(after.errors, before.errors)
        except EqtError:
            refused += 1
    assert refused > 20


def test_what_a_pack_holds_is_counted_as_it_is_read(tmp_path, monkeypatch):
    archive.write(tmp_path / "a.zip", archived(gt=1.0))
    with ZipFile(tmp_path / "a.zip", "a", 8) as packed:
        packed.writestr("zeros", bytes(10**6))
    monkeypatch.setattr(packs, "MOST_BYTES", 500_000)
    assert (tmp_path / "a.zip").stat().st_size < packs.MOST_BYTES
    with pytest.raises(EqtError, match=r"holds more than 0\.5 MB"):
        archive.read(tmp_path / "a.zip")


@pytest.mark.parametrize(
    ("part", "expected"),
    [
        (None, "no zip"),
        ("suite.json", "has no suite.json"),
        ("errors/1/quad_att", "errors/1/quad_att"),
        ("format", "lacks format"),
    ],
)
def test_a_file_that_is_none_is_refused(part, expected, tmp_path):
    archive.write(tmp_path / "whole.zip", archived(gt=1.0, eqt=1.1))
    if part is None:
        (tmp_path / "a.zip").write_bytes((tmp_path / "whole.zip").read_bytes()[:500])
    else:
        with ZipFile(tmp_path / "whole.zip") as whole, ZipFile(tmp_path / "a.zip", "w") as other:
            for name in whole.namelist():
                if name != part:
                    text = whole.read(name)
                    other.writestr(
                        name, text.replace(part.encode(), b"x") if "json" in name else text
                    )
    with pytest.raises(EqtError, match=expected):
        archive.read(tmp_path / "a.zip")


def test_a_pack_of_another_suite_is_not_shown(tmp_path, invoke):
    archive.write(tmp_path / "a.zip", replace(archived(good=0.5), suite="eqt-suite-99"))
    said = invoke("suite", "show", tmp_path / "a.zip", code=2).stderr
    assert "judged on eqt-suite-99, and this eqt has eqt-suite-" in said


def test_a_pack_of_the_first_suite_is_answered_by_the_suite_that_judged_it(tmp_path, invoke):
    """Its tasks had other digests under the same names, and no search said how it ended."""
    first, path = replace(archived(good=0.5), suite="eqt-suite-1"), tmp_path / "a.zip"
    first.laws["good"].tasks["quad_att"] = replace(judged(0.5), gained=np.array([]))
    archive.write(path, first)
    said = invoke("suite", "check", path, "--no-fresh", code=4).stdout
    assert f"judged on eqt-suite-1, and this eqt has {VERSION}" in said
    assert "task quad_att is not the one of this eqt; judge the law anew" in said
    assert "judge the law anew" in invoke("suite", "show", path, code=2).stderr


def test_a_law_is_better_by_its_ratio_and_fails_without_one():
    tasks, whole = {"quad_att": all_tasks()["quad_att"]}, archived(gt=1.0, good=0.5, bad=3.0)
    whole.laws["bad"].tasks["quad_att"].errors[1, 2] = np.nan
    rows = verdicts.verdicts(whole, tasks)
    assert [row.verdict for row in rows] == ["no difference", "better", "fails"]
    assert rows[1].ratio.value == pytest.approx(0.5, rel=1e-12)
    assert rows[2].failure == "failed 1/60"
    means = {row.law: row.ratio.value for row in verdicts.overall(rows, whole, tasks)}
    assert means["good"] == pytest.approx(0.5, rel=1e-12)
    assert np.isnan(means["bad"])


def test_nothing_is_said_of_a_law_whose_search_is_not_finished(tmp_path):
    tasks, whole = {"quad_att": all_tasks()["quad_att"]}, archived(gt=1.0, good=0.5, bad=3.0)
    still = replace(judged(0.5), gained=np.array([0.0, 0.02, 0.001]))
    whole.laws["good"].tasks["quad_att"] = still
    archive.write(tmp_path / "a.zip", whole)
    whole = archive.read(tmp_path / "a.zip")
    assert whole.laws["good"].tasks["quad_att"].gained.tolist() == [0.0, 0.02, 0.001]
    rows = verdicts.verdicts(whole, tasks)
    assert [row.verdict for row in rows] == ["no difference", "search not finished", "worse"]
    means = {row.law: row.ratio.value for row in verdicts.overall(rows, whole, tasks)}
    assert np.isnan(means["good"])
    assert means["bad"] == pytest.approx(3, rel=1e-6)  # float32 of the file


def test_every_search_of_the_archive_says_how_it_ended():
    cells = [x for law in archive.shipped_archive().laws.values() for x in law.tasks.values()]
    finished = [x for x in cells if x.is_finished]
    assert len(finished) >= 0.8 * len(cells)
    assert all(x.gained.max() <= 0.005 for x in finished)


def test_numbers_of_a_law_fit_its_task_and_a_redundant_one_is_left_out():
    tasks, laws = all_tasks(), shipped_laws()
    sliding, integral = laws["slotine_li"], laws["goodarzi2013"]
    assert set(sliding.over(tasks["late"])) == {"gains.kd", "controllers[0].slope"}
    # ki starts in the middle of its range, times kp at the start of the task
    for name, kp in (("late", 1.0), ("uuv_station", 10.0)):
        start = integral.start(tasks[name])["ki"]
        assert start == pytest.approx(kp * math.sqrt(0.001), rel=1e-5)


def test_a_part_of_the_archive_needs_a_law_that_fits_and_a_file_of_its_own(tmp_path, invoke):
    part = ("suite", "archive", "--laws", "quaternion", "--tasks", "robot")
    refused = invoke(*part, "--out", tmp_path / "a.zip", code=2)
    assert "quaternion: fits none of the tasks: robot" in refused.stderr
    before = archive.ARCHIVE.read_bytes()
    assert "name another file by --out" in invoke(*part, code=2).stderr
    assert archive.ARCHIVE.read_bytes() == before


def test_a_second_run_reverses_verdicts_or_not():
    """Errors of two runs are the first law's, times a factor of the law on each sample."""
    first = {"quad_att": {"gt": judged(1.0), "a": judged(1.2), "b": judged(1.5)}}
    again = {"quad_att": {"gt": judged(1.0), "a": judged(1.4), "b": judged(1.3)}}
    titles = {"gt": "GT", "a": "A", "b": "B"}
    same, other = (repeats.compared(first, run, titles) for run in (first, again))
    assert (same.pairs, same.both, same.once, same.reversed) == (3, 3, 0, [])
    assert [mean.share for mean in same.means] == [0, 0]
    assert other.reversed == ["a against b on quad_att: better, then worse"]
    mean = repeats.Mean("a", "A", 1, Interval(1.0, 0.9, 1 / 0.9), Interval(1.1, 1.0, 1.2))
    assert mean.share == pytest.approx(math.log(1.1) / (math.sqrt(2) * -math.log(0.9)))


def test_other_training_samples_are_no_held_out_runs(invoke):
    for seed in (15, 995):
        assert f"--seed {seed}" in invoke("suite", "repeat", "--seed", seed, code=2).stderr


def test_the_archive_has_the_laws_that_are_computed_for_it():
    assert set(archive.shipped_archive().laws) == set(shipped_laws())


@pytest.mark.ci("tunes a law on a task")
def test_the_archive_is_computed_anew_to_the_bit(tmp_path):
    """Gains and held-out errors of one law on the shortest task of the archive."""
    whole, tasks = archive.shipped_archive(), all_tasks()
    current = [name for name, digest in whole.tasks.items() if tasks[name].digest == digest]
    gt = whole.laws["gt"]
    name = min((name for name in current if name in gt.tasks), key=lambda n: gt.tasks[n].seconds)
    again = tuned(shipped_laws()["gt"], tasks[name], tmp_path / name, 2)
    assert again.values == gt.tasks[name].values
    assert np.array_equal(again.errors, gt.tasks[name].errors)


@pytest.fixture
def small(tmp_path, monkeypatch):
    """A suite of one small task, and the current folder."""
    text = (TASKS / "quad_att.yaml").read_text()
    text = re.sub(r"search: .*", "search: { points: 20, runs: 4, samples: 3, seed: 11 }", text)
    text = re.sub(r"judge: .*", "judge: { runs: 20, seed: 999 }", text)
    text = re.sub(r"duration: \d+, samples: \d+", "duration: 1, samples: 21", text)
    (tmp_path / "tasks").mkdir()
    (tmp_path / "tasks" / "quad_att.yaml").write_text(text)
    monkeypatch.setattr("eqt_cli.extensions.suite.tasks.TASKS", tmp_path / "tasks")
    monkeypatch.setattr(archive, "ARCHIVE", tmp_path / "archive.zip")
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.ci("prints every format of the tables")
def test_judged_laws_are_shown_in_every_format(small, invoke):
    whole = archived(gt=1.0, good=0.5, bad=3.0)
    whole.tasks["quad_att"] = read_task(small / "tasks" / "quad_att.yaml").digest
    archive.write(small / "archive.zip", whole)
    (row,) = json.loads(invoke("suite", "--json").stdout)["tasks"].values()
    assert (row["laws"], row["equal"]) == ("attitude", {"effort": 0.75})
    told = invoke("suite", "show").stdout
    assert re.search(r"GOOD +0\.5\d* \[.*better\n", told)
    latex = invoke("suite", "show", "--format", "latex").stdout
    assert latex.count(r"\toprule") == latex.count(r"\multicolumn") == 2  # overall, and the task
    assert "good,quad_att,better,0.5" in invoke("suite", "show", "--format", "csv").stdout
    assert '<td class="better">better</td>' in invoke("suite", "show", "--format", "html").stdout
    assert json.loads(invoke("suite", "show", "--json").stdout)["overall"][1]["tasks"] == "all"
    assert "no law 'godo'" in invoke("suite", "show", "--laws", "godo", code=2).stderr
    assert "all are meant" in invoke("suite", "check", "--tasks", "", code=2).stderr


@pytest.mark.ci("draws a figure")
def test_the_forest_has_a_row_for_each_law(small, invoke):
    whole = archived(gt=1.0, good=0.5, bad=3.0)
    whole.tasks["quad_att"] = read_task(small / "tasks" / "quad_att.yaml").digest
    archive.write(small / "archive.zip", whole)
    invoke("suite", "show", "--figure", "forest.svg")
    assert all(name in Path("forest.svg").read_text() for name in ("GOOD", "BAD", "quad_att"))


def test_a_file_may_change_only_numbers_of_its_laws():
    """A law without its sensor's noise would compute equal errors again."""
    archived, laws, tasks = archive.shipped_archive(), shipped_laws(), all_tasks()
    for label, law in archived.laws.items():
        of_law = {name: tasks[name] for name in law.tasks}
        assert not checking.other_keys(laws[label], law, of_law)
    eqt, values = archived.laws["eqt"], {"gains.kp[0]": 1.0, "sensors.velocity[0].std": 0.0}
    of_task = replace(eqt.tasks["quad_att"], values=(values, None))
    found = checking.other_keys(
        laws["eqt"], replace(eqt, tasks={"quad_att": of_task}), {"quad_att": tasks["quad_att"]}
    )
    assert found == ["quad_att: sensors.velocity[0].std"]


@pytest.mark.ci("tunes two laws under two names, and judges one on fresh runs")
def test_a_law_is_judged_packed_and_checked_under_any_name(small, invoke):
    text = PYTHON.replace('    tunes: ClassVar = {"layer": [0.1, 1]}\n', "")
    (small / "mine.py").write_text(text)
    (small / "moved").mkdir()
    (small / "moved" / "other.py").write_text(text)
    for file in ("mine.py", "moved/other.py"):
        invoke("suite", file, "--workers", "1")
    one, other = (archive.read(small / f"results/suite/{x}/law.zip") for x in ("mine", "other"))
    (a,), (b,) = one.laws.values(), other.laws.values()
    assert a.digest == b.digest
    assert np.array_equal(a.tasks["quad_att"].errors, b.tasks["quad_att"].errors)

    (small / "results/suite/mine").rename(small / "results/suite/my law")
    told = invoke("suite", "pack", "results/suite/my law", "--out", "my pack.zip").stdout
    assert "eqt suite check 'my pack.zip'" in told
    invoke("suite", "pack", "results/suite/my law")
    pack = "mine.eqtsuite.zip"
    assert Path(pack).stat().st_size < 100_000
    assert "a file is data" in invoke("suite", "check", pack, "--no-fresh").stdout
    again = "suite", "check", pack, "--no-fresh", "--share", "1", "--law"
    assert "60 computed again: none differ" in invoke(*again, "moved/other.py").stdout
    pretended = archive.read(Path(pack))
    pretended.laws["mine"].sources["mine.py"] += "# a different text to read\n"
    archive.write(small / "pretended.zip", pretended)
    told = invoke("suite", "check", "pretended.zip", "--law", "mine.py", "--no-fresh", code=4)
    assert "mine.py in the file is not the law of its hash" in told.stdout
    changed = archive.read(Path(pack))
    changed.laws["mine"].tasks["quad_att"].errors[:] *= 0.9
    archive.write(Path(pack), changed)
    assert "60 differ" in invoke(*again, "mine.py", code=4).stdout


def test_fresh_runs_tell_a_law_that_was_fitted_to_the_public_ones(monkeypatch):
    """Its error is 0.7 of what the same gains have on other runs."""
    task = all_tasks()["quad_att"]
    whole = archived(gt=1.0, fitted=0.7, honest=1.02)
    fresh = {"gt": judged(1.0).errors, "fitted": judged(1.0).errors, "honest": judged(1.02).errors}

    def held_out(document, task, points, workers):
        (entry,) = document.data["controllers"]
        return fresh[entry["label"]], np.full(3, 0.6)

    monkeypatch.setattr(checking, "held_out", held_out)
    laws = {name: Law(name, {"kind": "gt"}) for name in fresh}
    rows = {
        name: checking.optimism(
            (laws[name], laws["gt"]), (whole.laws[name], whole.laws["gt"]), {"quad_att": task}, 1
        )
        for name in ("fitted", "honest")
    }
    assert rows["fitted"][0].factor.value == pytest.approx(1 / 0.7, rel=1e-12)
    assert rows["fitted"][0].is_optimistic
    assert not rows["honest"][0].is_optimistic
    for stated in (0.4, 0.0, math.nan):  # of what runs cost that no check computes again
        of_task = replace(judged(1.02), spent=np.full(3, stated))
        cheap = replace(whole.laws["honest"], tasks={"quad_att": of_task})
        of_laws = laws["honest"], laws["gt"]
        (row,) = checking.optimism(of_laws, (cheap, whole.laws["gt"]), {"quad_att": task}, 1)
        assert row.is_optimistic


def test_a_file_is_checked_against_the_reference_law_of_the_archive():
    """A file could state any cost of it, or have another law of its label."""
    ours, theirs = archived(gt=1.0), archived(gt=2.0)
    for digest, shipped, expected in (("00", ours, ours), ("1", ours, ours), ("00", None, theirs)):
        found = actions.reference_of(theirs, shipped or Archive({}, {}), digest)
        assert found.tasks["quad_att"] is expected.laws["gt"].tasks["quad_att"]


def test_a_task_is_told_from_a_copy_and_from_noise():
    factors = {"gt": 1.0, "a": 1.2, "b": 1.5, "c": 2.0, "d": 3.0}
    of_task, suite = archived(**factors), archived(**factors)
    suite.tasks["other"] = "digest"
    for law in suite.laws.values():
        law.tasks["other"] = law.tasks["quad_att"]
    found = proposals.proposal("quad_att", of_task, suite)
    assert (found.resolved, found.nearest, found.correlation) == (1.0, "other", 1.0)
    assert found.faults == ["is redundant: it orders laws as other does"]
    assert proposals.kendall([1, 2, 3, 4], [1, 2, 4, 3]) == pytest.approx(2 / 3)


def test_the_page_has_the_ratios_of_the_archive():
    page = (Path(__file__).parents[3] / "docs" / "experiments" / "suite.md").read_text("utf-8")
    header, _, *rows = page[page.index("| law |") :].partition("\n\n")[0].splitlines()
    whole, tasks = archive.shipped_archive(), all_tasks()
    assert [name.strip() for name in header.split("|")[2:-1]] == list(tasks)
    cells = {row.split("|")[1].strip(): row.split("|")[2:-1] for row in rows}
    table = tables.task_table(verdicts.verdicts(whole, tasks), whole, tasks, Plain())
    for column, block in enumerate(table.blocks):
        stated = {law: row[column].strip(" *") for law, row in cells.items()}
        for law, ratio, *_ in block.rows[1:]:
            assert stated.pop(law) == ratio, (law, block.title)
        assert set(stated.values()) <= {"-"}


@pytest.mark.ci("compiles a network")
def test_a_network_is_judged_as_the_law_that_it_is(small, invoke):
    """PD by its formula, −kp (E − Eᵀ)^∨ − kd (ω − Eᵀω_d), as the one layer of a network."""
    onnx = pytest.importorskip("onnx")
    archive.write(small / "archive.zip", Archive({}, {}))
    layer = np.zeros((3, 12))
    for row, (plus, minus) in enumerate([(7, 5), (2, 6), (3, 1)]):  # of E, row by row
        layer[row, [plus, minus, 9 + row]] = [-0.8, 0.8, -0.3]
    names = [onnx.helper.make_tensor_value_info(n, 1, [1, k]) for n, k in (("x", 12), ("u", 3))]
    weights = onnx.numpy_helper.from_array(layer.T.astype(np.float32), "W")
    product = onnx.helper.make_node("MatMul", ["x", "W"], ["u"])
    graph = onnx.helper.make_graph([product], "pd", names[:1], names[1:], [weights])
    onnx.save(onnx.helper.make_model(graph), "net.onnx")
    observed = "[{signal: rotation_error}, {signal: rates_error}]"
    Path("net.yaml").write_text(
        f"{{file: net.onnx, observes: {observed}, commands: {{as: wrench, clip: 100}}}}"
    )
    Path("gains.yaml").write_text("quad_att: {kp: 0.8, kd: 0.3}")
    assert "net.yaml" in invoke("suite", "net.onnx", code=2).stderr
    invoke("suite", "net.yaml", "--workers", "1")
    pd = eqt_cli.suite("pd", gains="gains.yaml")
    assert pd.answer()[0].startswith("PD against GT: ")
    one, other = (
        next(iter(archive.read(folder / "law.zip").laws.values())).tasks["quad_att"]
        for folder in (Path("results/suite/net"), pd.folder)
    )
    assert one.errors == pytest.approx(other.errors, rel=1e-5)
    Path("tasks/pose.yaml").write_text(
        (TASKS / "robot.yaml").read_text().replace("eqt-suite-2/robot", "eqt-suite-2/pose")
    )
    refused = invoke("suite", "propose", "tasks/pose.yaml", "--laws", "quaternion", code=2)
    assert "quaternion does not fit" in refused.stderr
