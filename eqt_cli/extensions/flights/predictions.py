"""Predictions of a model for each flight, in a table, as control variates."""

from collections import defaultdict
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.flights.one_look import LEAST_PAIRS_OF_A_MODEL, permutation_test
from eqt_cli.extensions.logs.flight_list import ListedFlight, rows_of

UNLIKELY = 0.01
"""P-value of a difference of predictions that flights in random order hardly have."""


def predictions_of(
    path: Path, sides: Sequence[Sequence[ListedFlight]], paired: bool
) -> list[Array]:
    """Return the logarithms of what a table predicts for the flights of sides.

    It has a row for each flight, with columns ``file`` (a path from its folder, or a name), or
    ``flight`` as `eqt validate --predictions` writes it, and ``predicted``;
    with a column ``law``, a row for each flight and law, of which those of one law are taken: that
    of B, if it stands for all flights.

    Raises
    ------
    EqtError
        If a flight has no prediction, or predictions are of each flight's own law.
    """
    if paired and len(sides[0]) < LEAST_PAIRS_OF_A_MODEL:
        least = f"{LEAST_PAIRS_OF_A_MODEL} pairs are the least"
        loses = "fewer lose more by fitting its slope than it gives (5 pairs: a third)"
        raise EqtError(f"model: {least}, got {len(sides[0])}; {loses}")
    table: dict[str, dict[Path, float]] = defaultdict(dict)
    of_name = {f"{x.file.name} {x.begin}".strip(): x.file for side in sides for x in side}
    for place, row in rows_of(path, "predicted"):
        number, name = row["predicted"], row.get("file") or row.get("flight", "")
        file = of_name.get(name, path.parent / name).resolve()
        try:
            value = float(number)
        except ValueError:
            value = np.nan
        if not 0 < value < np.inf:
            raise EqtError(f"{place}: predicted: expected an error above 0, got '{number}'")
        of_law = table[row.get("law", "")]
        if of_law.setdefault(file, value) != value:
            raise EqtError(f"{place}: file: '{name}' has two predictions of one law")
    if not table:
        raise EqtError(f"{path}: has no rows; give one for each flight")
    files = [[flight.file.resolve() for flight in side] for side in sides]
    every = {file for side in files for file in side}
    lacking = {law: sorted(f"{x}" for x in every - {*rows}) for law, rows in table.items()}
    base = next((flight.law for flight in sides[-1]), "")
    whole = sorted((law for law, some in lacking.items() if not some), key=lambda law: law != base)
    if not whole:
        law, some = min(lacking.items(), key=lambda pair: len(pair[1]))
        of = f" by law {law}" if law else ""
        raise EqtError(
            f"{path}: no prediction{of} of {some[0]}; expected one of every flight, all by one "
            "law: predictions by each flight's own law contain the difference that is asked for"
        )
    logs = [np.log([table[whole[0]][file] for file in side]) for side in files]
    is_named = bool(whole[0]) or len(sides) != 2
    if not is_named and permutation_test(logs[0], logs[1], paired) <= UNLIKELY:
        ratio = f"{100 * np.expm1(logs[0].mean() - logs[1].mean()):+.0f}".replace("-", "−")
        raise EqtError(
            f"{path}: predictions of A are {ratio} % against those of B, which flights in "
            "random order hardly have; expected the start, wind and setpoints of every flight, "
            "flown by one law, which a column law names"
        )
    return logs
