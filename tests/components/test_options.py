"""Options of references: poses and files, and what is said of those that will not do."""

import numpy as np
import pytest
from case_tables import refusal

from eqt_cli.base.errors import InputError, Problems
from eqt_cli.components.pose_tables import LogMapping, TimeMapping
from eqt_cli.components.references import (
    ConstantReference,
    PathFactor,
    PathReference,
    RatesReference,
    SlewReference,
    TorqueReference,
)
from eqt_cli.components.waypoints import Waypoint, WaypointsReference
from eqt_cli.extend import formula, group_named

G = group_named("SO3")
POINTS = [Waypoint(0.0, "identity"), Waypoint(2.0, {"rotvec": [0.3, 0.0, 0.0]})]
TEXT = "t,qx,qy,qz,qw\n0,0,0,0,1\n2,0.14943813247359922,0,0,0.9887710779360422\n"


def notes(reference):
    """What a reference notes of its options, as (option, message)."""
    problems = Problems()
    reference.check(G, problems)
    return [(problem.path, problem.message) for problem in problems]


def test_waypoints_may_stand_in_a_file():
    written = WaypointsReference(POINTS)
    in_a_file = WaypointsReference(file="plan.csv").with_files({"plan.csv": TEXT})
    t = np.linspace(0.0, 2.0, 5)
    for found, expected in zip(in_a_file.motion(G, t), written.motion(G, t), strict=True):
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-14)


def test_files_are_those_that_hold_waypoints():
    assert WaypointsReference(file="plan.csv").files == {"file": "plan.csv"}
    assert WaypointsReference(POINTS).files == {}


def test_without_its_file_a_reference_stays_as_it_is():
    """Where the file could not be read, which is noted elsewhere, and where there is none."""
    unread, written = WaypointsReference(file="plan.csv"), WaypointsReference(POINTS)
    assert unread.with_files({"other.csv": TEXT}) is unread
    assert written.with_files({"plan.csv": TEXT}) is written
    assert notes(unread) == []


def test_each_waypoint_is_looked_at():
    points = [POINTS[1], Waypoint(2.0, "identiy"), Waypoint(3.0, "identity")]
    (pose, wrong), time = notes(WaypointsReference(points))
    assert pose == "points[1].pose"
    assert wrong
    assert time == ("points[1].t", "expected a time after 2 s, got 2 s")


@pytest.mark.parametrize(
    ("times", "message"),
    [
        ([-1e12, 1.0], "expected times from -1e+09 to 1e+09 s, got -1e+12 s"),
        ([-1e9, 5e9], "expected times from -1e+09 to 1e+09 s, got 5e+09 s"),
        ([0.0, 1e9 + 0.5], "expected times from -1e+09 to 1e+09 s, got 1e+09 s"),
        ([0.0, 1.0, 1.0 + 5e-10], "expected at least 1e-09 s between two waypoints, got 5e-10 s "
         "after 1 s"),
    ],
)  # fmt: skip
def test_times_are_within_bounds(times, message):
    found = WaypointsReference([Waypoint(t, "identity") for t in times])
    assert notes(found) == [("points", message)]
    assert refusal(InputError, found.pieces, G) == message


@pytest.mark.needs("logs")
def test_what_is_wrong_in_a_file_is_noted_at_its_name():
    found = WaypointsReference(file="plan.csv").with_files({"plan.csv": TEXT + "1,0,0,0,1\n"})
    advice = "; add `drop: [unordered]` to the mapping to leave such rows out"
    assert notes(found) == [("file", f"plan.csv:4: expected a time after 2 s, got 1 s{advice}")]


@pytest.mark.needs("logs")
def test_what_is_odd_in_a_file_is_a_remark():
    text = TEXT.replace("t,", "battery,t,").replace("\n0,", "\n12,0,").replace("\n2,", "\n11,2,")
    found = WaypointsReference(file="plan.csv").with_files({"plan.csv": text})
    assert list(found.remarks(G)) == ["plan.csv: column battery is not used"]
    assert list(WaypointsReference(POINTS).remarks(G)) == []


