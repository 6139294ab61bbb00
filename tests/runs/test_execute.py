"""What a result folder goes through: begun, interrupted, resumed, damaged, packed, patched."""

import errno
import json
import os
import platform
import shutil
from dataclasses import dataclass
from functools import partial

import numpy as np
import pytest
from case_tables import from_yaml, in_ci
from faults_harness import Losing, assert_equal, assert_same, contents
from plugin_sources import component
from said import error_of, mentions
from small_experiment import configuration, study_of

from eqt_cli.base.errors import ConfigError, EqtError
from eqt_cli.base.reporting import reporting
from eqt_cli.base.store_reader import open_results, read_arrays
from eqt_cli.base.store_writer import write_arrays
from eqt_cli.extend import Executor, Serial, Status
from eqt_cli.results.result import open_result
from eqt_cli.runs import compute_part, run_study
from eqt_cli.runs import folder as result_folder
from eqt_cli.runs.arithmetic import arithmetic
from eqt_cli.runs.batches import batches
from eqt_cli.runs.folder import ResultFolder
from eqt_cli.runs.lock import holder, locked
from eqt_cli.runs.part_files import unfinished
from eqt_cli.runs.run_study import Shard, execute, pack_folder

CONFIG = configuration(
    inertia="[1, 2, 3]",
    initial="{pose: {kind: haar}, velocity: {kind: normal}}",
    ensemble="{runs: 7, seed: 1}",
    time="{duration: 0.2, samples: 3}",
    solver="{rtol: 1.0e-6, block: 3, cross_check: 0, error_estimate: false}",
)
FLIGHT = """\
plant: {inertia: {relative: {uniform: [-0.1, 0.1]}}}
actuators: [{kind: limit, limit: {uniform: [0.8, 1.2]}}, {kind: lag, time_constant: 0.1}]
control: {period: 0.1, delay: 1}
sensors:
  pose: [{kind: noise, std: 0.01}]
  velocity: [{kind: bias, value: {normal: [0, 0.1]}, walk: 0.01}]
"""
SWEEP = """\
sweep:
  - grid: {gains.kp: [1, 2, 4]}
  - zip: {inertia: [[1, 2, 3], [1, 1, 1]], "controllers[1]": [gt, gt]}
"""


