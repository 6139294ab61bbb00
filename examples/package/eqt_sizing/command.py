"""`eqt actuator`: the torque that suffices for most runs."""

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

import eqt_cli


def actuator(
    result: Annotated[Path, typer.Argument(metavar="RESULT", help="Result folder.")],
    share: Annotated[float, typer.Option(min=0, max=1, help="Share of the runs.")] = 0.95,
) -> None:
    """Print the torque that suffices for most runs of each law."""
    with eqt_cli.open_result(result) as opened:
        for label, torque in zip(opened.labels, opened["peak_torque"], strict=True):
            enough = np.nanquantile(torque, share)
            typer.echo(f"{label}: {enough:.2f} N m suffice for {share:.0%} of the runs")
