"""Small results to draw: real ones, and the same with single arrays replaced or left out."""

import shutil
from hashlib import sha256

import h5py
import numpy as np
import pytest
import yaml
from made_up import Table, write
from small_experiment import mapping, study_of

from eqt_cli.api.loading import open_at
from eqt_cli.base.store_writer import Variable
from eqt_cli.runs.run_study import execute

RUNS = 6

CONFIG = mapping(
    inertia=[1.0, 2.0, 3.0],
    controllers=["eqt", "gt", "nog", "asym"],
    initial={"pose": "exp_normal", "velocity": "normal"},
    ensemble={"runs": RUNS, "seed": 1},
    time={"duration": 4.0, "samples": 41},
    solver={"rtol": 1e-3, "cross_check": 0, "error_estimate": False},
)


def simulated(folder, **changes):
    """The result file of a small experiment."""
    found = study_of(folder, yaml.safe_dump(CONFIG | changes), name="small.yaml")
    return execute(found, folder / "out").folder.results


@pytest.fixture(scope="session")
def simulated_once(made_once):
    """The result file of a small experiment, which all processes of the tests share."""

    def found(which, **changes):
        folder = made_once(f"drawn {which}", lambda folder: simulated(folder, **changes))
        return folder / "out" / "results.h5"

    return found


@pytest.fixture(scope="session")
def so3(simulated_once):
    return simulated_once("so3")


@pytest.fixture(scope="session")
def se3(simulated_once):
    return simulated_once(
        "se3",
        group="SE3",
        inertia=1.0,
        reference={"torque": ["cos(t)", "sin(t)", "0", "1", "cos(t)", "0"]},
    )


@pytest.fixture(scope="session")
def odd_names(simulated_once):
    """Four controllers with names of every kind, and trajectories of some runs only."""
    labels = ["_hidden", "g = $\\frac{1}{2}$", "5 $\\oops$", "a long name " * 6]
    return simulated_once(
        "odd_names",
        controllers=[{"kind": "family", "label": label} for label in labels],
        store={"trajectories": 4},
    )


@pytest.fixture
def curve_names():
    """The names of the curves of a drawing, in a legend or beside them."""

    def of(drawing):
        texts = drawing.legends[0].get_texts() if drawing.legends else []
        beside = [text for axes in drawing.axes for text in axes.texts]
        return [text.get_text() for text in texts or beside]

    return of


@pytest.fixture(scope="session")
def simulate(simulated_once):
    """The result file of `CONFIG` with some keys replaced, to be read only."""

    def found(**changes):
        return simulated_once(sha256(repr(changes).encode()).hexdigest()[:16], **changes)

    return found


@pytest.fixture(scope="session")
def _open():
    """Result files that are open, by their paths."""
    found = {}
    yield found
    for results in found.values():
        results.close()


@pytest.fixture
def opened(_open):
    """Open a result file, once for all tests."""

    def open_once(path):
        if path not in _open:
            _open[path] = open_at(path)
        return _open[path]

    return open_once


@pytest.fixture(scope="session")
def _pictures():
    return {}


@pytest.fixture
def picture(request, _pictures):
    """A figure of results that stay open, drawn once for all tests that only look at it."""
    arranged = "unarranged" not in request.fixturenames

    def drawn(figure, *results, width="column"):
        key = repr(figure), results, width, arranged
        if key not in _pictures:
            _pictures[key] = figure.draw(results, width)
        return _pictures[key]

    return drawn


@pytest.fixture
def altered(tmp_path, opened, request):
    """A result with some arrays replaced, or left out where None is given."""

    def alter(path, **arrays):
        results, target, new = opened(path), tmp_path / "altered.h5", tmp_path / "new.h5"
        if all(np.shape(array) == results[name].shape for name, array in arrays.items()):
            shutil.copy(results.path, new)
            with h5py.File(new, "r+") as file:
                for name, array in arrays.items():
                    file[name][...] = array
            new.replace(target)
        else:
            write(target, changed(results, arrays))
        altered = open_at(target)
        request.addfinalizer(altered.close)
        return altered

    def changed(results, arrays):
        def variable(name):
            given = arrays.get(name)
            return Variable(
                results.dims(name),
                results[name] if given is None else given,
                {"units": results.units(name), "long_name": results.long_name(name)},
            )

        none = {name for name, array in arrays.items() if array is None}
        return Table(
            {name: variable(name) for name in results.names if name not in none},
            {name: variable(name) for name in results.coordinates},
            results.attributes,
        )

    return alter