@pytest.fixture(autouse=True, scope="module")
def _small_parts():
    """Parts of one block, so that a small experiment has several."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("eqt_cli.config.study.PART_RUNS", 3)
        yield


def study_in(folder, text=CONFIG, *overrides, **more):
    return study_of(folder, text, *overrides, **more)


@pytest.fixture
def make(tmp_path):
    return partial(study_in, tmp_path)


@pytest.fixture(scope="module")
def finished(made_once):
    """The folder of an experiment or of a sweep that was not disturbed, to be read only."""
    texts = {"run": CONFIG, "sweep": CONFIG + SWEEP, "flight": CONFIG + FLIGHT}

    def found(name):
        def make(folder):
            execute(study_in(folder, texts[name]), folder / "out")

        return made_once(f"undisturbed {name}", make) / "out"

    return found


@dataclass(frozen=True)
class Stopping(Executor):
    """Does some items and is then interrupted, as by Ctrl-C."""

    after: int = 0

    def outcomes(self, task, items):
        yield from Serial().outcomes(task, items[: self.after])
        raise KeyboardInterrupt


@pytest.fixture
def whole(finished):
    return contents(finished("run"))


def interrupted(found, out, after=2):
    with pytest.raises(KeyboardInterrupt):
        execute(found, out, executor=Stopping(after=after))


@pytest.fixture
def begun(made_once, tmp_path):
    """A folder of the experiment that was interrupted after two parts."""
    once = made_once("interrupted run", lambda at: interrupted(study_in(at), at / "out"))
    return shutil.copytree(once / "out", tmp_path / "out")


def test_all_points_of_a_kind_are_variations_of_one_loop(make):
    """So that it is traced and compiled once, whatever the part."""
    found, seen = make(CONFIG + SWEEP), []
    for point in (3, 0):
        [batch] = batches(found, "eqt", np.arange(7 * point, 7 * point + 7))
        K = batch.problem.batched_loop().gains.K
        assert (K == found.experiment(point).loops["eqt"].gains.K).all()
        seen.append(batch.problem.loop)
    assert seen[0] is seen[1]


# Resuming.


def test_an_interrupted_run_continues_and_ends_the_same(make, whole, tmp_path, told):
    out = tmp_path / "out"
    with reporting(type(told)()):
        interrupted(make(), out)
    assert not (out / "results.h5").exists()
    outcome = execute(make(), out)
    assert told.steps[0] == ("runs", 14)
    assert told.skipped == [6]
    assert told.total("runs") == pytest.approx(8)
    assert outcome.resumed == 6
    assert outcome.failed == 0
    assert_equal(out, whole)
    assert not (out / "parts").exists()


@pytest.mark.parametrize(("after", "files"), [(60.0, 0), (0.0, 6)])
def test_a_short_session_writes_no_files_of_parts(make, whole, tmp_path, monkeypatch, after, files):
    """In a longer one, a kill loses no finished part, even while the result is packed."""
    found = []

    def pack(task, *given):
        found.extend(task.files.listed())
        run_study_pack(task, *given)

    run_study_pack = run_study.pack
    monkeypatch.setattr(run_study, "pack", pack)
    monkeypatch.setattr(run_study, "UNSAVED_SECONDS", after)
    execute(make(), tmp_path / "out")
    assert len(found) == files
    assert_equal(tmp_path / "out", whole)


def test_parts_that_are_removed_while_others_are_computed_are_missed(make, tmp_path, monkeypatch):
    found = compute_part.write_arrays

    def removing(path, arrays):
        found(path, arrays)
        if path.name == "000001.npy":
            (path.parent / "000000.npy").unlink()

    monkeypatch.setattr(compute_part, "write_arrays", removing)
    monkeypatch.setattr(run_study, "UNSAVED_SECONDS", 0.0)
    with pytest.raises(EqtError, match=r"out/parts: 1 of \d+ parts were removed while others"):
        execute(make(), tmp_path / "out")
    monkeypatch.undo()
    assert execute(make(), tmp_path / "out").packed


def test_an_interruption_after_a_file_was_written_writes_it_once(make, tmp_path, monkeypatch):
    written, found = [], compute_part.write_arrays

    def interrupting(path, arrays):
        found(path, arrays)
        written.append(path.name)
        if path.name == "000001.npy":
            raise KeyboardInterrupt

    monkeypatch.setattr(compute_part, "write_arrays", interrupting)
    monkeypatch.setattr(run_study, "UNSAVED_SECONDS", 0.0)
    with pytest.raises(KeyboardInterrupt):
        execute(make(), tmp_path / "out")
    assert written == ["reference.npy", "000000.npy", "000001.npy"]


def test_an_interrupted_packing_keeps_the_parts_of_a_short_session(
    make, whole, tmp_path, monkeypatch
):
    def pack(*_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(run_study, "pack", pack)
        with pytest.raises(KeyboardInterrupt):
            execute(make(), tmp_path / "out")
    assert execute(make(), tmp_path / "out").resumed == 14
    assert_equal(tmp_path / "out", whole)


@pytest.mark.parametrize(
    "damage",
    ["foreign", *(in_ci("as the first", x) for x in ("truncated", "reference", "other piece"))],
)
def test_what_is_damaged_is_computed_again(make, whole, tmp_path, damage, begun):
    of_part = damage in ("foreign", "truncated")
    part = begun / ("parts/000001.npy" if of_part else "parts/reference.npy")
    data = part.read_bytes()[:2000]
    if damage == "other piece":
        arrays = read_arrays(part)
        of_piece = {compute_part.STUDY: np.array([arrays.pop(compute_part.STUDY)[0], "1"])}
        write_arrays(part, {name: 0.9 * array for name, array in arrays.items()} | of_piece)
        data = part.read_bytes()
    if damage == "foreign":
        other = tmp_path / "other"
        interrupted(make(CONFIG, "gains.kp=2"), other)
        data = (other / "parts/000001.npy").read_bytes()
    part.write_bytes(data)
    execute(make(), begun)
    assert_equal(begun, whole)


@pytest.mark.ci("computes an experiment several times")
def test_a_kill_before_the_parts_are_removed_loses_nothing(make, whole, tmp_path, monkeypatch):
    out = tmp_path / "out"

    def die(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(ResultFolder, "finish", die)
    with pytest.raises(KeyboardInterrupt):
        execute(make(), out)
    monkeypatch.undo()
    monkeypatch.setattr("eqt_cli.config.study.PART_RUNS", 3)
    assert execute(make(), out).was_complete
    assert_equal(out, whole)


# Other versions.


def pretend(out, **versions):
    """Let the folder's last session have had other versions."""
    path = out / "manifest.json"
    manifest = json.loads(path.read_text(encoding="utf-8"))
    manifest["provenance"] |= versions
    manifest.pop("checksum", None)
    path.write_text(json.dumps(manifest), encoding="utf-8")


