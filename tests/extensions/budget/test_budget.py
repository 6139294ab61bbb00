"""Budgets of loops that are linear near rest, against their covariance in closed form."""

import re
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.linalg import solve_discrete_lyapunov

import eqt_cli
from eqt_cli.base.errors import EqtError, EqtWarning
from eqt_cli.cli.tables import as_latex
from eqt_cli.extensions.budget import budget
from eqt_cli.extensions.budget.budget import IDEAL, Budget, LawBudget, Row, rooted_mean, variants_of
from eqt_cli.extensions.budget.quantiles import Interval, mixed, of_runs
from eqt_cli.extensions.budget.sources import Source, sources_of, without
from eqt_cli.extensions.budget.tables import BudgetInWords, in_latex
from eqt_cli.numbers.leaves import structure
from eqt_cli.results.quantity import Window

J = np.array([0.3, 0.2, 0.1])
STIFFNESS, KD, T = 0.24, 0.2, 0.1  # Lee's law with kp 0.12: e_R is the angle, k_R = 2 kp
BODY = {
    "group": "SO3",
    "inertia": J.tolist(),
    "gains": {"kp": STIFFNESS / 2, "kd": KD},
    "reference": {"kind": "constant", "pose": {}},
    "controllers": ["lee2010"],
    "control": {"period": T},
    "initial": {"pose": {"kind": "exp_normal", "std": 1e-9}},
    "ensemble": {"runs": 40, "seed": 3},
    "time": {"duration": 100, "samples": 1001},
}
DEG = 180 / np.pi


def covariance(theta, omega, delay=0):
    """Mean square angle, deg², with noise of the measured angle and rate, rad and rad/s.

    x' = A x + B u over a period with a held torque; u = −k (θ + n) − d (ω + m), `delay` periods
    late.
    """
    total = 0.0
    for inertia in J:
        A, B = np.array([[1, T], [0, 1]]), np.array([[T**2 / 2], [T]]) / inertia
        K, N = np.array([[STIFFNESS, KD]]), np.diag([theta**2, omega**2])
        if delay:
            A = np.block([[A, B], [-K, np.zeros((1, 1))]])
            G = np.vstack([np.zeros((2, 2)), -K])
        else:
            A, G = A - B @ K, -B @ K
        total += solve_discrete_lyapunov(A, G @ N @ G.T)[0, 0]
    return total * DEG**2


def budget_of(window="30:", **sections):
    (law,) = eqt_cli.error_budget({**BODY, **sections}, window=window).laws
    return law, {row.source.key: row for row in law.rows}


NOISE = {"pose": [{"kind": "noise", "std": 1e-3}], "velocity": [{"kind": "noise", "std": 2e-3}]}


@pytest.mark.ci("compiles, and integrates 40 runs of 100 s seven times")
def test_noises_and_a_delay_cost_what_the_covariance_of_the_linear_loop_says():
    law, rows = budget_of(sensors=NOISE, control={"period": T, "delay": 1})
    of_pose, of_rate = covariance(1e-3, 0), covariance(0, 2e-3)
    late, prompt = covariance(1e-3, 2e-3, 1), of_pose + of_rate
    # 3 axes, 40 runs, 70 s with errors that last some 2 s: 4,000 independent squares, 1.1 %.
    assert rows["sensors.pose[0]"].alone.value == pytest.approx(np.sqrt(of_pose), rel=0.02)
    assert rows["sensors.velocity[0]"].alone.value == pytest.approx(np.sqrt(of_rate), rel=0.02)
    assert law.total.value == pytest.approx(np.sqrt(late), rel=0.02)
    # A delay costs nothing alone; beside noise, the difference of mean squares of the same noise.
    assert abs(rows["control.delay"].alone.value) < 1e-6
    assert rows["control.delay"].beside.value ** 2 == pytest.approx(late - prompt, abs=0.02 * late)
    # What the sum of squares leaves over is what the delay adds to both.
    left = np.sign(law.left_over) * law.left_over**2
    assert left == pytest.approx(late - prompt, abs=0.05 * late)


