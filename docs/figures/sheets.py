"""Sheets of all figures, to look at: in colour, in grey, and as two colour-blind readers see them.

    python docs/figures/sheets.py build/sheets                 every figure, of small experiments
    python docs/figures/sheets.py build/sheets paper fronts    those whose names begin so

A sheet shows every figure in one width, 3.5 in or a slide, as one reader sees it. Experiments are
kept in the folder and used again. To see an earlier commit, run this file with PYTHONPATH=CHECKOUT.
"""

import shlex
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image, ImageDraw

import eqt_cli
from eqt_cli.base.errors import EqtError

CONFIGS = Path(__file__).parents[2] / "configs"

# Machado, Oliveira and Fernandes (2009), doi:10.1109/TVCG.2009.113, severity 1, on linear RGB.
READERS: Mapping[str, Any] = {
    "colour": np.eye(3),
    "grey": np.tile([0.2126, 0.7152, 0.0722], (3, 1)),
    "deuteranopia": [
        [0.367322, 0.860646, -0.227968],
        [0.280085, 0.672501, 0.047413],
        [-0.011820, 0.042940, 0.968881],
    ],
    "protanopia": [
        [0.152286, 1.052583, -0.204868],
        [0.114503, 0.786281, 0.099216],
        [-0.003882, -0.048116, 1.051998],
    ],
}

PIXELS, ACROSS = {"column": 460, "slide": 640}, {"column": 7, "slide": 5}
"""Across a figure on its sheet, and figures in a row, by their width."""
GAP, NAME = 14, 16
"""Pixels between figures, and for the name above each."""

_FAST = "--set solver.error_estimate=false --set solver.cross_check=0 --engine native"
_FEW = "--set tune.confirm.runs=20"
_FRONTS = "--set tune.objective=null --set tune.objectives=[effort,mean_pose_error]"

EXPERIMENTS = {
    "paper": f"run paper --set ensemble.runs=60 {_FAST}",
    "damped": f"run paper --set ensemble.runs=60 --set gains.kd=1 --set name=damped {_FAST}",
    "laws": f"run reviewers --set ensemble.runs=20 {_FAST}",
    "so2": f"run so2 --set ensemble.runs=8 {_FAST}",
    "se2": f"run se2_vehicle --set ensemble.runs=8 {_FAST}",
    "se3": f"run se3 --set ensemble.runs=12 {_FAST}",
    "se23": f"run se23 --set ensemble.runs=8 {_FAST}",
    "lee": f"run quadrotor_lee {_FAST}",
    "wheels": f"run satellite_wheels --set ensemble.runs=2 {_FAST}",
    "thrusters": f"run se3_bluerov2_thrusters --set ensemble.runs=2 {_FAST}",
    "estimated": f"run satellite_estimated --set ensemble.runs=8 {_FAST}",
    "lag": f"sweep sweep_lag --set ensemble.runs=30 {_FAST}",
    "region": f"sweep sweep_region --set ensemble.runs=16 {_FAST}",
    "gains": f"sweep sweep_gains --set ensemble.runs=20 {_FAST}",
    "family": f"sweep sweep_family --set ensemble.runs=20 {_FAST}",
    "flies": f"sweep sweep_flies --set ensemble.runs=16 {_FAST}",
    "scenarios": f"sweep sweep_lag --set ensemble.runs=16 {_FAST} "
    "--set 'sweep=[{grid: {reference: [{torque: [cos(t), sin(t), 0]}, {torque: [0, 0, 0.1]}, "
    "{torque: [cos(2*t), 0, 0.2*sin(t)]}], "
    '"actuators[0].time_constant": [0.02, 0.1]}}]\'',
    "fronts": f"tune tune_paper {_FEW} {_FRONTS} --set tune.equal={{}} --set tune.budget=48 "
    f"--set tune.population=12 {_FAST}",
    "tuned": f"tune tune_paper {_FEW} --set tune.samples=1 {_FAST}",
    "worst": "worst satellite_breaks --set ensemble.runs=3 --set worst.budget=3 "
    f"--set worst.population=8 --set worst.seeds=1 {_FAST}",
}
"""Experiments as small as they may be: a command, a shipped configuration, and options."""