def origin_of(out):
    manifest = json.loads((out / "manifest.json").read_text(encoding="utf-8"))
    with open_results(out) as results:
        assert json.loads(results.attributes["provenance"]) == manifest["provenance"]
    return manifest["provenance"]


@pytest.fixture
def remarks(told):
    return told.remarks


def test_parts_of_other_versions_are_told_of_and_remembered(make, whole, remarks, begun):
    pretend(begun, numpy="1.0", machine="abacus")
    execute(make(), begun)
    assert remarks == [
        f"{begun}: some of its runs were computed with numpy 1.0 (not {np.__version__}), machine "
        f"abacus (not {platform.machine()}); they agree with the new ones within tolerances, not "
        "bit for bit; for runs of one version, choose another folder with out=…"
    ]
    origin = origin_of(begun)
    assert origin["numpy"] == np.__version__
    assert [session["numpy"] for session in origin["other_sessions"]] == ["1.0"]
    assert_equal(begun, whole)


@pytest.mark.parametrize(
    ("engine", "law", "of"),
    [
        ("solve_ivp", "eqt", "engine solve_ivp"),
        ("native", "eqt", None),
        pytest.param("native", "lqr", "controller 'lqr'", marks=pytest.mark.needs("designed_laws")),
    ],
)
def test_parts_of_another_arithmetic_are_told_of_where_bits_depend_on_it(
    make, tmp_path, remarks, engine, law, of
):
    text = CONFIG.replace("{rtol: 1.0e-6, block: 3", f"{{engine: {engine}, rtol: 1.0e-6")
    text = text.replace("[eqt", f"[{law}")
    out = tmp_path / "out"
    interrupted(make(text), out, after=1)
    pretend(out, processor="abacus", arithmetic=f"abacus by {of}" if of else "any")
    execute(make(text), out)
    now = f"arithmetic abacus by {of} (not {arithmetic()} by {of}); they agree"
    assert [now in remark for remark in remarks] == [True] * bool(of)
    assert origin_of(out)["processor"] == arithmetic()


@pytest.mark.ci("computes an experiment several times")
def test_every_session_is_remembered_once(make, tmp_path, remarks):
    out = tmp_path / "out"
    for version in ("1.0", "1.1", "1.0", np.__version__):
        interrupted(make(), out, after=1) if not out.exists() else None
        pretend(out, numpy=version)
        with pytest.raises(KeyboardInterrupt):
            execute(make(), out, executor=Stopping(after=0))
    execute(make(), out)
    assert "numpy 1.0 (not " in remarks[-1]
    assert "; or numpy 1.1 (not " in remarks[-1]
    assert sorted(session["numpy"] for session in origin_of(out)["other_sessions"]) == [
        "1.0",
        "1.1",
    ]


def test_versions_of_what_is_not_there_any_more_do_not_matter(make, remarks, begun):
    pretend(begun, numpy="1.0")
    execute(make(), begun, force=True)
    assert remarks == []
    assert "other_sessions" not in origin_of(begun)


