"""Files with a group for each point of a sweep, and those that only look like it."""

import time

import h5py
import numpy as np
import pytest

from eqt_cli.base import store_reader
from eqt_cli.base.errors import ResultError
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Blank, Variable, assemble, write

AGAIN = "eqt writes no such file: copy it again or run the experiment again"
FLOAT = np.dtype("f8")


def coordinates(times):
    labels = np.array(["eqt", "gt"], dtype=object)
    return {
        "controller": Variable(("controller",), labels),
        "time": Variable(("time",), np.linspace(0.0, 1.0, times), {"units": "s"}),
    }


def blanks():
    return {
        "pose_error": Blank(("controller", "time"), FLOAT, {"units": "1"}),
        "message": Blank(("controller",), None),
    }


def written(file, compression):
    """Two points, of 3 and of 5 times."""
    effort = {"effort": Blank(("point", "controller"), FLOAT, {"units": "mixed"})}
    root = {"controller": coordinates(3)["controller"]}
    sizes = {"point": 2, "controller": 2}
    with assemble(file, sizes, root, effort, compression) as whole:
        whole.put("effort", np.arange(4.0).reshape(2, 2))
        for point, times in enumerate((3, 5)):
            sizes = {"controller": 2, "time": times}
            group = whole.group(f"point_{point}", sizes, coordinates(times), blanks())
            group.put("pose_error", np.full((2, times), float(point)))
            group.put("message", np.array(["", f"of {point}"], dtype=object))
            group.describe({"config": f"point: {point}\n"})
        whole.describe({"config": "all\n", "title": "t"})
    return file


@pytest.fixture(scope="module", params=[None, "gzip"], ids=["plain", "gzip"])
def content(request, tmp_path_factory):
    return written(tmp_path_factory.mktemp("written") / "results.h5", request.param).read_bytes()


@pytest.fixture
def path(tmp_path, content):
    (tmp_path / "results.h5").write_bytes(content)
    return tmp_path / "results.h5"


def test_points_are_read_from_their_groups(path):
    with open_results(path) as results:
        assert results.names == ("effort",)
        assert results.has_groups
        for point, times in enumerate((3, 5)):
            group = results.at(point)
            assert not group.has_groups
            assert dict(group.dimensions) == {"controller": 2, "time": times}
            np.testing.assert_array_equal(group["pose_error"], np.full((2, times), point))
            assert group["message"].tolist() == ["", f"of {point}"]
            assert group.units("pose_error") == "1"
            assert dict(group.attributes) == {"config": f"point: {point}\n", "title": "t"}


def test_what_a_group_says_is_checked_once_and_not_before_it_is_read(path, monkeypatch):
    seen, check = [], store_reader.contents_of

    def noted(owner, *given):
        seen.append(owner.name)
        return check(owner, *given)

    monkeypatch.setattr(store_reader, "contents_of", noted)
    with open_results(path) as results:
        assert results["effort"].size
        assert seen == ["/"]
        for _ in range(2):
            results.at(1)
    assert seen == ["/", "/point_1"]


def test_equal_tables_and_groups_give_equal_bytes(tmp_path, table):
    def both():
        write(tmp_path / "table.h5", table)
        return (tmp_path / "table.h5").read_bytes(), written(tmp_path / "g.h5", None).read_bytes()

    first = both()
    time.sleep(1.1)  # HDF5 would keep times of modification in seconds
    assert both() == first


def test_closing_a_point_closes_the_file(path):
    with open_results(path).at(1) as group:
        assert group["pose_error"].shape == (2, 5)
    with pytest.raises(ResultError, match=r": is closed; read within its `with` block$"):
        group.read("pose_error")


def test_messages_name_the_group(path):
    with h5py.File(path, "r+") as file:
        del file["point_1/time"].attrs["REFERENCE_LIST"]
    assert refusal(path) == "'point_1/pose_error' has an axis without a dimension"


def refusal(path):
    with pytest.raises(ResultError) as caught:
        _open_all(path)
    text = str(caught.value)
    assert text.startswith(f"{path}: refused: ") and text.endswith(f"; {AGAIN}")
    return text.removeprefix(f"{path}: refused: ").removesuffix(f"; {AGAIN}")


def _open_all(path):
    with open_results(path) as results:
        for point in range(results.dimensions["point"]):  # a group is checked when it is read
            results.at(point)


def _another_group(file):
    file.create_group("evil")


def _one_too_many(file):
    file.copy("point_1", "point_2")


def _a_gap(file):
    file.move("point_1", "point_2")


def _within_a_group(file):
    file.create_group("point_1/evil")


def _the_root_within_itself(file):
    file["point_1/evil"] = file["/"]


def _the_same_group_twice(file):
    del file["point_1"]
    file["point_1"] = file["point_0"]


def _external_link_for_a_group(file):
    del file["point_1"]
    file["point_1"] = h5py.ExternalLink("/etc/other.h5", "/data")


def _data_of_another_group(file):
    file["point_1/evil"] = file["point_0/pose_error"]


def _dimension_of_another_group(file):
    file["point_1"].create_dataset("evil", data=np.zeros(3))
    file["point_1/evil"].dims[0].attach_scale(file["point_0/time"])


def _dimension_of_the_root(file):
    file["point_1"].create_dataset("evil", data=np.zeros(2))
    file["point_1/evil"].dims[0].attach_scale(file["controller"])


# What is refused anywhere is planted in a group once; base/test_store_safety.py has all of it.
BUILDERS = {
    _another_group: "'evil' is a group",
    _one_too_many: "it has 3 groups of points, and another number of points",
    _a_gap: "its groups of points are not numbered from 0",
    _within_a_group: "'point_1/evil' is a group",
    _the_root_within_itself: "'point_1/evil' has another name, too",
    _the_same_group_twice: "'point_0' has another name, too",
    _external_link_for_a_group: "'point_1' is an external link",
    _data_of_another_group: "'point_0/pose_error' has another name, too",
    _dimension_of_another_group: "'point_0/time' is attached where it cannot be",
    _dimension_of_the_root: "'controller' is attached where it cannot be",
}


@pytest.mark.parametrize("content", [None], indirect=True, ids=["plain"])
@pytest.mark.parametrize("build", BUILDERS, ids=lambda build: build.__name__.strip("_"))
def test_what_eqt_never_writes_is_refused(path, build):
    with h5py.File(path, "r+") as file:
        build(file)
    assert refusal(path) == BUILDERS[build]
