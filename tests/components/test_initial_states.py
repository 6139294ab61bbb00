"""Initial states: what a run's numbers depend on, and how they are distributed.

Samples are drawn with a fixed seed. A mean of N values with standard deviation σ is allowed four
times σ/√N from what it estimates, which another seed would exceed once in 16 000 cases.
"""

import numpy as np
import pytest
from case_tables import from_yaml
from drawn_starts import draw_initial_states
from said import says
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from eqt_cli.base.option_types import Kind
from eqt_cli.components.initial_states import (
    FactorPoses,
    ListedPoses,
    ListedVelocities,
    Speed,
    Spread,
    Stream,
    generator,
    pose_distributions,
    velocity_distributions,
)
from eqt_cli.extend import Problems, group_named

SEED = 2025


def pose_distribution(name, **options):
    return pose_distributions.get(name)(**options)


def velocity_distribution(name, **options):
    return velocity_distributions.get(name)(**options)


def draw(G, poses, velocities=None, runs=range(5), seed=SEED, Qd=None, Vd=None):
    return draw_initial_states(
        G,
        poses,
        velocities or velocity_distribution("normal"),
        Qd=G.identity if Qd is None else Qd,
        Vd=np.zeros(G.dimension) if Vd is None else Vd,
        seed=seed,
        runs=runs,
    )


def numbers(name, **options):
    """The first numbers of a distribution of poses."""
    G, random = group_named("SO3"), generator(SEED, Stream.INITIAL_STATE, 0)
    return pose_distribution(name, **options).draw(G, random)


def wrong_options(distribution, G):
    """What the distribution notes of its options, as (option, message)."""
    found = Problems()
    distribution.check(G, found)
    return [(problem.path, problem.message) for problem in found]


def assert_mean(values, expected, sigma):
    """The mean over the first axis is `expected` within four standard errors."""
    assert (np.abs(values.mean(axis=0) - expected) < 4 * sigma / np.sqrt(len(values))).all()


def assert_spread(values, std):
    """Normal columns with mean 0 and these standard deviations; that of a variance is √2 std²."""
    assert_mean(values, 0.0, np.asarray(std))
    assert_mean(values**2, np.square(std), np.sqrt(2) * np.square(std))


# Seeds --------------------------------------------------------------------------------------------


def test_first_numbers_of_a_run_never_change():
    """The seed contract: these numbers are part of every result that has been written."""
    first = generator(2025, Stream.INITIAL_STATE, 0)
    assert first.uniform(-1.0, 1.0, 3).tolist() == [
        0.616380861001633,
        0.6049632639753335,
        -0.9405733066172017,
    ]
    assert first.standard_normal(3).tolist() == [
        0.30743101562047603,
        -0.6832539358036811,
        -0.9619450269247757,
    ]
    last = generator(2025, Stream.INITIAL_STATE, 199)
    assert last.uniform(-1.0, 1.0, 1).tolist() == [0.3870355523086735]


def test_first_initial_state_of_the_paper_never_changes():
    Q, V = draw(group_named("SO3"), pose_distribution("euler"), runs=range(1))
    expected = [
        [0.11577101267107764, 0.9804598742273436, 0.15904561501410414],
        [-0.3024050951768488, 0.18731286237376982, -0.934593521270304],
        [-0.9461227357146609, 0.06010263404749078, 0.3181814613461307],
    ]
    # The angles are exact, sines and cosines may differ in their last place between machines.
    np.testing.assert_allclose(Q[0], expected, rtol=0, atol=1e-15)
    assert V[0].tolist() == [0.30743101562047603, -0.6832539358036811, -0.9619450269247757]


def test_numbers_of_streams_never_change():
    """As those drawn from them."""
    assert {stream.name: stream.value for stream in Stream} == {
        "INITIAL_STATE": 0,
        "CROSS_CHECK": 1,
        "CERTIFICATES": 2,
        "VEHICLE": 3,
        "EXACT_STATES": 4,
        "EXPORTED_STATES": 5,
        "CODE": 6,
    }
    firsts = [generator(2025, stream, 0).integers(2**63) for stream in Stream]
    assert len(set(firsts)) == len(Stream)


def test_streams_of_seeds_and_runs_differ():
    firsts = {
        generator(root, Stream.INITIAL_STATE, run).integers(2**63)
        for root in (0, 1, 2025, 2**40)
        for run in (0, 1, 2, 1000)
    }
    assert len(firsts) == 16


def test_pose_and_velocity_do_not_share_their_numbers():
    G = group_named("SO3")
    Q, V = draw(G, pose_distribution("exp_normal", std=0.1), runs=range(4000))
    products = G.log(Q)[:, :, None] * V[:, None, :]
    assert_mean(products, 0.0, 0.1)


