import numpy as np
import pytest

from eqt_cli.core.errors import ResultError
from eqt_cli.store.variables import Table, Variable

TIME = Variable(("time",), np.zeros(3))


def test_dimensions_come_with_the_coordinates_first():
    table = Table({"x": Variable(("run", "time"), np.zeros((2, 3)))}, {"time": TIME})
    assert list(table.dimensions.items()) == [("time", 3), ("run", 2)]


@pytest.mark.parametrize(
    ("variables", "coordinates", "attributes", "message"),
    [
        (
            {"x": Variable(("time",), np.zeros(4))},
            {"time": TIME},
            {},
            "x: dimension 'time' has 4 entries, but 3 in 'time'; give both the same size",
        ),
        (
            {"x": Variable(("run",), np.zeros((2, 3)))},
            {},
            {},
            "x: dimensions ('run',) do not fit data of shape (2, 3); "
            "give every axis one name of its own",
        ),
        (
            {"x": Variable(("run", "run"), np.zeros((2, 2)))},
            {},
            {},
            "x: dimensions ('run', 'run') do not fit data of shape (2, 2); "
            "give every axis one name of its own",
        ),
        (
            {"time": TIME},
            {"time": TIME},
            {},
            "time: is both a variable and a coordinate; give it once or rename one",
        ),
        (
            {"run": Variable(("run",), np.zeros(2))},
            {},
            {},
            "run: has the name of a dimension, but is not its coordinate; rename it, "
            "or give it among the coordinates with dims ('run',)",
        ),
        (
            {"x": Variable(("run", "time"), np.zeros((2, 3)))},
            {"time": Variable(("run",), np.zeros(2))},
            {},
            "time: has the name of a dimension, but is not its coordinate; rename it, "
            "or give it among the coordinates with dims ('time',)",
        ),
        (
            {"x": Variable(("run",), np.zeros(2))},
            {"gain": Variable(("point",), np.zeros(4))},
            {},
            "gain: is a coordinate along ('point',), which no variable has; "
            "give it among the variables",
        ),
        (
            {"a/b": Variable((), np.array(1.0))},
            {},
            {},
            "a/b: cannot store the name 'a/b'; use a letter or underscore first, then letters, "
            "digits and _ . @ + -",
        ),
        (
            {"x": Variable(("run",), np.zeros(2, dtype=bool))},
            {},
            {},
            "x: cannot store data of type bool; expected integers, floats of 4 or 8 bytes, "
            "or strings",
        ),
        (
            {"x": Variable(("run",), np.array(["ok", None], dtype=object))},
            {},
            {},
            "x: cannot store None among strings; expected str",
        ),
        (
            {"x": Variable(("run",), np.array(["a\0b"]))},
            {},
            {},
            "x: cannot store the text 'a\\x00b', which holds a NUL or a lone surrogate; "
            "replace that character",
        ),
        (
            {"x": Variable((), np.array(1.0), {"units": "\udc80"})},
            {},
            {},
            "x.units: cannot store the text '\\udc80', which holds a NUL or a lone surrogate; "
            "replace that character",
        ),
        (
            {"x": Variable((), np.array(1.0), {"converged": True})},
            {},
            {},
            "x.converged: cannot store a bool; expected str, int or float",
        ),
        (
            {},
            {},
            {"seed": 2**63},
            "attributes.seed: 9223372036854775808 does not fit 64 bits; store it as text",
        ),
        (
            {},
            {},
            {"CLASS": "x"},
            "attributes: cannot store an attribute called 'CLASS'; choose another name",
        ),
    ],
)
def test_contradictions_are_refused(variables, coordinates, attributes, message):
    with pytest.raises(ResultError) as caught:
        Table(variables, coordinates, attributes)
    assert str(caught.value) == message
