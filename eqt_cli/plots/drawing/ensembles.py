"""The controllers of one or several results, as figures name and number them."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from eqt_cli.controllers import controllers
from eqt_cli.core.arrays import Array
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.plots.drawing.style import Look
from eqt_cli.store.reader import Results


@dataclass(frozen=True)
class Ensemble:
    """The runs of one controller of a result.

    Attributes
    ----------
    results
        The result that holds them.
    controller
        The controller's position there.
    look
        On what its line style depends: its position; among several results, its law for the colour
        and the result for the dashes, or the result for both where there is one law.
    label, title
        Its name in the result and in figures; both name the result too where there are several.
    good : (runs,)
        Which of the runs ended with status 0.
    """

    results: Results
    controller: int
    look: Look
    label: str
    title: str
    good: Array

    @property
    def failed(self) -> int:
        """How many runs are left out because they failed."""
        return int(self.good.size - np.count_nonzero(self.good))


def ensembles(
    results: Sequence[Results], figure: str, chosen: Sequence[str] = ()
) -> list[Ensemble]:
    """The controllers of single experiments on one group.

    Parameters
    ----------
    results
        Open.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Raises
    ------
    EqtError
        If one is a sweep, they are of several groups, a label is of no controller, or no run of
        any is good.
    """
    for one in results:
        one.single(f"figure '{figure}' shows single experiments")
    _check_group(results, figure)
    several = len(results) > 1
    laws = list(dict.fromkeys(label for one in results for label in _labels(one)))
    kept_by_result = positions(results, figure, chosen)
    shown = {
        _labels(one)[k] for one, kept in zip(results, kept_by_result, strict=True) for k in kept
    }
    found: list[Ensemble] = []
    for number, (one, name, kept) in enumerate(
        zip(results, names(results), kept_by_result, strict=True)
    ):
        labels, end = _labels(one), f", {name}" if several else ""
        for position in kept:
            label = labels[position]
            good = one.read("status", controller=position) == 0
            look = Look(position)
            if several:
                pairs = (len(laws), len(results)) if len(shown) > 1 else (0, 0)
                look = Look(len(found), (laws.index(label), number), pairs)
            found.append(
                Ensemble(one, position, look, label + end, title_of(one, label) + end, good)
            )
    if not any(ensemble.good.any() for ensemble in found):
        message = "has nothing to show, since every run failed; see `eqt show`"
        raise error(results[0], figure, message)
    return found


def positions(results: Sequence[Results], figure: str, chosen: Sequence[str]) -> list[list[int]]:
    """Where the chosen controllers are in each result, all if none is chosen.

    Raises
    ------
    EqtError
        If a label is of no controller of any result.
    """
    by_result = [_labels(one) for one in results]
    known = list(dict.fromkeys(label for labels in by_result for label in labels))
    for label in chosen:
        if label not in known:
            hint = suggestion(label, known) or f"; the result holds: {', '.join(known)}"
            raise error(results[0], figure, f"finds no controller '{label}'{hint}")
    return [
        [k for k, label in enumerate(labels) if not chosen or label in chosen]
        for labels in by_result
    ]


def title_of(results: Results, label: str) -> str:
    """How a controller is written in figures: by its law's title, or by the label it was given."""
    try:
        titles = json.loads(str(results.attributes["titles"]))
    except (KeyError, ValueError):  # written before there were titles in the file
        titles = None
    if isinstance(titles, dict):
        return str(titles.get(label, label))
    return law_title(label)


def law_title(name: str) -> str:
    """How a law is written in figures; its name where it is not registered here."""
    law = controllers.get(name) if name in controllers.names() else None
    return str(getattr(law, "title", name))


def names(results: Sequence[Results]) -> list[str]:
    """What tells results apart: their titles, else their folders, else numbers as well."""
    titles = [str(one.attributes.get("title", one.path.parent.name)) for one in results]
    folders = [one.path.parent.resolve().name for one in results]
    for candidates in (titles, folders):
        if len(set(candidates)) == len(results):
            return candidates
    return [f"{title} ({number})" for number, title in enumerate(titles, start=1)]


def error(results: Results, figure: str, message: str) -> EqtError:
    """An error of a figure about a result."""
    return EqtError(f"{results.path}: figure '{figure}' {message}")


def _check_group(results: Sequence[Results], figure: str) -> None:
    first, *others = results
    group = first.attributes.get("group")
    for other in others:
        if other.attributes.get("group") != group:
            message = (
                f"shows results on one group; this is on {other.attributes.get('group')}, and "
                f"{first.path} on {group}"
            )
            raise error(other, figure, message)


def _labels(results: Results) -> list[str]:
    return [str(label) for label in results.coordinate("controller")]
