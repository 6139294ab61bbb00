"""Citations of a result as BibTeX: the paper, eqt, and the publications of its laws."""

from collections.abc import Iterable

from eqt_cli.controllers import controllers
from eqt_cli.core.errors import ComponentError
from eqt_cli.core.version import __version__

PAPER = """\
@misc{hampsey2025equivariant,
  author = {Hampsey, Matthew and van Goor, Pieter and Banavar, Ravi and Mahony, Robert},
  title  = {Equivariant Tracking Control for Fully Actuated Mechanical Systems on Matrix {Lie}
            Groups},
  year   = {2025},
  doi    = {10.48550/arXiv.2511.18800},
  eprint = {2511.18800},
  archivePrefix = {arXiv}
}"""

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
