"""The section `estimator`: what it refuses, how runs end, and that a run keeps its bits."""

import numpy as np
import pytest
from case_tables import from_yaml, in_ci
from said import says
from scipy.linalg import expm

from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.components.estimators import Complementary, Invariant, indefinite, pivots
from eqt_cli.components.vehicle import Vehicle, exactly_measured
from eqt_cli.components.vehicle_parts import Normal, Sampling
from eqt_cli.config.document import read_config
from eqt_cli.config.remarks import remarks
from eqt_cli.config.study import study
from eqt_cli.engines.engine import INDEFINITE, Status
from eqt_cli.engines.native import programs
from eqt_cli.extend import MatrixLieGroup, Noise, group_named
from eqt_cli.loop.signals import compute
from eqt_cli.numbers.c_code import c_function
from eqt_cli.numbers.program import traced
from eqt_cli.numbers.rounded import evaluated

FIXES = "[{kind: noise, std: 0.02, period: 0.2}]"
MEASURED = "[{kind: noise, std: 0.01}, {kind: bias, value: 0.05}]"
ATTITUDE = "[{kind: noise, std: 0.02, of: rotation}]"


def text(
    estimator="invariant",
    group="SO2",
    pose=FIXES,
    velocity=MEASURED,
    clock="control: {period: 0.1}",
    engine="solve_ivp",
):
    sensors = "".join(
        f"  {name}: {entries}\n" for name, entries in (("pose", pose), ("velocity", velocity))
        if entries
    )  # fmt: skip
    return f"""
group: {group}
inertia: 1.0
gains: {{kp: 1, kd: 1}}
reference: {{kind: constant, velocity: {[0.1] * group_named(group).dimension}}}
controllers: [eqt]
initial: {{pose: {{kind: exp_normal, std: 0.5}}, velocity: {{kind: normal, std: 0.5}}}}
ensemble: {{runs: 3, seed: 4}}
{clock}
{f"sensors:{chr(10)}{sensors}" if sensors else ""}
estimator: {estimator}
time: {{duration: 1.0, samples: 11}}
solver: {{engine: {engine}}}
"""


@from_yaml
def test_what_cannot_be_estimated_is_refused(solved, options, said):
    with pytest.raises(ConfigError) as error:
        solved(text(**options))
    assert any(says(f"{each.path}: {each.message}", said) for each in error.value.problems)


@pytest.mark.parametrize(
    ("options", "varies"),
    [
        ({}, False),
        ({"initial_pose_std": 0.5}, True),
        ({"initial_pose_std": 0.5, "initial_error": 0.1}, False),
        ({"initial_pose_std": 0.5, "initial_error": Normal([0.0, 0.1])}, True),
    ],
)
def test_runs_differ_where_the_start_of_the_estimate_is_drawn(options, varies):
    assert Invariant(**options).varies == varies


def test_the_start_of_each_run_is_drawn_with_its_deviation():
    G, std = group_named("SO3"), [0.1, 0.2, 0.3]
    drawn = Invariant(initial_pose_std=std).of_run(G, np.random.default_rng(6))
    normal = np.random.default_rng(6).standard_normal(3)
    np.testing.assert_allclose(drawn.initial_error, std * normal, rtol=1e-14)
    mean = Invariant(initial_pose_std=std).of_run(G, None)
    np.testing.assert_array_equal(mean.initial_error, np.zeros(3))
    given = Invariant(initial_pose_std=std, initial_error=0.7).of_run(G, np.random.default_rng(6))
    np.testing.assert_array_equal(given.initial_error, [0.7] * 3)
    assert Invariant().of_run(G, np.random.default_rng(6)).initial_error is None


DEVIATIONS = "pose_std", "velocity_std", "bias_walk", "initial_pose_std", "initial_bias_std"


@pytest.mark.parametrize("name", DEVIATIONS)
def test_no_deviation_is_negative(noted, name):
    said = "expected a standard deviation of at least 0, got -1"
    assert noted(Invariant(**{name: -1.0}), group_named("SO3")) == [(name, said)]


def settling(G, estimator, *sensors):
    """What the filter says of its gains, for these sensors of the pose."""
    problems, vehicle = Problems(), Vehicle(control=Sampling(0.1), pose_sensors=sensors)
    estimator.check_sensors(vehicle.schedule(G), vehicle.deviations(G), problems)
    return [problem.message for problem in problems]


