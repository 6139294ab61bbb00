"""Options of commands that measure the errors in recordings."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from eqt_cli.cli import options

FORMATS = "csv", "tum", "euroc"
QUANTITIES = "position", "velocity", "attitude", "rates"
ASSOCIATIONS = "linear", "nearest", "held"
ALIGNMENTS = "rigid", "similarity", "yaw", "origin"


@dataclass(frozen=True)
class Errors:
    """Which motions are compared, when and how, and the folder of the outcome."""

    second_mapping: Annotated[Path | None, options.option("--second-mapping")] = None
    second_format: Annotated[str | None, options.option("--second-format", names=FORMATS)] = None
    topic: Annotated[str | None, options.option("--topic")] = None
    setpoint: Annotated[str | None, options.option("--setpoint")] = None
    association: Annotated[str, options.option("--association", names=ASSOCIATIONS)] = "linear"
    align: Annotated[str | None, options.option("--align", names=ALIGNMENTS)] = None
    relative: Annotated[str | None, options.option("--relative")] = None
    begin: Annotated[str | None, options.option("--begin")] = None
    end: Annotated[str | None, options.option("--end")] = None
    disarmed: Annotated[bool, options.option("--disarmed")] = False
    out: options.Out = None
