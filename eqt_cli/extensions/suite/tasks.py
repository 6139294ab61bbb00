"""The tasks of the suite: plain configurations with one more section, `suite`.

The section says where a law is put, what is measured, and how each law is tuned and judged. A name
such as ``eqt-suite-2/quad_att`` never changes its meaning: a wrong task is withdrawn.
"""

from __future__ import annotations

import json
import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from hashlib import sha256
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import EqtError, KeyPath, Problems, suggestion
from eqt_cli.base.files import text_of
from eqt_cli.base.option_types import Count, Real, shown, validated
from eqt_cli.config.document import Document, Place
from eqt_cli.config.marks import Section
from eqt_cli.extensions.search.keys import TunedAxis

VERSION = "eqt-suite-2"
"""The suite that this version of eqt judges by."""

TASKS = Path(__file__).with_name("tasks") / VERSION.rpartition("-")[2]
"""The folder of its tasks."""

REFERENCE = "gt"
"""The law that all others are compared with; a task has it in the place of the law."""

FURTHER = 40
"""Points for each number of a law beyond two."""

_BY_SUITE = ("ensemble", "tune", "worst", "sweep", "plugins")
"""Sections of a configuration that follow from the section `suite`, or that a task cannot have."""


class SearchedSection(Section):
    """How each law is tuned.

    Attributes
    ----------
    points
        Largest number of points for each law and training sample, with one number or two; each
        further number of a law has `FURTHER` more.
    runs
        Training runs at each point.
    samples
        Training samples; sample k has the seed `seed` + k − 1.
    seed
        Seed of the first one.
    exchanges, exchanged
        How often the samples of a law exchange their best points at most, and how many points each
        of them may then try: those of this eqt.
    """

    points: Count = 100
    runs: Count
    samples: Count = 5
    seed: Annotated[int, Field(ge=0, lt=2**62)]
    exchanges: Literal[3] = 3
    exchanged: Literal[40] = 40

    def budget(self, numbers: int) -> int:
        """Return the largest number of points of a law with so many numbers."""
        return self.points + FURTHER * max(0, numbers - 2)


class JudgedSection(Section):
    """The held-out runs, which are the same for all laws.

    Attributes
    ----------
    runs
        How many.
    seed
        Root of their random streams.
    """

    runs: Count
    seed: Annotated[int, Field(ge=0, lt=2**62)]


class SuiteSection(Section):
    """What makes a configuration a task.

    Attributes
    ----------
    name
        The suite and the task: ``eqt-suite-2/quad_att``.
    says
        What the task is, in one sentence.
    laws
        What kind of law it takes: `attitude`, also within a cascade, or `pose`.
    objective
        The metric of each run that is made small.
    equal
        The most that all laws may spend, as in `tune`.
    gains
        Ranges of the gains of every law, `kp` and `kd`, also with entries, `kp[0:3]`; and of keys
        that all laws share, such as `controllers[0].position.kx`.
    search, judge
        How each law is tuned, and on which runs it is judged.
    """

    name: str
    says: str
    laws: Literal["attitude", "pose"]
    objective: str
    equal: dict[str, Real] = Field(min_length=1, max_length=1)
    gains: dict[str, TunedAxis]
    search: SearchedSection
    judge: JudgedSection


@dataclass(frozen=True)
class Task:
    """A task.

    Attributes
    ----------
    document
        Its configuration with `REFERENCE` in the place of the law, without the section `suite`.
    section
        The section `suite`.
    ranges
        The ranges in it as they are written.
    place
        Where a law is put: ``("controllers", 0)``, or ``("controllers", 0, "attitude")``.
    """

    document: Document
    section: SuiteSection
    ranges: dict[str, Any]
    place: KeyPath

    @property
    def name(self) -> str:
        """Its name in the suite."""
        return self.section.name.partition("/")[2]

    @property
    def cost(self) -> tuple[str, float]:
        """The metric of what laws spend, and how much of it all may spend."""
        return next(iter(self.section.equal.items()))

    @cached_property
    def digest(self) -> str:
        """Hash of all that decides its numbers; not of its text, so that comments may change."""
        section = self.section.model_dump(exclude={"says", "gains"}) | {"gains": self.ranges}
        text = json.dumps([self.document.data, section], sort_keys=True)
        return sha256(text.encode()).hexdigest()