@pytest.mark.ci("compiles, and integrates 5 runs of 100 s seven times")
def test_constant_sources_add_as_vectors_and_the_sum_of_squares_leaves_the_rest_over():
    force, bias = np.array([1e-5, -2e-5, 1e-5]), np.array([5e-5, 5e-5, -5e-5])
    law, rows = budget_of(
        window="80:",
        ensemble={"runs": 5},
        plant={"forces": [{"kind": "constant", "force": force.tolist()}]},
        sensors={"velocity": [{"kind": "bias", "value": bias.tolist()}]},
    )
    angles = {"plant.forces[0]": force / STIFFNESS, "sensors.velocity[0]": -KD * bias / STIFFNESS}
    for key, angle in angles.items():
        # The slowest pole, 0.36 1/s, leaves 1e-12 after 80 s; squares of angles of 1e-4 rad.
        assert rows[key].alone.value == pytest.approx(DEG * np.linalg.norm(angle), rel=1e-6)
    whole, parts = np.linalg.norm(sum(angles.values())), [x @ x for x in angles.values()]
    # The law compensates the measured b x J b, 3e-5 of the torque of the bias and across it.
    assert law.total.value == pytest.approx(DEG * whole, rel=2e-5)
    rest = whole**2 - sum(parts)
    assert np.sign(law.left_over) * law.left_over**2 == pytest.approx(rest * DEG**2, rel=1e-4)


def test_an_rms_is_over_time_and_not_over_rows():
    """From 0.2 rad to nearly 0 in four rows, where the first one counts half."""
    start = {"pose": {"kind": "exp_normal", "std": 1e-9, "centre": [0.2, 0, 0]}}
    time = {"duration": 3.0, "samples": 4}
    noise = {"velocity": [{"kind": "noise", "std": 1e-9}]}
    settings = {"initial": start, "time": time, "ensemble": {"runs": 5}, "control": {"period": 1.0}}
    law, _ = budget_of("0:", solver={"engine": "solve_ivp"}, sensors=noise, **settings)
    angle, rate, squares = 0.2, 0.0, []
    for weight in (1.0, 2.0, 2.0, 1.0):
        squares.append(weight * angle**2 / 6)
        torque = -STIFFNESS * np.sin(angle) - KD * rate
        angle, rate = angle + rate + torque / J[0] / 2, rate + torque / J[0]
    assert law.total.value == pytest.approx(DEG * np.sqrt(np.sum(squares)), rel=1e-6)


def test_constant_forces_and_inertia_are_off_by_numbers_of_the_same_program():
    """So that what is compiled for one variant serves others."""
    force = {"kind": "constant", "force": [1e-5, 0, 0]}
    for inertia in ([0.33, 0.2, 0.1], {"relative": 0.1}):
        plant = {"inertia": inertia, "forces": [force]}
        loop = eqt_cli.load_experiment({**BODY, "plant": plant}).base.loop
        off = without(loop, {"plant.inertia", "plant.forces[0]"})
        assert structure(off.vehicle) == structure(loop.vehicle)
        assert np.allclose(off.vehicle.inertia.at(off.inertia.at(0.0), 0.0).matrix, np.diag(J))
        assert not np.any(off.vehicle.forces[0].force)


def test_equal_variants_and_equal_laws_are_computed_once(monkeypatch):
    computed = []

    def solved(block, reference, names, whole, context):
        computed.append(block)
        errors = np.outer(1.0 + np.arange(5) + len(computed), np.ones(11))
        return SimpleNamespace(status=np.zeros(5, int), arrays={names[0]: errors})

    monkeypatch.setattr(budget, "solved", solved)
    config = {**BODY, "controllers": ["lee2010", {"kind": "lee2010", "label": "again"}]}
    config |= {"sensors": {"pose": NOISE["pose"]}, "time": {"duration": 1, "samples": 11}}
    laws = eqt_cli.error_budget(config, {"ensemble.runs": 5, "solver.engine": "solve_ivp"}).laws
    # Without sensors and a clock; without sensors; silent ones, as with all left out; with all.
    assert len(computed) == 4
    assert laws[0].rows == laws[1].rows


