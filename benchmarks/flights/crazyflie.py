"""Gain settings of one law on a Crazyflie: lists of the flights that have one vehicle and one path.

Exclusions, decided by the setpoints before any error was computed: flights by its setpoints by
more than `JUMP` from one row to the next, within 10 ms, and those with take-off or landing, whose
setpoints change their height by more than `LEVEL`; then groups of fewer than five settings.
"""

import csv
import re
from collections import defaultdict
from pathlib import Path
from typing import Any

import numpy as np
import yaml

import eqt_cli

SOURCE = "https://github.com/IMRCLab/crazyswarm2-tools at 847605ab, MIT"
FEWEST, JUMP, LEVEL = 5, 0.05, 0.1

ALONG = "xyz"


def gains_of(info: dict[str, float]) -> dict[str, str]:
    """Return the columns of a list: gains of the firmware as keys of the model."""

    def three(name: str, scale: float = 1.0, least: float = 0.0) -> list[float]:
        return [max(round(scale * float(info[f"{name}{axis}"]), 12), least) for axis in ALONG]

    stiff = three("KR_")
    # 𝑘 of the trace form: (k₂ + k₃ − k₁)/2 and so on give the stiffness KR about each axis
    half = [round(sum(stiff) / 2 - one, 10) for one in stiff]
    columns = {
        "position.kx": three("Kpos_P"),
        "position.kv": three("Kpos_D"),
        "position.ki": three("Kpos_I"),
        "gains.kp": half,
        "gains.kd": three("Kw_"),
        "attitude.ki": three("KI_", 1e-3, 1e-12),
    }
    return {f"controllers[0].{name}": f"{value}" for name, value in columns.items()}


def is_odd(log: Path) -> bool:
    """Whether the setpoints of a flight jump, or change their height."""
    goal = eqt_cli.log_errors(log, delays=False).goals["position"]
    steps, times = np.linalg.norm(np.diff(goal.numbers, axis=0), axis=1), np.diff(goal.times)
    return bool((steps[times < 0.01] > JUMP).any() or np.ptp(goal.numbers[:, 2]) > LEVEL)


def write_lists(data: Path, folder: Path) -> dict[str, tuple[Path, dict[str, Any]]]:
    """Write a list for each group, and return them with the changes of the model, by name."""
    groups = defaultdict(list)
    for log in sorted((data / "crazyswarm2-tools/logs").glob("log*")):
        number = re.match(r"log(\d+)", log.name)
        assert number
        if is_odd(log):
            print(f"left out: {log.name}, by its setpoints")
            continue
        info = yaml.safe_load((log.parent.parent / f"info/info{number[1]}.yaml").read_text())
        path = f"{info['trajectory']}".removesuffix(".csv")
        group = f"{path} {info['mass']} kg {info['timescale']} {info['motors'].split()[0]}"
        groups[group].append((log, gains_of(info), float(info["mass"])))
    lists = {}
    for group, flights in sorted(groups.items()):
        if len({repr(gains) for _, gains, _ in flights}) < FEWEST:
            continue
        name = "crazyflie-" + re.sub(r"[^\w.]+", "-", group.replace("translation_", ""))
        mass = flights[0][2]
        file = folder / f"{name}.csv"
        with file.open("w", newline="") as stream:
            writer = csv.writer(stream, lineterminator="\n")
            writer.writerow(["file", "law", *flights[0][1]])
            writer.writerows([[log.resolve(), "lee", *gains.values()] for log, gains, _ in flights])
        inertia = [16.571710e-6, 16.655602e-6, 29.261652e-6, mass, mass, mass]
        forces = [{"kind": "restoring", "weight": mass * 9.81}]
        lists[name] = file, {"inertia": inertia, "model": {"forces": forces}}
    return lists
