"""The paper's experiment as `results` holds it: its figure, and a row for each law with the digest.

python docs/figures/printed.py draw|check RESULT    from the result folder of configs/paper.yaml

`make paper` draws, and `make figures-check` compares.
"""

import csv
import json
import subprocess
import sys
from io import StringIO
from pathlib import Path

import numpy as np
from PIL import Image

PLACE = Path(__file__).parents[2] / "results"

COLUMNS = {
    "mean_attitude_error": "mean attitude error, deg",
    "final_attitude_error": "final attitude error, deg",
    "early_torque": "mean torque of the first 5 s, N m",
    "mean_pose_error": "mean |I - Q_E|",
}
DIGITS = 6
TOLERANCE = 1e-5
"""Relative, of a number in a row: ten units of its last digit.

The runs are integrated to 7e-9; what differs between processors is smaller.
"""

MOST_LEVELS = 0.1
"""Mean difference of two pictures, of 255 levels: numbers of a scale in another font make 0.2."""


def summary(result: Path) -> str:
    """Return the rows as CSV, below a line with the digest of the configuration."""
    show = [sys.executable, "-m", "eqt_cli", "show", str(result), "--json"]
    shown = json.loads(subprocess.run(show, check=True, capture_output=True, text=True).stdout)
    text = StringIO()
    rows = csv.writer(text, lineterminator="\n")
    rows.writerow(["law", "settled", "runs", *COLUMNS.values()])
    for law in shown["controllers"]:
        numbers = [f"{law[name]:.{DIGITS}g}" for name in COLUMNS]
        rows.writerow([law["controller"], law["settled"], law["runs"], *numbers])
    return f"# digest {shown['digest']}\n{text.getvalue()}"


def picture(result: Path) -> Image.Image:
    """Return the figure as printed, at most 1400 pixels wide."""
    image = Image.open(result / "figures" / "paper.png").convert("RGB")
    image.thumbnail((1400, image.height), Image.Resampling.LANCZOS)
    return image


def rows_differ(found: str, kept: str) -> bool:
    """Whether the digest, a name or a count differs, or a number by more than the tolerance."""
    pairs = [text.replace("\n", ",").split(",") for text in (found, kept)]
    return len(pairs[0]) != len(pairs[1]) or any(
        new != old and not _close(new, old) for new, old in zip(*pairs, strict=True)
    )


def _close(new: str, old: str) -> bool:
    try:
        return abs(float(new) - float(old)) <= TOLERANCE * abs(float(old))
    except ValueError:  # a name
        return False


def pictures_differ(found: Image.Image, kept: Image.Image) -> bool:
    """Whether the sizes or the pixels differ visibly."""
    if found.size != kept.size:
        return True
    new, old = (np.asarray(image, dtype=float) for image in (found, kept))
    return float(np.abs(new - old).mean()) > MOST_LEVELS


def main(task: str, result: Path) -> int:
    """Write the files that say something else, so that others stay, or return 4 if one does."""
    rows, image = PLACE / "paper.csv", PLACE / "paper.png"
    differing = {
        rows: rows_differ(summary(result), rows.read_text(encoding="utf-8")),
        image: pictures_differ(picture(result), Image.open(image).convert("RGB")),
    }
    if task == "draw":
        if differing[rows]:
            rows.write_text(summary(result), encoding="utf-8")
        if differing[image]:
            picture(result).save(image, optimize=True)
        return 0
    for path in (path for path, differs in differing.items() if differs):
        print(f"results/{path.name}: differs from what {result} holds; `make paper` writes it anew")
    return 4 if any(differing.values()) else 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1], Path(sys.argv[2])))
