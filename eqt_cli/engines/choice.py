"""The section `solver`, and the engine of an experiment that names none, chosen from its loops."""

from collections.abc import Iterable, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import repeat
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import OTHER_FOLDER, EqtError, EqtWarning, InputError, Problems
from eqt_cli.base.option_types import Kind, option_names, shown, unknown_key, validated
from eqt_cli.base.reporting import reporter
from eqt_cli.engines.engine import Compiled, Engine, SolverChecks, engines
from eqt_cli.loop.closed_loop import ClosedLoop

AUTO = "auto"
"""The engine of configurations that name none: native where it can be used, else solve_ivp."""

FAST, GENERAL = "native", "solve_ivp"
"""The engines of which eqt chooses one. The first, which takes a moment to load, needs C."""


@dataclass(frozen=True)
class Solver:
    """The engine and the judgement of its accuracy.

    Attributes
    ----------
    section
        The section as it is written.
    judgement
        Settings of error estimates and cross-checks.
    engine
        The engine that integrates the runs.
    other
        Where the section names none: the engine of loops that `engine` cannot solve.
    """

    section: dict[str, Any]
    judgement: SolverChecks
    engine: Engine
    other: Engine | None = None

    @property
    def is_auto(self) -> bool:
        """Whether the section names no engine, so that eqt chooses."""
        return self.other is not None

    @property
    def estimates_errors(self) -> bool:
        """Whether every run is solved twice to estimate its error."""
        wanted = self.judgement.error_estimate
        return isinstance(self.engine, Compiled) if wanted is None else wanted

    @property
    def resolved(self) -> dict[str, Any]:
        """The complete section."""
        keys = {"engine": AUTO} | self.section | asdict(self.engine) | asdict(self.judgement)
        return {k: v for k, v in keys.items() if v is not None} | {"engine": self.engine.name}

    def chosen(self, loops: Iterable[ClosedLoop]) -> "Solver":
        """Return the solver with an engine that can solve some loops."""
        if self.other is None:
            return self
        from eqt_cli.engines.native import refusal

        why = refusal(loops)
        if not why:
            return self
        slower = f"engine {self.other.name}, 2 to 17 times slower than native: {why.args[0]}"
        reporter().remark(EqtWarning(slower, *why.remedies, lines=why.lines))
        return replace(self, engine=self.other)

    def begun_by(self, engine: object, folder: Path) -> str | None:
        """Return the engine that began a folder, if eqt chose another one; else None.

        Raises
        ------
        EqtError
            If that engine cannot be used here.
        """
        if not self.is_auto or engine == self.engine.name or engine not in engines.names():
            return None
        if why := unavailable(engines.get(str(engine))):
            needs = why.partition("; or use")[0]
            raise EqtError(f"{folder}: was begun by engine {engine}; {needs}", OTHER_FOLDER)
        reporter().remark(EqtWarning(f"{folder}: goes on by engine {engine}, which began it"))
        return str(engine)


def unavailable(kind: type[Engine]) -> str | None:
    """Return why an engine cannot be used on this machine, and the remedy; None if it can."""
    return kind.unavailable() if issubclass(kind, Compiled) else None


class SolverKind(Kind):
    """The section `solver`: the name of an engine, and its keys."""

    def checked(self, value: Any, problems: Problems, group: Any = None) -> Solver | None:
        """Return the solver of a section, or None after noting its problems."""
        if not isinstance(value, dict):
            problems.add(f"expected a mapping, got {shown(value)}")
            return None
        name, kinds = value.get("engine", AUTO), []
        is_auto = name == AUTO
        if is_auto:
            from eqt_cli.engines.native import refusal

            name, kinds = GENERAL if refusal() else FAST, engines.core()
        with problems.catching("engine"):
            if not isinstance(name, str):
                raise InputError(f"expected the name of an engine, got {shown(name)}")
            if why := unavailable(engines.get(name)):
                raise InputError(why)
            kinds = kinds or [engines.get(name)]
        if not kinds or value.keys() - {*_keys(kinds)}:
            kinds = engines.all()
        _check_keys(value, kinds, is_auto, problems)
        owners: list[type[Any]] = [SolverChecks, *kinds]
        data = ({key: value[key] for key in option_names(o) if key in value} for o in owners)
        judgement, *built = map(validated, owners, data, repeat(problems))
        by_name = {engine.name: engine for engine in built if engine}
        if engine := by_name.get(name):
            engine.check(problems)
        if engine is None or problems:
            return None
        return Solver(value, judgement, engine, by_name[GENERAL] if is_auto else None)

    def section(self, solver: Solver) -> dict[str, Any]:
        """Return the complete section."""
        return solver.resolved


def _check_keys(
    section: dict[str, Any], kinds: Sequence[type[Engine]], is_auto: bool, problems: Problems
) -> None:
    """Note unknown keys; and keys of one engine where eqt chooses, and might choose another."""
    keys = _keys(kinds)
    for key in section:
        having = {kind.name for kind in kinds if key in option_names(kind)}
        if key not in keys:
            problems.at(key).add(unknown_key(key, keys))
        elif is_auto and having and not having >= {FAST, GENERAL}:
            problems.at(key).add(f"is a key of engine {min(having)}; add engine: {min(having)}")


def _keys(kinds: Iterable[type[Engine]]) -> list[str]:
    """Return the keys of the section, where these are the engines."""
    owners: list[type[Any]] = [SolverChecks, *kinds]
    return ["engine", *dict.fromkeys(key for owner in owners for key in option_names(owner))]
