"""Initial states whose numbers are formulas in names of the section `draws`."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import lru_cache
from typing import Any

from numpy.random import Generator

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import Problems, parse_key
from eqt_cli.base.option_types import validated
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.initial_states import PoseDistribution, VelocityDistribution
from eqt_cli.config.document import Document
from eqt_cli.config.experiment import Start
from eqt_cli.config.schema import Config, InitialSection
from eqt_cli.extensions.draws.formulas import Take, at_run, names_of, texts_in
from eqt_cli.extensions.draws.names import DrawnNames
from eqt_cli.numbers.leaves import STRUCTURE


@dataclass(frozen=True, eq=False)
class Written:
    """The section `initial` as it is written.

    Attributes
    ----------
    section
        Its keys.
    names
        The names of its formulas.
    """

    section: dict[str, Any]
    names: DrawnNames
    G: MatrixLieGroup

    def __repr__(self) -> str:
        return repr((self.section, self.names))

    def of_run(self, seed: int, run: int, problems: Problems | None = None) -> Any:
        """Return the section with the numbers of a run; without `problems`, they must be right."""
        if problems is not None:
            section = at_run(self.section, self.names, self.names.of(seed, run))
            return validated(InitialSection, section, problems, group=self.G)
        return _of_run(self, seed, run)


@lru_cache(maxsize=20_000)
def _of_run(written: Written, seed: int, run: int) -> Any:
    problems = Problems()
    section = written.of_run(seed, run, problems)
    problems.raise_if_any()
    return section


@dataclass(frozen=True)
class DrawnPoses(PoseDistribution):
    """Poses by a distribution with other numbers in each run.

    Attributes
    ----------
    nominal
        The distribution with the means.
    written
        The section.
    """

    nominal: PoseDistribution
    written: Written = field(metadata=STRUCTURE)

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the numbers of the run of a generator."""
        stream: Any = generator.bit_generator.seed_seq
        run = int(stream.spawn_key[1])
        poses = self.written.of_run(stream.entropy, run).pose
        numbers: Array = poses.draw_of_run(G, generator, run)
        return numbers

    def place(self, G: MatrixLieGroup, numbers: Array) -> Array:
        """Return the poses, for which no numbers but these are needed."""
        return self.nominal.place(G, numbers)


@dataclass(frozen=True)
class DrawnVelocities(VelocityDistribution):
    """Velocities by a distribution with other numbers in each run.

    Attributes
    ----------
    written
        The section.
    """

    written: Written = field(metadata=STRUCTURE)

    def draw(self, G: MatrixLieGroup, generator: Generator) -> Array:
        """Return the numbers of the run of a generator."""
        stream: Any = generator.bit_generator.seed_seq
        run = int(stream.spawn_key[1])
        velocities = self.written.of_run(stream.entropy, run).velocity
        numbers: Array = velocities.draw_of_run(G, generator, run)
        return numbers


@purposes.starts_of_draws
def drawn_start(
    start: Start,
    config: Config,
    document: Document,
    problems: Problems,
    take: Take,
    G: MatrixLieGroup,
) -> Start:
    """Return the starts of runs with the names of `draws`, and with the rows of their table."""
    names = names_of(document, problems, take)
    if names is None:
        return start
    if names.rows is not None:
        rows = [rows for rows in (start.rows, len(names.rows)) if rows is not None]
        files = {names.file[0]: names.file[1]} | start.files
        start = replace(start, rows=min(rows), files=files)
    section = document.data.get("initial")
    if not any(texts_in(section, names)):
        return start
    assert isinstance(section, dict)
    written = Written(section, names, G)
    runs = config.ensemble.runs
    if "runs" not in config.ensemble.model_fields_set and start.rows is not None:
        runs = start.rows
    for run in range(runs):
        of_run = Problems()
        written.of_run(config.ensemble.seed, run, of_run)
        for problem in of_run:
            problems.at("initial", *parse_key(problem.path)).add(f"in run {run}: {problem.message}")
        if of_run:
            break
    resolved = start.resolved | {
        key: section[key] for key in ("pose", "velocity") if key in section
    }
    return replace(
        start,
        poses=DrawnPoses(start.poses, written),
        velocities=DrawnVelocities(written),
        resolved=resolved,
    )
