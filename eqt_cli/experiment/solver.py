"""The `solver` section: one engine is used, the keys of all engines are checked and kept."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

from eqt_cli.core.errors import ComponentError, suggestion
from eqt_cli.core.numbers import Positive
from eqt_cli.engines import Engine, engines
from eqt_cli.experiment.components import option_names, options_into
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.translate import UNKNOWN_KEY

DEFAULT_ENGINE = "solve_ivp"


@dataclass(frozen=True)
class Judgement:
    """The keys of `solver` that do not belong to an engine.

    Attributes
    ----------
    max_error
        Runs whose error estimate exceeds it count as failed.
    error_estimate
        Solve every run a second time at a tenth of the tolerance and compare.
    """

    max_error: Positive | None = None
    error_estimate: bool = False


@dataclass(frozen=True)
class Solver:
    """The engine, how its accuracy is judged, and the section as it is kept."""

    engine: Engine
    judgement: Judgement
    resolved: dict[str, Any]


def solver_from(section: dict[str, Any], problems: Problems) -> Solver | None:
    """The solver that a section asks for, or None after noting what is wrong with it."""
    before = len(problems)
    name = section.get("engine", DEFAULT_ENGINE)
    owners: dict[str, type] = {"": Judgement} | {entry.name: entry for entry in engines.all()}
    known = {key: owner for owner in owners.values() for key in option_names(owner)}
    for key in section.keys() - known.keys() - {"engine"}:
        names = ["engine", *known]
        hint = suggestion(key, names) or f"; known here: {', '.join(names)}"
        problems.add(("solver", key), UNKNOWN_KEY + hint)
    try:
        engines.get(str(name))
    except ComponentError as error:
        problems.add(("solver", "engine"), str(error))
    built = {
        owner: options_into(
            component,
            {key: section[key] for key in option_names(component) if key in section},
            ("solver",),
            problems,
        )
        for owner, component in owners.items()
    }
    for candidate in built.values():
        if isinstance(candidate, Engine):
            for option, message in candidate.problems():
                problems.add(("solver", option), message)
    if len(problems) > before:
        return None
    engine, judgement = built[name], built[""]
    assert isinstance(engine, Engine) and isinstance(judgement, Judgement)
    kept = {key: section[key] for key in section if key != "engine"}
    own = {**asdict(engine), **asdict(judgement)}
    filled = {key: value for key, value in own.items() if value is not None}
    return Solver(engine, judgement, {"engine": name, **kept, **filled})
