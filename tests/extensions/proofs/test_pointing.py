"""The task to point an axis, against plain programs and closed forms."""

from dataclasses import replace

import numpy as np
import pytest
from case_tables import from_yaml
from said import mentions
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation
from small_experiment import configuration, study_of

from eqt_cli.components.inertia import critical_sets
from eqt_cli.components.tasks import TRACK, Point
from eqt_cli.extend import EqtError, Native, Status, group_named
from eqt_cli.extensions.proofs.certificates import Verdict
from eqt_cli.extensions.proofs.verification import verify_experiment
from eqt_cli.loop.growth import growth
from eqt_cli.loop.linearised import linearised
from eqt_cli.results.result import open_result
from eqt_cli.results.summary import compared_first, headlines

ENGINES = ["solve_ivp", pytest.param("native", marks=pytest.mark.ci("compiles a law"))]

A, B = np.array([0.0, 0.6, 0.8]), np.array([1.0, 2.0, -2.0]) / 3
J = np.array([[0.05, 0.002, 0], [0.002, 0.042, 0.001], [0, 0.001, 0.03]])
KEYS = {
    "task": "{kind: point, axis: [0, 3, 4], at: [1, 2, -2]}",
    "reference": None,
    "inertia": str(J.tolist()),
    "gains": "{kp: 0.1, kd: 0.08}",
    "ensemble": "{runs: 2, seed: 1}",
    "time": "{duration: 20, samples: 81}",
    "settling_threshold": "2 deg",
    "solver": "{rtol: 1.0e-12, atol: 1.0e-14, cross_check: 0}",
}


def ran(invoke, folder, *options, code=0, **changes):
    (folder / "c.yaml").write_text(configuration(**KEYS | changes), encoding="utf-8")
    invoke("run", folder / "c.yaml", *options, "--out", folder / "out", code=code)
    return open_result(folder / "out")


def experiment(folder, **changes):
    return study_of(folder, configuration(**KEYS | changes)).base


def plain(torque, R, w, times, J=J):
    """Solve Ṙ = R ω^, Jω̇ = Jω × ω + τ(t, R, ω)."""

    def rates(t, x):
        R, w = x[:9].reshape(3, 3), x[9:]
        w_dot = np.linalg.solve(J, np.cross(J @ w, w) + torque(t, R, w))
        return np.concatenate([np.cross(R, w).ravel(), w_dot])  # rows of R: (R ω^)ᵢ = Rᵢ × ω

    start = np.concatenate([R.ravel(), w])
    x = solve_ivp(rates, times[[0, -1]], start, "DOP853", times, rtol=1e-13, atol=1e-15).y.T
    return x[:, :9].reshape(-1, 3, 3), x[:, 9:]


def angle(x, y):
    """The angle between unit vectors, in degrees."""
    return np.degrees(
        2 * np.arctan2(np.linalg.norm(x - y, axis=-1), np.linalg.norm(x + y, axis=-1))
    )


@pytest.mark.parametrize("engine", ENGINES)
def test_an_axis_turns_to_a_direction_as_in_a_plain_program(invoke, tmp_path, engine):
    """k a × Rᵀb − k_d ω; Lee, Leok and McClamroch also cancel ω × Jω."""

    def eqt(t, R, w):
        return 0.1 * np.cross(A, R.T @ B) - 0.08 * w

    def lee2010(t, R, w):
        return eqt(t, R, w) + np.cross(w, J @ w)

    option = f"solver.engine={engine}"
    with ran(invoke, tmp_path, "--set", option, controllers="[eqt, lee2010]") as result:
        for c, torque in enumerate((eqt, lee2010)):
            for run in range(2):
                R, w = result["pose"][c, run], result["velocity"][c, run]
                expected, rates = plain(torque, R[0], w[0], result.times)
                assert np.abs(R - expected).max() < 1e-9
                assert np.abs(w - rates).max() < 1e-9
                error = angle(R @ A, B)
                assert np.abs(result["pointing_error"][c, run] - error).max() < 1e-5
                mean = np.trapezoid(error, result.times) / result.times[-1]
                assert result["mean_pointing_error"][c, run] == pytest.approx(mean, rel=1e-8)
                late = np.flatnonzero(error > 2)[-1]  # settled by the angle of the axis alone
                share = (error[late] - 2) / (error[late] - error[late + 1])
                settles = result.times[late] + share * (result.times[1] - result.times[0])
                assert result["settling_time"][c, run] == pytest.approx(settles, abs=1e-4)
        assert (result["mean_pose_error"] > 0.5).all()  # the turn about the axis stays
        assert not result.has("mean_attitude_error")