@pytest.mark.needs("logs")
def test_a_mapping_is_of_a_file_and_fits_it():
    no_file = ("mapping", "describes a `file`, which is not given; remove this key")
    assert notes(WaypointsReference(POINTS, mapping=LogMapping())) == [no_file]
    upside_down = LogMapping(time=TimeMapping(begin=2.0, end=1.0))
    assert notes(WaypointsReference(POINTS, mapping=upside_down)) == [
        no_file,
        ("mapping.time.end", "expected a time after 2 s, got 1 s"),
    ]
    mapping = LogMapping(units={"t": "m"})
    found = WaypointsReference(file="plan.csv", mapping=mapping).with_files({"plan.csv": TEXT})
    assert notes(found) == [
        ("mapping.units.t", "column t: expected a time in s, ms, us, min or h, got 'm'")
    ]


def test_times_of_a_clock_are_told_what_to_do():
    text = TEXT.replace("\n0,", "\n1700000000,").replace("\n2,", "\n1700000002,")
    found = WaypointsReference(file="plan.csv").with_files({"plan.csv": text})
    [(option, said)] = notes(found)
    assert option == "file"
    assert said == (
        "expected times from -1e+09 to 1e+09 s, got 1.7e+09 s; add `time: {offset: first}` to "
        "`mapping`"
    )


@pytest.mark.parametrize(
    ("option", "given"), [("from", {"from_": "nowhere", "to": "identity"}), ("to", {"to": "up"})]
)
def test_both_ends_of_a_slew_are_looked_at(option, given):
    [(path, message)] = notes(SlewReference(duration=1.0, **given))
    assert path == option
    assert message


def test_a_slew_begins_at_once_unless_told():
    slew = SlewReference(to={"rotvec": [0.0, 0.0, 1.0]}, duration=2.0)
    Q, _, _ = slew.motion(G, np.array([0.0, 1.0, 2.0]))
    np.testing.assert_allclose(Q, G.exp(np.array([[0, 0, 0], [0, 0, 0.5], [0, 0, 1]])), atol=1e-15)


def test_only_numbers_that_differ_from_piece_to_piece_are_held():
    """What is 0, 1 or −1 in all pieces is structure, which costs nothing once compiled."""
    pieces = SlewReference(to={"rotvec": [0.0, 0.0, 1.0]}, duration=2.0, start=1.0).pieces(G)
    _, held = pieces.at(pieces.starts)
    shared = (held == held[0]).all(axis=0)
    assert not np.isin(held[0, shared], (-1.0, 0.0, 1.0)).any()


def test_every_factor_of_a_path_is_looked_at():
    factors = [PathFactor("wz", "0.1*t"), PathFactor("wq", "t"), PathFactor("wx", "0.1*u")]
    options = [option for option, _ in notes(PathReference(factors))]
    assert options == ["factors[1].axis", "factors[2].by"]


TURNS = np.linspace(0.0, 3.0, 31)
NOISY = [
    Waypoint(float(t), {"rotvec": [float(np.sin(t) + e), 0.0, 0.0]})
    for t, e in zip(TURNS, 0.02 * np.random.default_rng(0).normal(size=31), strict=True)
]


@pytest.mark.needs("logs")
def test_smoothing_is_proposed_from_the_noise_of_a_file():
    """0.02 rad from row to row at 10 Hz: accelerations of 2 rad/s² and more by noise alone."""
    rows = [f"{p.t},{np.sin(h := p.pose['rotvec'][0] / 2)},0,0,{np.cos(h)}" for p in NOISY]
    found = WaypointsReference(file="a.csv")
    [said] = found.with_files({"a.csv": "\n".join(["t,qx,qy,qz,qw", *rows])}).remarks(G)
    start = "goes through every row, noise included; add `smoothing: {rotation: "
    assert said.startswith(start)
    assert 0.01 < float(said.removeprefix(start).rstrip("}`")) < 0.02
    # Places of a task are meant as they are.
    assert list(WaypointsReference(NOISY).remarks(G)) == []


@pytest.mark.needs("logs")  # what its message asks
def test_the_residual_of_smoothed_waypoints_is_told():
    found = WaypointsReference(NOISY, smoothing={"rotation": "1 deg"})
    assert notes(found) == []
    told = "smoothed: the root mean square residual of rotation is"
    assert list(found.remarks(G)) == [f"{told} 1 deg"]
    (auto,) = WaypointsReference(NOISY, smoothing="auto").remarks(G)
    assert auto == f"{told} 0.718 deg"
    (most,) = WaypointsReference(NOISY, smoothing={"rotation": "90 deg"}).remarks(G)
    angles = [point.pose["rotvec"][0] for point in NOISY]
    (squares,) = np.polyfit(TURNS, angles, 1, full=True)[1]  # λ → ∞: a constant velocity
    line = np.rad2deg(np.sqrt(squares / len(TURNS)))
    assert most == f"{told} {line:.3g} deg instead of 90 deg, and cannot be larger"
    Q, _, _ = found.motion(G, TURNS)
    left = G.log(np.swapaxes(Q, -1, -2) @ WaypointsReference(NOISY).motion(G, TURNS)[0])
    size = np.sqrt(np.mean(np.sum(left**2, axis=1)))
    np.testing.assert_allclose(size, np.deg2rad(1.0), rtol=1e-3)


