"""Says what differs between two results."""

from __future__ import annotations

from eqt_cli.analysis.differences import Differences, differences
from eqt_cli.api.paths import ResultPath, path_from
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
        What differs; `equal` where nothing does but the provenance.

    Raises
    ------
    EqtError
        If there is no such result, or one is damaged.

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
