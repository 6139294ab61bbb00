"""Draws docs/figures/provable.png: each law with the gains whose proof is best.

python docs/figures/provable.py    takes about ten minutes
"""

from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import matplotlib.pyplot as plt
import numpy as np
import yaml

import eqt_cli
from eqt_cli.figures.style import CurvePlace, distinct, house_style, line_style

HERE = Path(__file__).parent
LAWS = {
    "lee2010": "Lee 2010",
    "asym": "asym",
    "logarithmic": "logarithmic",
    "gt": "GT",
    "bullo_murray": "Bullo–Murray",
    "eqt": "EqT",
    "lee2012": "Lee 2012",
    "nog": "nog",
}
BOUNDS = (0.1, 0.25, 0.6, 1.2, 2.0)
WEIGHTS = {"g": (0.0, 0.5, 1.0, 1.5, 2.0), "n": (0.0, 0.25, 0.5, 0.75, 1.0)}


def best(controllers: list[Any], v: float) -> dict[str, float]:
    """The best proved rate of each law at a bound of the velocity, NaN without one."""
    config = yaml.safe_load((HERE.parents[1] / "configs/tune_proved.yaml").read_text("utf-8"))
    over = {key: axis for key, axis in config["tune"]["over"].items() if key.startswith("gains")}
    short = {"ensemble": {"runs": 1}, "time": {"duration": 1.0, "samples": 11}}
    tune = {"over": over, "proof": {"velocity": v}, "confirm": {"runs": 1}}
    changed = config | short | {"controllers": controllers, "tune": config["tune"] | tune}
    with TemporaryDirectory() as folder:
        laws = eqt_cli.tune(changed, Path(folder) / "tuned").record["laws"]
    return {
        x["label"]: max((w["objectives"][0] for w in x["winners"]), default=np.nan) for x in laws
    }


def drawn(rates: dict[str, list[float]], plane: Any) -> None:
    """Draw the rates over the bounds, and those of the weights (g, 1 − n, n), ``(g, n)``."""
    with house_style():
        drawing, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3.2), layout="constrained")
        for look, (label, title) in zip(
            distinct([CurvePlace(k) for k in range(len(LAWS))]), LAWS.items(), strict=True
        ):
            left.plot(BOUNDS, rates[label], label=title, marker=".", **line_style(look))
        left.set(
            xlabel="bound v of each $|\\omega_{d,i}|$ (rad/s)",
            ylabel="best proved rate (1/s)",
            ylim=(0, None),
        )
        left.legend(fontsize="small")
        shown = right.pcolormesh(
            WEIGHTS["n"], WEIGHTS["g"], plane, shading="nearest", cmap="viridis"
        )
        right.set(xlabel="weight n, with c = 1 − n", ylabel="weight g")
        right.set(xticks=WEIGHTS["n"], yticks=WEIGHTS["g"])
        for n, g, name in ((0, 1, "EqT"), (0.5, 0.5, "GT"), (0, 0, "nog"), (0.5, 1, "asym")):
            ink = "black" if name == "asym" else "white"  # on the brightest cell
            right.annotate(name, (n, g), ha="center", va="center", color=ink)
        drawing.colorbar(shown, label="best proved rate (1/s)")
        drawing.savefig(HERE / "provable.png", dpi=190)


if __name__ == "__main__":
    columns = [best([*LAWS], v) for v in BOUNDS]
    pairs = [[(g, n) for n in WEIGHTS["n"]] for g in WEIGHTS["g"]]
    families = [
        [{"kind": "family", "gyroscopic": g, "transport": 1 - n, "connection": n} for g, n in row]
        for row in pairs
    ]
    cells = [[best([law], 1.2)["family"] for law in row] for row in families]
    drawn({label: [column[label] for column in columns] for label in LAWS}, cells)
