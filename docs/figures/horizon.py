"""Draws docs/figures/horizon.png: the errors of a predictive law and of laws without a horizon.

python docs/figures/horizon.py    takes a minute
"""

from pathlib import Path
from tempfile import TemporaryDirectory

import matplotlib.pyplot as plt
import numpy as np

import eqt_cli
from eqt_cli.figures.style import CurvePlace, distinct, house_style, line_style

HERE = Path(__file__).parent
TITLES = "EqT", "Lee 2010", "LQR", "MPC"
LIMIT = 1.01
"""A rate above which a run counts, rad/s: 1 % beyond the limit."""

STUDIES = {"tuned": "torque limited", "rates": "rates limited, too"}


def drawn(folder: Path) -> None:
    """Fly both configurations, and draw the median error and the largest rate over time."""
    with house_style():
        drawing, axes = plt.subplots(1, 3, figsize=(7.2, 2.8), layout="constrained")
        looks = distinct([CurvePlace(k) for k in range(len(TITLES))])
        for k, (name, words) in enumerate(STUDIES.items()):
            config = HERE.parents[1] / f"examples/horizon/{name}.yaml"
            result = eqt_cli.run(config, folder / name)
            beyond = np.abs(result["velocity"]).max(axis=-1) > LIMIT
            for row, (look, title) in enumerate(zip(looks, TITLES, strict=True)):
                style = {"label": title, **line_style(look)}
                axes[k].plot(result.times, np.median(result["attitude_angle"][row], 0), **style)
                if k:
                    axes[2].plot(result.times, 100 * beyond[row].mean(axis=0), **style)
            axes[k].set(title=words, xlabel="t (s)", yscale="log", ylabel="median error (deg)")
        axes[2].set(title=words, xlabel="t (s)", ylabel="runs beyond 1 rad/s (%)", ylim=(0, None))
        axes[2].legend(fontsize="small")
        drawing.savefig(HERE / "horizon.png", dpi=170)


if __name__ == "__main__":
    with TemporaryDirectory() as place:
        drawn(Path(place))
