"""An experiment as a vector environment: bits of runs, Gymnasium's rules, rewards, slips."""

import random
from types import SimpleNamespace

import numpy as np
import pytest
from policies import POLICY, attitude
from said import error_of, says

import eqt_cli
from eqt_cli.engines.engine import hurried
from eqt_cli.extend import less

gymnasium = pytest.importorskip("gymnasium", reason="needs the extra gym")


def make(**options):
    config = options.pop("config", None) or attitude()
    return eqt_cli.gym.make(config, **{"num_envs": 5, "episodes": 8, **options})


@pytest.fixture(scope="module", autouse=True)
def _little():
    """Compile fast: no test takes many steps."""
    with hurried():
        yield


@pytest.fixture(scope="module")
def env():
    return make()


def policy(observations):
    """Some smooth function, within the limits and beyond."""
    k = np.arange(1, observations.shape[1] + 1)
    return np.stack([1.5 * np.sin(observations @ (k + j)) for j in range(3)], axis=-1)


def flown(env, steps, **options):
    """Observations and rewards of some steps under the policy."""
    observed, rows = env.reset(**options)[0], []
    for _ in range(steps):
        observed, reward, *_ = env.step(policy(observed))
        rows.append(np.column_stack([observed, reward]))
    return np.array(rows)


def test_a_run_has_the_same_bits_in_any_company(env):
    """Its episodes too, of which the fourth begins while others are under way."""
    many, few = make(num_envs=9, seed=4), make(num_envs=2, seed=4)
    together, alone = (flown(each, 50, seed=3) for each in (many, few))
    assert (together[:, :2] == alone).all()
    observed = many.reset(seed=3)[0]
    for k in range(30):  # the first environment is set back twice
        if k in (7, 12):
            runs = {"reset_mask": np.arange(9) == 0, "runs": np.array([5])}
            observed = many.reset(options=runs)[0]
        observed = many.step(policy(observed))[0]
    late = observed[0]
    observed = few.reset(options={"runs": np.array([5, 1])})[0]
    for _ in range(18):
        observed = few.step(policy(observed))[0]
    assert (late == observed[0]).all()


def test_a_list_of_seeds_has_one_for_each_environment_and_a_mask_may_be_empty(env):
    """As in Gymnasium's environments: an order of episodes belongs to its seed, not to a place."""
    first = env.reset(seed=[4, 7, 4, 2**63, 7])[0]
    assert (first[[0, 1]] == first[[2, 4]]).all()
    assert (first[0] != first[1]).any()
    runs = env.runs.copy()
    env.reset(options={"reset_mask": np.zeros(5, bool)})
    assert (env.runs == runs).all()
    assert (env.reset(seed=[7, 4, 3, 3, 7])[0][[0, 1]] == first[[1, 0]]).all()


def test_rewards_are_minus_the_metric_of_a_run(env, tmp_path):
    """By a plain program from the trajectory: trapezoids between instants."""
    env.reset(options={"runs": np.arange(5)})
    errors, rewards = [env.exactly("pose_error")], []
    for _ in range(env.plant.ticks - 1):
        rewards.append(env.step(np.zeros((5, 3)))[1])
        errors.append(env.exactly("pose_error"))
    means = (np.array(errors)[1:] + np.array(errors)[:-1]) / 2
    assert -np.array(rewards) == pytest.approx(means, rel=1e-12)  # rounding


def test_an_episode_is_followed_by_the_next_one_in_the_same_step(env):
    first = env.reset(seed=1)[0]
    for _ in range(env.plant.ticks - 1):
        *_, terminated, truncated, info = env.step(np.zeros((5, 3)))
        assert not (terminated | truncated).any()
        assert "final_obs" not in info
    observed, _, terminated, truncated, info = env.step(np.zeros((5, 3)))
    assert truncated.all()
    assert not terminated.any()
    assert (env.plant.tick == 0).all()
    assert all((last != now).any() for last, now in zip(info["final_obs"], observed, strict=True))
    assert info["_final_obs"].all()
    assert (env.reset(seed=1)[0] == first).all()
    assert (env.reset(seed=2)[0] != first).any()


