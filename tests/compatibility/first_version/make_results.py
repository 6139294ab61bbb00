"""Writes the results of the first version that are kept here; it runs with that version only.

The first version is the package as of commit 18a8291. In a checkout of it:
``PYTHONPATH=$PWD python …/first_version/make_results.py``.
"""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import numpy as np
import yaml

from eqt_cli.core.registry import load_plugin
from eqt_cli.ensemble.executors.serial import Serial
from eqt_cli.experiment.execute import Shard, execute
from eqt_cli.experiment.source import read_config
from eqt_cli.experiment.sweeping import study
from eqt_cli.plots.render import render
from eqt_cli.store.reader import open_results

HERE = Path(__file__).parent
RESULTS = HERE / "results"

BASE = {
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "0"]},
    "controllers": ["eqt", "gt", "nog", "asym"],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 6, "seed": 1},
    "time": {"duration": 8.0, "samples": 17},
    "solver": {"rtol": 1e-7, "cross_check": 1},
}
SWEPT = BASE | {"controllers": ["eqt", "gt"], "ensemble": {"runs": 3, "seed": 1}}
KINDS = {
    "single": BASE,
    "parts": BASE
    | {
        "group": "SE3",
        "inertia": [0.2, 0.3, 0.4, 2.0, 2.0, 2.0],
        "gains": {"kp": [1.0, 2.0, 3.0, 0.5], "kd": 1.0},
        "reference": {"torque": ["cos(t)", "sin(t)", 0, 1, "cos(t)", 0], "velocity": [0.1] * 6},
        "controllers": ["eqt", {"kind": "family", "label": "half", "transport": 0.5}],
        "initial": {"pose": {"kind": "haar", "position": {"std": 1.0}}, "velocity": "normal"},
        "ensemble": {"runs": 3, "seed": 4},
        "time": {"duration": 4.0, "samples": 9},
    },
    "sweep": SWEPT | {"sweep": [{"grid": {"gains.kp": [1, 2], "gains.kd": [0.5, 1]}}]},
    "ragged": SWEPT
    | {
        "inertia": 2.0,
        "time": {"duration": 2.0, "samples": 5},
        "initial": {"pose": {"kind": "exp_normal", "std": 0.5}, "velocity": "normal"},
        "sweep": [
            {
                "zip": {
                    "group": ["SO3", "SE2"],
                    "reference.torque": [["cos(t)", "sin(t)", "0"], ["cos(t)", "0", "1"]],
                }
            },
        ],
    },
    "thinned": BASE | {"store": {"trajectories": 2, "decimate": 4}},
    "failed": BASE
    | {
        "controllers": ["eqt", "gt"],
        "solver": {"rtol": 1e-7, "cross_check": 0, "block": 1, "max_steps": 480},
    },
    "unfinished": SWEPT
    | {
        "ensemble": {"runs": 120, "seed": 1},
        "time": {"duration": 2.0, "samples": 3},
        "solver": {"rtol": 1e-5, "cross_check": 0},
        "store": {"trajectories": 1},
    },
    "unfinished_sweep": SWEPT
    | {
        "ensemble": {"runs": 60, "seed": 1},
        "time": {"duration": 2.0, "samples": 3},
        "solver": {"rtol": 1e-5, "cross_check": 0},
        "store": {"trajectories": "none"},
        "sweep": [{"grid": {"gains.kp": [1, 2], "gains.kd": [0.5, 1]}}],
    },
}
SHORT = ("ensemble.runs=2", "time.duration=2", "time.samples=3", "solver.cross_check=0")


DOCUMENTS = {
    "show": ["single", "parts", "sweep", "ragged", "thinned", "failed", "unfinished", "all_kinds"],
    "compare": ["single", "parts", "thinned", "failed", "all_kinds"],
    "verify": ["single", "parts", "thinned", "failed", "all_kinds"],
}
FIGURES = {
    "single": ["paper", "runs", "distributions", "phase", "sphere", "torque", "decay", "medians"],
    "parts": ["paper", "phase"],
    "sweep": ["sweep", "pareto", "scatter"],
    "ragged": ["pareto"],
    "thinned": ["paper", "distributions"],
    "failed": ["paper", "distributions"],
    "all_kinds": ["paper", "decay", "medians"],
    "heisenberg": ["scatter"],
}


def keep_documents() -> None:
    """What the commands say of the results with --json."""
    for command, names in DOCUMENTS.items():
        for name in names:
            trust = ["--trust-plugins"] if (command, name) == ("verify", "all_kinds") else []
            line = [sys.executable, "-m", "eqt_cli", command, f"results/{name}", "--json", *trust]
            said = subprocess.run(line, cwd=HERE, capture_output=True, text=True, check=False)
            (HERE / "documents").mkdir(exist_ok=True)
            (HERE / "documents" / f"{command}_{name}.json").write_text(said.stdout)
            print(command, name, said.returncode, len(said.stdout), said.stderr[:200])


def keep_figures() -> None:
    """The numbers behind figures."""
    for name, figures in FIGURES.items():
        with open_results(RESULTS / name) as results:
            for figure in figures:
                render([results], figure, HERE / "figures" / name, formats=["json"])


def write(config: Path, name: str) -> None:
    """Run a configuration; of one that is to be unfinished, a share only."""
    shard = Shard(1, 2) if name.startswith("unfinished") else None
    outcome = execute(study(read_config(config)), RESULTS / name, executor=Serial(1), shard=shard)
    print(name, outcome.runs, outcome.failed, "packed" if outcome.packed else "unfinished")


def main() -> None:
    """All of them, and the numbers of the shipped configurations."""
    shutil.rmtree(RESULTS, ignore_errors=True)
    configs = HERE / "configurations"
    configs.mkdir(exist_ok=True)
    for name, config in KINDS.items():
        path = configs / f"{name}.yaml"
        path.write_text(yaml.safe_dump({"name": name} | config, sort_keys=False))
        write(path, name)
    for plugin in sorted((HERE / "plugins").glob("*.py")):
        load_plugin(plugin)
    for name in ("all_kinds", "heisenberg"):
        write(HERE / f"{name}.yaml", name)
    keep_documents()
    keep_figures()
    shipped = {}
    for path in sorted((HERE / "shipped").glob("*.yaml")):
        found = {"digest": study(read_config(path)).digest}
        execute(study(read_config(path, SHORT)), RESULTS / "tmp", executor=Serial(1), force=True)
        with open_results(RESULTS / "tmp") as results:
            for metric in ("mean_pose_error", "effort", "energy_residual"):
                values = results[metric]
                found[metric] = np.where(np.isnan(values), None, values).ravel().tolist()
        shipped[path.stem] = found
    shutil.rmtree(RESULTS / "tmp")
    (HERE / "shipped.json").write_text(json.dumps(shipped, indent=1) + "\n")


if __name__ == "__main__":
    main()
