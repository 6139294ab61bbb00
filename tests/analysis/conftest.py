"""Small results with numbers that are known."""

import numpy as np
import pytest

from eqt_cli.store.reader import open_results
from eqt_cli.store.variables import Table, Variable
from eqt_cli.store.writer import write

PER_RUN = ("controller", "run")


class MakeResult:
    """Writes results out of their parts and opens them."""

    times = np.linspace(0.0, 20.0, 41)

    def __init__(self, folder):
        self.folder, self.opened = folder, []

    def constant(self, *levels):
        """Signals that are constant over time: a list of runs per controller."""
        return np.asarray(levels, float)[..., None] * np.ones(len(self.times))

    def __call__(
        self, labels, signals=None, metrics=None, status=None, kinds=None, units=None, stored=None
    ):
        signals, metrics, units = signals or {}, metrics or {}, units or {}
        runs = np.shape(next(iter([*metrics.values(), *signals.values()])))[1]
        status = np.zeros((len(labels), runs)) if status is None else status
        entries = "".join(
            f"  - kind: {kind}\n    label: {label}\n"
            for label, kind in zip(labels, kinds or labels, strict=True)
        )
        dims = ("controller", "run" if stored is None else "stored_run", "time", "axis")
        table = Table(
            {
                name: Variable(dims[: np.ndim(values)], values, {"units": units.get(name, "1")})
                for name, values in signals.items()
            }
            | {
                name: Variable(PER_RUN, np.asarray(values, float), {"units": units.get(name, "1")})
                for name, values in metrics.items()
            }
            | {"status": Variable(PER_RUN, np.asarray(status, dtype=np.int32))},
            {
                "controller": Variable(("controller",), np.array(labels, dtype=object)),
                "run": Variable(("run",), np.arange(runs)),
                "time": Variable(("time",), self.times, {"units": "s"}),
            }
            | (
                {}
                if stored is None
                else {"stored_run": Variable(("stored_run",), np.arange(stored))}
            ),
            {"title": "made up", "group": "SO3", "config": f"controllers:\n{entries}"},
        )
        path = self.folder / f"results{len(self.opened)}.h5"
        write(path, table)
        self.opened.append(open_results(path))
        return self.opened[-1]


@pytest.fixture
def make_result(tmp_path):
    make = MakeResult(tmp_path)
    yield make
    for results in make.opened:
        results.close()
