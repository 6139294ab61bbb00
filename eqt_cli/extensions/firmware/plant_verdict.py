"""Whose plant is this: the answer, its table and its document for `eqt verify --plant`."""

from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable
from eqt_cli.extensions.firmware.plant import Model, Plant, States, adapter_in, short_way
from eqt_cli.extensions.firmware.plant_evidence import STATES, Judge, number

HEADER = ["part", "coefficient", "expected", "finding"]

UNITS = {"position": "m", "attitude": "deg", "velocity": "m/s", "rates": "rad/s"}
"""Units of errors of a step."""

PERIODS = 20
"""Number of states from which a step of a period is compared."""


def judged(
    experiment: Any, plant: str, adapter: Path | None, simulator: bool
) -> tuple[dict[str, Any], str, TextTable]:
    """Judge a plant, ``FILE:FUNCTION``, and return its record, the answer and the table.

    Raises
    ------
    EqtError
        If it cannot be judged: with the place, and what to do.
    """
    name, _, function = plant.partition(":")
    file, loop = Path(name), next(iter(experiment.loops.values()))
    if not function or not file.is_file() or file.suffix != ".py":
        raise EqtError(f"--plant: expected FILE.py:FUNCTION of a file in Python, got {plant}")
    beside = file.with_suffix(".adapter.yaml")
    if adapter is None and not beside.is_file():
        raise EqtError(f"{plant}: needs an adapter; give {beside.name} beside it, or --adapter")
    how = adapter_in(adapter or beside, loop.group)
    called = Plant(how, Model.of(loop, how.input.axes), file, function)
    result = Judge(called).judged()
    said = result.sentences
    finding, answer = "is", f"{called.name} is the plant, within what {STATES} states show"
    if said:
        besides = [x for x in said if x.startswith(("lacks ", "has "))]
        lacks = all(x.startswith("lacks ") for x in said)
        unexplained = all("is unexplained" in x for x in said)
        finding = "lacks" if lacks else "undecided" if unexplained else "differs"
        answer = f"{called.name} differs: {'; '.join(said)}"
        if len(besides) == len(said):
            answer = f"{called.name} is the plant but {' and '.join(said)}"
    notes = [f"cannot be seen: {x}" for x in result.unseen]
    steps = ", ".join(f"{kind} {scheme}" for kind, scheme in result.steps.items())
    notes += [f"scheme of the step: {steps}"] * bool(steps)
    record = {
        "plant": called.name,
        "finding": finding,
        "answer": answer,
        "parts": [dict(zip(HEADER, row, strict=True)) for row in result.rows],
        "sentences": said,
        "unseen": result.unseen,
        "step": result.steps,
    }
    if simulator:
        period = loop.period
        if not how.step or not period:
            raise EqtError(
                "--simulator: compares a step over control.period: give `returns: {state: dt}` in "
                "the adapter, and control.period in the configuration"
            )
        errors = over_period(called, period)
        record["period"] = errors
        words = [
            f"{kind} {number(e)} {UNITS[kind]} (order {n:.1f})" for kind, (e, n) in errors.items()
        ]
        notes.insert(0, f"largest error over a period of {period:g} s: {', '.join(words)}")
    return (
        record,
        answer,
        TextTable("plant", "", HEADER, [Block("", [[*row] for row in result.rows])], notes),
    )


def over_period(plant: Plant, period: float) -> dict[str, tuple[float, float]]:
    """Return the largest error of a step over a period, and its order, by kind.

    The order is that of the step over many periods: halving the period leaves 2^−(order + 1) of
    the error of one.
    """
    states = Judge(plant).states[0].of(slice(PERIODS))
    whole, half = (errors_of(plant, states, h) for h in (period, period / 2))
    return {
        kind: (e, float(np.log2(e / half[kind]) - 1) if half[kind] else 0.0)
        for kind, e in whole.items()
    }


def errors_of(plant: Plant, states: States, period: float) -> dict[str, float]:
    """Return the largest error of a step from these states, by kind."""
    end, found = after(plant.model, states, period), plant.answers(states, period)
    exact, errors = plant.flat(end), dict[str, float]()
    for kind, (part, where) in plant.parts.items():
        apart = (found - exact)[:, where] / part.factor if kind != "attitude" else found[:, where]
        if kind == "attitude":
            here, turns = plant.turned(end)
            apart = short_way(part, apart, here)
            apart = np.degrees((np.linalg.pinv(turns) @ apart[..., None])[..., 0])
        errors[kind] = float(np.linalg.norm(apart, axis=1).max())
    return errors


def after(model: Model, states: States, period: float) -> States:
    """Return the states of the model after a period with the same inputs."""
    from scipy.integrate import solve_ivp

    G, n = model.group, len(states.V)
    d, m = G.size, G.dimension

    def rate(_: float, y: Array) -> Array:
        Q, V = y[: n * d * d].reshape(n, d, d), y[n * d * d :].reshape(n, m)
        V_dot = model.acceleration(States(Q, V, states.inputs))
        return np.concatenate([(Q @ G.hat(V)).ravel(), V_dot.ravel()])

    y = np.concatenate([states.Q.ravel(), states.V.ravel()])
    y = solve_ivp(rate, (0.0, period), y, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1]
    return States(y[: n * d * d].reshape(n, d, d), y[n * d * d :].reshape(n, m), states.inputs)