# Every combination --------------------------------------------------------------------------------


def test_draws_are_errors_to_the_desired_state(G):
    """Q(0) = Q_d(0)·draw and V(0) = V_d(0) + draw."""
    poses = pose_distribution("exp_normal")
    Qd, Vd = G.exp(np.linspace(0.1, 1.0, G.dimension)), np.linspace(-1.0, 1.0, G.dimension)
    pose_draws, velocity_draws = draw(G, poses)
    Q, V = draw(G, poses, Qd=Qd, Vd=Vd)
    np.testing.assert_allclose(Q, Qd @ pose_draws, rtol=0, atol=1e-14)
    np.testing.assert_allclose(V, Vd + velocity_draws, rtol=0, atol=1e-15)


@pytest.mark.parametrize(
    ("distribution", "group", "options"),
    [
        (pose_distribution("exp_normal", std=0.0), "SO3", []),
        (pose_distribution("exp_normal", std=[0.0, 1.0, 1.0]), "SO3", []),
        (pose_distribution("fixed", coordinates=[1.0]), "SO3", ["coordinates"]),
        (pose_distribution("euler", sequence="ZYZ"), "SO3", []),
        (pose_distribution("euler", low=1.0, high=1.0), "SO3", []),
        (pose_distribution("euler", sequence="ZZX"), "SO3", ["sequence"]),
        (pose_distribution("euler", sequence="ZXX"), "SO3", ["sequence"]),
        (pose_distribution("euler", sequence="ZYA"), "SO3", ["sequence"]),
        (pose_distribution("euler", sequence="ZYXZ"), "SO3", ["sequence"]),
        (pose_distribution("euler", sequence="zyx"), "SO3", []),
        (pose_distribution("euler", sequence="Zyx"), "SO3", ["sequence"]),
        (pose_distribution("euler", sequence="ZY"), "SO3", ["sequence"]),
        (pose_distribution("haar", position=Spread(1.0)), "SE3", []),
        (pose_distribution("haar", position=Spread([1.0])), "SE3", ["position.std"]),
        (pose_distribution("angle", angle=[1.0, 1.0]), "SO3", []),
        (pose_distribution("angle", angle=[1.0, 2.0, 3.0]), "SO3", ["angle"]),
        (pose_distribution("angle", angle=0.0), "SO3", []),
        (velocity_distribution("normal", std=[1.0]), "SO3", ["std"]),
        (velocity_distribution("normal", std=[1.0, -1.0, 1.0]), "SO3", ["std"]),
        (velocity_distribution("fixed", coordinates=[1.0]), "SO3", ["coordinates"]),
    ],
)
def test_options_that_do_not_fit_are_reported(distribution, group, options):
    problems = wrong_options(distribution, group_named(group))
    assert [option for option, _ in problems] == options


@from_yaml
def test_what_is_said_of_options_that_do_not_fit(group, name, options, said):
    distribution = velocity_distribution if name == "speed" else pose_distribution
    parts = {"position": Spread, "velocity": Spread, "translation": Speed}
    made = {key: parts[key](**each) if key in parts else each for key, each in options.items()}
    found = wrong_options(distribution(name, **made), group_named(group))
    assert says("\n".join(f"{option}: {message}" for option, message in found), said)


def test_a_spread_is_one_or_numbers():
    """Without a word, deviations are 1; `true` is no number."""
    lengths = Spread().draw(4, generator(SEED, Stream.INITIAL_STATE, 0))
    expected = generator(SEED, Stream.INITIAL_STATE, 0).standard_normal(4)
    np.testing.assert_array_equal(lengths, expected)
    problems = Problems()
    given = {"kind": "haar", "position": {"std": True}}
    assert Kind(pose_distributions).checked(given, problems, group_named("SE3")) is None
    assert [problem.path for problem in problems] == ["position.std"]


# Distributions ------------------------------------------------------------------------------------


def elementary(axis, angle):
    """The rotation about one axis of space."""
    i, j = {"X": (1, 2), "Y": (2, 0), "Z": (0, 1)}[axis]
    R = np.eye(3)
    R[i, i] = R[j, j] = np.cos(angle)
    R[i, j], R[j, i] = -np.sin(angle), np.sin(angle)
    return R