def test_without_autoreset_the_caller_begins_episodes_anew():
    env = make(autoreset="disabled", terminated=lambda x: x.t > 0.1 * (x.pose_error > 0))
    assert env.metadata["autoreset_mode"] is gymnasium.vector.AutoresetMode.DISABLED
    plain = make(autoreset="disabled")
    env.reset(seed=0), plain.reset(seed=0)
    for _ in range(11):
        _, reward, terminated, _, _ = env.step(np.zeros((5, 3)))
        usual = plain.step(np.zeros((5, 3)))[1]
    assert terminated.all()
    assert reward == pytest.approx(10 * usual, rel=1e-12)  # and of the nine steps that are left
    said = error_of(env.step, np.zeros((5, 3)))
    assert says(said, "step: environment 0 has ended…reset(options={'reset_mask': …")
    env.reset(options={"reset_mask": np.arange(5) < 4})
    assert "environment 4 has ended" in error_of(env.step, np.zeros((5, 3)))
    env.reset(options={"reset_mask": np.arange(5) == 4})
    env.step(np.zeros((5, 3)))


def test_it_is_an_environment_of_gymnasium(env):
    """What `check_env` asks of a single one, of all together."""
    assert isinstance(env, gymnasium.vector.VectorEnv)
    observed, info = env.reset(seed=0)
    assert env.observation_space.contains(observed)
    assert env.single_observation_space.shape == (15,)
    assert isinstance(info, dict)
    env.action_space.seed(0)
    action = env.action_space.sample()
    before = action.copy()
    given = env.step(action)
    assert env.observation_space.contains(given[0])
    assert (action == before).all()
    for values, kind in zip(given[1:4], (float, bool, bool), strict=True):
        assert values.shape == (5,)
        assert values.dtype == kind
    again = [env.reset(seed=0)[0], *env.step(action)[:4]]
    for one, other in zip(again, [observed, *given[:4]], strict=True):
        assert (one == other).all()
        assert not np.shares_memory(one, other)
    wrapped = gymnasium.wrappers.vector.RecordEpisodeStatistics(env)
    wrapped.reset(seed=0)
    for _ in range(env.plant.ticks):
        *_, info = wrapped.step(np.zeros((5, 3)))
    assert (info["episode"]["l"] == env.plant.ticks).all()


@pytest.mark.ci("loads an experiment")
def test_a_seed_repeats_staggered_ends_and_given_runs_are_whole():
    env = make(stagger=True)

    def ends(**options):
        env.reset(**options)
        return [env.step(np.zeros((5, 3)))[3].tolist() for _ in range(env.plant.ticks)]

    first = ends(seed=3)
    assert any(map(any, first[:-1]))
    assert ends(seed=3) == first
    whole = ends(options={"runs": np.arange(5)})
    assert not any(map(any, whole[:-1]))
    assert all(whole[-1])


@pytest.mark.ci("compiles a reward")
def test_functions_of_signals_are_compiled_where_they_can_be():
    compiled = make(reward=lambda x: -x.pose_error - (x.action * x.last_action).sum(axis=-1))
    assert compiled.reward.function.is_compiled
    plain = make(reward=lambda x: np.exp(-x.pose_error) + np.arctan2(x.t, 1.0))
    assert not plain.reward.function.is_compiled
    for env in (compiled, plain):
        env.reset(options={"runs": np.arange(5)})
    first, second = np.full((5, 3), 0.1), np.full((5, 3), 2.0)  # the latter beyond the limit of 1
    compiled.step(first), plain.step(first)
    rewards = compiled.step(second)[1], plain.step(second)[1]
    error = plain.exactly("pose_error")
    assert rewards[0] == pytest.approx(-error - 0.3, rel=1e-12)
    assert rewards[1] == pytest.approx(np.exp(-error) + np.arctan(0.02), rel=1e-12)


REWARDS = {
    "compared": (
        lambda x: -1.0 * ((x.pose_error > 2.5) | ~(x.t > 0.015)),
        lambda x: -float(x.pose_error > 2.5 or not x.t > 0.015),
    ),
    "counted": (
        lambda x: -(abs(x.action) >= 0.4).sum(axis=-1),
        lambda x: -sum(abs(a) >= 0.4 for a in x.action),
    ),
    "largest": (lambda x: -np.abs(x.action).max(axis=-1), lambda x: -max(map(abs, x.action))),
    "all": (
        lambda x: 1.0 * (abs(x.velocity) < 0.5).all(axis=-1),
        lambda x: float(all(abs(v) < 0.5 for v in x.velocity)),
    ),
    "chosen": (
        lambda x: np.where(x.pose_error > 2, -5.0, -np.exp(x.pose_error)),
        lambda x: -5.0 if x.pose_error > 2 else -np.exp(x.pose_error),
    ),
    "terms": (
        lambda x: {"error": -x.pose_error, "norm": -np.linalg.norm(x.velocity, axis=-1)},
        lambda x: -x.pose_error - np.sqrt(sum(v * v for v in x.velocity)),
    ),
}