FIGURES: Mapping[str, tuple[str, str, Mapping[str, Any]]] = {
    "paper": ("paper", "paper", {}),
    "paper, SE(3)": ("se3", "paper", {}),
    "summary": ("paper", "summary", {}),
    "summary, log": ("paper", "summary", {"log": True}),
    "summary, SE(3)": ("se3", "summary", {"log": True}),
    "summary, SE2(3)": ("se23", "summary", {"log": True}),
    "summary, 13 laws": ("laws", "summary", {}),
    "summary, two results": ("paper damped", "summary", {}),
    "summary, a law diverges": ("lee", "summary", {}),
    "path": ("lee", "path", {"bodies": 6}),
    "path, space": ("lee", "path", {"view": "space", "bodies": 6}),
    "path, SE(2)": ("se2", "path", {"bodies": 6}),
    "path, many runs": ("se2", "path", {"runs": 8}),
    "path, SE(3)": ("se3", "path", {"runs": 3}),
    "path, sphere": ("paper", "path", {"view": "sphere"}),
    "path, AUV": ("thrusters", "path", {}),
    "path, 13 laws": ("laws", "path", {"view": "sphere"}),
    "pose": ("lee", "pose", {}),
    "pose, AUV": ("thrusters", "pose", {}),
    "pose, SE(2)": ("se2", "pose", {}),
    "pose, SO(3)": ("paper", "pose", {}),
    "pose, SE2(3)": ("se23", "pose", {}),
    "torque": ("paper", "torque", {}),
    "torque, SE(3)": ("se3", "torque", {}),
    "torque, feedforward": ("paper", "torque", {"share": "feedforward"}),
    "torque, thrust along one axis": ("lee", "torque", {}),
    "runs": ("paper", "runs", {}),
    "runs, 13 laws": ("laws", "runs", {}),
    "distributions": ("paper", "distributions", {}),
    "distributions, 13 laws": ("laws", "distributions", {}),
    "distributions, ecdf": ("paper", "distributions", {"kind": "ecdf"}),
    "distributions, two": ("paper damped", "distributions", {"kind": "ecdf"}),
    "reference": ("paper", "reference", {}),
    "reference, SE(3)": ("se3", "reference", {}),
    "reference, SE2(3)": ("se23", "reference", {"degrees": True}),
    "commands": ("wheels", "commands", {"run": 1}),
    "commands, AUV": ("thrusters", "commands", {}),
    "commands, thrusters": ("thrusters", "commands", {"thrusters": True}),
    "estimate": ("estimated", "estimate", {}),
    "runs, estimated": ("estimated", "runs", {}),
    "sweep, lag": ("lag", "sweep", {}),
    "sweep, gains": ("gains", "sweep", {}),
    "sweep, family": ("family", "sweep", {}),
    "sweep, region": ("region", "sweep", {}),
    "sweep, flies": ("flies", "sweep", {}),
    "sweep, scenarios": ("scenarios", "sweep", {}),
    "settled": ("lag", "settled", {}),
    "settled, two keys": ("region", "settled", {}),
    "winners, lag": ("lag", "winners", {}),
    "winners, gains": ("gains", "winners", {}),
    "winners, region": ("region", "winners", {"metric": "settling_time"}),
    "winners, scenarios": ("scenarios", "winners", {}),
    "pareto": ("gains", "pareto", {}),
    "pareto, flies": ("flies", "pareto", {}),
    "forest": ("flies", "forest", {}),
    "fronts": ("fronts", "fronts", {}),
    "summary, tuned": ("tuned", "summary", {}),
    "distributions, tuned": ("tuned", "distributions", {"kind": "ecdf"}),
    "worst": ("worst", "worst", {}),
}
"""By what stands above it: the experiments, the figure and its options."""


def result(folder: Path, name: str) -> Path:
    """The folder of an experiment, which is computed unless it is there."""
    out = folder / "results" / name
    if not (out / "results.h5").is_file():
        command, config, *options = shlex.split(EXPERIMENTS[name])
        called = [sys.executable, "-m", "eqt_cli", command, str(CONFIGS / f"{config}.yaml")]
        subprocess.run([*called, *options, "--out", str(out), "--force", "--quiet"], check=True)
    return out


def drawn(folder: Path, name: str, width: str) -> Image.Image:
    """A figure as its file shows it; what eqt says where it has none."""
    experiments, figure, options = FIGURES[name]
    results = [result(folder, each) for each in experiments.split()]
    out = folder / "figures" / width / name.replace(", ", "-").replace(" ", "_")
    try:
        file, *_ = eqt_cli.plot(results, {figure: options}, out, formats=["png"], width=width)
    except EqtError as error:
        said = Image.new("RGB", (PIXELS[width], 60), "white")
        ImageDraw.Draw(said).multiline_text((4, 4), _wrapped(str(error), PIXELS[width]), "red")
        return said
    picture = Image.open(file).convert("RGB")
    size = PIXELS[width], round(picture.height * PIXELS[width] / picture.width)
    return picture.resize(size, Image.Resampling.LANCZOS)


def _wrapped(text: str, pixels: int) -> str:
    count = pixels // 7
    return "\n".join(text[k : k + count] for k in range(0, len(text), count))


def sheet(pictures: Mapping[str, Image.Image], pixels: int, across: int) -> Image.Image:
    """All pictures with their names, each in the column that is shortest so far."""
    ends = [GAP] * across
    places = {}
    for name, picture in pictures.items():
        column = ends.index(min(ends))
        places[name] = GAP + column * (pixels + GAP), ends[column]
        ends[column] += NAME + picture.height + GAP
    found = Image.new("RGB", (across * (pixels + GAP) + GAP, max(ends)), "#dddddd")
    write = ImageDraw.Draw(found)
    for name, (left, top) in places.items():
        write.text((left, top), name, "black")
        found.paste(pictures[name], (left, top + NAME))
    return found


def seen(picture: Image.Image, reader: str) -> Image.Image:
    """A picture as a reader sees it."""
    channels = np.asarray(picture, dtype=float) / 255
    linear = np.where(channels <= 0.04045, channels / 12.92, ((channels + 0.055) / 1.055) ** 2.4)
    light = np.clip(linear @ np.asarray(READERS[reader]).T, 0, 1)
    back = np.where(light <= 0.0031308, 12.92 * light, 1.055 * light ** (1 / 2.4) - 0.055)
    return Image.fromarray((255 * back).round().astype(np.uint8))


def main(folder: Path, starts: tuple[str, ...]) -> None:
    """Write ``<folder>/<width>-<reader>.png``."""
    names = [name for name in FIGURES if not starts or name.startswith(starts)]
    for width in PIXELS:
        pictures = {name: drawn(folder, name, width) for name in names}
        found = sheet(pictures, PIXELS[width], ACROSS[width])
        for reader in READERS:
            file = folder / f"{width}-{reader}.png"
            seen(found, reader).save(file, optimize=True)
            print(file)


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    main(Path(sys.argv[1]), tuple(sys.argv[2:]))