@pytest.mark.ci("computes an experiment several times")
def test_what_affects_no_number_is_not_told(make, remarks, begun):
    pretend(begun, h5py="1.0", cpu_count=1000, command="eqt else")
    execute(make(), begun)
    assert remarks == []


@pytest.mark.ci("computes an experiment several times")
@pytest.mark.needs("growth")
def test_failed_runs_computed_again_with_other_versions(make, tmp_path, remarks):
    out = tmp_path / "out"
    execute(make(), out, executor=Losing(lost={1}))
    pretend(out, numpy="1.0")
    execute(make(), out, rerun_failed=True)
    assert [f"numpy 1.0 (not {np.__version__})" in remark for remark in remarks] == [True]
    origin = origin_of(out)
    assert origin["numpy"] == "1.0"  # as most of its runs
    assert [session["numpy"] for session in origin["other_sessions"]] == [np.__version__]


@pytest.mark.ci("computes an experiment several times")
def test_packing_parts_of_shards_of_other_versions(make, tmp_path, remarks):
    out = tmp_path / "out"
    execute(make(), out, shard=Shard(1, 2))
    pretend(out, numpy="1.0")
    execute(make(), out, shard=Shard(2, 2))
    pack_folder(make(), out)
    assert ["numpy 1.0" in remark for remark in remarks] == [True, True]
    assert [session["numpy"] for session in origin_of(out)["other_sessions"]] == ["1.0"]


# Parts of versions that keep other numbers.


@pytest.mark.ci("computes an experiment several times")
def test_numbers_of_a_part_are_read_by_name(make, whole, remarks, begun):
    """As a version writes them in whose source they have another order."""
    path = begun / "parts/000001.npy"
    arrays = read_arrays(path)
    write_arrays(path, dict(reversed(arrays.items())))
    assert execute(make(), begun).resumed == 6
    assert remarks == []
    assert_equal(begun, whole)


@pytest.mark.parametrize("change", [lambda effort: None, lambda effort: effort[1:]])
def test_a_part_without_a_number_of_every_run_is_computed_again(make, whole, begun, change):
    path = begun / "parts/000001.npy"
    arrays = read_arrays(path)
    arrays["effort"] = change(arrays["effort"])
    write_arrays(path, {name: x for name, x in arrays.items() if x is not None})
    execute(make(), begun)
    assert_equal(begun, whole)


def execute_without(name, *arguments, **options):
    """As a version of eqt computes it that does not keep a quantity."""
    with pytest.MonkeyPatch.context() as patch:
        known = result_folder.quantities
        patch.setattr(
            result_folder, "quantities", lambda *of: [q for q in known(*of) if q.name != name]
        )
        execute(*arguments, **options)


@pytest.mark.needs("growth")
def test_failed_runs_of_a_result_that_lacks_a_number_are_patched(make, whole, tmp_path):
    out, name = tmp_path / "out", "effort"
    execute_without(name, make(), out, executor=Losing(lost={1}))
    assert execute(make(), out, rerun_failed=True).failed == 0
    found = contents(out)
    expected = np.full_like(whole[name], np.nan)
    expected[1, :3] = whole[name][1, :3]
    np.testing.assert_array_equal(found[name], expected)
    assert_same(found | {name: whole[name]}, whole)


@pytest.mark.needs("growth")
def test_failed_runs_of_a_result_that_lacks_an_integer_are_not_computed(make, tmp_path):
    out = tmp_path / "out"
    execute_without("steps", make(), out, executor=Losing(lost={1}))
    assert error_of(execute, make(), out, rerun_failed=True) == (
        f"{out}/results.h5: was written by a version of eqt that stores other variables; compute "
        "its failed runs with that version, or choose another folder with out=…"
    )


# Workers.


def test_runs_of_a_lost_part_are_rows_with_a_status(make, tmp_path):
    out = tmp_path / "out"
    outcome = execute(make(), out, executor=Losing(lost={1}))
    assert outcome.failed == 3
    with open_results(out) as results:
        status = results["status"]
        assert (status[1, :3] == Status.WORKER_LOST).all()
        assert np.count_nonzero(status) == 3
        assert results["message"][1, 0] == "worker lost 3 times (killed, or out of memory)"
        assert np.isnan(results["effort"][1, :3]).all()


