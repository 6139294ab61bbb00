"""The diagram of all laws of an experiment: boxes by stage, and what differs between the laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

from eqt_cli.base import purposes
from eqt_cli.base.extensions import functions_for
from eqt_cli.base.option_types import UnitPlace, option_names, plain_data
from eqt_cli.components.laws import Controller
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.schema import GainsSection
from eqt_cli.extensions.diagram.boxes import (
    ACTUATION,
    ESTIMATION,
    LAW,
    PLANT,
    REFERENCE,
    SENSING,
    STAGES,
    Box,
    Loop,
)
from eqt_cli.extensions.diagram.wording import SPACE, option_text


class Line(NamedTuple):
    """A line of words in a box.

    Attributes
    ----------
    laws
        The display names of the laws that it is about; empty where it is about all in its box.
    """

    text: str
    laws: tuple[str, ...] = ()


@dataclass(frozen=True)
class Drawn:
    """A box of all laws.

    Attributes
    ----------
    laws
        The laws that have it; empty for all.
    """

    place: str
    title: str
    lines: tuple[Line, ...]
    laws: tuple[str, ...]
    blocks: tuple[str, ...]
    is_ideal: bool
    beside: bool
    gives: tuple[str, ...]


class Lane(NamedTuple):
    """Boxes in the order of the signals, and the laws that they are of; empty for all."""

    laws: tuple[str, ...]
    boxes: list[Drawn]


@dataclass(frozen=True)
class Diagram:
    """The loop of an experiment.

    Attributes
    ----------
    title
        Name and group of the experiment.
    stages
        Lanes by stage; only that of the laws has several.
    arrows
        What stands on the arrow from a stage to the next one.
    notes
        What is swept.
    """

    title: str
    stages: Mapping[str, list[Lane]]
    arrows: Mapping[str, tuple[str, ...]]
    notes: tuple[str, ...] = ()


def diagram_of(experiment: Experiment, swept: Sequence[str] = ()) -> Diagram:
    """Return the diagram of an experiment.

    Parameters
    ----------
    swept
        Keys that differ from point to point of a sweep.
    """
    titles, of_law = experiment.titles, dict[str, dict[str, list[Box]]]()
    for label, loop in experiment.loops.items():
        law = experiment.laws[label]
        gains = tuple(_gains(experiment, label))
        varied = _varied(loop.controller, [x.controller for x in experiment.loops.values()])
        described = Loop(loop, experiment.document.data, law.index, gains, varied)
        of_law[titles[label]] = described.stages()
    stages: dict[str, list[Lane]] = {}
    for stage in STAGES:
        boxes = {name: stages_of[stage] for name, stages_of in of_law.items()}
        stages[stage] = _lanes(boxes) if stage == LAW else [Lane((), _merged(boxes))]
    # Other extensions draw what no block is: each function yields stage, title and lines.
    for boxes_of in functions_for(purposes.boxes_of_a_diagram):
        for stage, title, lines in boxes_of(experiment):
            words = tuple(map(Line, lines))
            box = Drawn(title, title, words, (), (), is_ideal=False, beside=True, gives=())
            stages[stage][0].boxes.append(box)
    notes = [f"Swept: {', '.join(swept)}."] if swept else []
    texts = " ".join(
        line.text
        for lanes in stages.values()
        for lane in lanes
        for box in lane.boxes
        for line in box.lines
    )
    if "±" in texts:
        notes.append("m ± s: drawn for each run, normal with mean m and deviation s.")
    if f"{SPACE}…{SPACE}" in texts:
        notes.append("a … b: drawn for each run, uniform between a and b.")
    name = f"{experiment.name} on {experiment.group.name}"
    return Diagram(name, stages, _arrows(stages), tuple(notes))


def _varied(law: Controller, laws: Sequence[Controller]) -> frozenset[str]:
    """Return the options of a law that other laws of its class have otherwise."""
    alike = [plain_data(other) for other in laws if type(other) is type(law)]
    names = option_names(type(law))
    return frozenset(x for x in names if any(y.get(x) != alike[0].get(x) for y in alike))


def _gains(experiment: Experiment, label: str) -> list[str]:
    """Return the gains of a law: its own, or those of the section `gains`."""
    section: Any = experiment.config.gains
    law, of_law = experiment.laws[label].law, experiment.laws[label].gains
    shared = {} if section is None else plain_data(section.model_dump(exclude_none=True))
    controllers = experiment.document.data.get("controllers") or []
    entry = controllers[experiment.laws[label].index] if controllers else {}
    written = (entry.get("gains") if isinstance(entry, dict) else None) or {}
    written = {**(experiment.document.data.get("gains") or {}), **written}
    group = getattr(law, "gains_group", lambda G: G)(experiment.group)
    place = UnitPlace(group)
    example = section if section is not None else GainsSection()
    return [
        option_text(example, name, value, place, written.get(name))
        for name, value in {**shared, **plain_data(of_law)}.items()
    ]


def _lanes(of_law: Mapping[str, list[Box]]) -> list[Lane]:
    """Return a lane for all laws whose boxes are at the same places."""
    alike: dict[tuple[str, ...], dict[str, list[Box]]] = {}
    for name, boxes in of_law.items():
        alike.setdefault(tuple(box.place for box in boxes), {})[name] = boxes
    is_one = len(alike) == 1
    return [Lane(() if is_one else tuple(laws), _merged(laws)) for laws in alike.values()]


def _merged(of_law: Mapping[str, list[Box]]) -> list[Drawn]:
    """Return the boxes of several laws, each once, in the order of the signals."""
    places: list[str] = []
    for boxes in of_law.values():
        at = 0
        for box in boxes:
            if box.place in places:
                at = places.index(box.place) + 1
            else:
                places.insert(at, box.place)
                at += 1
    drawn, is_alone = [], all(len(boxes) == 1 for boxes in of_law.values())
    for place in places:
        same = {name: box for name, boxes in of_law.items() for box in boxes if box.place == place}
        drawn.append(_one(same, () if len(same) == len(of_law) else tuple(same), is_alone))
    return [*(box for box in drawn if not box.beside), *(box for box in drawn if box.beside)]


def _one(of_law: Mapping[str, Box], only: tuple[str, ...], is_alone: bool) -> Drawn:
    """Return the box of some laws, in which lines that differ name their laws."""
    first, boxes = next(iter(of_law.values())), [*of_law.values()]
    titles = dict.fromkeys(box.title for box in boxes)
    common = [line for line in first.lines if all(line in box.lines for box in boxes)]
    lines, differing = [Line(line) for line in common], dict[tuple[str, ...], list[str]]()
    for name, box in of_law.items():
        rest = [line for line in box.lines if line not in common]
        words_of_law = [*([box.title] if len(titles) > 1 else []), *rest]
        if words_of_law or (first.place == LAW and len(of_law) > 1):
            differing.setdefault(tuple(words_of_law), []).append(name)
    if len(differing) == 1 and not is_alone and not any(differing):
        differing = {}  # the laws differ in another box
    for texts, names in differing.items():
        texts = texts[1:] if texts[:1] == tuple(names) else texts
        head = ", ".join(names)
        lines.append(Line(f"{head}: {'; '.join(texts)}" if texts else head, tuple(names)))
    kind = " laws" if first.place.startswith(LAW) else ""
    title = first.title if len(titles) == 1 else f"one of {len(of_law)}{kind}"
    return Drawn(
        first.place,
        title,
        tuple(lines),
        only,
        tuple(dict.fromkeys(name for box in boxes for name in box.blocks)),
        all(box.is_ideal for box in boxes),
        first.beside,
        first.gives,
    )


def _arrows(stages: Mapping[str, list[Lane]]) -> dict[str, tuple[str, ...]]:
    """Return what stands on the arrow from each stage to the next one."""
    arrows = {}
    for stage in (REFERENCE, LAW, ACTUATION, PLANT, SENSING, ESTIMATION):
        boxes = [box for lane in stages[stage] for box in lane.boxes if box.gives]
        arrows[stage] = boxes[-1].gives if boxes else ()
    if not arrows[ACTUATION]:
        arrows[ACTUATION] = arrows[LAW][:2]
    return arrows