def test_a_source_goes_and_the_places_of_others_stay():
    config = {**BODY, "sensors": NOISE, "control": {"period": T, "delay": 1}}
    config["plant"] = {
        "inertia": [0.33, 0.2, 0.1],
        "forces": [{"kind": "constant", "force": 1e-5}, {"kind": "constant", "force": 2e-5}],
    }
    loop = eqt_cli.load_experiment(config).experiment(0).loops["lee2010"]
    keys = [source.key for source in sources_of(loop)]
    assert keys == [
        "plant.inertia",
        "plant.forces[0]",
        "plant.forces[1]",
        "sensors.pose[0]",
        "sensors.velocity[0]",
        "control.delay",
    ]
    for key in keys:
        assert [source.key for source in sources_of(without(loop, {key}))].count(key) == (
            key != "control.delay"  # another part stands in its place
        )
    silent = without(loop, {"sensors.pose[0]"}).vehicle.pose_sensors[0]
    drawn = np.random.default_rng(1)
    assert not silent.errors(loop.group, 5, T, drawn).any()
    assert silent.white_deviation(loop.group, T) == pytest.approx([1e-3] * 3)


@pytest.mark.parametrize(
    ("sections", "words"),
    [
        ({}, "no imperfection to switch off"),
        ({"sensors": NOISE, "ensemble": {"runs": 2}}, "at least 5 .*got 2"),
        ({"sensors": NOISE, "sweep": [{"grid": {"gains.kd": [0.1, 0.2]}}]}, "--point"),
    ],
)
def test_what_has_no_budget(sections, words):
    with pytest.raises(EqtError, match=words):
        eqt_cli.error_budget({**BODY, **sections})


def test_an_unknown_error_names_those_that_are_there():
    with pytest.raises(EqtError, match="unknown error 'atitude_angle'; did you mean"):
        eqt_cli.error_budget({**BODY, "sensors": NOISE}, error="atitude_angle")


def test_a_number_without_its_unit_is_remarked_on_before_the_runs():
    sensors = {"velocity": [{"kind": "noise", "density": 0.26}]}
    refused = pytest.raises(EqtError, match="unknown error")
    with pytest.warns(EqtWarning, match="894 deg/sqrt"), refused:
        eqt_cli.error_budget({**BODY, "sensors": sensors}, error="none")


@pytest.mark.ci("integrates 5 runs of two variants")
def test_the_record_of_a_budget_holds_the_remarks():
    short = {"time": {"duration": 1, "samples": 11}, "ensemble": {"runs": 5}}
    noise = {"pose": [{"kind": "noise", "std": 1.5}]}  # rad
    sampled = short | {"sensors": noise, "control": {"period": T}, "solver": {"cross_check": 0}}
    with pytest.warns(EqtWarning) as told:
        budget = eqt_cli.error_budget({**BODY, **sampled}, window="0:")
    held = budget.record()["remarks"]
    assert [one for one in held if one.startswith("sensors.pose[0]: a noise of 1.5 rad")]
    assert all(any(one in str(x.message) for x in told) for one in held)


def test_a_budget_in_latex_escapes_what_latex_reads_as_its_own():
    def exactly(value):
        return Interval(value, value, value)

    row = Row(Source("sensors.depth_2.delay", "late"), exactly(-0.5), exactly(-0.5))
    law = LawBudget("gt", "GT", 5, 0, exactly(1.0), 1.0, [row], [])
    made = Budget("b", "attitude_angle", "deg", Window(), [law])
    lines = as_latex(in_latex(BudgetInWords(made).sources(law))).splitlines()
    body = [line for line in lines if not line.startswith("%")]
    assert any(r"\%" in line and r"depth\_2" in line for line in body)
    assert not re.search(r"(?<!\\)[%_]|−", "\n".join(body))


# Quantiles ----------------------------------------------------------------------------------------


def test_order_statistics_are_binomial():
    runs = np.arange(1.0, 101.0)
    # Of 100 runs, 40 to 61 are the order statistics of the median (Conover, table A3).
    assert of_runs(runs, 0.5)[1:] == (40.0, 61.0, 0)
    assert of_runs(runs, 0.997)[2:] == (np.inf, 1228)  # 0.997^1228 = 0.025


def coverage(interval_of, truth, sample, experiments):
    shown = [interval_of(sample()) for _ in range(experiments)]
    return np.mean([one.low <= truth <= one.high for one in shown])


