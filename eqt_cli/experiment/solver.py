"""The sections `solver` and `settling`: the engine of the runs, and when a run has settled."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from itertools import repeat
from typing import Any

from eqt_cli.config.schema import DEFAULT_ENGINE, SolverChecks
from eqt_cli.core.errors import InputError, Problems
from eqt_cli.core.option_types import option_names, shown, unknown_key, validated
from eqt_cli.engines import Engine, engines
from eqt_cli.groups import MatrixLieGroup


def check_thresholds(
    thresholds: Mapping[str, float], G: MatrixLieGroup, problems: Problems
) -> None:
    """Note unknown parts, and angles beyond a half-turn, among thresholds by part."""
    parts = {part.name: part for part in G.parts}
    for name, threshold in thresholds.items():
        here = problems.at(name)
        if name not in parts:
            here.add(unknown_key(name, parts))
        elif parts[name].turns and threshold > math.pi:
            here.add(f"expected an angle of at most 180 deg, got {math.degrees(threshold):.6g} deg")


@dataclass(frozen=True)
class Solver:
    """The engine and the judgement of its accuracy.

    Attributes
    ----------
    engine
        The engine that integrates the runs.
    judgement
        Settings of error estimates and cross-checks.
    resolved
        The complete section.
    """

    engine: Engine
    judgement: SolverChecks
    resolved: dict[str, Any]

    @property
    def estimates_errors(self) -> bool:
        """Whether every run is solved twice to estimate its error."""
        wanted = self.judgement.error_estimate
        return self.engine.estimates_errors if wanted is None else wanted


def solver_from(section: dict[str, Any], problems: Problems) -> Solver | None:
    """Return the solver of a section, or None after noting its problems."""
    name = section.get("engine", DEFAULT_ENGINE)
    with problems.catching("engine"):
        _require_available(name)
    kinds = engines.own()
    if all(kind.name != name for kind in kinds) or set(section) - set(_keys(kinds)):
        kinds = engines.all()
    owners: list[type[Any]] = [SolverChecks, *kinds]
    known = _keys(kinds)
    for key in section:
        if key not in known:
            problems.at(key).add(unknown_key(key, known))
    own = ({key: section[key] for key in option_names(kind) if key in section} for kind in owners)
    judgement, *built = map(validated, owners, own, repeat(problems))
    engine = next((entry for entry in built if entry and entry.name == name), None)
    if engine is not None:
        engine.check(problems)
        if "device" in section and "device" not in option_names(type(engine)):
            able = [each.name for each in engines.all() if "device" in option_names(each)]
            problems.at("device").add(f"engine {name} has none; use engine {' or '.join(able)}")
    if engine is None or problems:
        return None
    keys = {**section, **asdict(engine), **asdict(judgement), "engine": name}
    given = {key: value for key, value in keys.items() if value is not None}
    return Solver(engine, judgement, {"engine": name} | given)


def _keys(kinds: Iterable[type[Engine]]) -> list[str]:
    """Return the keys of the section, where these are the engines."""
    owners: list[type[Any]] = [SolverChecks, *kinds]
    return ["engine", *dict.fromkeys(key for own in owners for key in option_names(own))]


def _require_available(name: Any) -> None:
    """Raise an `InputError` if there is no engine of this name, or it is not available."""
    if not isinstance(name, str):
        raise InputError(f"expected the name of an engine, got {shown(name)}")
    unavailable = engines.get(name).unavailable()
    if unavailable:
        raise InputError(unavailable)
