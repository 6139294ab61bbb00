"""Whose plant is this: the answer, its table and its document for `eqt verify --plant`."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError
from eqt_cli.base.reporting import Block, TextTable
from eqt_cli.extensions.plants.plant import Model, Plant, States, adapter_in, short_way
from eqt_cli.extensions.plants.plant_evidence import FEW, STATES, Judge, number

HEADER = ["part", "coefficient", "expected", "finding"]

UNITS = {"position": "m", "attitude": "deg", "velocity": "m/s", "rates": "rad/s"}


@purposes.verify_plant
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
    if function and file.suffix == ".py" and not file.is_file():
        raise EqtError(f"--plant: {name}: not found; give the file of a plant in Python")
    if not function or file.suffix != ".py":
        raise EqtError(f"--plant: expected FILE.py:FUNCTION of a file in Python, got {plant}")
    beside = file.with_suffix(".adapter.yaml")
    if adapter is None and not beside.is_file():
        raise EqtError(f"{plant}: needs an adapter; write {beside.name} next to it, or --adapter")
    how = adapter_in(adapter or beside, loop.group)
    if simulator and not (how.step and loop.period):
        raise EqtError(
            "--simulator: compares a step over control.period: give `returns: {state: dt}` in the "
            "adapter, and control.period in the configuration"
        )
    called = Plant(how, Model.of(loop, how.input.axes), file, function)
    judge = Judge(called)
    judge.judge()
    finding, answer = answer_of(judge.sentences)
    answer = f"{called.name} {answer}"
    notes = [f"cannot be seen: {x}" for x in judge.unseen]
    if judge.steps:
        steps = [f"{kind}: {scheme}" for kind, scheme in judge.steps.items()]
        notes.append(f"scheme of the step: {'; '.join(steps)}")
    parts = [dict(zip(HEADER, row, strict=True)) for row in judge.rows]
    record: dict[str, Any] = {
        "plant": called.name,
        "finding": finding,
        "answer": answer,
        "parts": parts,
    }
    record |= {"sentences": judge.sentences, "unseen": judge.unseen, "step": judge.steps}
    if simulator:
        few = judge.states[0].of(slice(FEW))
        record["period"] = errors = errors_of(called, few, loop.period)
        half = errors_of(called, few, loop.period / 2)
        words = []
        for kind, error in errors.items():
            order = math.log2(error / half[kind]) - 1 if error and half[kind] else math.nan
            said = f", order {order:.1f}" if finding == "is" and math.isfinite(order) else ""
            words.append(f"{kind} {number(error)} {UNITS[kind]}{said}")
        notes.insert(0, f"largest error over a period of {loop.period:g} s: {'; '.join(words)}")
    blocks = [Block("", [[*row] for row in judge.rows])]
    return record, answer, TextTable("plant", "", HEADER, blocks, notes)


def answer_of(sentences: list[str]) -> tuple[str, str]:
    """Return the finding, is, lacks, differs or undecided, and the answer."""
    if not sentences:
        return "is", f"is the plant, within what {STATES} states show"
    wrong = [x for x in sentences if not x.startswith("lacks ")]
    lacking = ", ".join(x[6:] for x in sentences if x not in wrong)
    lacks = [f"lacks {lacking}"] if lacking else []
    if all(x.startswith("has ") for x in wrong):
        finding = "differs" if wrong else "lacks"
        return finding, f"is the plant but {' and '.join([*lacks, *wrong])}"
    finding = "undecided" if all("is unexplained" in x for x in sentences) else "differs"
    return finding, f"differs: {'; '.join([*wrong, *lacks])}"


def errors_of(plant: Plant, states: States, period: float) -> dict[str, float]:
    """Return the largest error of a step from these states, by kind."""
    end, values = after(plant.model, states, period), plant.answers(states, period)
    exact, errors = plant.flat(end), dict[str, float]()
    for kind, (part, where) in plant.parts.items():
        if kind == "attitude":
            attitude, turns = plant.turned(end)
            error = short_way(part, values[:, where], attitude)
            error = np.degrees((np.linalg.pinv(turns) @ error[..., None])[..., 0])
        else:
            error = (values - exact)[:, where] / part.factor
        errors[kind] = float(np.linalg.norm(error, axis=1).max())
    return errors


def after(model: Model, states: States, period: float) -> States:
    """Return the states of the model after a period with the same inputs."""
    from scipy.integrate import solve_ivp

    G, n = model.group, states.Q.size

    def of(y: Array) -> States:
        return States(y[:n].reshape(states.Q.shape), y[n:].reshape(states.V.shape), states.inputs)

    def rate(_: float, y: Array) -> Array:
        moving = of(y)
        return np.hstack([(moving.Q @ G.hat(moving.V)).ravel(), model.acceleration(moving).ravel()])

    y = np.hstack([states.Q.ravel(), states.V.ravel()])
    return of(solve_ivp(rate, (0.0, period), y, method="DOP853", rtol=1e-12, atol=1e-12).y[:, -1])