@pytest.mark.ci("400 experiments of up to 1,667 runs")
@pytest.mark.parametrize(("share", "runs"), [(0.5, 20), (0.99, 500), (0.997, 1667)])
def test_intervals_of_quantiles_cover(share, runs):
    from scipy.signal import lfilter
    from scipy.stats import norm

    random, decay = np.random.default_rng(5), np.exp(-1 / 20)

    def sample():
        # Of each run a constant and a Gauss-Markov process, of variance 1 each.
        steps = random.standard_normal((runs, 100))
        steps[:, 1:] *= np.sqrt(1 - decay**2)
        drift = lfilter([1], [1, -decay], steps, axis=1)
        return np.abs(random.standard_normal((runs, 1)) + drift)

    truth = np.sqrt(2) * norm.ppf((1 + share) / 2)
    # 0.95 of 400 experiments, less two standard deviations of 0.011.
    assert coverage(lambda e: mixed(e, share), truth, sample, 400) > 0.925
    one = coverage(lambda e: of_runs(e[:, 0], share), truth, sample, 400)
    assert one > 0.93 if runs > 20 else one > 0.925


@pytest.mark.ci("1,000 experiments of 1,667 runs")
def test_a_mixed_quantile_of_constant_runs_covers_with_the_fewest_that_show_it():
    from scipy.stats import norm

    random, share = np.random.default_rng(6), 0.997

    def constant():
        return np.abs(random.standard_normal((1667, 1))).repeat(2, axis=1)

    assert mixed(constant()[:1600], share).needed == 1667
    truth = norm.ppf((1 + share) / 2)
    # 0.95 of 1,000 experiments, less three standard deviations of 0.007.
    assert coverage(lambda e: mixed(e, share), truth, constant, 1000) > 0.929


@pytest.mark.ci("800 experiments, each with 2,000 resamples")
@pytest.mark.parametrize(("runs", "axes", "least"), [(10, 1, 0.91), (40, 1, 0.925), (20, 3, 0.925)])
def test_intervals_of_constant_errors_cover(runs, axes, least):
    random = np.random.default_rng(7)

    def sample():
        return (random.standard_normal((runs, axes)) ** 2).sum(axis=1)

    # 3,000 experiments gave 0.932, 0.945 and 0.948, Student's t 0.853, 0.919 and 0.927; the
    # standard deviation of a share of 800 is 0.008.
    assert coverage(rooted_mean, np.sqrt(axes), sample, 800) > least


def test_equal_runs_have_no_interval():
    assert rooted_mean(np.full(5, 4.0)) == (2.0, 2.0, 2.0, 0)
    assert rooted_mean(np.zeros(5)) == (0.0, 0.0, 0.0, 0)


TILTED = {
    "initial": {"pose": {"kind": "fixed", "coordinates": [0, 0, 0.5]}},
    "plant": {"forces": [{"kind": "constant", "force": [{"normal": [0, 1e-4]}, 0, 0]}]},
    "ensemble": {"runs": 5, "seed": 1},
}


@pytest.mark.ci("compiles, and integrates 5 runs of 100 s five times")
def test_the_start_has_a_row_of_its_own_beside_a_clock():
    law, _ = budget_of(window="0:", **TILTED)
    times, J3 = np.linspace(0, 100, 1001), J[2]

    def swing(t, x):
        return x[1], (-STIFFNESS * np.sin(x[0]) - KD * x[1]) / J3

    angle = solve_ivp(swing, (0, 100), [0.5, 0], t_eval=times, rtol=1e-10, atol=1e-12).y[0]
    start, sampling = law.rows[:2]
    # Both are means over time by the trapezoidal rule; the engine's rtol is 1e-9.
    mean_square = np.trapezoid(angle**2, times) / 100
    assert start.alone.value == pytest.approx(DEG * np.sqrt(mean_square), rel=1e-7)
    assert (start.source.words, sampling.source.words) == (
        "start and reference",
        "sampling of the law",
    )
    assert sampling.alone.value < 0.1 * start.alone.value


@pytest.mark.parametrize(
    ("controllers", "has"),
    [(["lee2010"], True), ([{"kind": "super_twisting", "layer": None}], False)],
)
def test_only_laws_that_do_without_a_clock_are_computed_without_one(controllers, has):
    base = eqt_cli.load_experiment({**BODY, **TILTED, "controllers": controllers})
    assert ((IDEAL, "") in variants_of(base, [])) is has


def test_a_root_mean_square_has_no_negative_end():
    squares = np.array([0.0, 0.0, 0.0, 1.0, 40.0])
    assert rooted_mean(squares).low < 0 == rooted_mean(squares, 0.0).low