@pytest.mark.parametrize("sequence", ["ZYX", "XYZ", "ZXZ"])
def test_euler_turns_about_moving_axes_in_upper_case(sequence):
    G = group_named("SO3")
    a, b, c = angles = np.array([0.3, -1.2, 2.5])
    moving = pose_distribution("euler", sequence=sequence).place(G, angles[None])[0]
    expected = elementary(sequence[0], a) @ elementary(sequence[1], b) @ elementary(sequence[2], c)
    np.testing.assert_allclose(moving, expected, rtol=0, atol=1e-15)
    fixed = pose_distribution("euler", sequence=sequence.lower()).place(G, angles[None])[0]
    expected = elementary(sequence[2], c) @ elementary(sequence[1], b) @ elementary(sequence[0], a)
    np.testing.assert_allclose(fixed, expected, rtol=0, atol=1e-15)


def test_euler_angles_are_uniform_between_their_bounds():
    low, high = -0.2, 1.0
    Q, _ = draw(
        group_named("SO3"), pose_distribution("euler", low=low, high=high), runs=range(4000)
    )
    angles = Rotation.from_matrix(Q).as_euler("ZYX")
    assert low <= angles.min() < low + 0.01
    assert high - 0.01 < angles.max() <= high
    assert_mean(angles, (low + high) / 2, (high - low) / np.sqrt(12))
    # ∫x² and ∫x⁴ over [−½, ½] are 1/12 and 1/80.
    centred = (angles - (low + high) / 2) / (high - low)
    assert_mean(centred**2, 1 / 12, np.sqrt(1 / 80 - 1 / 144))


def test_haar_rotations_of_space_are_uniform():
    """E R = 0 with E R_ij² = ⅓; the trace, a character, has E tr = 0, E tr² = 1 and E tr⁴ = 3."""
    Q, _ = draw(group_named("SO3"), pose_distribution("haar"), runs=range(10_000))
    assert_mean(Q, 0.0, np.sqrt(1 / 3))
    trace = np.trace(Q, axis1=1, axis2=2)
    assert_mean(trace, 0.0, 1.0)
    assert_mean(trace**2, 1.0, np.sqrt(3 - 1))


def test_haar_rotations_of_the_plane_are_uniform():
    """E R = 0 with E R_ij² = ½, E R_ij⁴ = ⅜, and E R_11 R_21 = 0 with variance ⅛."""
    Q, _ = draw(group_named("SO2"), pose_distribution("haar"), runs=range(4000))
    assert_mean(Q, 0.0, np.sqrt(1 / 2))
    assert_mean(Q**2, 1 / 2, np.sqrt(3 / 8 - 1 / 4))
    assert_mean(Q[:, 0, 0] * Q[:, 1, 0], 0.0, np.sqrt(1 / 8))


def test_exp_normal_has_normal_coordinates():
    G = group_named("SE3")
    std = [0.1, 0.2, 0.3, 1.0, 2.0, 3.0]  # log gives back what stays below π
    Q, _ = draw(G, pose_distribution("exp_normal", std=std), runs=range(4000))
    assert_spread(G.log(Q), std)


def test_velocities_are_normal():
    G = group_named("SE2")
    std = [0.5, 1.0, 2.0]
    velocities = velocity_distribution("normal", std=std)
    _, V = draw(G, pose_distribution("fixed"), velocities, runs=range(4000))
    assert_spread(V, std)


@pytest.mark.parametrize("name", ["euler", "haar"])
def test_translations_are_normal_where_asked_for(name):
    poses = pose_distribution(name, position=Spread([1.0, 2.0, 3.0]))
    Q, _ = draw(group_named("SE23"), poses, runs=range(2000))
    assert_spread(Q[:, :3, 4], [1.0, 2.0, 3.0])
    assert not Q[:, :3, 3].any()  # the velocity column


def test_fixed_distributions_are_what_they_are_given(G):
    coordinates = np.linspace(-0.5, 0.5, G.dimension).tolist()
    poses = pose_distribution("fixed", coordinates=coordinates)
    velocities = velocity_distribution("fixed", coordinates=coordinates)
    Q, V = draw(G, poses, velocities, runs=range(3))
    assert (Q == G.exp(np.array(coordinates))).all()
    assert (V == coordinates).all()


@pytest.mark.parametrize("name", ["fixed", "identity"])
def test_fixed_distributions_are_no_error_by_default(G, name):
    Q, V = draw(G, pose_distribution(name), velocity_distribution("fixed"), runs=range(3))
    assert (Q == G.identity).all()
    assert not V.any()


def test_a_speed_is_0_by_default():
    _, V = draw(group_named("SE3"), pose_distribution("fixed"), velocity_distribution("speed"))
    assert not V.any()