@pytest.mark.ci("compiles rewards")
@pytest.mark.parametrize("name", REWARDS)
@pytest.mark.parametrize("count", [1, 3])
def test_a_reward_is_that_of_a_loop_over_environments(name, count):
    """Two of its numbers differ by the order of sums at most, and all are compiled."""
    reward, plainly = REWARDS[name]
    env = make(num_envs=count, reward=reward, cost=reward)
    assert env.reward.function.is_compiled
    env.reset(options={"runs": np.arange(count)})
    env.step(np.zeros((count, 3)))
    for action in np.random.default_rng(0).uniform(-1, 1, (3, count, 3)):
        _, values, _, _, info = env.step(action)
        rows = zip(env.exactly("pose_error"), env.exactly("velocity"), action, strict=True)
        t, names = env.plant.time[0], ("pose_error", "velocity", "action")
        steps = [SimpleNamespace(t=t, **dict(zip(names, row, strict=True))) for row in rows]
        assert values == pytest.approx([plainly(x) for x in steps], rel=1e-12)
        assert (info["cost"] == values).all()
        if name == "terms":
            terms = info["reward_terms"]
            assert [*terms] == ["error", "norm", "end"]
            assert sum(terms.values()) == pytest.approx(values, rel=1e-12)


@pytest.mark.ci("loads an experiment")
def test_a_reward_that_changes_what_it_reads_or_whose_numbers_change_is_refused():
    calls, weight = [], {"error": 1.0}

    def counting(x):
        calls.append(0)
        return -x.pose_error

    said = error_of(make, reward=counting)
    assert says(said, "reward: gives other numbers for the same step, since it…counts…")
    env = make(reward=lambda x: -weight["error"] * x.pose_error)
    weight["error"] = 2.0
    said = error_of(env.reset)
    assert says(said, "reward: gives … where it gave … when it was set…env.set_reward…")
    limit = 0.5
    env.set_reward(lambda x: -np.minimum(x.pose_error, limit))
    env.reset()
    assert env.training["reward"] == "-np.minimum(x.pose_error, limit), limit = 0.5"


@pytest.mark.ci("loads two experiments")
def test_what_is_privileged_is_exact_and_asked_for():
    env = make(privileged=["velocity", "inertia.matrix"])
    _, info = env.reset(options={"runs": np.arange(5)})
    drawn = info["privileged"]["inertia.matrix"]
    assert (drawn[:, 0] > 0.015).all()
    assert len({*drawn[:, 0]}) == 5
    assert info["privileged"]["velocity"].shape == (5, 3)
    assert "privileged" not in make().reset()[1]


