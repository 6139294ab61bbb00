"""Configurations of the first version: the same experiment, and equal numbers."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.config.source import read_config
from eqt_cli.execution.executors import executors
from eqt_cli.execution.run_study import execute
from eqt_cli.experiment.read_study import study
from eqt_cli.store.reader import open_results

FIRST = Path(__file__).parent / "first_version"
SHIPPED = json.loads((FIRST / "shipped.json").read_text())
SHORT = ("ensemble.runs=2", "time.duration=2", "time.samples=3", "solver.cross_check=0")
# Rounding on another machine, or by products in another order, as steps of adaptive length carry it
# on: a tenth of the tolerance 1e-7 that these configurations ask for.
ROUNDING = {"rtol": 1e-7, "atol": 1e-8}

# The first version found the reference from a run without errors, this one by itself, with steps of
# its own: both are right to the tolerance 1e-7, which 2 s of motion carry on.
REFERENCE = ("desired_pose", "desired_velocity", "reference_residual")
TOLERANCE = {"rtol": 0.0, "atol": 5e-7}


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_configuration_is_the_same_experiment(name: str) -> None:
    """Equal digests: folders that were begun then are resumed, and finished ones are complete."""
    assert study(read_config(FIRST / "shipped" / f"{name}.yaml")).digest == SHIPPED[name]["digest"]


@pytest.mark.parametrize("name", SHIPPED)
def test_a_shipped_configuration_gives_equal_numbers(name: str, tmp_path: Path) -> None:
    found = study(read_config(FIRST / "shipped" / f"{name}.yaml", SHORT))
    execute(found, tmp_path / "out", executor=executors.get("serial")(1))
    with open_results(tmp_path / "out") as results:
        for metric in ("mean_pose_error", "effort", "energy_residual"):
            then = np.array(SHIPPED[name][metric], dtype=float)
            np.testing.assert_allclose(results[metric].ravel(), then, **ROUNDING, err_msg=metric)


@pytest.mark.parametrize("name", ["single", "parts", "sweep", "ragged", "thinned", "failed"])
def test_a_configuration_gives_its_result_again(name: str, tmp_path: Path) -> None:
    """Every variable of the file, with its unit and its meaning."""
    found = study(read_config(FIRST / "configurations" / f"{name}.yaml"))
    execute(found, tmp_path / "out", executor=executors.get("serial")(1))
    with open_results(FIRST / "results" / name) as then, open_results(tmp_path / "out") as now:
        assert set(then.names) <= set(now.names)
        assert now.attributes["digest"] == then.attributes["digest"]
        for variable in then.names:
            assert now.dims(variable) == then.dims(variable)
            assert now.units(variable) == then.units(variable)
            values = then[variable]
            if values.dtype.kind == "f":
                within = TOLERANCE if variable in REFERENCE else ROUNDING
                np.testing.assert_allclose(now[variable], values, **within, err_msg=variable)
            else:
                np.testing.assert_array_equal(now[variable], values, err_msg=variable)


def test_a_digest_with_plugins_is_the_same(plugins) -> None:
    plugins()
    for name in ("all_kinds", "heisenberg"):
        kept = json.loads(Path(f"results/{name}/manifest.json").read_text())["digest"]
        assert study(read_config(Path(f"{name}.yaml"))).digest == kept
