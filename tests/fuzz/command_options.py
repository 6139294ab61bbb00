"""Commands with options of any value, by seed."""

from __future__ import annotations

import random
from functools import cache
from pathlib import Path
from typing import Any

import typer.main

from eqt_cli.cli.app import app

NUMBERS = """nan inf -inf -1 0 1 2 3 0.5 1e17 1e-300 1e300 -0.0 99999999999
1000000000000000000000000000000 x 1.5 1_000 0x10 pi""".split()
TEXTS = ["", " ", *"eqt gt x = a=b - .. / \x00".split(" "), "é" * 300, "a/b", "1,2", "1:2"]
KEYS = """control.delay control.period sensors.velocity ensemble.seed ensemble.runs time.samples
time.duration solver.cross_check solver.max_steps solver.block solver.rtol solver.max_error
store.decimate store.trajectories controllers[0].pieces tune.budget tune.samples
tune.confirm.runs worst.budget worst.seeds worst.population worst.profile.points gains.kp
settling_threshold name""".split()
CONFIG = """group: SO3
inertia: [1.0, 2.0, 2.5]
gains: {kp: 2, kd: 2}
reference: {torque: ["0.1*cos(t)", 0, 0]}
controllers: [{kind: lqr, label: eqt, pieces: 5}, gt]
initial: {pose: {kind: exp_normal, std: 0.6}}
control: {period: 0.1}
ensemble: {runs: 2, seed: 1}
time: {duration: 1, samples: 5}
tune: {over: {gains.kp: [1, 3]}, budget: 5, samples: 1}
worst: {objective: final_pose_error, over: {gains.kp: [1, 3]}, budget: 1, seeds: 1}
"""
SLOW = {"run", "sweep", "tune", "worst", "bench"}
UNTRIED = {"new", "archive", "repeat"}
"""Commands that ask, replace a file of the installed eqt, or compute for minutes."""
LEFT_OUT = {"--help", "--executor", "--workers", "--out"}
"""Options that start processes or write outside the folder."""


@cache
def commands() -> list[tuple[list[str], Any]]:
    """Every command with its words."""

    def below(words: list[str], command: Any) -> Any:
        for name, each in getattr(command, "commands", {}).items():
            yield from below([*words, name], each)
        if not hasattr(command, "commands") and words[-1] not in UNTRIED:
            yield words, command

    return list(below([], typer.main.get_command(app)))


def command(seed: int, bases: list[Path]) -> list[str]:
    """Write a configuration, and return a command."""
    random_ = random.Random(seed)
    Path("case.yaml").write_text(CONFIG, "utf-8")
    words, chosen = random_.choice(commands())
    takes = [each for each in chosen.params if each.param_type_name == "argument"]
    options = [each for each in chosen.params if each.opts[0].startswith("--")]
    result = str(random_.choice(bases))
    paths = ["case.yaml", "case.yaml", result, result, "none.yaml", ".", *TEXTS[:3]]
    found = [*words]
    for _ in takes[: random_.choice((1, 1, 1, 2))]:
        found.append(random_.choice(paths))
    free = [each for each in options if each.opts[0] not in LEFT_OUT]
    for each in random_.sample(free, min(len(free), random_.choice((0, 1, 1, 2)))):
        found.append(each.opts[0])
        if not each.is_flag:
            kinds = NUMBERS if each.bare_type in (float, int) else [*TEXTS, *NUMBERS[:4]]
            found.append(random_.choice(kinds))
    has_set = any(each.opts[0] == "--set" for each in options)
    if has_set and random_.random() < 0.7:
        found += ["--set", f"{random_.choice(KEYS)}={random_.choice(NUMBERS)}"]
    if words[0] in SLOW and any(each.opts[0] == "--dry-run" for each in options):
        found.append("--dry-run")
    return found