SLIPS = {
    "no network": (
        {"config": attitude(controllers=["eqt"])},
        "config: controllers: expected a law of kind: network…docs/howto/train.md…",
    ),
    "two networks": (
        {"config": attitude(controllers=[POLICY, POLICY | {"label": "other"}])},
        "config: has 2 networks: policy, other; choose one by `controller`",
    ),
    "another label": (
        {"controller": "polcy"},
        "controller: expected one of policy, got 'polcy'…policy…",
    ),
    "no period": (
        {"config": attitude(control=None, sensors=None)},
        "controllers[0]: answers at control instants only; set control.period…",
    ),
    "a sweep": (
        {"config": attitude(sweep={"gains.kp": [1, 2]})},
        "config: has a sweep…one experiment…",
    ),
    "another engine": (
        {"config": attitude(solver={"engine": "solve_ivp"})},
        "config: solver.engine: solve_ivp…leave it out, or write native",
    ),
    "several rates": (
        {"config": attitude(control={"period": "10 ms", "delay": "5 ms"})},
        "config: control: …(control)…one rate…",
    ),
    "an estimator": (
        {"config": attitude(estimator={"kind": "invariant", "velocity_std": 0.1})},
        "config: estimator: …leave the estimator out…",
    ),
    "no environments": ({"num_envs": 0}, "num_envs: expected a whole number from 1, got 0"),
    "the judge's seed": ({"seed": 1}, "seed: 1 is ensemble.seed, …train by another one…"),
    "a mode": ({"autoreset": "next_step"}, "autoreset: expected 'same_step' or 'disabled'…"),
    "a metric": (
        {"reward": "mean_pose_eror"},
        "reward: mean_pose_eror: unknown metric…mean_pose_error…lambda x: -x.pose_error",
    ),
    "no sum": ({"reward": "final_pose_error"}, "reward: final_pose_error: is no mean…"),
    "a signal": (
        {"reward": lambda x: -x.pose_eror},
        "reward: this loop has no signal 'pose_eror'…pose_error…",
    ),
    "a compiled signal of no estimator": (
        {"reward": lambda x: -x.estimate_error},
        "reward: this loop has no signal 'estimate_error'…did you mean 'pose_error'?…there are: …",
    ),
    "an end that no number reaches": (
        {"terminated": lambda x: less(1.0, x.bias_error)},
        "terminated: this loop has no signal 'bias_error'…there are: pose, velocity…",
    ),
    "a metric of another group": (
        {"reward": "mean_pointing_error"},
        "reward: mean_pointing_error: this loop has no signal 'pointing_error'…mean_pose_error…",
    ),
    "a shape": (
        {"reward": lambda x: -np.abs(x.velocity)},
        "reward: expected a number for each run, of shape (2,), got …(2, 3)…",
    ),
    "no function": ({"reward": 3}, "reward: expected the name of a metric, or…got 3"),
    "no condition": ({"terminated": True}, "terminated: expected a function…got True"),
    "a number as an end": (
        {"terminated": lambda x: x.pose_error},
        "terminated: expected a condition, as x.pose_error > 1, got the number …",
    ),
    "a sum over environments": (
        {"reward": lambda x: -(x.action**2).sum()},
        "reward: expected a number for each run, of shape (2,), got …shape ()…sum(axis=-1)",
    ),
    "one that mixes environments": (
        {"reward": lambda x: x.pose_error - x.pose_error.mean()},
        "reward: the number of an environment depends on the other environments…",
    ),
    "a random reward": (
        {"reward": lambda x: x.pose_error + random.random()},
        "reward: gives other numbers for the same step, since it draws random numbers…",
    ),
    "a word as a penalty": ({"penalty": "ten"}, "penalty: expected a number from 0, got 'ten'"),
    "no number": ({"penalty": np.nan}, "penalty: expected a number from 0, got nan"),
    "whole numbers": ({"dtype": int}, "dtype: expected np.float32 or np.float64, got …int…"),
    "a type": ({"dtype": "flat"}, "dtype: expected np.float32 or np.float64, got 'flat'"),
    "no list": ({"privileged": "velocity"}, "privileged: expected a list of names…'velocity'"),
    "no function of a step": (
        {"reward": lambda: 0},
        "reward: the function fails: TypeError: …takes 0 positional…one argument…",
    ),
    "an if": (
        {"reward": lambda x: -1 if x.pose_error > 1 else 0},
        "reward: the function fails: ValueError…np.where…",
    ),
    "an empty reward": ({"reward": ""}, "reward: : unknown metric…"),
    "keys as a list": (
        {"overrides": ["control.period=0.02"]},
        "overrides: expected values by key, as {'control.period': 0.02}, got […]",
    ),
    "a number of a law": ({"controller": 3}, "controller: expected the label…got 3"),
    "one number": ({"privileged": [3]}, "privileged: expected a list of names, got [3]"),
    "a privilege": ({"privileged": ["mass"]}, "privileged: unknown name 'mass'…pose, velocity…"),
}


@pytest.mark.ci("loads an experiment for each")
@pytest.mark.parametrize("slip", SLIPS)
def test_a_slip_is_answered_with_a_sentence(slip):
    options, sentence = SLIPS[slip]
    said = error_of(make, **options)
    assert says(said, sentence), said