@pytest.mark.ci("computes an experiment twice")
@pytest.mark.parametrize(
    ("name", "text"),
    [("sweep", CONFIG + SWEEP), ("flight", CONFIG + FLIGHT)],
    ids=["sweep", "flight"],
)
@pytest.mark.needs("growth")
def test_rerun_failed_mends_a_lost_part_bit_for_bit(make, finished, tmp_path, name, text):
    out = tmp_path / "out"
    execute(make(text), out, executor=Losing(lost={1, 2}))
    outcome = execute(make(text), out, rerun_failed=True)
    assert outcome.failed == 0
    assert outcome.resumed == outcome.runs - 6
    found, expected = contents(out), contents(finished(name))
    for given in ("initial_pose", "initial_velocity"):  # rows of a lost part are drawn, too
        np.testing.assert_array_equal(found[given], expected[given])
    assert_same(found, expected)
    assert not (out / "reruns").exists()
    assert execute(make(text), out, rerun_failed=True).was_complete


@pytest.mark.ci("computes every run twice, and once more by itself")
@pytest.mark.needs("growth")
def test_rerun_failed_integrates_failed_runs_alone(make, tmp_path):
    """With a limit of steps that a block of three exceeds by its stricter tolerance only."""
    out = tmp_path / "out"
    text = CONFIG.replace("error_estimate: false", "max_error: 1.0e-30, error_estimate: true")
    first = execute(make(text), out)
    assert first.failed == 14
    before = contents(out)
    again = execute(make(text), out, rerun_failed=True)
    assert again.failed == 14
    after = contents(out)
    assert (after["status"] == Status.ACCURACY).all()
    assert not np.array_equal(before["effort"], after["effort"])
    # Both are within a few times the tolerance of the same solution.
    np.testing.assert_allclose(before["effort"], after["effort"], rtol=1e-4)


@pytest.mark.ci("compiles two laws")
@pytest.mark.needs("growth")
def test_a_run_with_noise_is_the_same_alone_if_compiled(make, tmp_path):
    """Neither its neighbours in a batch nor the law that waits for all of them changes it."""
    out = tmp_path / "out"
    text = (CONFIG + FLIGHT).replace(
        "rtol: 1.0e-6, block: 3, cross_check: 0, error_estimate: false",
        "engine: native, cross_check: 0, max_error: 1e-30",
    )
    assert execute(make(text), out).failed == 14
    before = contents(out)
    execute(make(text), out, rerun_failed=True)
    assert_equal(out, before)


def test_shards_and_pack_give_the_same_bits(make, whole, tmp_path):
    out = tmp_path / "out"
    first = execute(make(), out, shard=Shard(1, 2))
    assert not first.packed
    with pytest.raises(
        EqtError, match=r": 3 of 6 parts are missing; complete every shard, or use eqt run"
    ):
        pack_folder(make(), out)
    execute(make(), out, shard=Shard(2, 2))
    assert pack_folder(make(), out).failed == 0
    assert_equal(out, whole)


@pytest.mark.parametrize("damage", ["flipped", "cut", "missing"])
def test_parts_are_used_again_where_the_manifest_is_damaged(damage, make, whole, tmp_path, remarks):
    """They say themselves of which experiment they are."""
    out = tmp_path / "out"
    execute(make(), out, shard=Shard(1, 2))
    manifest = out / "manifest.json"
    content = manifest.read_bytes()
    at = content.index(b'"runs"') + 1
    flipped = content[:at] + bytes([content[at] ^ 1]) + content[at + 1 :]
    manifest.write_bytes({"flipped": flipped, "cut": content[:100], "missing": b""}[damage])
    if damage == "missing":
        manifest.unlink()
    execute(make(), out)
    assert_equal(out, whole)
    [said] = [str(remark) for remark in remarks if "manifest.json" in str(remark)]
    assert "manifest.json is damaged or missing; 3 of its 3 parts say" in said


