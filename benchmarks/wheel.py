"""Experiments of `eqt tune` whose runs a plain program flies, so that there can be hundreds.

Searches, exchanges and intervals are eqt's; the runs are those of `benchmarks.searches.PLANT`, a
wheel of inertia 1 under a held torque, in closed form: an experiment takes a tenth of the time.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from eqt_cli.api.loading import document_from
from eqt_cli.base.arrays import Array
from eqt_cli.extensions.search import ratios
from eqt_cli.extensions.search.exchanges import unfinished
from eqt_cli.extensions.search.model_search import Tried
from eqt_cli.extensions.search.training import Training, _course
from eqt_cli.extensions.search.tune import Search

PERIOD, STEPS = 0.1, 30
"""Time between two torques, s, and number of torques."""

TRAINING, HELD, MANY = 16, 60, 4000
"""Runs of a training sample, held-out runs, and those that give the ratio that is meant."""


def flown(kp: Array, kd: Array, angle: Array, rate: Array, feedforward: float = 1.0) -> Any:
    """Return the mean pose error and the effort of runs.

    Parameters
    ----------
    kp, kd : (points, 1)
        Gains.
    angle, rate : (runs,)
        Starts, rad and rad/s. The reference turns by 1 − cos t.
    feedforward
        What the law adds of the torque cos t of the reference.

    Returns
    -------
    (points, runs), (points, runs)
        Mean of ‖I − Q_E‖ = √8 |sin(e/2)| by the trapezoidal rule, and ∫τ² dt.
    """
    errors, effort = [], np.zeros((len(kp), len(angle)))
    angle, rate = angle + 0 * kp, rate + 0 * kp
    for t in PERIOD * np.arange(STEPS + 1):
        error = angle - (1 - np.cos(t))
        errors.append(np.sqrt(8) * np.abs(np.sin(error / 2)))
        torque = feedforward * np.cos(t) - kd * (rate - np.sin(t)) - 2 * kp * np.sin(error)
        if len(errors) <= STEPS:
            effort += PERIOD * torque**2
        angle = angle + PERIOD * rate + PERIOD**2 / 2 * torque
        rate = rate + PERIOD * torque
    weights = np.full(STEPS + 1, 1 / STEPS)
    weights[[0, -1]] /= 2
    return np.tensordot(weights, np.array(errors), 1), effort


def starts(random: np.random.Generator, runs: int) -> tuple[Array, Array]:
    """Draw angles of 0.5 to 2.5 rad to either side, and normal rates."""
    angles = random.uniform(0.5, 2.5, runs)
    return random.choice([-1.0, 1.0], runs) * angles, random.normal(size=runs)


def search(plant: Mapping[str, Any], over: Mapping[str, Any], tune: Mapping[str, Any]) -> Search:
    """Return the search for the only law of a configuration."""
    data = {**plant, "controllers": ["gt"], "tune": {**tune, "over": over}}
    return Search.read(document_from(data, {}))


def experiment(seed: int, laws: tuple[Search, Search], feedforward: float = 1.0) -> dict[str, Any]:
    """Tune two laws, the second with a feedforward of its own, and judge it against the first.

    ``meant`` is the ratio that the interval should hold if these were all training samples: at the
    gains that were found, over `MANY` other runs. ``of_samples`` has its logarithm on each sample.
    """
    random, errors, many, cost = np.random.default_rng([seed, 155]), [], [], []
    finished, points = [], []
    train = {sample: starts(random, TRAINING) for sample in laws[0].samples}
    held, others = starts(random, HELD), starts(np.random.default_rng(9), MANY)
    for one, factor in zip(laws, (1.0, feedforward), strict=True):
        best = _tuned(one, train, factor)
        gains = _gains(one, np.array([x.tried.shares[x.point] for x in best.values()]))
        errors.append(flown(*gains, *held, factor)[0])
        many.append(flown(*gains, *others, factor)[0].mean(axis=1))
        cost.append([float(x.tried.costs[x.point]) for x in best.values()])
        finished.append(not unfinished([x.gained for x in best.values()]))
        points.append([len(x.tried) for x in best.values()])
    pair = ratios.paired(errors[1], errors[0], "b", "a", "mean_pose_error", "lower")
    logs = np.log(many[1] / many[0])
    return {
        "seed": seed,
        "verdict": str(pair.word),
        "ratio": pair.value,
        "low": pair.low,
        "high": pair.high,
        "meant": float(np.exp(logs.mean())),
        "of_samples": logs.round(6).tolist(),
        "finished": finished,
        "points": points,
        "training": np.round(cost, 6).tolist(),
    }


def _gains(one: Search, shares: Array) -> tuple[Array, Array]:
    values = [one.laws[0].values(point) for point in shares.tolist()]
    kp, kd = ([[of[f"gains.{name}"]] for of in values] for name in ("kp", "kd"))
    return np.array(kp), np.array(kd)


def _tuned(one: Search, train: Mapping[int, tuple[Array, Array]], feedforward: float) -> Any:
    """Return the best points of a law by sample."""
    course = _course(one, {sample: Training(one.laws[0], sample) for sample in train}, {})
    answers: Any = None
    while True:
        try:
            asked = course.send(answers)
        except StopIteration as stopped:
            return stopped.value
        answers = {}
        for sample, shares in asked.items():
            errors, effort = flown(*_gains(one, shares), *train[sample], feedforward)
            none = np.zeros(len(shares))
            spent = effort.mean(axis=1)[:, None]
            answers[sample] = Tried(shares, errors.mean(axis=1), spent, none, none)
