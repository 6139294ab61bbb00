"""Formulas in names of the section `draws`: where they may stand, and where they may not."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from typing import Any

from eqt_cli.base import purposes
from eqt_cli.base.errors import InputError, KeyPath, Problems
from eqt_cli.base.expressions import formula
from eqt_cli.components.vehicle_parts import NamedFormula
from eqt_cli.config.document import Document
from eqt_cli.config.experiment import Experiment
from eqt_cli.extensions.draws.names import DrawnNames

ALLOWED = ("plant", "actuators", "sensors", "initial")
"""Sections of what laws do not know."""

SHARED = ("control", "time", "ensemble", "solver", "failed_when", "settling_threshold", "measure")
"""Sections that all runs share."""

TOLD = ("gains", "controllers", "model", "inertia", "estimator")
"""Sections of what laws know."""

FOLLOWED = ("reference", "target")
"""Sections of what all runs of a point follow."""

WORDS = {"kind", "label", "of", "file", "frame", "sequence", "up_axis", "extends"}
"""Options whose texts are no formulas."""

_NAME = re.compile(r"[A-Za-z_]\w*")

Take = Callable[..., Any]
"""Takes over what the last point of a sweep has made of the same objects."""


def names_of(document: Document, problems: Problems, take: Take) -> DrawnNames | None:
    """Return the names of a configuration."""
    here, section = problems.at("draws"), document.data["draws"]
    names: DrawnNames | None = take("draws", here, lambda: DrawnNames.read(document, here), section)
    return names


@purposes.draws
def with_formulas(document: Document, problems: Problems, take: Take) -> dict[str, Any]:
    """Return the data of a configuration with formulas in names where they may stand.

    In `initial`, the means stand for them, for the runs have starts of their own.
    """
    data = document.data
    names = names_of(document, problems, take)
    if names is None:
        return data
    changed = dict(data)
    for key in (*TOLD, *FOLLOWED, *SHARED):
        for path, text in texts_in(data.get(key), names, (key,)):
            problems.at(*path).add(f"'{text}' {why_not(key)}")
    for key in ALLOWED:
        if key in data:
            here = problems.at(key)
            changed[key] = take(
                f"draws in {key}",
                here,
                lambda key=key, here=here: replaced(data[key], names, here, key == "initial"),
                data[key],
                names,
            )
    return changed


def why_not(section: str) -> str:
    """Return why no formula in names may stand in a section."""
    where = "write it in plant, actuators, sensors or initial"
    if section in TOLD:
        return (
            f"would tell the laws what a run draws; {where}, and here the number that they believe"
        )
    if section in FOLLOWED:
        return (
            "differs by run, and all runs have the same reference; sweep it, with one run at each "
            "point: sweep: [{random: {points: 50, axes: {…}}}, {set: {…}}]"
        )
    return f"differs by run, and all runs share {section}; {where}"


def texts_in(value: Any, names: DrawnNames, path: KeyPath = ()) -> Iterator[tuple[KeyPath, str]]:
    """Yield the formulas with names in a section, each with its place."""
    if isinstance(value, dict):
        for key, entry in value.items():
            if key not in WORDS:
                yield from texts_in(entry, names, (*path, key))
    elif isinstance(value, list):
        for index, entry in enumerate(value):
            yield from texts_in(entry, names, (*path, index))
    elif isinstance(value, str) and {*_NAME.findall(value)} & {*names.names}:
        yield path, value


def replaced(value: Any, names: DrawnNames, problems: Problems, by_means: bool) -> Any:
    """Return a section with its formulas with names parsed, or replaced by numbers."""
    texts = dict(texts_in(value, names))
    return _replaced(value, texts, (), names, problems, names.means if by_means else None)


def at_run(value: Any, names: DrawnNames, numbers: dict[str, float]) -> Any:
    """Return a section with the numbers of a run in place of its formulas with names."""
    return _replaced(value, dict(texts_in(value, names)), (), names, Problems(), numbers)


def _replaced(
    value: Any,
    texts: dict[KeyPath, str],
    path: KeyPath,
    names: DrawnNames,
    problems: Problems,
    numbers: dict[str, float] | None,
) -> Any:
    if not any(place[: len(path)] == path for place in texts):
        return value
    if isinstance(value, dict):
        return {
            key: _replaced(entry, texts, (*path, key), names, problems, numbers)
            for key, entry in value.items()
        }
    if isinstance(value, list):
        return [
            _replaced(entry, texts, (*path, k), names, problems, numbers)
            for k, entry in enumerate(value)
        ]
    with problems.catching(*path):
        expression = formula(value, ("t", *names.names))
        if numbers is None:
            return NamedFormula(value, names, expression)
        if "t" in expression.variables:
            raise InputError(f"expected a number in each run, got '{value}', which depends on t")
        return float(expression.evaluate(numbers))
    return 0.0


def unused(experiment: Experiment) -> Iterator[tuple[KeyPath, str]]:
    """Yield a remark on each name that no formula reads."""
    data = experiment.document.data
    names = names_of(experiment.document, Problems(), lambda *of: of[2]())
    assert names is not None
    texts = [text for key in ALLOWED for _, text in texts_in(data.get(key), names)]
    used = {name for text in texts for name in _NAME.findall(text)}
    used |= {name for drawing in names.drawings for name in drawing.reads}
    for drawing in names.drawings:
        for name in drawing.names:
            if name not in used:
                yield ("draws", ", ".join(drawing.names)), f"no formula reads {name}; remove it"
