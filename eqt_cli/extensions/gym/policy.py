"""A trained policy: is it flown as it was trained? And what its file says of its training."""

from __future__ import annotations

import json
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.base.files import refusals, replace_file
from eqt_cli.base.registry import described
from eqt_cli.base.reporting import reporter
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Problem
from eqt_cli.extensions.gym import judging
from eqt_cli.extensions.gym.rewards import plain
from eqt_cli.extensions.gym.stepping import Episodes
from eqt_cli.extensions.network.network import Network, bare_source, call, emitted, function_of
from eqt_cli.extensions.network.onnx_files import TRAINED
from eqt_cli.runs.batches import batches

APART = 1e-9
"""Most by which poses of the environment and of `eqt run` may differ, relative above 1. Both are
moved by the same programs, so that 1e-11 was not exceeded; a wrong tick or number is 1e-4."""

AGREES = 1e-4
"""Most by which a function and its exported network may differ, relative above 1: of 32 bits."""


def with_file(environment: Any, path: Path, runs: int) -> Study:
    """Return the experiment of an environment with a network from a file, as `eqt run` flies it."""
    document = environment.study.document
    (law,) = document.data["controllers"]
    files = {name: text for name, text in document.home.files.items() if name != law["file"]}
    data = document.data | {"controllers": [law | {"file": str(path.resolve())}]}
    data["ensemble"] = (data.get("ensemble") or {}) | {"runs": runs}
    return study(replace(document, data=data, home=replace(document.home, files=files)))


def flown(experiment: Study, label: str, runs: int) -> tuple[Array, Problem]:
    """Return the states of the first runs at all instants, as `eqt run` solves them."""
    (batch,) = batches(experiment, label, np.arange(runs))
    starts = [span.start for span in batch.problem.spans if span.tick is not None]
    problem = replace(batch.problem, times=np.array([*starts, batch.problem.times[-1]]))
    return batch.engine.solve(problem).states, problem


def commands_of(law: Network) -> Callable[[Array], Array]:
    """Return the network of a law in C, as a function of observations, which keeps its memory."""
    function = function_of(bare_source(emitted(law.text, law.file, law._pairs)))
    start, memory = np.array(law.network.initial), list[Array]()

    def commands(observations: Array) -> Array:
        if not memory:
            memory.append(np.tile(start, (len(observations), 1)))
        outputs = np.empty((len(observations), law.network.commands))
        call(function, memory[0], np.ascontiguousarray(observations), outputs)
        return outputs

    return commands


def check(environment: Any, path: Path, policy: Callable[[Array], Any] | None, runs: int) -> float:
    """Return the largest difference of poses; see `Environment.check`."""
    judged, label = with_file(environment, path, runs), environment.label
    expected, problem = flown(judged, label, runs)
    law = judged.base.loops[label].controller
    assert isinstance(law, Network)
    commands, same = commands_of(law), environment.of_runs(Episodes(problem))
    observed, apart = same.reset(options={"runs": np.arange(runs)})[0], 0.0
    if same.plant.asks_first:  # by a network whose memory has not begun
        observed = same.step(commands_of(law)(observed))[0]
    poses, spent = problem.loop.layout.slices["pose"], np.zeros(runs)
    for k in range(same.plant.ticks):
        actions = commands(observed)
        if policy is not None:
            _compare(path, policy, observed, actions)
        observed, *_, info = same.step(actions)
        spent += info.get("cost", 0.0)
        ours, theirs = (x[..., poses] for x in (same.plant.states, expected[:, k + 1]))
        scale = np.maximum(1.0, np.abs(theirs))
        there = np.isfinite(theirs).all(axis=1)
        apart = max(apart, float((np.abs(ours - theirs) / scale)[there].max(initial=0.0)))
        if not apart < APART:
            t = problem.times[k + 1]
            raise EqtError(
                f"{path}: at {t:g} s, poses of the environment and of eqt run differ by "
                f"{apart:.2g}, and {APART:g} is allowed; please report this with the configuration"
            )
        if same.plant.failed.all():
            break
    if same.bound:
        metric, most = same.bound
        _tell_of_bound(path, metric, most, spent)
    return apart


def _tell_of_bound(path: Path, metric: str, most: float, spent: Array) -> None:
    """Remark on a policy that spends more in the mean than it may."""
    if spent.mean() > most:
        message = (
            f"{path}: {metric} is {spent.mean():.3g} in the mean of {len(spent)} runs, and "
            f"{most:g} is the bound; train with the rewards of eqt_cli.gym.bounded(env)"
        )
        reporter().remark(EqtWarning(message))


def _compare(path: Path, policy: Callable[[Array], Any], observed: Array, expected: Array) -> None:
    """Refuse a function whose actions are not those of the file."""
    try:
        actions = plain(policy(observed.astype(np.float32))).astype(float)
    except Exception as error:
        raise EqtError(
            f"policy: the function fails: {described(error)}; it gets observations of shape "
            f"{observed.shape} and returns the actions alone, as lambda x: model.predict(x)[0]"
        ) from error
    if actions.shape != expected.shape:
        raise EqtError(
            f"policy: expected actions of shape {expected.shape} for observations of shape "
            f"{observed.shape}, got {actions.shape}"
        )
    apart = np.abs(actions - expected) / np.maximum(1.0, np.abs(expected))
    if not apart.max() < AGREES:
        run, k = np.unravel_index(int(np.nanargmax(apart)), apart.shape)
        raise EqtError(
            f"{path}: its output {k} is {expected[run, k]:.6g} where the policy gives "
            f"{actions[run, k]:.6g}; export the whole policy, with its normalisation and its last "
            "function"
        )


# What the file of a policy says of its training ---------------------------------------------------


def record(environment: Any, path: Path) -> dict[str, Any]:
    """Write into an ONNX file what its policy was trained for; see `Environment.record`."""
    try:
        import onnx
    except ImportError:
        raise EqtError(
            "the metadata of ONNX needs onnx, which is not installed; pip install '.[network]'"
        ) from None
    try:
        model = onnx.load(path, load_external_data=False)
    except Exception as error:
        raise EqtError(f"{path}: cannot be read as ONNX: {error}") from error
    about, earlier = environment.training, _recorded(model)
    seeds = sorted({about["seed"], *judging.seeds_of_training(earlier)})
    about["seeds"] = ", ".join(map(str, seeds))
    marks = judging.starts_of(environment.study, environment.label, environment.episodes)
    marks |= judging.from_text(earlier.get("starts", ""))
    others = [entry for entry in model.metadata_props if entry.key != TRAINED]
    del model.metadata_props[:]
    model.metadata_props.extend(others)
    entry = model.metadata_props.add()
    entry.key, entry.value = TRAINED, json.dumps(about | {"starts": judging.as_text(marks)})
    with refusals(path, "written"):
        replace_file(path, model.SerializeToString())
    return about


def _recorded(model: Any) -> dict[str, Any]:
    """Return what a file records of earlier trainings, which went on with this one."""
    for entry in model.metadata_props:
        if entry.key == TRAINED:
            with suppress(ValueError, RecursionError):
                about = json.loads(entry.value)
                return about if isinstance(about, dict) else {}
    return {}