NO_POSE = (
    "expected identity, a 3×3 matrix or {rotvec: …} for SO3 (quaternion, euler or matrix may "
    "replace rotvec), got 'nowhere'"
)


@pytest.mark.needs("logs")
@pytest.mark.parametrize(
    ("reference", "expected"),
    [
        (TorqueReference(["1", "2", "t"]), []),
        (TorqueReference(["1", "cos(t", "t"]), [("torque[1]", "'cos(t': the '(' at column 4 is "
         "never closed")]),
        (RatesReference(["1"]), [("rates", "expected 3 expressions for SO3, got 1")]),
        (RatesReference(["1", "2", "3", "4"]),
         [("rates", "expected 3 expressions for SO3, got 4")]),
        (ConstantReference(pose="nowhere", velocity=[1.0, 2.0]),
         [("pose", NO_POSE), ("velocity", "expected 3 entries for SO3, got 2")]),
        (PathReference([], pose="nowhere"), [("pose", NO_POSE), ("factors", "expected at least one "
         "factor, such as [{axis: wz, by: 0.1*t}]")]),
        (PathReference([PathFactor([1.0], "t")]), [("factors[0].axis", "expected 3 entries for "
         "SO3, got 1")]),
        (PathReference([PathFactor("wq", "t")]), [("factors[0].axis", "expected wx, wy, wz or a "
         "list of 3 numbers for SO3, got 'wq'")]),
        (WaypointsReference(), [("", "expected the waypoints as `points` or in a `file`, got "
         "neither")]),
        (WaypointsReference(POINTS, file="plan.csv"), [("", "expected the waypoints as `points` "
         "or in a `file`, got both")]),
        (WaypointsReference(POINTS), []),
        (WaypointsReference(POINTS[:1]), [("points", "expected at least two points, got 1")]),
        (WaypointsReference([Waypoint(-1e9, "identity"), Waypoint(1e9, "identity")]), []),
        (WaypointsReference([Waypoint(0.0, "identity"), Waypoint(1e-9, "identity")]), []),
        (WaypointsReference(POINTS, smoothing="auto"), [("points", "expected at least 5 waypoints "
         "to smooth, got 2")]),
        (WaypointsReference(NOISY, smoothing={"rotation": "2 m"}), [("smoothing.rotation",
         "expected a number or an angle in rad, mrad, deg, arcmin or arcsec, got '2 m'")]),
        (WaypointsReference(NOISY, smoothing={"rotation": 0.1, "position": 1.0}),
         [("smoothing.position", "unknown key; did you mean 'rotation'?")]),
        (WaypointsReference(NOISY, smoothing={}), [("smoothing", "expected a deviation for each of "
         "rotation; missing rotation")]),
    ],
)  # fmt: skip
def test_what_is_noted_of_the_options_of_a_reference(reference, expected):
    assert notes(reference) == expected


def test_a_constant_reference_rests_unless_told():
    Q, V, _ = ConstantReference().motion(G, np.array([0.0, 3.0]))
    np.testing.assert_array_equal(Q, [np.eye(3)] * 2)
    assert not V.any()


def test_other_functions_of_time_leave_a_reference_as_it_is():
    one, t = TorqueReference(["1", "2", "t"]), 0.5
    other = one.with_functions(lambda: formula("7"))
    assert other.values(t).tolist() == [7.0, 7.0, 7.0]
    assert one.values(t).tolist() == [1.0, 2.0, 0.5]


def test_a_reference_without_a_file_is_given_at_all_times():
    torque = TorqueReference(["1", "2", "t"])
    assert torque.ends(G) == (-np.inf, np.inf)
    assert (torque.gaps(G), torque.files, torque.instants(G, 1.0).shape) == ([], {}, (0,))
    assert torque.held(G, 0.5) is None
    assert torque.with_files({"a.csv": TEXT}) is torque
