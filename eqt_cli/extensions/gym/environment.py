"""An experiment as a vector environment of Gymnasium, and how it is made from a configuration."""

from __future__ import annotations

import os
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from eqt_cli.api.loading import Configuration, document_from
from eqt_cli.base import purposes, yaml_source
from eqt_cli.base.arrays import Array
from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.base.extensions import function_for, functions_for
from eqt_cli.base.version import __version__
from eqt_cli.config.document import Document, changed_at, overridden
from eqt_cli.config.study import Study, study
from eqt_cli.engines.engine import Problem
from eqt_cli.engines.native import Native, programs
from eqt_cli.extensions.gym import laws, policy
from eqt_cli.extensions.gym.judging import seed_of_training
from eqt_cli.extensions.gym.registration import register
from eqt_cli.extensions.gym.rewards import (
    Evaluated,
    Function,
    FunctionReward,
    MetricReward,
    is_integral,
    plain,
    signal_program,
    signals_of,
)
from eqt_cli.extensions.gym.sources import text_of
from eqt_cli.extensions.gym.stepping import Episodes, Plant
from eqt_cli.extensions.network.network import UNTRAINED
from eqt_cli.loop.bounds import bounds_of
from eqt_cli.numbers.leaves import leaves
from eqt_cli.runs.batches import batches_at

try:
    import gymnasium
    from gymnasium.vector import AutoresetMode, VectorEnv
    from gymnasium.vector.utils import batch_space
except ImportError:
    raise EqtError(
        "eqt_cli.gym needs Gymnasium, which is not installed; pip install '.[gym]'"
    ) from None

USUAL = "policy.onnx"
"""The file of a policy where the configuration names none."""

MODES = {"same_step": AutoresetMode.SAME_STEP, "disabled": AutoresetMode.DISABLED}

OPTIONS = "a mapping with reset_mask or runs"

FLOATS = float, "float32", "float64", np.float32, np.float64
"""Types of observations: an integer would cut their fractions."""

KEYS = "values by key, as {'control.period': 0.02}"

LABEL = "the label of a network"

FUNCTION = "a function of the signals, as lambda x: x.pose_error > 1"

Reward = str | Function | None

Bound = tuple[str, float] | None
"""What laws may spend of a metric in the mean over runs, as in a task of the suite."""