@pytest.mark.parametrize("engine", ENGINES)
def test_an_axis_follows_that_of_a_reference_and_its_spin_is_left(invoke, tmp_path, engine):
    """With K_d a = 0, J e' = −K_d e + k a × RᵀR_d a keeps e·a of a principal axis a."""
    J_principal, rate, damping = np.diag([0.05, 0.042, 0.03]), [0.1, -0.2, 0.3], [0.08, 0.08, 0]

    def law(t, R, w):
        R_d = Rotation.from_rotvec(t * np.array(rate)).as_matrix()
        xi = R.T @ R_d @ rate
        force = 0.1 * np.cross([0, 0, 1], R.T @ R_d[:, 2]) - damping * (w - xi)
        return force + np.cross(w, J_principal @ w) - J_principal @ np.cross(w, xi)

    changes = {
        "task": "{kind: point, axis: [0, 0, 1], along: reference}",
        "inertia": str(np.diag(J_principal).tolist()),
        "reference": f"{{kind: constant, velocity: {rate}}}",
        "gains": f"{{kp: [0, 0, 0.1], kd: {damping}}}",
        "controllers": "[lee2010]",
    }
    with ran(invoke, tmp_path, "--set", f"solver.engine={engine}", **changes) as result:
        R, w = result["pose"][0, 0], result["velocity"][0, 0]
        expected, _ = plain(law, R[0], w[0], result.times, J_principal)
        assert np.abs(R - expected).max() < 1e-9
        R_d = Rotation.from_rotvec(result.times[:, None] * rate).as_matrix()
        assert np.abs(result["pointing_error"][0, 0] - angle(R[..., 2], R_d[..., 2])).max() < 1e-5
        spin = (w - np.einsum("tji,tj->ti", R, R_d @ rate))[:, 2]
        assert np.ptp(spin) < 1e-9 and abs(spin[0]) > 0.1
        assert (result["final_pointing_error"] < 1).all()


def test_the_laws_that_point_fall_in_their_own_l(tmp_path):
    """Identities and the decrease of L hold for all laws that are not refused."""
    laws = "[eqt, gt, nog, asym, lee2010, lee2012, bullo_murray, maithripala2006, stabilising]"
    changes = {"task": "{kind: point, axis: [0, 0, 1], at: [0, 0, 1]}", "controllers": laws}
    changes |= {"solver": "{rtol: 1.0e-6, cross_check: 0}"}  # the verdicts need no more
    for damping in ("0.08", "[0.08, 0.08, 0]"):
        one = experiment(tmp_path, **changes | {"gains": f"{{kp: 0.1, kd: {damping}}}"})
        rows = verify_experiment(one).rows
        assert not [row for row in rows if row.verdict is Verdict.FAILS]
        falls = [row for row in rows if row.name == "decrease of L"]
        assert len(falls) == 9 and {row.verdict for row in falls} == {Verdict.HOLDS}
        arrives = [row.verdict for row in rows if row.name == "P → P_d"]
        assert (set(arrives) == {Verdict.UNCLAIMED}) == ("[" in damping)


def region(one, runs):
    """The rows that count the starts in {L < 2k}, with the number of these by its formula."""
    from drawn_starts import draw_initial_states

    G = group_named("SO3")
    Qd, Vd = one.desired.pose, one.desired.velocity
    start, seed = one.start, one.config.ensemble.seed
    R, w = draw_initial_states(
        G, start.poses, start.velocities, Qd=Qd, Vd=Vd, seed=seed, runs=range(runs)
    )
    k = 0.1
    L = np.einsum("ri,ij,rj->r", w, J, w) / 2 + k * (1 - R @ A @ B)
    verification = verify_experiment(one, runs)
    rows = [row for row in verification.rows if row.name == "the axis arrives from {L < 2k}"]
    return rows, int((L < 2 * k).sum())


def test_starts_in_the_region_of_the_certificate_arrive(tmp_path):
    changes = {"ensemble": "{runs: 60, seed: 3}", "initial": "{pose: haar, velocity: normal}"}
    changes |= {"solver": "{rtol: 1.0e-6}", "controllers": "[eqt]"}
    [row], inside = region(experiment(tmp_path, **changes), 60)
    assert row.verdict is Verdict.HOLDS and 0 < inside < 60
    assert row.remark.startswith(f"not settled: 0 of {inside} runs from there, ")
    assert row.remark.endswith(f" of {60 - inside} from elsewhere")
    # On a horizon that is too short, runs have not settled, which refutes nothing.
    [row], inside = region(experiment(tmp_path, **changes | {"time": "{duration: 1}"}), 60)
    assert row.verdict is Verdict.UNDECIDED and row.measured > 0