def test_a_damaged_manifest_of_another_experiment_is_told(make, tmp_path):
    out = tmp_path / "out"
    execute(make(), out, shard=Shard(1, 2))
    (out / "manifest.json").write_bytes(b"{")
    other = make(CONFIG.replace("seed: 1", "seed: 2"))
    with pytest.raises(EqtError, match="is damaged or missing, and none of the 3"):
        execute(other, out)


@pytest.mark.ci("the other cases of a damaged manifest are quick")
def test_a_damaged_manifest_before_the_first_finished_run(make, whole, tmp_path, remarks):
    out = tmp_path / "out"
    execute(make(), out, shard=Shard(1, 2))
    (out / "manifest.json").write_bytes(b"{")
    for path in (out / "parts").glob("0*.npy"):
        path.unlink()
    execute(make(), out)
    assert_equal(out, whole)
    assert any("damaged or missing; no run is finished there" in str(x) for x in remarks)


# The lock.

POSIX = pytest.mark.skipif(os.name != "posix", reason="locks files as POSIX does")


@POSIX
def test_two_processes_do_not_share_a_folder(make, tmp_path):
    out = tmp_path / "out"
    with locked(out):
        assert holder(out)["pid"] == os.getpid()
        with pytest.raises(EqtError) as caught:
            execute(make(), out)
    assert str(caught.value) == (
        f"{out}: another eqt (process {os.getpid()} on {platform.node()}) is writing to it; "
        "wait for its end, or choose another folder with out=…"
    )
    assert holder(out) is None
    assert execute(make(), out).failed == 0


@POSIX
def test_shards_share_a_folder_but_not_with_others_or_themselves(make, tmp_path):
    out = tmp_path / "out"
    with locked(out, shared=True), locked(out, name=".lock-1-2"):
        execute(make(), out, shard=Shard(2, 2))
        for blocked in ({"shard": Shard(1, 2)}, {}):
            with pytest.raises(EqtError, match="another eqt"):
                execute(make(), out, **blocked)


@pytest.mark.ci("computes an experiment several times")
@POSIX
@pytest.mark.parametrize(("code", "shard"), [(errno.ENOLCK, None), (errno.ENOTSUP, Shard(1, 1))])
def test_a_disk_that_refuses_locks_is_told_of_once(
    make, tmp_path, monkeypatch, remarks, code, shard
):
    def refused(*_):
        raise OSError(code, "refused")

    monkeypatch.setattr("fcntl.flock", refused)
    out = tmp_path / "out"
    execute(make(), out, shard=shard)
    assert remarks == [
        f"{out}: its disk does not support file locks, so a second eqt could write to it at the "
        "same time; run one at a time there, or choose another disk with out=…"
    ]
    assert holder(out) is None


# The state of an unfinished folder.


@pytest.mark.ci("computes an experiment several times")
def test_status_counts_from_the_listing_alone(make, tmp_path):
    out = tmp_path / "out"
    interrupted(make(), out, after=4)
    (out / "parts/000001.npy").rename(out / "parts/000001.f2.npy")
    found = unfinished(out)
    assert (found.runs, found.done, found.failed) == (14, 12, 2)
    assert found.writer is None
    assert found.remaining is None
    execute(make(), out)
    assert unfinished(out) is None


# Sweeps.


@pytest.mark.ci("computes every point of a sweep twice")
def test_points_of_a_sweep_are_those_of_experiments_by_themselves(make, tmp_path):
    """One point after the other, with blocks that hold runs of one point only, bit for bit."""
    text = CONFIG.replace("block: 3", "block: 7")
    execute(make(text + SWEEP), tmp_path / "sweep")
    swept = contents(tmp_path / "sweep")
    assert swept["effort"].shape == (6, 2, 7)
    np.testing.assert_array_equal(swept["gains.kp"], [1, 1, 2, 2, 4, 4])
    assert [json.loads(v) for v in swept["inertia"][:2]] == [[1, 2, 3], [1, 1, 1]]
    for point, (kp, inertia) in enumerate(
        (kp, inertia) for kp in (1, 2, 4) for inertia in ("[1, 2, 3]", "[1, 1, 1]")
    ):
        out = tmp_path / f"point{point}"
        execute(make(text, f"gains.kp={kp}", f"inertia={inertia}"), out)
        alone = contents(out)
        for name in ("pose", "torque", "effort", "status", "desired_pose", "steps"):
            np.testing.assert_array_equal(swept[name][point], alone[name], err_msg=name)
        np.testing.assert_array_equal(swept["initial_pose"], alone["initial_pose"])