def make(
    config: Configuration,
    num_envs: int = 64,
    seed: int | None = None,
    *,
    reward: Reward = None,
    cost: str | Function | None = None,
    terminated: Function | None = None,
    penalty: float | None = None,
    autoreset: str | AutoresetMode = "same_step",
    privileged: Sequence[str] = (),
    controller: str | None = None,
    law: laws.Written | None = None,
    overrides: Mapping[str, Any] | None = None,
    episodes: int = 4096,
    stagger: bool = False,
    dtype: Any = np.float32,
) -> Environment:
    """Return an experiment as a vector environment of Gymnasium.

    Its plant is that of `eqt run`: the same vehicle with its limits, lags, delays, noise and drawn
    numbers, the same reference, moved by the same compiled programs. A policy stands in the place
    of the law of ``kind: network``, whose `observes` and `commands` are its observations and
    actions; its file need not be there yet.

    Parameters
    ----------
    config
        A YAML file, a result, a configuration as a mapping, or the name of a task of the suite,
        as ``eqt-suite-2/quad_att``.
    num_envs
        Number of environments. Each call costs some tenths of a millisecond, so that fewer than 64
        are slow.
    seed
        Seed of all that is drawn in training. Default: the first one behind ``ensemble.seed`` that
        judges no law, because the experiment is to judge the policy by other runs.
    reward
        A stored metric by name, which counts negatively, or a function of a `Step`. Default:
        ``tune.objective`` of the configuration, or mean_pose_error. A function may return terms by
        name, whose sum is the reward; ``info["reward_terms"]`` has them, and as ``end`` what the
        end of an episode adds.
    cost
        A stored metric by name, or a function of a `Step`: ``info["cost"]`` has what a step spends
        of what a constraint bounds. Terms by name are in ``info["cost_terms"]``. No reward has it;
        `bounded` charges it, by default what a task of the suite or ``tune.equal`` bounds.
    terminated
        Function of a `Step` that says where an episode ends. Episodes also end beyond a bound of
        ``failed_when`` in the experiment, and where the state is no longer finite; they are
        truncated at ``time.duration``.
    penalty
        What is subtracted from the reward where an episode terminates. Default: as many times minus
        the reward of the last step as steps are left, so that it does not pay to end early.
    autoreset
        ``same_step``: an episode that ends is followed by the next one in the same step, and
        ``info["final_obs"]`` has its last observation. ``disabled``: the caller resets.
    privileged
        Signals and drawn numbers that ``info["privileged"]`` has, exactly: for a critic.
    controller
        Label of the law, where several are networks.
    law
        A network as a mapping, or in a YAML file as for `eqt suite`, in place of the laws: what it
        observes and commands. Default of a task: it observes the errors, and commands a wrench.
    overrides
        Values by key, as of `load_experiment`.
    episodes
        Number of runs of the experiment, from 0 on, that episodes are taken from at random. An
        episode has the start and the drawn numbers of one, and the sensor errors of another one.
    stagger
        Whether the first episodes after a `reset` of all end at different times, so that few end
        together; not of one with given ``runs``.
    dtype
        Type of the observations.

    Returns
    -------
    Environment
        A `gymnasium.vector.VectorEnv`.

    Raises
    ------
    EqtError
        If the experiment cannot be stepped so, or an argument is wrong.

    Examples
    --------
    >>> env = eqt_cli.gym.make("examples/gym/attitude.yaml", num_envs=2, episodes=4)
    >>> observation, info = env.reset(seed=0)
    >>> observation.shape, env.action_space.shape
    ((2, 12), (2, 3))
    """
    _expect(isinstance(overrides, Mapping | None), "overrides", KEYS, overrides)
    _expect(isinstance(controller, str | None), "controller", LABEL, controller)
    settings = {
        f"overrides[{k!r}]": f"{k}={yaml_source.flow(v)}" for k, v in (overrides or {}).items()
    }
    document, objective, equal, judges = _experiment(config, law, settings)
    document, label = _for_training(document, controller)
    judges["ensemble.seed"] = int((document.data.get("ensemble") or {}).get("seed", 0))
    for further in functions_for(purposes.seeds_of_judges):
        judges.update(further(document))
    seed = seed_of_training(judges, seed)
    for name, count in (("num_envs", num_envs), ("episodes", episodes)):
        _whole(count, name)
    is_number = isinstance(penalty, int | float | np.number) and not isinstance(penalty, bool)
    _expect(
        penalty is None or (is_number and 0 <= penalty < np.inf),
        "penalty",
        "a number from 0",
        penalty,
    )
    _expect(terminated is None or callable(terminated), "terminated", FUNCTION, terminated)
    is_cost = cost is None or isinstance(cost, str) or callable(cost)
    _expect(is_cost, "cost", f"the name of a metric, or {FUNCTION}", cost)
    is_list = isinstance(privileged, list | tuple) and all(isinstance(x, str) for x in privileged)
    _expect(is_list, "privileged", "a list of names", privileged)
    is_type = isinstance(dtype, str | type | np.dtype)
    _expect(is_type and dtype in FLOATS, "dtype", "np.float32 or np.float64", dtype)
    if str(autoreset) not in (*MODES, *map(str, MODES.values())):
        raise EqtError(
            f"autoreset: expected 'same_step' or 'disabled', got {autoreset!r}; in the mode "
            "NEXT_STEP, every episode has a step without an action"
        )
    document = changed_at(document, ("ensemble", "seed"), seed, "seed")
    trained = study(document)
    usual = objective if isinstance(objective, str) else "mean_pose_error"
    bound = next(((name, most) for name, most in equal.items() if is_integral(name)), None)
    return Environment(
        trained,
        label,
        num_envs,
        Episodes(problem_of(trained, label, episodes)),
        reward=usual if reward is None else reward,
        cost=cost,
        bound=bound if bound and cost in (None, bound[0]) else None,
        terminated=terminated,
        penalty=penalty,
        mode=MODES.get(str(autoreset), autoreset),
        privileged=privileged,
        stagger=stagger,
        dtype=dtype,
    )