@pytest.mark.ci("10,000 runs")
def test_ten_thousand_starts(tmp_path):
    """None of those in the region fails; of the others, some have not settled by then."""
    spread = "{pose: haar, velocity: {kind: normal, std: 1.5}}"
    changes = {"ensemble": "{runs: 10000, seed: 3}", "initial": spread, "controllers": "[lee2010]"}
    changes |= {"solver": "{rtol: 1.0e-6}", "time": "{duration: 7, samples: 71}"}
    [row], inside = region(experiment(tmp_path, **changes), 10_000)
    assert row.verdict is Verdict.HOLDS and 1_000 < inside < 9_000
    outside = int(row.remark.split(" runs from there, ")[1].split(" of ")[0])
    assert row.measured == 0 and outside > 0


def test_the_energy_bounds_the_angle(invoke, tmp_path):
    """cos θ ≥ 1 − L(0)/k at all times; it keeps runs that start in the region off the opposite."""
    keys = {"ensemble": "{runs: 20, seed: 2}", "solver": "{rtol: 1.0e-9}", "controllers": "[gt]"}
    with ran(invoke, tmp_path, **keys) as result:
        L, cosine = result["lyapunov"][0], np.cos(np.radians(result["pointing_error"][0]))
        w, R = result["velocity"][0], result["pose"][0]
        own = np.einsum("rti,ij,rtj->rt", w, J, w) / 2 + 0.1 * (1 - R @ A @ B)
        assert np.abs(L - own).max() < 1e-10  # of poses that leave the group by 1e-11
        assert (cosine >= 1 - L[:, :1] / 0.1 - 1e-9).all()


def test_small_errors_across_the_axis(tmp_path):
    """Jλ² + k_d λ + k = 0 across a principal axis, Jλ + k_d = 0 of the spin about it."""
    changes = {
        "task": "{kind: point, axis: [0, 0, 1], at: [0, 1, 0]}",
        "inertia": "[0.05, 0.05, 0.03]",
    }
    changes |= {"controllers": "[lee2010]"}
    for damping, spin in (("0.08", [-0.08 / 0.03]), ("[0.08, 0.08, 0]", [])):
        one = experiment(tmp_path, **changes | {"gains": f"{{kp: 0.1, kd: {damping}}}"})
        start = np.zeros(1), one.desired.pose[None], one.desired.velocity[None]
        found = linearised(one.loop, *start)
        across = [*np.roots([0.05, 0.08, 0.1])] * 2
        eigenvalues = np.linalg.eigvals(found.closed[0])
        np.testing.assert_allclose(np.sort(eigenvalues), np.sort([*across, *spin]), atol=1e-8)
        assert growth(found).is_stable


SEEN = {
    "task": "{kind: point, axis: [0, 0, 1], at: [0, 0, 1]}",
    "controllers": "[lee2010]",
    "control": "{period: 0.1, delay: 1}",
    "sensors": "{pose: [{kind: noise, std: 0.001, period: 0.2}], velocity: "
    "[{kind: noise, std: 0.001}, {kind: bias, value: {normal: [0, 0.01]}, walk: 0.001}]}",
    "estimator": "{kind: invariant}",
}


@pytest.mark.ci("settles an estimator")
def test_what_is_left_out_is_one_eigenvalue_also_with_an_estimate(tmp_path):
    """Body and estimate turn together about the axis: of the whole loop, one eigenvalue is 1."""
    one = experiment(tmp_path, **SEEN)
    start = np.zeros(1), one.desired.pose[None], one.desired.velocity[None]
    whole = linearised(replace(one.loop, task=TRACK), *start, with_estimator=True)
    across = linearised(one.loop, *start, with_estimator=True)
    every, kept = (np.sort_complex(np.linalg.eigvals(x.closed[0])) for x in (whole, across))
    free = np.abs(every - 1).argmin()
    assert every[free] == pytest.approx(1, abs=1e-7) and np.abs(kept).max() < 0.9999
    # 1e-3: those that are 0 several times are roots of the errors of differences.
    np.testing.assert_allclose(np.abs(kept), np.abs(np.delete(every, free)), atol=1e-3)


