"""Experiments from text, and their runs."""

import numpy as np
import pytest

from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.runs.batches import batches


@pytest.fixture
def solved(tmp_path):
    """The problem and the solution of a controller's runs, of a configuration in text."""

    def solve(text, label="eqt", runs=None, workers=1):
        path = tmp_path / "flight.yaml"
        path.write_text(text, encoding="utf-8")
        found = study(read_config(path))
        entries = np.arange(found.plan.entries) if runs is None else np.asarray(runs)
        [batch] = batches(found, label, entries)
        return batch.problem, batch.engine.solve(batch.problem, workers)

    return solve


@pytest.fixture
def experiment_of(tmp_path):
    """The experiment of a configuration in text."""

    def build(text):
        path = tmp_path / "flight.yaml"
        path.write_text(text, encoding="utf-8")
        return study(read_config(path)).base

    return build
