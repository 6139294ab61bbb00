import numpy as np

from eqt_cli.store.writer import Table, Variable

TIME = Variable(("time",), np.zeros(3))


def test_dimensions_come_with_the_coordinates_first():
    table = Table({"x": Variable(("run", "time"), np.zeros((2, 3)))}, {"time": TIME})
    assert list(table.dimensions.items()) == [("time", 3), ("run", 2)]
