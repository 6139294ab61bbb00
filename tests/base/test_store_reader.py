import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from made_up import Table, write

from eqt_cli.base import store_reader
from eqt_cli.base.errors import ResultError
from eqt_cli.base.store_reader import open_results
from eqt_cli.base.store_writer import Variable


@pytest.fixture(params=[None, "gzip"])
def results(request, tmp_path, table):
    write(tmp_path / "results.h5", table, request.param)
    with open_results(tmp_path) as results:
        yield results


def test_returns_what_was_written(results, table):
    assert results.names == tuple(table.variables)
    assert results.coordinates == tuple(table.coordinates)
    assert dict(results.dimensions) == table.dimensions
    assert dict(results.attributes) == dict(table.attributes)
    for name, variable in {**table.variables, **table.coordinates}.items():
        assert results.dims(name) == variable.dims
        np.testing.assert_array_equal(results[name], variable.data)
    assert results["message"].dtype == object


@pytest.mark.parametrize("every", [1, 4, 40])
def test_dense_positions_are_read_at_once(tmp_path, every, monkeypatch):
    values = np.arange(3 * 400.0).reshape(3, 400)
    write(tmp_path / "results.h5", Table({"x": Variable(("run", "sample"), values, {})}, {}, {}))
    reads, readinto = [], store_reader.CheckedStream.readinto
    with open_results(tmp_path) as results:
        monkeypatch.setattr(
            store_reader.CheckedStream,
            "readinto",
            lambda stream, buffer: reads.append(0) or readinto(stream, buffer),
        )
        chosen = [*range(397, 0, -every)]
        np.testing.assert_array_equal(results.read("x", sample=chosen), values[:, chosen])
    assert len(reads) < 10 + 3 * (every > store_reader.DENSE) * len(chosen)


def test_describes_variables_and_coordinates(results):
    assert (results.units("torque"), results.long_name("torque")) == ("N m", "control torque τ")
    assert (results.units("time"), results.long_name("time")) == ("s", "time")
    assert results.units("status") == ""
    assert results.has("torque")
    assert results.has("time")
    assert not results.has("run")


NAMES = st.from_regex(r"[A-Za-z_][A-Za-z0-9_.]{0,30}", fullmatch=True)
TEXT = st.text(st.characters(exclude_characters="\0", exclude_categories=["Cs"]), max_size=30)
DATA = hnp.arrays(
    st.sampled_from(["<f8", ">f8", "<f4", "<i8", ">i4", "u1"]),
    hnp.array_shapes(min_dims=0, max_dims=3, min_side=0, max_side=5),
) | hnp.arrays(
    np.dtype(object), hnp.array_shapes(min_dims=0, max_dims=2, min_side=0), elements=TEXT
)


@given(
    st.dictionaries(NAMES, st.tuples(DATA, TEXT), max_size=12),
    st.dictionaries(NAMES, TEXT | st.integers(-(2**63), 2**63 - 1) | st.floats(allow_nan=False)),
    st.sampled_from([None, "gzip"]),
)
@settings(max_examples=8)
def test_any_table_comes_back(tmp_path_factory, columns, attributes, compression):
    variables = {
        # Names that end in a hyphen are the dimensions', which depend on the length alone.
        name: Variable(tuple(f"d{k}_{n}-" for k, n in enumerate(data.shape)), data, {"units": unit})
        for name, (data, unit) in columns.items()
    }
    path = tmp_path_factory.mktemp("any") / "any.h5"
    write(path, Table(variables, attributes=attributes), compression)
    with open_results(path) as results:
        assert results.names == tuple(variables)
        assert dict(results.attributes) == attributes
        for name, variable in variables.items():
            assert results[name].shape == variable.data.shape
            np.testing.assert_array_equal(results[name], variable.data)
            assert results.units(name) == variable.attributes["units"]


POSITIONS = st.integers(-5, 4)
CHOICES = (
    POSITIONS
    | st.builds(slice, *[st.none() | st.integers(-7, 7)] * 2, st.none() | st.sampled_from([-2, 3]))
    | st.lists(POSITIONS, max_size=7)
)


@given(st.dictionaries(st.sampled_from(["a", "b", "c"]), CHOICES))
def test_reads_parts_as_numpy_would(cube, selection):
    results, data = cube
    expected = data
    for axis, dim in reversed(list(enumerate("abc"))):
        choice = selection.get(dim, slice(None))
        choice = np.array(choice, dtype=int) if isinstance(choice, list) else choice
        expected = expected[(slice(None),) * axis + (choice,)]
    read = results.read("x", **selection)
    assert read.shape == expected.shape
    np.testing.assert_array_equal(read, expected)


@pytest.fixture(scope="module")
def cube(tmp_path_factory):
    data = np.arange(125).reshape(5, 5, 5)
    path = tmp_path_factory.mktemp("cube") / "cube.h5"
    write(path, Table({"x": Variable(("a", "b", "c"), data)}))
    with open_results(path) as results:
        yield results, data


@pytest.mark.parametrize(
    ("read", "message"),
    [
        (
            lambda r: r["torqe"],
            "holds no variable 'torqe'; did you mean 'torque'?; it holds: controller, time, "
            "torque, settling_time, status, message, reference_drift",
        ),
        (
            lambda r: r.coordinate("tim"),
            "holds no coordinate 'tim'; did you mean 'time'?; its coordinates are: "
            "controller, time",
        ),
        (
            lambda r: r.read("torque", tine=3),
            "'torque' has no dimension 'tine'; did you mean 'time'?; its dimensions are: "
            "controller, run, time, axis",
        ),
        (lambda r: r.read("torque", run=5), "'torque': run: 5 is out of range; expected -5 to 4"),
        (
            lambda r: r.read("torque", controller="gtt"),
            "'torque': controller: has no 'gtt'; did you mean 'gt'?",
        ),
        (
            lambda r: r.read("torque", controller={"gt"}),
            "'torque': controller: cannot select {'gt'}; expected an integer, a slice or a list "
            "of integers",
        ),
        (
            lambda r: r.read("torque", run=[True, False, True, False, True]),
            "'torque': run: cannot select [True, False, True, False, True]; expected an integer, "
            "a slice or a list of integers",
        ),
    ],
)
def test_unknown_names_and_positions_are_explained(results, read, message):
    with pytest.raises(ResultError) as caught:
        read(results)
    assert str(caught.value).removeprefix(f"{results.path}: ") == message


def test_a_closed_file_says_so(tmp_path, table):
    write(tmp_path / "results.h5", table)
    with open_results(tmp_path) as results:
        pass
    with pytest.raises(ResultError) as caught:
        results["torque"]
    assert str(caught.value) == f"{results.path}: is closed; read within its `with` block"


def test_a_file_replaced_while_open_still_reads(tmp_path, table):
    write(tmp_path / "results.h5", table)
    with open_results(tmp_path) as results:
        write(tmp_path / "results.h5", Table({}))
        assert results["message"].tolist() == table.variables["message"].data.tolist()


@pytest.mark.ci("imports xarray")
def test_a_file_that_xarray_holds_open_in_this_process(tmp_path, table):
    xarray = pytest.importorskip("xarray")
    path = tmp_path / "results.h5"
    write(path, table)
    with xarray.open_dataset(path, engine="h5netcdf") as held, open_results(path) as results:
        assert set(held.data_vars) == set(results.names)