def test_slips_of_steps_are_answered_with_a_sentence(env):
    fresh = make()
    assert says(error_of(fresh.step, np.zeros((5, 3))), "step: call reset() first")
    env.reset(seed=0)
    assert says(error_of(env.step, np.zeros(3)), "step: expected actions of shape (5, 3), got (3,)")
    wrong = np.zeros((5, 3))
    wrong[2, 1] = np.nan
    assert says(error_of(env.step, wrong), "step: the action of environment 2 is not finite: …")
    ragged = [[0, 0, 0], [0, 0]]
    masked = np.ma.masked_array(np.ones((5, 3)), wrong != wrong)
    lost = np.ones((5, 3)) + 1j, masked, np.ones((5, 3)).astype("m8[s]"), [["1"] * 3] * 5
    for actions in ([["a"] * 3] * 5, ragged, *lost, [[10**400] * 3] * 5):
        assert says(error_of(env.step, actions), "step: expected actions that are numbers…")
    one = eqt_cli.gym.SingleEnvironment(fresh)
    one.vector.reset(seed=0)
    assert says(error_of(one.step, masked[2]), "step: expected actions that are numbers…masked…")
    for option, hidden in (("runs", np.arange(5)), ("reset_mask", np.ones(5, bool))):
        hidden = np.ma.masked_array(hidden, np.arange(5) == 2)
        assert says(error_of(env.reset, options={option: hidden}), f"{option}: got masked…")
    for seed in (-1, 1.5, True):
        for wrong in (seed, [0, 0, 0, 0, seed]):
            said = error_of(env.reset, seed=wrong)
            assert says(said, f"seed: expected a whole number from 0, got {seed!r}")
    said = error_of(env.reset, seed=[1, 2])
    assert says(said, "seed: expected a whole number, or 5 of them, got 2")
    env.reset(seed=np.int64(3))
    assert says(error_of(env.reset, options=[1]), "options: expected a mapping…got [1]")
    assert says(error_of(env.exactly, "bias_error"), "exactly: this loop has no signal…pose_error…")
    assert says(error_of(env.exactly, 3), "exactly: expected the name of a signal, got 3")
    assert says(error_of(env.check, 3), "path: expected a file, got 3")
    assert says(error_of(env.record, None), "path: expected a file, got None")
    assert says(error_of(env.check, "x.onnx", 3), "function: expected a function…got 3")
    for options, sentence in {
        "reset_mask": "reset_mask: expected 5 booleans…int64 of shape (3,)",
        "runs": "runs: expected 5 whole numbers from 0 to 7, got …",
        "rows": "options: unknown 'rows'; known: reset_mask, runs",
    }.items():
        said = error_of(env.reset, options={options: np.arange(3) + 7})
        assert says(said.replace("\n", " "), sentence), said


@pytest.mark.ci("loads two experiments")
def test_an_episode_ends_where_its_run_fails():
    """A bound of `failed_when` is the same as a condition of the user's own."""
    bounded = make(config=attitude(failed_when={"attitude": "120 deg"}), penalty=0)
    own = make(terminated=lambda x: x.attitude_angle > 120, penalty=0)
    compiled = make(terminated=lambda x: less(120.0, x.attitude_angle), penalty=0)
    assert own._ends[0].is_compiled
    assert compiled._ends[0].is_compiled
    ends = []
    for env in (bounded, own, compiled):
        env.reset(options={"runs": np.arange(5)})
        for _ in range(env.plant.ticks):
            *_, terminated, _, info = env.step(np.ones((5, 3)))
            ends.append(terminated)
            if "final_info" in info:
                mask = info["_final_info"]
                assert (info["final_info"]["_run"] == mask).all()
                assert (
                    info["final_info"]["failed"][mask] == (env is bounded) * terminated[mask]
                ).all()
    of_bounds, of_own, of_compiled = np.split(np.array(ends), 3)
    assert (of_bounds == of_own).all()
    assert (of_compiled == of_own).all()
    assert 0 < of_own.sum() < of_own.size


@pytest.mark.ci("loads an experiment for each")
def test_what_a_function_gives_in_a_step_is_answered_with_a_sentence():
    for options, sentence in {
        "reward": "reward: is -inf in environment 0, at 0.01 s; give a number there, too",
        "cost": "cost: is -inf in environment 0, at 0.01 s; give a number there, too",
    }.items():
        function = dict.fromkeys(("reward", "cost"), lambda x: -x.pose_error / 0)
        env = make(**{options: function[options]})
        env.reset(seed=0)
        with np.errstate(divide="ignore"):
            assert says(error_of(env.step, np.zeros((5, 3))), sentence)
    env.close()
    assert says(error_of(env.step, np.zeros((5, 3))), "step: the environment is closed…")
    assert says(error_of(env.reset), "reset: the environment is closed…")
