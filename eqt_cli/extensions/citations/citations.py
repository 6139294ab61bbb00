"""Cites a result as BibTeX: the paper, eqt, and the publications of its laws."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path

from eqt_cli.api.loading import ResultPath
from eqt_cli.base import purposes
from eqt_cli.base.errors import ComponentError, EqtWarning
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.reporting import reporter
from eqt_cli.base.version import __version__
from eqt_cli.components.laws import controllers, published
from eqt_cli.results.result import open_result

PAPER = published("hampsey2025equivariant")

PROGRAM = f"""\
@software{{eqt,
  author  = {{{{The eqt developers}}}},
  title   = {{eqt: experiments with equivariant tracking control on matrix {{Lie}} groups}},
  version = {{{__version__}}}
}}"""
"""Both as in CITATION.cff."""


def citations(kinds: Iterable[str]) -> tuple[list[str], list[str]]:
    """The entries for laws of these kinds, and the kinds that nothing is known of.

    Those are of plugins that are not loaded.
    """
    entries, unknown = [PAPER, PROGRAM], list[str]()
    for kind in dict.fromkeys(kinds):
        try:
            entries.append(controllers.get(kind).bibtex)
        except ComponentError:
            unknown.append(kind)
    return list(dict.fromkeys(filter(None, entries))), unknown


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
    kinds, more = list[str](), list[str]()
    others = [] if result is None else list(functions_for(purposes.citations, Path(result)))
    for cited in others:
        of_folder, entries_of_folder = cited(Path(result or ""))
        kinds, more = [*kinds, *of_folder], [*more, *entries_of_folder]
    if result is not None and not others:
        with open_result(Path(result)) as opened:
            kinds = list(opened.kinds.values())
    entries, unknown = citations(kinds)
    if unknown:
        text = f"{', '.join(unknown)}: of a plugin, without an entry here; cite the source yourself"
        reporter().remark(EqtWarning(text))
    return "\n\n".join([*entries, *more])