def _again(
    document: Document, label: str, num_envs: int, episodes: int, options: dict[str, Any]
) -> Environment:
    """Return an environment as another one was made."""
    trained = study(document)
    drawn = Episodes(problem_of(trained, label, episodes))
    return Environment(trained, label, num_envs, drawn, **options)


def _whole(value: Any, name: str, least: int = 1) -> None:
    if not isinstance(value, int | np.integer) or isinstance(value, bool) or value < least:
        raise EqtError(f"{name}: expected a whole number from {least}, got {value!r}")


def _expect(is_right: bool, name: str, what: str, value: Any) -> None:
    if not is_right:
        raise EqtError(f"{name}: expected {what}, got {value!r}")


def _conditions(terms: Mapping[str, Array]) -> None:
    """Refuse an end that is no condition."""
    value = next(iter(terms.values()))
    if terms.keys() != {""} or ((value != 0) & (value != 1)).any():
        raise EqtError(
            "terminated: expected a condition, as x.pose_error > 1, got "
            + (f"the number {value[0]}" if terms.keys() == {""} else "terms")
        )


def _numbers(values: Any, expected: str) -> Array:
    try:
        return np.array(plain(values), dtype=float)
    except (TypeError, ValueError, OverflowError) as error:
        raise EqtError(f"{expected} that are numbers, in rows of one length: {error}") from error


def _array(values: Any, name: str) -> Array:
    try:
        return plain(values)
    except (TypeError, ValueError) as error:
        raise EqtError(f"{name}: {error}") from error


def _path(path: Any) -> Path:
    _expect(isinstance(path, str | os.PathLike), "path", "a file", path)
    return Path(path)


NAMED = re.compile(r"eqt-suite-[0-9]+/\w+")
"""The name of a task of the suite."""


def _experiment(
    config: Configuration, law: laws.Written | None, settings: Mapping[str, str]
) -> tuple[Document, Any, Mapping[str, float], dict[str, int]]:
    """Return a configuration or a named task, what it makes small and bounds, and its seeds."""
    if isinstance(config, str) and NAMED.fullmatch(config):
        document, place, objective, equal, seeds = function_for(purposes.task_by_name)(config)
        document = overridden(laws.with_law(document, place, law), settings)
        return document, objective, equal, dict(seeds)
    document = document_from(config, settings)
    if law is not None:
        document = replace(document, data=document.data | {"controllers": [None]})
        document = laws.with_law(document, ("controllers", 0), law)
    tune = document.data.get("tune") or {}
    equal = {k: x for k, x in (tune.get("equal") or {}).items() if isinstance(x, int | float)}
    return document, tune.get("objective"), equal, {}


def _for_training(document: Document, controller: str | None) -> tuple[Document, str]:
    """Return an experiment of its network alone, without a file, and its label."""
    data, name = document.data, document.path
    networks = [
        law
        for law in data.get("controllers") or []
        if isinstance(law, dict) and law.get("kind") == laws.KIND
    ]
    labels = [str(law.get("label", laws.KIND)) for law in networks]
    if not networks:
        raise EqtError(
            f"{name}: controllers: expected a law of kind: network, whose `observes` and "
            "`commands` say what the policy reads and gives; add one (docs/howto/train.md)"
        )
    if controller is None and len(networks) > 1:
        raise EqtError(
            f"{name}: has {len(networks)} networks: {', '.join(labels)}; choose one by `controller`"
        )
    if controller is not None and controller not in labels:
        raise EqtError(
            f"controller: expected one of {', '.join(labels)}, got {controller!r}"
            f"{suggestion(controller, labels)}"
        )
    if data.get("sweep"):
        raise EqtError(
            f"{name}: has a sweep, and an environment is of one experiment; leave `sweep` out, and "
            "draw the numbers that vary between episodes, as in plant: {inertia: …}"
        )
    law = dict(networks[labels.index(controller) if controller else 0])
    law.pop("memory", None)
    law = {"label": labels[0] if controller is None else controller, **law}
    law["file"] = str(law.get("file") or USUAL)
    solver = dict(data.get("solver") or {})
    if (engine := solver.get("engine", "native")) not in ("native", "auto"):
        raise EqtError(
            f"{name}: solver.engine: {engine}, and an environment is stepped by compiled code; "
            "leave it out, or write native"
        )
    solver["engine"] = "native"
    changed = data | {"controllers": [law], "solver": solver}
    home = replace(document.home, files={**document.home.files, law["file"]: UNTRAINED})
    return replace(document, data=changed, home=home), law["label"]