def test_factors_of_a_product_are_drawn_one_after_the_other():
    """From one stream, each by its own distribution."""
    G = group_named("SE3*R2*SO2")
    each = (
        pose_distribution("haar", position=Spread([1.0, 2.0, 3.0])),
        pose_distribution("exp_normal", std=[4.0, 5.0]),
        pose_distribution("angle", angle=[1.0, 2.0]),
    )
    Q, _ = draw(G, FactorPoses(each), runs=range(3))
    for run, pose in enumerate(Q):
        random = generator(SEED, Stream.INITIAL_STATE, run)
        blocks = [
            one.place(factor, one.draw(factor, random)[None])[0]
            for one, factor in zip(each, G.factors, strict=True)
        ]
        np.testing.assert_array_equal(pose, block_diag(*blocks))


def test_listed_states_are_those_of_their_runs():
    """Whoever draws without a run gets the first."""
    G, random = group_named("SO2"), generator(SEED, Stream.INITIAL_STATE, 0)
    turns = np.array([[0.1], [0.2], [0.3]])
    poses, velocities = ListedPoses(G.exp(turns)), ListedVelocities(-turns)
    Q, V = draw(G, poses, velocities, runs=[2, 0])
    assert (Q == G.exp(turns[[2, 0]])).all()
    assert (V == -turns[[2, 0]]).all()
    assert (poses.place(G, poses.draw(G, random)[None]) == G.exp(turns[:1])).all()
    assert velocities.draw(G, random).tolist() == [-0.1]


def test_exp_normal_is_drawn_around_its_centre():
    G = group_named("SO3")
    half_turn = [np.pi, 0.0, 0.0]
    around = pose_distribution("exp_normal", std=1e-3, centre=half_turn)
    Q, _ = draw(G, around)
    Q_alone, _ = draw(G, pose_distribution("exp_normal", std=1e-3))
    np.testing.assert_allclose(Q, np.diag([1.0, -1.0, -1.0]) @ Q_alone, rtol=0, atol=1e-14)


# Angles and speeds --------------------------------------------------------------------------------


@pytest.mark.parametrize("name", ["SO2", "SO3", "SE2", "SE3", "SE23"])
def test_starts_have_the_angle_and_the_speed_that_are_asked_for(name):
    G, angle = group_named(name), np.radians(170)
    Q, V = draw(
        G, pose_distribution("angle", angle=angle), velocity_distribution("speed", speed=0.5)
    )
    turn = G.log(Q)[:, : G.rotations]
    # Tens of last places of an angle near π.
    np.testing.assert_allclose(np.linalg.norm(turn, axis=1), angle, rtol=0, atol=1e-13)
    np.testing.assert_allclose(np.linalg.norm(V[:, : G.rotations], axis=1), 0.5, rtol=1e-15)
    assert not V[:, G.rotations :].any()
    assert not Q[:, : G.space, G.space :].any()


def test_axes_of_angles_and_speeds_are_uniform():
    """Of unit vectors of space, E u = 0 with E u_i² = ⅓ and E u_i⁴ = 1/5."""
    G = group_named("SO3")
    Q, V = draw(
        G,
        pose_distribution("angle", angle=2.0),
        velocity_distribution("speed", speed=3.0),
        runs=range(4000),
    )
    for axes in (G.log(Q) / 2.0, V / 3.0):
        assert_mean(axes, 0.0, np.sqrt(1 / 3))
        assert_mean(axes**2, 1 / 3, np.sqrt(1 / 5 - 1 / 9))


def test_an_angle_between_two_is_uniform_and_shares_its_axis_with_others():
    G, (low, high) = group_named("SO3"), (1.0, 3.0)
    Q, _ = draw(G, pose_distribution("angle", angle=[low, high]), runs=range(4000))
    angles = np.linalg.norm(G.log(Q), axis=1)
    assert low <= angles.min() < low + 0.01
    assert high - 0.01 < angles.max() <= high
    assert_mean(angles, (low + high) / 2, (high - low) / np.sqrt(12))
    one, other = (numbers("angle", angle=angle) for angle in (1.0, [2.0, 3.0]))
    np.testing.assert_allclose(other / np.linalg.norm(other), one, rtol=1e-15)


def test_a_speed_of_the_translation_is_in_its_part_of_the_velocity():
    G = group_named("SE3")
    found = velocity_distribution("speed", axis=[0, 0, 2], speed=3.0, translation=Speed(0.5))
    _, V = draw(G, pose_distribution("fixed"), found)
    assert (V[:, :3] == [0.0, 0.0, 3.0]).all()
    np.testing.assert_allclose(np.linalg.norm(V[:, 3:], axis=1), 0.5, rtol=1e-15)