def test_gains_settle_by_the_rate_of_the_fixes_of_each_part():
    """Without k_I, an error shrinks by 1 − T k_P from fix to fix, and the bias stays."""
    G, slow = group_named("SE2"), Noise(0.1, of="translation", period=0.5)
    both = Noise(0.1, of="rotation"), slow
    assert settling(G, Complementary(kp=3.9, ki=0.0), *both) == []
    assert settling(G, Complementary(kp=[19.0, 0.5, 3.9], ki=0.0), *both) == []
    [said] = settling(G, Complementary(kp=[19.0, 0.5, 5.0], ki=0.0), *both)
    assert said == (
        "the estimate of the translation does not settle with fixes every 0.5 s: an error grows by "
        "1.5 from one to the next; choose kp between 0 and 4 and a smaller ki"
    )
    assert settling(G, Complementary(kp=99.0, ki=0.0), slow)[0].startswith(
        "the estimate of the translation"
    )
    # With T k_P = 1 a fix leaves no error of the pose, and 1 − T² k_I of that of the bias.
    assert settling(G, Complementary(kp=2.0, ki=7.9), slow) == []
    assert len(settling(G, Complementary(kp=2.0, ki=8.1), slow)) == 1


def test_an_estimate_without_a_covariance_starts_without_one():
    G = group_named("SE2")
    start = Complementary().first(G, np.broadcast_to(np.eye(3), (2, 4, 3, 3)))
    assert start.bias.shape == (2, 4, 3) and start.covariance.shape == (2, 4, 0, 0)
    assert not start.bias.any()
    assert (Complementary().kp, Complementary().ki) == (1.0, 0.3)


def test_an_error_of_a_part_has_the_unit_of_its_velocity_times_a_second():
    units = {part.name: part.length_unit for part in group_named("SE23").parts}
    assert units == {"rotation": "rad", "velocity": "m/s", "position": "m"}


def test_what_is_known_for_sure_is_no_degree_of_freedom(solved):
    start = "{kind: invariant, initial_pose_std: 0.1, initial_bias_std: [0.1, 0, 0]}"
    problem, solution = solved(text(start, "SE2", ATTITUDE))
    with np.errstate(all="ignore"):
        s = compute(problem.batched_loop(extra_axes=1), problem.times, solution.states)
    assert (s["nees_dof"] == 4).all() and np.isfinite(s["nees"]).all()


def test_a_part_that_nothing_measures_is_told_before_the_run(tmp_path):
    path = tmp_path / "flight.yaml"
    start = "{kind: invariant, initial_pose_std: 0.1, initial_bias_std: [0.1, 0, 0]}"
    path.write_text(text(start, "SE2", ATTITUDE), encoding="utf-8")
    said = [str(each) for each in remarks(study(read_config(path)).base)]
    assert said == [
        f"{path}:14:1: estimator: no sensor measures the translation, so the error of its "
        "estimate grows without bound; add an entry for it to sensors.pose"
    ]


@pytest.mark.parametrize(
    ("group", "more", "exact"),
    [
        ("SO2", {"velocity": "", "estimator": "{kind: complementary, kp: 0.7}"}, "velocity"),
        ("SE2", {}, ""),
        ("SE2", {"pose": ATTITUDE, "estimator": ""}, "pose (translation)"),
        ("SE2", {"velocity": ATTITUDE, "estimator": ""}, "velocity (translation)"),
        ("SE2", {"pose": "", "velocity": "", "estimator": ""}, ""),
    ],
)
def test_what_is_measured_without_errors(tmp_path, group, more, exact):
    path = tmp_path / "flight.yaml"
    path.write_text(text(group=group, **more).replace("estimator: \n", ""), encoding="utf-8")
    base = study(read_config(path)).base
    assert exactly_measured(base.group, base.loop.vehicle) == exact


def test_a_run_whose_covariance_loses_definiteness_ends_and_harms_no_other(solved, monkeypatch):
    problem, whole = solved(text())
    chosen = whole.states[1, 4, problem.loop.layout.slices["vehicle.estimator_pose"]]
    moved = Invariant.moved

    def spoiled(self, G, now, by):
        found = moved(self, G, now, by)
        here = (np.abs(G.pack(found.pose) - chosen) < 1e-14).all(axis=-1)
        sign = np.where(here, -1.0, 1.0)
        return found._replace(covariance=sign[..., None, None] * found.covariance)

    monkeypatch.setattr(Invariant, "moved", spoiled)
    _, found = solved(text())
    assert found.status.tolist() == [0, Status.ESTIMATE_LOST, 0]
    assert found.messages[1] == f"t = 0.4 s: {INDEFINITE[1]}"
    assert np.isfinite(found.states[1]).all(axis=1).tolist() == [True] * 5 + [False] * 6
    for run in (0, 2):
        np.testing.assert_array_equal(found.states[run], whole.states[run])
    assert (found.steps == whole.steps).tolist() == [True, False, True]
    assert 0 < found.steps[1] < whole.steps[1]


