"""Every figure of every shipped configuration, drawn in three widths and searched for flaws.

    python docs/figures/shipped.py build/shipped              all, of small ensembles: an hour
    python docs/figures/shipped.py build/shipped paper so2    those of some configurations

Prints each text that covers another one, leaves the page or is too small, with its figure, and at
last their number; the exit code is 4 if there are any. Keeps a sheet of each configuration, of the
figures of a column.
"""

import subprocess
import sys
from io import BytesIO
from pathlib import Path

import sheets
import yaml
from PIL import Image

sys.path.insert(0, str(Path(__file__).parents[2] / "tests" / "shared"))

from flaws import flaws

from eqt_cli.api.drawing import desired_motion
from eqt_cli.api.loading import experiment_at, open_at
from eqt_cli.base.errors import EqtError
from eqt_cli.figures.figure import figures
from eqt_cli.figures.render import encode
from eqt_cli.figures.style import WIDTHS

PIXELS = 640
"""Pixels across a figure on its sheet."""

FAST = "--set solver.cross_check=0 --set solver.error_estimate=false --engine native".split()
SMALL = {
    "run": ["--set", "ensemble.runs=20"],
    "sweep": ["--set", "ensemble.runs=10", "--set", "store.trajectories=none"],
    "tune": sheets._FEW.split(),
    "worst": "--set ensemble.runs=3 --set worst.budget=3 --set worst.population=8 "
    "--set worst.seeds=1".split(),
}
"""Options of a command by which its result is small."""

OPTIONS = {
    "commands": [{}, {"thrusters": True}, {"wheels": True}],
    "torque": [{}, {"share": "feedforward"}, {"signed": True}],
    "distributions": [{}, {"kind": "ecdf"}],
    "rates": [{"bounds": 3}],  # each takes a proof for every law
}
"""Options of figures with several pictures."""


def result(folder: Path, name: str) -> Path | None:
    """Return the result of a configuration, computed unless it is there; None if it cannot be."""
    path, out = sheets.CONFIGS / f"{name}.yaml", folder / "results" / name
    keys = yaml.safe_load(path.read_text(encoding="utf-8"))
    task = next((key for key in ("tune", "worst", "sweep") if key in keys), "run")
    if not (out / "results.h5").is_file():
        called = [sys.executable, "-m", "eqt_cli", task, str(path), *SMALL[task], *FAST]
        done = subprocess.run([*called, "--out", str(out), "--force", "--quiet"], check=False)
        if done.returncode not in (0, 4):  # 4: some runs failed, which figures show as well
            print(f"{name}: no result, exit code {done.returncode}")
            return None
    return out


def search(folder: Path, name: str) -> int:
    """Draw all figures of a configuration; return the number of flaws."""
    path, found = result(folder, name), 0
    if path is None:
        return 1
    pictures: dict[str, Image.Image] = {}
    with open_at(path) as opened:
        point = 0 if opened.is_sweep else None
        motion = desired_motion(experiment_at(sheets.CONFIGS / f"{name}.yaml", point))
        for figure in figures.names():
            kind = figures.get(figure)
            for options, width in ((o, w) for o in OPTIONS.get(figure, [{}]) for w in WIDTHS):
                said = f"{figure} {' '.join(f'{k}={v}' for k, v in options.items())}".strip()
                captions: list[str] | None = None if width == "slide" else []
                shown = opened if kind.needs_runs else motion
                try:
                    drawing = kind(**options).draw([shown], width, captions=captions)
                except EqtError:
                    continue  # this result has no such figure
                for flaw in flaws(drawing, width):
                    print(f"{name}, {said}, {width}: {flaw}", flush=True)
                    found += 1
                if width == "column":
                    picture = Image.open(BytesIO(encode(drawing, "png"))).convert("RGB")
                    size = PIXELS, round(picture.height * PIXELS / picture.width)
                    pictures[said] = picture.resize(size, Image.Resampling.LANCZOS)
    sheets.sheet(pictures, PIXELS, min(4, len(pictures))).save(folder / f"{name}.png")
    return found


if __name__ == "__main__":
    if len(sys.argv) < 2:
        raise SystemExit(__doc__)
    names = sys.argv[2:] or sorted(path.stem for path in sheets.CONFIGS.glob("*.yaml"))
    count = sum(search(Path(sys.argv[1]), name) for name in names)
    print(f"{count} flaws in the figures of {len(names)} configurations")
    sys.exit(4 if count else 0)
