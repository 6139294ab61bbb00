"""Plugins of the first version, with the imports that they had."""

from __future__ import annotations

import subprocess
import sys
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

from eqt_cli.config.source import read_config
from eqt_cli.core.errors import EqtError
from eqt_cli.core.old_paths import MOVED, RENAMED, find_moved
from eqt_cli.execution.executors import executors
from eqt_cli.execution.run_study import execute
from eqt_cli.experiment.read_study import study
from eqt_cli.store.reader import open_results

PLUGINS = Path(__file__).parent / "first_version" / "plugins"
DEFINE = {
    "certificates": [
        "certificate 'the error ends small'",
        "certificate 'the g-term has no power'",
        "certificate 'the reference moves'",
    ],
    "claims": ["claim set 'nobody1999'"],
    "controller": ["controller 'damped'", "controller 'halfway'", "controller 'limited'"],
    "designs": ["design 'diagonal'", "design 'star'"],
    "engines": ["engine 'rk4_fixed'"],
    "executors": ["executor 'backwards'"],
    "figures": ["figure 'decay'", "figure 'margins'", "figure 'medians'", "figure 'scatter'"],
    "group": ["group 'H3'", "group 'Turning'"],
    "poses": ["pose distribution 'shell'", "pose distribution 'tilted'"],
    "reference": ["reference 'swinging'"],
    "velocities": ["velocity distribution 'box'"],
}
LOAD = """\
import sys
from pathlib import Path
from eqt_cli.core.registry import load_plugin
print(*sorted(load_plugin(Path(sys.argv[1]))), sep="\\n")
"""


@pytest.mark.parametrize("name", DEFINE)
def test_a_plugin_is_all_that_a_process_needs_to_load(name: str) -> None:
    """Nothing else is imported before, so the base class alone must bring its registry."""
    command = [sys.executable, "-W", "error", "-c", LOAD, str(PLUGINS / f"{name}.py")]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    assert done.stderr == ""
    assert done.stdout.splitlines() == DEFINE[name]


def test_they_give_equal_numbers(here, plugins, unlike) -> None:
    plugins()
    done = execute(
        study(read_config(Path("all_kinds.yaml"))),
        Path("again"),
        executor=executors.get("backwards")(1),
    )
    assert done.failed == 0
    with open_results(Path("results/all_kinds")) as then, open_results(Path("again")) as now:
        for name in then.names:
            if then[name].dtype.kind in "fi":
                # Fixed steps: rounding is all that may differ on another machine.
                np.testing.assert_allclose(
                    now[name], then[name], rtol=1e-9, atol=1e-9, err_msg=name
                )


def test_what_is_wrong_with_their_options_is_said_at_its_place(here, plugins) -> None:
    plugins()
    wrong = {
        "frequencies: [1.0, 2.0, pi/2]": "frequencies: [1.0]",
        'amplitude: "1 + 0.2*cos(t)"': 'amplitude: "1 +"',
        "weight: 0.25": "wieght: 0.25",
        "angle: 0.8": "angle: -1",
        "rtol: 1.0e-6": "rtol: 2.0",
    }
    text = Path("all_kinds.yaml").read_text()
    for right, value in wrong.items():
        assert right in text
        text = text.replace(right, value)
    Path("all_kinds.yaml").write_text(text)
    with pytest.raises(EqtError) as caught:
        study(read_config(Path("all_kinds.yaml")))
    said = [line.split(": ", 1)[1] for line in str(caught.value).splitlines()]
    assert [line.partition(":")[0] for line in said] == [
        "reference.frequencies",
        "reference.amplitude",
        "controllers[4].wieght",
        "initial.pose.angle",
        "solver.rtol",
    ]
    assert said[0] == "reference.frequencies: expected 3 for Turning, got 1"
    assert said[4] == "solver.rtol: expected less than 1, got 2"


def test_an_engine_of_a_plugin_is_not_the_second_opinion(here, plugins) -> None:
    """Its name comes before those of eqt's own, of which one checks the other."""
    plugins("engines")
    source = read_config(Path("configurations/single.yaml"))
    other = study(source).base.solver.other
    assert other is None or other.name == "taylor"


# Names of then -----------------------------------------------------------------------------------


def test_what_has_moved_is_found_where_it_is_today() -> None:
    find_moved()
    for old, new in MOVED.items():
        today = [import_module(place) for place in new.split()]
        found = import_module(old)
        assert len(today) > 1 or found is today[0], old


def test_names_that_have_moved_are_found() -> None:
    find_moved()
    for module, names in RENAMED.items():
        for name in names:
            assert getattr(import_module(module), name) is not None


def test_a_moved_package_is_not_loaded_a_second_time() -> None:
    find_moved()
    old = import_module("eqt_cli.ensemble.executors.base")
    assert old is import_module("eqt_cli.execution.executors.base")
    assert old.__name__ == old.__spec__.name == "eqt_cli.execution.executors.base"


def test_what_never_was_is_not_found() -> None:
    find_moved()
    with pytest.raises(ModuleNotFoundError, match=r"eqt_cli\.run\.executors\.gone"):
        import_module("eqt_cli.ensemble.executors.gone")
    with pytest.raises(AttributeError, match="has no attribute 'gone'"):
        _ = import_module("eqt_cli.plots").gone