def read_task(path: Path) -> Task:
    """Read a task.

    Raises
    ------
    ConfigError
        If its section `suite` is missing or wrong, with every problem at its place.
    """
    source = yaml_source.load(
        text_of(path, "a task of the suite is a YAML file").encode(), str(path)
    )
    data = dict(source.data)
    problems = Problems(source.key_place)
    here = problems.at("suite")
    written = data.pop("suite", None)
    if written is None:
        here.add(
            "missing; it makes a configuration a task: {name: …, says: …, laws: attitude, "
            "objective: …, equal: {effort: …}, gains: {…}, search: {…}, judge: {…}}"
        )
    problems.raise_if_any()
    section = validated(SuiteSection, written, here)
    for key in _BY_SUITE:
        if key in data:
            problems.at(key).add("follows from the section `suite`, or from the law; leave it out")
    place = _place_of_law(data.get("controllers"))
    if place is None:
        problems.at("controllers").add(
            f"expected one entry with {REFERENCE} in the place of the law, [{REFERENCE}] or "
            f"[{{kind: cascade, attitude: {REFERENCE}, …}}], got {shown(data.get('controllers'))}"
        )
    if section is not None:
        _check(section, path, here)
    if not isinstance(data.get("control"), dict) or "period" not in data["control"]:
        problems.at("control", "period").add(
            "missing; a task has a period of control, since code in C is called at its instants"
        )
    problems.raise_if_any()
    data.setdefault("name", path.stem)
    document = Document(source, data, Place(path.parent))
    return Task(document, section, dict(written["gains"]), place or ())


def _check(section: SuiteSection, path: Path, here: Problems) -> None:
    """Note a name that is none, and training runs that are held-out ones, too."""
    suite, _, name = section.name.partition("/")
    if not re.fullmatch(r"[a-z][a-z0-9-]*", suite) or name != path.stem:
        here.at("name").add(f"expected SUITE/{path.stem}, as {VERSION}/{path.stem}")
    first, judged = section.search.seed, section.judge.seed
    if first <= judged < first + section.search.samples:
        here.at("judge", "seed").add(
            f"is a seed of the training samples, {first} to {first + section.search.samples - 1}; "
            "held-out runs must differ from them"
        )


def _place_of_law(controllers: Any) -> KeyPath | None:
    """Return the place of the reference law; None if there is not exactly one."""
    if not isinstance(controllers, list) or len(controllers) != 1:
        return None
    (entry,) = controllers
    if entry == REFERENCE:
        return ("controllers", 0)
    if not isinstance(entry, dict):
        return None
    places = [key for key, value in entry.items() if value == REFERENCE and key != "label"]
    if len(places) != 1 or places == ["kind"]:
        return None
    return ("controllers", 0, places[0])


def all_tasks() -> dict[str, Task]:
    """Return the tasks of the suite by name."""
    return {path.stem: read_task(path) for path in sorted(TASKS.glob("*.yaml"))}


def text_of_task(name: Path) -> str:
    """Return the file of a task that is named, as late or eqt-suite-2/late; else ""."""
    path = TASKS / f"{name.name}.yaml"
    named = name.parent in (Path(), Path(VERSION)) and not name.exists()
    return path.read_text(encoding="utf-8") if named and path.is_file() else ""


def chosen_tasks(names: Sequence[str]) -> dict[str, Task]:
    """Return some tasks of the suite by name, or all.

    Raises
    ------
    EqtError
        If there is no such task.
    """
    tasks = all_tasks()
    for name in names:
        if name not in tasks:
            near = suggestion(name, tasks) or f"; there are: {', '.join(tasks)}"
            raise EqtError(f"no task '{name}' in {VERSION}{near}")
    return {name: tasks[name] for name in names or tasks}


def digest_of(tasks: dict[str, Task]) -> str:
    """Return the hash of several tasks, which tells one set of tasks from another."""
    text = json.dumps({name: task.digest for name, task in tasks.items()}, sort_keys=True)
    return sha256(text.encode()).hexdigest()


def with_judge(task: Task, seed: int) -> Task:
    """Return the task with another seed of the held-out runs."""
    judge = task.section.judge.model_copy(update={"seed": seed})
    return replace(task, section=task.section.model_copy(update={"judge": judge}))


def with_training(task: Task, seed: int) -> Task:
    """Return the task with other training samples, the first of which has this seed."""
    search = task.section.search.model_copy(update={"seed": seed})
    return replace(task, section=task.section.model_copy(update={"search": search}))
