"""Finds the differences between two results."""

from __future__ import annotations

from eqt_cli.analysis.differences import Differences, differences
from eqt_cli.api.loading import ResultPath, path_from
from eqt_cli.results.result import open_result


def diff(first: ResultPath, second: ResultPath) -> Differences:
    """Compare two results: configuration, provenance, and the numbers bit by bit.

    Parameters
    ----------
    first, second
        The result folders, or the files in them.

    Returns
    -------
    Differences
        The differences; ``equal`` is true if only the provenance differs.

    Raises
    ------
    EqtError
        If a result does not exist or is damaged.

    Examples
    --------
    >>> again = eqt_cli.run(eqt_cli.load_experiment("results/paper/results.h5"), "again")
    >>> eqt_cli.diff("results/paper", again).equal
    True
    """
    with (
        open_result(path_from("first", first)) as one,
        open_result(path_from("second", second)) as other,
    ):
        return differences(one, other)