def test_the_free_turn_is_no_instability(invoke, tmp_path):
    text = configuration(**KEYS | {"control": "{period: 0.05}", "controllers": "[lee2010]"})
    (tmp_path / "c.yaml").write_text(text, encoding="utf-8")
    said = " ".join(invoke("margins", tmp_path / "c.yaml").stdout.split())
    assert "stable" in said and "unstable" not in said
    assert "left out: the turn about the axis (0, 0.6, 0.8) (task: point leaves it)" in said
    said = " ".join(invoke("config", "check", tmp_path / "c.yaml").stdout.split())
    assert "the turn about the axis (0, 0.6, 0.8) is free; nothing is claimed" in said
    said = invoke("config", "check", tmp_path / "c.yaml", "--set", "control=null").stdout
    assert "claimed: from L < 2k = 0.2 J the axis arrives" in " ".join(said.split())


def barriers(one):
    return [
        loop.task.barrier(loop.controller, loop.gains, loop.reference)
        for loop in one.loops.values()
    ]


def test_what_is_claimed_of_an_axis_whose_spin_is_left(tmp_path):
    """At rest it arrives. Along a reference, laws that do not cancel e × 𝕀e are disturbed by it."""
    left = {"gains": "{kp: 0.1, kd: [0.1, 0.1, 0]}", "inertia": "[0.05, 0.042, 0.03]"}
    left |= {"initial": "{pose: haar, velocity: {kind: normal, std: 3}}"}
    left |= {"controllers": "[lee2010, lee2012]", "solver": "{rtol: 1.0e-6}"}
    at_rest = left | {"task": "{kind: point, axis: [0, 0, 1], at: [0, 0, 1]}"}
    moving = {"task": "{kind: point, axis: [0, 0, 1], along: reference}"}
    moving |= {"reference": "{kind: constant, velocity: [0.5, -0.7, 0.3]}"}
    one = experiment(tmp_path, **at_rest)
    assert barriers(one) == [0.2, 0.2]
    one = experiment(tmp_path, **left | moving)
    assert barriers(one) == [0, 0]
    damped = experiment(tmp_path, **left | moving | {"gains": "{kp: 0.1, kd: 0.1}"})
    assert barriers(damped) == [0.2, 0.2]
    rows = [row for row in verify_experiment(one, 2).rows if row.name == "Q → Q_d"]
    assert rows[0].measured < 2 < 10 < rows[1].measured  # deg
    assert rows[1].verdict is Verdict.UNDECIDED


def test_the_critical_sets_of_an_axis():
    """Υ = k(1 − cos θ) is 0 on all turns about c, and 2k where c is turned over."""
    G, c = group_named("SO3"), B
    least, most = critical_sets(G, 0.5 * np.outer(c, c))
    assert least.name == "turns about (0.333, 0.667, -0.667)"
    assert (least.dimension, least.index, least.nullity) == (1, 0, 1)
    assert (most.dimension, most.index, most.nullity) == (1, 2, 1)
    turned = Rotation.from_rotvec(2.0 * c).as_matrix()
    over = Rotation.from_rotvec(np.pi * np.cross(c, [0, 0, 1]) / np.hypot(*c[:2])).as_matrix()
    assert most.squared_distance(turned @ over) == pytest.approx(0, abs=1e-12)
    assert most.squared_distance(turned) == pytest.approx(8)  # ‖I − R‖² = 8 of a half-turn


@pytest.mark.parametrize("at", [B, A, -A, [0, -0.6, -0.8 - 1e-12]])
def test_the_reference_at_rest_is_the_shortest_turn(at):
    R_d = Point(kind="point", axis=A.tolist(), at=list(at)).pose
    b = np.array(at) / np.linalg.norm(at)
    assert np.abs(R_d @ R_d.T - np.eye(3)).max() < 1e-14 and np.linalg.det(R_d) > 0
    assert np.abs(R_d @ A - b).max() < 1e-8
    turn = np.degrees(Rotation.from_matrix(R_d).magnitude())
    assert turn == pytest.approx(angle(A, b), abs=1e-5)


@pytest.mark.parametrize("at", [[0, 0, 1], [0.6, 0, 0.8]])
def test_a_run_that_starts_opposite_is_decided_by_rounding(invoke, tmp_path, at):
    """Where R_d turns, R_dᵀR is a half-turn across the axis, and R R_dᵀ is none."""
    over = "{pose: {kind: fixed, coordinates: [3.141592653589793, 0, 0]}, velocity: fixed}"
    changes = {"task": f"{{kind: point, axis: [0, 0, 1], at: {at}}}", "initial": over}
    changes |= {"time": "{duration: 20}", "controllers": "[lee2010]", "ensemble": "{runs: 1}"}
    changes |= {"solver": "{rtol: 1.0e-6}"}
    with ran(invoke, tmp_path, code=3, **changes) as result:
        assert (result.status == Status.BY_ROUNDING).all()
        assert result["unstable_distance"].max() < 1e-9