def test_definiteness_is_told_by_pivots():
    random = np.random.default_rng(1)
    A = random.standard_normal((3, 4, 4))
    definite, zero = A @ A.swapaxes(-1, -2), np.diag([1.0, 0.0, 2.0, 0.0])
    worse = definite - 1.001 * np.linalg.eigvalsh(definite)[:, :1, None] * np.eye(4)
    assert indefinite(definite).tolist() == [0.0] * 3
    assert indefinite(worse).tolist() == [1.0] * 3
    assert indefinite(zero) == 0.0
    assert indefinite(-zero) == 1.0


def test_pivots_are_those_of_a_triangular_factor():
    """Of LDLᵀ, whose row behind a pivot of 0 is 0; the columns of L there are those of I."""
    random = np.random.default_rng(4)
    L, D = np.tril(random.standard_normal((5, 5)), -1) + np.eye(5), [2.0, -0.5, 0.0, 3.0, 0.25]
    L[:, 2] = np.eye(5)[2]
    v = random.standard_normal(5)
    for shape in ((), (2,), (2, 3)):
        A = np.broadcast_to(L @ np.diag(D) @ L.T, (*shape, 5, 5))
        found, y = pivots(A, np.broadcast_to(v, (*shape, 5)))
        D_here, v_here = (np.broadcast_to(each, (*shape, 5)) for each in (D, v))
        np.testing.assert_allclose(np.stack(found, axis=-1), D_here, atol=1e-13)
        np.testing.assert_allclose(np.stack(y, axis=-1) @ L.T, v_here, atol=1e-13)
        assert indefinite(A).shape == shape and indefinite(A).all()


@pytest.mark.parametrize("engine", ["solve_ivp", in_ci("the engines agree, see below", "native")])
def test_a_run_has_the_same_bits_alone(solved, engine):
    """As after an interruption, which cuts a study elsewhere."""
    blocks = "{kind: eqf, initial_pose_std: 0.5}"
    each = text(blocks, pose="[{kind: noise, std: 0.02, period: 0.2, delay: 1, dropout: 0.2}]")
    each = each.replace("engine: solve_ivp", f"engine: {engine}")
    if engine == "solve_ivp":
        each = each.replace("engine: solve_ivp", "engine: solve_ivp, block: 1")
    _, together = solved(each)
    _, alone = solved(each, runs=[2])
    np.testing.assert_array_equal(alone.states[0], together.states[2])


def test_engines_agree(solved):
    late = "[{kind: noise, std: 0.02, period: 0.2, delay: 4, dropout: 0.2}]"
    found = [solved(text("eqf", pose=late, engine=engine))[1].states
             for engine in ("solve_ivp", "native")]  # fmt: skip
    np.testing.assert_allclose(found[1], found[0], rtol=0, atol=1e-8)


def test_a_later_fix_makes_no_longer_program(tmp_path):
    """The steps from the oldest instant kept to the present are one loop."""
    lengths = []
    for delay in (5, 50):
        pose = f"[{{kind: noise, std: 0.02, period: 0.2, delay: {delay}}}]"
        path = tmp_path / f"late_{delay}.yaml"
        path.write_text(text("complementary", pose=pose))
        program = programs(study(read_config(path)).base.loop).after_instant
        lengths.append(len(c_function(program, "law", static=True)))
    assert lengths[1] < 1.05 * lengths[0]


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23", "R3", "SO3*R3"])
def test_the_jacobian_is_the_mean_of_the_adjoint_along_the_exponential(name):
    """∫₀¹ exp(s ad_x) ds is a block of exp [[ad_x, I], [0, 0]]."""
    G = group_named(name)
    m = G.dimension
    for size in (1e-9, 0.3, 1.0, 2.5):
        x = size * np.random.default_rng(2).standard_normal(m)
        both = np.block([[G.ad_matrix(x), np.eye(m)], [np.zeros((m, 2 * m))]])
        expected = expm(both)[:m, m:]
        np.testing.assert_allclose(G.jacobian(x), expected, rtol=0, atol=1e-12)
        if size < 1.0:
            found = MatrixLieGroup.jacobian(G, x)
            np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23", "R3", "SO3*R3"])
def test_the_exponential_of_symbols_is_that_of_numbers(name):
    G = group_named(name)
    program = traced(lambda given: {"Q": G.exp(given["x"][None])[0]}, {"x": G.dimension})
    for size in (0.0, 1e-8, 0.4, 1.0, 3.0):
        x = size * np.random.default_rng(3).standard_normal(G.dimension)
        found = np.array([float(q) for q in evaluated(program, {"x": x})["Q"]])
        np.testing.assert_allclose(found, G.exp(x).ravel(), rtol=0, atol=1e-13)