@pytest.mark.ci("computes a sweep")
def test_blocks_mix_points_and_agree_within_the_tolerance(make, finished, tmp_path):
    execute(make(CONFIG, "gains.kp=4"), tmp_path / "alone")
    swept, alone = contents(finished("sweep")), contents(tmp_path / "alone")
    # rtol 1e-6, amplified little over half a second.
    np.testing.assert_allclose(swept["pose"][4], alone["pose"], atol=1e-5)


@pytest.mark.ci("computes a sweep")
def test_a_swept_seed_gives_points_initial_states_of_their_own(make, tmp_path):
    execute(make(grids=["ensemble.seed=1,2"]), tmp_path / "sweep")
    execute(make(CONFIG, "ensemble.seed=2"), tmp_path / "alone")
    swept, alone = contents(tmp_path / "sweep"), contents(tmp_path / "alone")
    assert swept["initial_pose"].shape == (2, 7, 3, 3)
    np.testing.assert_array_equal(swept["initial_pose"][1], alone["initial_pose"])


def test_a_large_sweep_keeps_trajectories_only_if_asked(make, monkeypatch):
    monkeypatch.setattr("eqt_cli.config.study.MOST_TRAJECTORIES", 40)
    grids = ["gains.kp=1,2,3"]  # 3 points of 2 controllers and 7 runs
    assert make(grids=grids).trajectories == 0
    assert make(CONFIG, "store.trajectories=2", grids=grids).trajectories == 2
    assert make(grids=grids, text=CONFIG.replace("runs: 7", "runs: 2")).trajectories == 2


@from_yaml
def test_what_is_wrong_with_a_point_is_said_where_it_was_written(make, sweep, message):
    assert mentions(error_of(make, f"{CONFIG}sweep:\n  {sweep}", kind=ConfigError), message)


def test_what_is_wrong_on_the_command_line_is_said_there(make):
    assert error_of(make, grids=["gains.kp=1,-2"], kind=ConfigError).startswith(
        "grids[0]: gains.kp: must be positive"
    )


# Laws with states of their own.


REMEMBERING = component("""
remembering(eqt_cli.components.laws.EqT):
    def memory(self, G):  # the time
        return {"clock": 2}

    def initial_memory(self, s):
        return {"clock": 0 * s.V[..., :2]}

    def memory_rate(self, s):
        return {"clock": 1 + 0 * s.V[..., :2]}
""")


@pytest.mark.ci("computes an experiment several times")
@pytest.mark.parametrize(
    ("laws", "text"),
    [
        ("[eqt, remembering]", CONFIG),
        ("[remembering, eqt]", CONFIG + "sweep: [{grid: {inertia: [1, 2]}}]\n"),
    ],
)
def test_laws_may_have_states_of_different_lengths(make, tmp_path, laws, text):
    """Parts and the cross-check take states by name.

    The law is EqT's, so both have the same reference to the tolerance of the solver, which the
    residual shows, and the two integrators agree.
    """
    (tmp_path / "remembering.py").write_text(REMEMBERING, encoding="utf-8")
    text = text.replace("controllers: [eqt, gt]", f"plugins: [remembering.py]\ncontrollers: {laws}")
    text = text.replace("cross_check: 0", "cross_check: 2")
    out = tmp_path / "out"
    assert execute(make(text), out).failed == 0
    with open_result(out) as results:
        assert results["reference_residual"].max() < 1e-3
        check = results.cross_check
        assert check is not None and check.holds
        np.testing.assert_allclose(results["effort"][..., 0, :], results["effort"][..., 1, :], 1e-3)