def test_the_answer_begins_with_the_pointing_error(invoke, tmp_path):
    with ran(invoke, tmp_path, controllers="[eqt, lee2010]", ensemble="{runs: 12}") as result:
        assert headlines(result)[:2] == ["mean_pointing_error", "final_pointing_error"]
        assert compared_first(result)[0] == "mean_pointing_error"
        assert np.allclose(result.described.axis, A)
    first = invoke("compare", tmp_path / "out").stdout.splitlines()[0]
    assert "mean pointing error" in first
    assert "deg" in invoke("show", tmp_path / "out").stdout.split("mean pointing error")[1][:6]


def test_the_path_on_the_sphere_is_that_of_the_axis(invoke, tmp_path, unarranged):
    """R a seen by an eye: two orthonormal rows; another axis would not be a linear map of it."""
    from eqt_cli.extensions.paths.figures import PathFigure

    with ran(invoke, tmp_path, controllers="[lee2010]", ensemble="{runs: 1}") as result:
        (axes,) = PathFigure().draw([result]).axes
        tips = result["pose"][0, 0] @ A
    near, far = (
        np.stack(line.get_data(), axis=-1)
        for side in ("", ", far side")
        for line in axes.lines
        if line.get_label() == f"lee2010 0{side}"
    )
    drawn = np.where(np.isfinite(near), near, far)
    rows = np.linalg.lstsq(tips, drawn, rcond=None)[0].T
    np.testing.assert_allclose(tips @ rows.T, drawn, atol=1e-10)
    np.testing.assert_allclose(rows @ rows.T, np.eye(2), atol=1e-10)


# A quadrotor whose thrust points, with its yaw left free


QUADROTOR = {
    "group": "SE3",
    "task": "{kind: point, axis: [0, 0, 1], along: reference}",
    "inertia": "[0.02, 0.02, 0.04, 1, 1, 1]",
    "gains": None,
    "model": "{forces: [{kind: restoring, weight: 9.81}]}",
    "reference": '{kind: flat, position: ["sin(t)", "cos(t)", 1], heading: 0}',
    "controllers": "[{kind: cascade, attitude: lee2010, position: {kx: 4, kv: 3}, "
    "along: [0, 0, 1], gains: {kp: 2, kd: 0.4}}]",
    "initial": "{pose: {kind: fixed, coordinates: [0, 0, 2.5, 0, 0, 0]}}",
    "ensemble": None,
    "time": "{duration: 12, samples: 121}",
    "solver": "{engine: native}",
    "settling_threshold": "2 deg",
}


@pytest.mark.ci("compiles the flight of a quadrotor")
@pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")
def test_a_quadrotor_points_its_thrust_and_leaves_its_yaw(invoke, tmp_path):
    """It flies with the yaw that it starts with: the law has no torque about the thrust."""
    with ran(invoke, tmp_path, **QUADROTOR) as result:
        R, R_d = result["pose"][0, 0, :, :3, :3], result["desired_pose"][:, :3, :3]
        assert np.abs(result["pointing_error"][0, 0] - angle(R[..., 2], R_d[..., 2])).max() < 1e-5
        assert result["final_pointing_error"][0, 0] < 1
        assert result["final_position_error"][0, 0] < 0.01
        assert result["heading_error"][0, 0, -1] > 90
        assert np.isfinite(result["settling_time"][0, 0])
    with ran(invoke, tmp_path / "..", **QUADROTOR | {"task": "track"}) as result:
        assert result["heading_error"][0, 0, -1] < 1


# What is refused

POINT = "{kind: point, axis: [0, 0, 1], at: [0, 1, 0]}"


@from_yaml
def test_what_is_no_pointing_is_refused(tmp_path, changes, said):
    with pytest.raises(EqtError) as error:
        experiment(tmp_path, **{"task": POINT, "target": None} | changes)
    assert mentions(str(error.value), said)
    assert len(str(error.value).splitlines()) == 1  # nothing else is said to be wrong


def test_weights_of_rank_one_stay_refused_elsewhere(tmp_path):
    changes = {"task": None, "reference": "{kind: constant}", "gains": "{kp: [0, 0, 1], kd: 1}"}
    with pytest.raises(EqtError, match=r"must be positive, got .* else small errors"):
        experiment(tmp_path, **changes)
