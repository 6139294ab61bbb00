"""Says what to cite with a result."""

from __future__ import annotations

from pathlib import Path

from eqt_cli.analysis.citations import citations
from eqt_cli.api.paths import ResultPath
from eqt_cli.core.errors import EqtWarning
from eqt_cli.core.reporting import reporter
from eqt_cli.results.result import open_result


def cite(result: ResultPath | None = None) -> str:
    r"""BibTeX entries of the paper, of eqt, and of the publications that the laws are after.

    Parameters
    ----------
    result
        The result folder, or the file in it; without, the paper and eqt only.

    Returns
    -------
    str
        The entries, with an empty line between two of them.

    Raises
    ------
    EqtError
        If there is no such result.

    Examples
    --------
    >>> print(eqt_cli.cite("results/paper").partition("\n")[0])
    @misc{hampsey2025equivariant,
    """
    kinds: list[str] = []
    if result is not None:
        with open_result(Path(result)) as opened:
            kinds = list(opened.kinds.values())
    entries, unknown = citations(kinds)
    if unknown:
        told = f"{', '.join(unknown)}: of a plugin, without an entry here; cite the source yourself"
        reporter().remark(EqtWarning(told))
    return "\n\n".join(entries)
