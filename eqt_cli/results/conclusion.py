"""What the command that made a result concludes from it, which all readers ask for."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.files import TEXT_BYTES, content_of
from eqt_cli.base.reporting import TextTable
from eqt_cli.base.stored import CASE
from eqt_cli.results.result import Result


@dataclass(frozen=True)
class Conclusion:
    """What an extension concludes from a result that one of its commands made.

    Readers show it first. The defaults are those of a result without a conclusion.

    Attributes
    ----------
    id, short, title
        Name in addresses, and short and full title of its section in a report.
    tables
        Returns the tables that `eqt show` prints and a report contains.
    finding
        Returns the sentence on these tables with which a report begins.
    document
        Returns what `eqt show --json` has in addition, by key.
    figures
        Default figures of a report, which then does not compare the laws run by run: captions by
        name, "" for the usual caption.
    plotted
        Default figures of `eqt plot` of a sweep.
    starts
        Labels of laws before they were tuned. If there are any, gains differ between the laws
        because each law has those that suit it.
    further
        Labels that comparisons leave out unless they are named.
    premise
        What a comparison run by run leaves out, in a sentence.
    pair
        Labels of the two laws that a figure of cases compares; None for those of the result.
    variants
        Law and number of the variant that a label stands for, if it is not a law of its own.
    """

    id: str = ""
    short: str = ""
    title: str = ""
    tables: Callable[[], Sequence[TextTable]] = list
    finding: Callable[[Sequence[TextTable]], str] = lambda _: ""
    document: Callable[[], Mapping[str, Any]] = dict
    figures: Mapping[str, str] = field(default_factory=dict)
    plotted: Sequence[str] = ()
    starts: Sequence[str] = ()
    further: Collection[str] = ()
    premise: str = ""
    pair: Sequence[str] | None = None
    variants: Mapping[str, tuple[str, int]] = field(default_factory=dict)

    def compared(self, result: Result) -> list[str]:
        """Return the labels that comparisons of a result show; may raise an `EqtError`."""
        return [label for label in result.labels if label not in self.further]


def conclusion_of(result: Result) -> Conclusion:
    """Return what the command that made a result concludes from it.

    Extensions have functions for the purpose ``conclusion of a result``. Each takes an open result
    and returns a `Conclusion`, or None for results that its commands did not make.
    """
    functions = functions_for(purposes.conclusion_of_a_result, result.path.parent)
    return next(filter(None, (conclude(result) for conclude in functions)), Conclusion())


def words_of(result: Result) -> Mapping[str, Any]:
    """Return the configuration beside a result, whose words may be newer, or that within it."""
    from eqt_cli.base.yaml_source import load  # slow to import, and most readers need it not

    beside = result.path.with_name("config.yaml")
    with suppress(OSError, EqtError, ValueError):  # a link is not followed
        text = content_of(beside, TEXT_BYTES, follow=False).decode()
        if result.path.name == "results.h5" and ("\nrequire:" in text or "\nwindows:" in text):
            return load(text, beside.name).data
    return result.config


def answers_of(result: Result) -> tuple[dict[str, Any], list[TextTable]]:
    """Return what extensions answer about a result, for programs, and the tables that stand first.

    Extensions have functions for the purpose ``answers of a result``, such as on requirements.
    """
    document, tables = dict[str, Any](), list[TextTable]()
    for answer in functions_for(purposes.answers_of_a_result, result.path.parent):
        if (both := answer(result)) is not None:
            document, tables = document | both[0], tables + both[1]
    return document, tables


def side_by_side(result: Result) -> Sequence[str]:
    """Return the labels of the two laws that a figure of cases compares.

    Empty if the result has no cases, or no such pair.
    """
    if [swept.key for swept in result.swept_keys] != [CASE]:
        return []
    pair = conclusion_of(result).pair
    labels = result.labels if pair is None else pair
    return labels if len(labels) == 2 else []
