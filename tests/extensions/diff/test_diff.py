"""`eqt diff`: what differs between two results."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest
from said import says

import eqt_cli
from eqt_cli.api.loading import open_at
from eqt_cli.base.files import checksum_of

BRIEF = (
    *("--set", "controllers=[eqt]", "--set", "ensemble.runs=1"),
    *("--set", "time.duration=0.1"),
)


@pytest.fixture(autouse=True)
def first(eqt):
    eqt("run", "c.yaml", "--out", "first", "--quiet")
    return "first"


@pytest.fixture
def second(first):
    """A copy of the first result, with entries of a dataset changed."""

    def changed(name, place, value, of="second"):
        if not Path(of).exists():
            shutil.copytree(first, of)
        with h5py.File(Path(of, "results.h5"), "r+") as file:
            file[name][place] = value

    return changed


def test_a_result_and_itself(eqt):
    done = eqt("diff", "first", "first/results.h5")
    assert (done.code, done.err) == (0, "")
    assert says(done.out, "equal: … datasets, configuration and provenance\n")


@pytest.mark.ci("runs once more")
def test_a_result_that_was_run_again(eqt):
    eqt("run", "first/results.h5", "--out", "second", "--quiet")
    done = eqt("diff", "first", "second")
    assert (done.code, done.err) == (0, "")
    lines = done.out.splitlines()
    assert lines[0].split() == ["provenance", "first", "second"]
    assert lines[2].split()[:3] == ["command", "eqt", "run"]
    assert says(lines[-1], "equal: provenance differs, the … datasets do not")


def test_another_machine_cross_checks_in_other_bits(eqt):
    shutil.copytree("first", "second")
    for folder, difference in ("first", 1.22653e-10), ("second", 1.22651e-10):
        with h5py.File(Path(folder, "results.h5"), "r+") as file:
            check = {
                "method": np.bytes_("LSODA"),
                "runs": 1,
                "bound": 1e-6,
                "difference": difference,
            }
            file.attrs.update({f"cross_check_{key}": value for key, value in check.items()})
    done = eqt("diff", "first", "second")
    assert done.code == 0 and done.out.splitlines()[2].startswith("cross_check_difference")


def test_another_configuration(eqt, monkeypatch):
    eqt("run", "c.yaml", "--set", "gains.kp=2", "--out", "second", "--quiet")
    done = eqt("diff", "first", "second")
    assert (done.code, done.err) == (4, "")
    lines = [line.split() for line in done.out.splitlines()]
    assert lines[0] == ["configuration", "first", "second"]
    assert lines[2] == ["gains.kp", "1.0", "2.0"]
    assert says(done.out.splitlines()[-1], "different: 1 key of the configuration, … of … datasets")
    with open_at("first") as one:
        a = one["pose_error"]
    with open_at("second") as other:
        b = other["pose_error"]
    gap = np.abs(a - b)
    row = next(line for line in done.out.splitlines() if line.startswith("pose_error "))
    count = str(np.count_nonzero(gap))
    assert row.split() == ["pose_error", "2×3×11", count, f"{gap.max():.3g}"]
    whole = eqt_cli.diff("first", "second")
    monkeypatch.setattr("eqt_cli.extensions.diff.diff.BLOCK_ENTRIES", 50)
    assert eqt_cli.diff("first", "second") == whole  # large datasets are read in parts


def test_a_single_entry(eqt, second):
    second("effort", (1, 2), 1e6)
    second("effort", (1, 2), 1e6 + 0.5, of="third")
    done = eqt("diff", "second", "third")
    assert done.code == 4
    row, _, verdict = done.out.splitlines()[2:]
    assert row.split() == ["effort", "2×3", "1", "0.5"]
    assert says(verdict, "different: 1 of … datasets")


def test_entries_that_are_not_finite(eqt, second):
    second("effort", (0, 0), np.inf)
    second("effort", (0, 1), np.nan)
    (found,) = eqt_cli.diff("first", "second").datasets
    assert (found.different, found.largest) == (2, np.inf)


def test_bits_of_nan(eqt, second):
    for of, bits in (("second", 0x7FF8000000000000), ("third", 0xFFF8000000000000)):
        second("effort", (1, 0), np.uint64(bits).view(float), of)
    done = eqt("diff", "second", "third")
    assert done.code == 4
    row, _, verdict = done.out.splitlines()[2:]
    assert row.split() == "effort 2×3 1 0".split()
    assert says(verdict, "different: 1 of … datasets")


def test_the_sign_of_zero(second):
    second("effort", (1, 0), 0.0)
    second("effort", (1, 0), -0.0, of="third")
    (found,) = eqt_cli.diff("second", "third").datasets
    assert (found.different, found.largest) == (1, 0.0)


def test_other_shapes_and_laws(eqt):
    more = ["--set", "time.samples=21", "--set", "controllers=[eqt, nog]"]
    eqt("run", "c.yaml", *more, "--out", "second", "--quiet")
    done = eqt("diff", "first", "second")
    assert done.code == 4
    rows = {line.split()[0]: line.split()[1:] for line in done.out.splitlines() if line}
    assert rows["controllers[1].kind"] == ["gt", "nog"]
    assert rows["controller"] == ["2", "1", "-"]
    assert rows["pose"] == ["2×3×11×3×3,", "2×3×21×3×3", "-", "-"]
    assert says(done.out.splitlines()[-1], "different: 3 keys of the configuration, … datasets")


@pytest.mark.ci("runs once more")
def test_datasets_that_one_result_lacks(eqt):
    eqt("run", "c.yaml", "--set", "store.trajectories=none", "--out", "second", "--quiet")
    rows = {
        line.split()[0]: line.split()[1:]
        for line in eqt("diff", "first", "second").out.splitlines()
        if line
    }
    assert rows["pose"] == ["only", "in", "the", "first", "-", "-"]
    back = eqt("diff", "second", "first").out
    assert "only in the second" in back


@pytest.mark.ci("runs a sweep of two groups")
def test_points_of_several_shapes(eqt):
    words = ["--grid", "time.samples=3,6", *BRIEF]
    eqt("sweep", "c.yaml", *words, "--out", "one", "--quiet")
    shutil.copytree("one", "two")
    assert eqt_cli.diff("one", "two").equal
    with h5py.File("two/shapes/1.h5", "r+") as file:
        file["pose"][0, 0, 0, 2, 1, 1] = 0.5
    sums = " ".join(checksum_of(Path(f"two/shapes/{shape}.h5")) for shape in range(2))
    with h5py.File("two/results.h5", "r+") as file:
        file.attrs["shapes"] = np.bytes_(sums)
    (found,) = eqt_cli.diff("one", "two").datasets
    assert (found.name, found.different) == ("shape 1: pose", 1)


def test_one_document(eqt, second):
    second("effort", (1, 2), 1e6)
    second("effort", (1, 2), 1e6 + 0.5, of="third")
    done = eqt("diff", "second", "third", "--json")
    assert (done.code, done.err) == (4, "")
    found = json.loads(done.out)
    assert (found["first"], found["second"], found["equal"]) == ("second", "third", False)
    assert not any(found[kind] for kind in ("configuration", "attributes", "provenance"))
    assert found["compared"] > 30
    [effort] = found["datasets"]
    assert effort == {"name": "effort", "shapes": [[2, 3], [2, 3]], "different": 1, "largest": 0.5}


def test_a_key_that_one_result_lacks(eqt):
    turned = "reference.pose={rotvec: [0, 0, 0.5]}"
    eqt("run", "c.yaml", "--set", turned, "--out", "second", "--quiet")
    done = eqt("diff", "first", "second", "--json")
    changes = json.loads(done.out)["configuration"]
    assert changes[0] == {"key": "reference.pose", "first": "identity"}
    assert changes[-1] == {"key": "reference.pose.rotvec[2]", "second": 0.5}


@pytest.mark.ci("runs once more")
def test_a_stored_file_is_compared_by_its_text(eqt):
    """Its name is another one where the configuration is the copy in the result folder."""
    Path("starts.csv").write_text("wx [rad],wy [rad],wz [rad]\n1,0,0\n", encoding="utf-8")
    brief = (*BRIEF, "--set", "ensemble={}")
    initial = (*brief, "--set", "initial={file: starts.csv}", "-q", "--out")
    eqt("run", "c.yaml", *initial, "one")
    eqt("run", "one/config.yaml", "-q", "--out", "again")
    done = eqt("diff", "one", "again")
    assert (done.code, done.err) == (0, "")
    assert done.out.splitlines()[-1].startswith("equal: provenance differs")
    Path("starts.csv").write_text("wx [rad],wy [rad],wz [rad]\n2,0,0\n", encoding="utf-8")
    eqt("run", "c.yaml", *initial, "other")
    changes = json.loads(eqt("diff", "one", "other", "--json").out)
    assert changes["attributes"] == [
        {
            "key": "file starts.csv",
            "first": "wx [rad],wy [rad],wz [rad]\n1,0,0\n",
            "second": "wx [rad],wy [rad],wz [rad]\n2,0,0\n",
        }
    ]
    assert not changes["configuration"]


def test_quiet_leaves_the_exit_code(eqt, second):
    second("effort", (1, 2), 1e6)
    done = eqt("diff", "first", "second", "--quiet")
    assert (done.code, done.out, done.err) == (4, "", "")