def problem_of(experiment: Study, label: str, runs: int) -> Problem:
    """Return the first runs of an experiment as a problem."""
    _check(experiment.document.path, experiment.base.loops[label])
    (batch,) = batches_at(experiment, label, np.zeros(runs, int), np.arange(runs))
    return batch.problem  # with its samples: an instant that equals one but for rounding is that


def _check(name: str, loop: Any) -> None:
    """Refuse a loop that is not stepped yet."""
    vehicle = loop.vehicle
    if vehicle.solves:
        raise EqtError(
            f"{name}: actuators: a solver distributes the torque at each instant, and an "
            "environment calls compiled code only; let the policy command the thrusts (commands: "
            "{as: rotors}), or use another actuator"
        )
    if vehicle.clocks:
        raise EqtError(
            f"{name}: control: not all parts act at each tick ({', '.join(vehicle.clocks)}), and "
            "an environment has one rate; give all one period, and delays in whole periods"
        )
    if vehicle.estimates:
        raise EqtError(
            f"{name}: estimator: an environment has measurements only; leave the estimator out, "
            "or train without it and judge with it"
        )
    programs(loop)  # raises where it cannot be compiled


class Environment(VectorEnv[Array, Array, Array]):
    """Runs of an experiment that a policy steps, a control period at a time; see `make`.

    Attributes
    ----------
    study
        The experiment of the training, with one law.
    label
        Its label.
    bound
        What laws may spend of a metric in the mean over runs, as in a task of the suite; or None.
    training_seed
        Seed of all that is drawn.
    episodes
        Number of runs that episodes are taken from.
    runs : (num_envs,)
        The run of the experiment that each environment is.
    """

    def __init__(
        self,
        experiment: Study,
        label: str,
        num_envs: int,
        episodes: Episodes,
        *,
        reward: str | Function,
        cost: str | Function | None = None,
        bound: Bound = None,
        terminated: Function | None = None,
        penalty: float | None = None,
        mode: Any = AutoresetMode.SAME_STEP,
        privileged: Sequence[str] = (),
        stagger: bool = False,
        dtype: Any = np.float32,
    ) -> None:
        self.study, self.label, self.num_envs = experiment, label, num_envs
        self.metadata = {"autoreset_mode": mode, "render_modes": []}
        self.training_seed = experiment.base.config.ensemble.seed
        self.episodes = len(episodes.states)
        self._penalty, self._stagger = penalty, stagger
        self._options = {
            "reward": reward,
            "cost": cost,
            "bound": bound,
            "terminated": terminated,
            "penalty": penalty,
            "mode": mode,
            "privileged": privileged,
            "stagger": stagger,
            "dtype": dtype,
        }
        problem = problem_of(experiment, label, 1)
        engine = experiment.base.engine
        assert isinstance(engine, Native)
        self._episodes, self._engine = episodes, engine
        self.plant = Plant(problem, engine, episodes, num_envs)
        limit = problem.loop.controller.commands_.clip  # type: ignore[attr-defined]
        self._limit, most = limit, np.float32(np.inf if limit is None else limit)
        actions, observations = (self.plant.actions,), (self.plant.observations,)
        self.single_action_space = gymnasium.spaces.Box(-most, most, actions, np.float32)
        self.single_observation_space = gymnasium.spaces.Box(-np.inf, np.inf, observations, dtype)
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        self._last = np.zeros((num_envs, *actions))
        self._rewards, self._costs = np.zeros((2, num_envs))
        self._observed = np.zeros((num_envs, *observations))
        self._begun, self._places = np.zeros(num_envs, np.uint64), np.arange(num_envs)
        self._order = np.full(num_envs, self.training_seed, np.uint64)
        self._ended, self._started = np.zeros(num_envs, bool), False
        self.runs, self._horizon = np.zeros((2, num_envs), np.int64)
        self._signals = dict[str, Any]()
        self._ends = [Evaluated(self.plant, terminated, "terminated")] if terminated else []
        for end in self._ends:
            _conditions(end.trial.values)
        self.cost = self._counting(cost, "cost") if cost else None
        self.bound = bound
        self._steps = 0
        self._fails = list[Evaluated]()
        if bounds_of_errors := experiment.base.config.failed_when:
            bounds = bounds_of(bounds_of_errors, problem.loop)
            crossed = Evaluated(self.plant, lambda x: bounds.crossed(x.__getattr__), "failed_when")
            self._fails.append(crossed)
        self.terminated_text = "" if terminated is None else text_of(terminated)
        self._privileged = tuple(privileged)
        for name in self._privileged:
            if name not in self.offered:
                raise EqtError(
                    f"privileged: unknown name '{name}'{suggestion(name, self.offered)}; this "
                    f"experiment has {', '.join(self.offered)}"
                )
        self.set_reward(reward)

    def set_reward(self, reward: str | Function) -> None:
        """Set the reward from the next step on; a function is compiled with its numbers of now."""
        _expect(
            isinstance(reward, str) or callable(reward),
            "reward",
            "the name of a metric, or a function of the signals, as lambda x: -x.pose_error",
            reward,
        )
        self._reward, self.reward = reward, self._counting(reward, "reward")

    def set_cost(self, cost: str | Function) -> None:
        """Set what ``info["cost"]`` has from the next step on, as `cost` of `make`."""
        self._options["cost"], counted = cost, self._counting(cost, "cost")
        counted.begin(slice(None))
        self.cost = counted

    def _counting(self, counted: str | Function, what: str) -> MetricReward | FunctionReward:
        if isinstance(counted, str):
            return MetricReward(self.plant, counted, what)
        return FunctionReward(self.plant, counted, what)

    # Copies in other processes: what is compiled is made again there.

    def __reduce__(self) -> Any:
        """Return how the environment is made again, and where its episodes are."""
        if isinstance(self._reward, str) or self._reward is not self._options["reward"]:
            self._options["reward"] = self._reward
        of = self.study.document, self.label, self.num_envs, self.episodes, self._options
        before = [getattr(counted, "_before", None) for counted in self._counted]
        state = {name: getattr(self, name) for name in STATE}, self.plant.moments, before
        return _again, of, state

    def __setstate__(self, state: tuple[dict[str, Any], dict[str, Any], Any]) -> None:
        """Continue the episodes of another environment."""
        attributes, moments, before = state
        vars(self).update(attributes)
        self.plant.moments = moments
        for counted, values in zip(self._counted, before, strict=True):
            if values is not None:
                counted._before = values  # type: ignore[union-attr]

    @property
    def _counted(self) -> list[MetricReward | FunctionReward]:
        """The reward, and the cost if there is one."""
        return [self.reward, *([self.cost] if self.cost else [])]

    # Episodes.

    def reset(
        self, *, seed: int | Sequence[int] | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Array, dict[str, Any]]:
        """Begin new episodes.

        Parameters
        ----------
        seed
            Seed of the order in which episodes follow; the episodes are those of `make`. A list has
            one for each environment, and equal ones give equal orders.
        options
            ``reset_mask``: which environments begin anew; all by default. ``runs``: the run of the
            experiment that each of these is, with its own sensor errors.
        """
        self._check_open("reset")
        self._repeat_trials()
        _expect(isinstance(options, Mapping | None), "options", OPTIONS, options)
        options = dict(options or {})
        if seed is not None:
            self._begin_orders(seed)
        super().reset(seed=None if seed is None or np.ndim(seed) else int(seed))  # type: ignore[arg-type]
        mask = options.pop("reset_mask", None)
        which = np.arange(self.num_envs) if mask is None else self._masked(mask)
        runs = options.pop("runs", None)
        if options:
            raise EqtError(f"options: unknown '{next(iter(options))}'; known: reset_mask, runs")
        self._begin(which, None if runs is None else self._runs(runs, len(which)))
        if self._stagger and mask is None and runs is None:
            # Of the first episodes only the ends differ: motion and reference begin as always.
            left = _hashed(self._order, self._places, 0, FIRST_END)
            self._horizon = 1 + (left % np.uint64(self.plant.ticks)).astype(int)
        self._started = True
        np.copyto(self._observed, self.plant.observe(), where=~self.plant.failed[:, None])
        return self._observations(), self._info()

    def _begin_orders(self, seed: Any) -> None:
        """Set the order of episodes of each environment, by one seed or one of each."""
        is_list = isinstance(seed, list | tuple | np.ndarray)
        if is_list and len(seed) != self.num_envs:
            raise EqtError(
                f"seed: expected a whole number, or {self.num_envs} of them, got {len(seed)}"
            )
        for one in seed if is_list else [seed]:
            _whole(one, "seed", least=0)
        self._order[:] = [int(one) % 2**64 for one in seed] if is_list else int(seed) % 2**64
        self._places[:] = 0 if is_list else np.arange(self.num_envs)
        self._begun[:] = 0

    def _begin(self, which: Array, runs: Array | None) -> None:
        """Begin these environments anew: as these runs, or as runs drawn for each by itself."""
        rows: Any = runs
        if runs is None:
            count, self._begun[which] = self._begun[which], self._begun[which] + np.uint64(1)
            sizes = len(self._episodes.states), self._episodes.rows
            runs, rows = (
                (
                    _hashed(self._order[which], self._places[which], count, salt) % np.uint64(size)
                ).astype(int)
                for salt, size in zip((START, ERRORS), sizes, strict=True)
            )
        self.plant.begin(which, runs, np.minimum(rows, self._episodes.rows - 1))
        self.runs[which], self._last[which] = runs, 0.0
        self._rewards[which] = self._costs[which] = 0.0
        self._horizon[which], self._ended[which] = self.plant.ticks, False
        for counted in self._counted:
            counted.begin(which)

    def _masked(self, mask: Any) -> Array:
        mask = _array(mask, "reset_mask")
        if mask.shape != (self.num_envs,) or mask.dtype != bool:
            raise EqtError(
                f"reset_mask: expected {self.num_envs} booleans, got {mask.dtype} of shape "
                f"{mask.shape}"
            )
        if not self._started:
            raise EqtError("reset_mask: call reset() for all environments first")
        return np.flatnonzero(mask)

    def _runs(self, runs: Any, count: int) -> Array:
        runs = _array(runs, "runs")
        most = min(len(self._episodes.states), max(self._episodes.rows, 1))
        most = most if self._episodes.errors else len(self._episodes.states)
        if (
            runs.shape != (count,)
            or runs.dtype.kind not in "iu"
            or not ((runs >= 0) & (runs < most)).all()
        ):
            raise EqtError(
                f"runs: expected {count} whole numbers from 0 to {most - 1}, got {runs!r}; "
                "`episodes` of make says how many there are"
            )
        return runs

    # Steps.

    def step(self, actions: Any) -> tuple[Array, Array, Array, Array, dict[str, Any]]:
        """Move every environment by a control period.

        Actions are clipped to `clip` of `commands`, as those of a network are.
        """
        action = self._checked(actions)
        plant, self._steps = self.plant, self._steps + 1
        if self._steps % REPEATED == 0:
            self._repeat_trials()
        moves = ~plant.waits
        plant.act(action)
        for counted in self._counted:
            counted.after_instant()
        plant.advance()
        failed = plant.failed
        crossed = self._any_of(self._fails, action) & moves & ~failed
        reward = self.reward(action, self._last)
        reward = self._number(reward, self._rewards, failed, moves, "reward")
        numbers = self._costs_of(action, failed, moves) if self.cost else {}
        terminated = failed | crossed | (self._any_of(self._ends, action) & moves & ~failed)
        self._last[moves] = action[moves]
        truncated = (plant.tick >= self._horizon) & ~terminated
        if terminated.any():
            reward = np.where(terminated, self._at_end(reward), reward)
        if terms := self.reward.terms:
            terms = {name: np.where(moves & ~failed, x, 0.0) for name, x in terms.items()}
            numbers["reward_terms"] = terms | {"end": reward - sum(terms.values())}
        now = plant.observe()
        np.copyto(self._observed, now, where=~failed[:, None])
        self._ended = terminated | truncated
        info = {}
        if self._ended.any() and self.metadata["autoreset_mode"] is AutoresetMode.SAME_STEP:
            info = self._followed(np.flatnonzero(self._ended), failed | crossed)
        return self._observations(), reward, terminated, truncated, info | numbers | self._info()

    def _number(self, value: Array, last: Array, failed: Array, moves: Array, what: str) -> Array:
        """Return a reward or a cost of this step: of a failed run, that of the step before."""
        value = np.where(moves, np.where(failed, last, value), 0.0)
        if not np.isfinite(value).all():
            place = int(np.flatnonzero(~np.isfinite(value))[0])
            raise EqtError(
                f"{what}: is {value[place]} in environment {place}, at {self.plant.time[place]:g} "
                "s; give a number there, too"
            )
        last[:] = value
        return value

    def _costs_of(self, action: Array, failed: Array, moves: Array) -> dict[str, Any]:
        """Return what `info` has of the costs of this step."""
        assert self.cost is not None
        value = self.cost(action, self._last)
        value = self._number(value, self._costs, failed, moves, "cost")
        terms = {name: np.where(moves, x, 0.0) for name, x in self.cost.terms.items()}
        return {"cost": value} | ({"cost_terms": terms} if terms else {})

    def _repeat_trials(self) -> None:
        """Refuse functions that give other numbers than when they were set."""
        counted = [x.function for x in self._counted if isinstance(x, FunctionReward)]
        for function in (*counted, *self._ends):
            function.trial.repeat()

    def _any_of(self, conditions: Sequence[Evaluated], action: Array) -> Array:
        """Return whether any of these conditions holds, of each run."""
        holds = np.zeros(self.num_envs, bool)
        for condition in conditions:
            value = condition(action, self._last)[""]
            holds |= (value != 0) & ~np.isnan(value)
        return holds

    def _checked(self, actions: Any) -> Array:
        """Return actions as floats, within their limits."""
        self._check_open("step")
        if not self._started:
            raise EqtError("step: call reset() first")
        if self._ended.any():
            raise EqtError(
                f"step: environment {int(np.flatnonzero(self._ended)[0])} has ended; begin it anew "
                "by reset(options={'reset_mask': terminated | truncated})"
            )
        action = _numbers(actions, "step: expected actions")
        if action.shape != self._last.shape:
            raise EqtError(
                f"step: expected actions of shape {self._last.shape}, got {action.shape}"
            )
        if not np.isfinite(action).all():
            place = int(np.flatnonzero(~np.isfinite(action).all(axis=1))[0])
            raise EqtError(
                f"step: the action of environment {place} is not finite: {action[place]}"
            )
        return action if self._limit is None else np.clip(action, -self._limit, self._limit)

    def _check_open(self, what: str) -> None:
        if self.closed:
            raise EqtError(f"{what}: the environment is closed; make another one")

    def _at_end(self, reward: Array) -> Array:
        """Return the rewards of steps that terminate an episode."""
        if self._penalty is not None:
            return reward - self._penalty
        return reward + np.minimum(reward, 0.0) * (self._horizon - self.plant.tick)

    def _followed(self, ended: Array, failed: Array) -> dict[str, Any]:
        """Begin the next episodes; return what is known of the last ones."""
        last: Any = np.full(self.num_envs, None, dtype=object)
        rows = self._observed[ended].astype(self.single_observation_space.dtype)
        for place, row in zip(ended.tolist(), rows, strict=True):
            last[place] = row
        mask = self._ended.copy()
        about = self._info() | {"failed": failed, "_failed": mask, "_run": mask}
        self._begin(ended, None)
        self._observed[ended] = self.plant.observe(ended)
        return {"final_obs": last, "_final_obs": mask, "final_info": about, "_final_info": mask}

    def _observations(self) -> Array:
        return self._observed.astype(self.single_observation_space.dtype)

    def _info(self) -> dict[str, Any]:
        info: dict[str, Any] = {"run": self.runs.copy(), "_run": np.ones(self.num_envs, bool)}
        if self._privileged:
            info["privileged"] = {name: self.exactly(name) for name in self._privileged}
        return info

    # What a critic may be told, and a policy may not.

    @cached_property
    def _numbers(self) -> dict[str, slice]:
        """Columns of the parameters that differ from run to run, by their places."""
        numbers, at = dict[str, slice](), 0
        rows = self._episodes.parameters
        for path, values in leaves(self.plant.loop).items():
            if (rows[:, at : at + values.size] != rows[0, at : at + values.size]).any():
                numbers[path.removeprefix("vehicle.")] = slice(at, at + values.size)
            at += values.size
        return numbers

    @property
    def offered(self) -> list[str]:
        """Names of exact signals and of drawn numbers."""
        return [*signals_of(self.plant.loop), *self._numbers]

    def exactly(self, name: str) -> Array:
        """Return a signal or drawn numbers of each environment now, by a name that is `offered`."""
        _expect(isinstance(name, str), "exactly", "the name of a signal", name)
        if name in self._numbers:
            return self.plant.parameters[:, self._numbers[name]].copy()
        if name not in self._signals:
            self._signals[name] = signal_program(self.plant, name, "exactly")
        return self.plant.evaluate(*self._signals[name])[name]

    # The way to the verdict.

    def of_runs(self, episodes: Episodes) -> Environment:
        """Return environments for episodes of the same loop, with 64-bit observations."""
        other = Environment(
            self.study,
            self.label,
            len(episodes.states),
            episodes,
            reward=self._reward,
            cost=self.bound[0] if self.bound else None,
            bound=self.bound,
            mode=AutoresetMode.DISABLED,
            dtype=np.float64,
        )
        other._fails = []  # all runs are compared to their end
        return other

    @property
    def training(self) -> dict[str, Any]:
        """What a file records of the training: experiment, seed, reward, ends of episodes."""
        config = self.study.base.config
        return {
            "experiment": config.name,
            "seed": self.training_seed,
            "reward": self.reward.text,
            "cost": self.cost.text if self.cost else "",
            "terminated": self.terminated_text,
            "period": self.plant.period,
            "version": __version__,
        }

    def record(self, path: str | os.PathLike[str]) -> dict[str, Any]:
        """Write what a policy was trained for into the metadata of its ONNX file, and return it.

        `eqt compare` then refuses to judge the policy by the runs of its training.
        """
        return policy.record(self, _path(path))

    def write_law(self, path: str | os.PathLike[str], file: str) -> None:
        """Write the law that the policy becomes, as `eqt suite` and ``law`` of `make` take it.

        Parameters
        ----------
        path
            The YAML file to write.
        file
            The exported network, relative to it.
        """
        _expect(isinstance(file, str), "file", "the name of a network's file", file)
        laws.write(_path(path), file, self.study.document.data["controllers"][0])

    def check(
        self,
        path: str | os.PathLike[str],
        function: Callable[[Array], Any] | None = None,
        *,
        runs: int = 20,
    ) -> float:
        """Assert that `eqt run` flies the policy of a file as this environment does.

        Parameters
        ----------
        path
            The exported network.
        function
            The policy as it was trained, from observations ``(runs, n)``, 32 bits, to actions. Its
            actions are compared with those of the file.

        Returns
        -------
        float
            The largest difference of poses, relative where they are above 1.

        Raises
        ------
        EqtError
            If they differ, if the function differs from the file, or if the file does not fit.
        """
        _whole(runs, "runs")
        _expect(function is None or callable(function), "function", "a function or None", function)
        return policy.check(self, _path(path), function, runs)


STATE = (
    *("_last", "_rewards", "_costs", "_observed", "_begun", "_order", "_places", "_ended"),
    *("_started", "runs", "_horizon", "_steps"),
)
"""Attributes of an environment that its steps change."""

REPEATED = 1000
"""After so many steps, functions of the user are tried again."""

register()  # by name, with Gymnasium

FIRST_END, START, ERRORS = range(3)
"""What is drawn of an episode."""


def _hashed(seeds: Array, which: Array, count: Any, salt: int) -> Array:
    """Return 64 bits for each environment, by SplitMix64: they depend on no other environment."""
    word = np.array(seeds, np.uint64)
    for part in (np.asarray(which, np.uint64), np.asarray(count, np.uint64), np.uint64(salt)):
        word = (word ^ part) + np.uint64(0x9E3779B97F4A7C15)
        word = (word ^ (word >> np.uint64(30))) * np.uint64(0xBF58476D1CE4E5B9)
        word = (word ^ (word >> np.uint64(27))) * np.uint64(0x94D049BB133111EB)
        word ^= word >> np.uint64(31)
    return word
