"""Laws that flew, found from logs; the flights are of plain programs, without eqt."""

from pathlib import Path

import numpy as np
import pytest
from case_tables import refusal
from said import mentions, says
from scipy.spatial.transform import Rotation

import eqt_cli
from eqt_cli.base.errors import EqtError

KP, KV, KI = np.array([3.0, 4.0, 3.5]), np.array([4.0, 4.0, 3.0]), np.array([1.0, 1.2, 0.8])
NAMES = "t,x,y,z,vx,vy,vz,x_d,y_d,z_d,vx_d,vy_d,vz_d,u1,u2,u3"
COMMAND = {"command": {"ax": "u1", "ay": "u2", "az": "u3"}}
J = np.array([0.02, 0.025, 0.035])


def fly(name="f.csv", *, noise=0.0, late=1, seconds=20, seen=False, change=None, seed=0, most=99):
    """A point in wind under PID with feedforward, whose command is so many rows late."""
    random, h, rows, past = np.random.default_rng(seed), 0.02, [], []
    p, v, total, wind = np.array([1.0, 0.2, 0.1]), np.zeros(3), np.zeros(3), np.zeros(3)
    f = np.array([0.9, 1.7, 1.3])
    for k in range(round(seconds / h)):
        t = k * h
        wanted, speed, rate = np.sin(f * t), f * np.cos(f * t), -(f**2) * np.sin(f * t)
        q = p + 0.2 * noise * random.normal(size=3)
        w = v + noise * random.normal(size=3)
        e, ev = (q if seen else p) - wanted, (w if seen else v) - speed
        kp = KP if change is None or t < seconds / 2 else change
        past.append(np.clip(rate - kp * e - KV * ev - KI * total, -most, most))
        u, total = past[max(k - late, 0)], total + e * h
        rows.append([t, *q, *w, *wanted, *speed, *u])
        p, v = p + v * h, v + (u - 0.3 * v + wind) * h
        wind = wind - wind * h + 0.5 * np.sqrt(h) * random.normal(size=3)
    np.savetxt(name, rows, "%.9g", ",", header=NAMES, comments="")


def gains(loop, term):
    return [g for g in loop.gains if g.term == term]


def position(*args, **how):
    (loop,) = eqt_cli.identify_law([*args] or ["f.csv"], COMMAND, **how).loops
    return loop


TRUE = {"stiffness": KP, "damping": KV, "integral": KI, "feedforward": np.ones(3)}


def test_a_law_without_noise_is_found_to_three_digits():
    fly()
    loop = position()
    assert loop.delay == pytest.approx(0.02)
    for term, values in TRUE.items():
        # Sums before and behind a row differ by ki h/2.
        found = [g.value for g in gains(loop, term)]
        np.testing.assert_allclose(found, values, atol=0.5 * 1.2 * 0.02 + 4e-3 * max(values))
    assert says(loop.nearest, "`cascade`, by its `position`; it lacks the integral")


@pytest.mark.parametrize(
    "seen",
    [False, pytest.param(True, marks=pytest.mark.ci("flies once more"))],
    ids=["noise of the log", "noise that the law saw"],
)
def test_intervals_hold_gains_where_least_squares_fails(seen):
    fly(noise=0.03, seen=seen)
    loop = position()
    assert loop.delay == pytest.approx(0.02)
    every = [
        (g, x) for term, xs in TRUE.items() for g, x in zip(gains(loop, term), xs, strict=True)
    ]
    assert sum(not (g.low <= x <= g.high) for g, x in every if not g.word) <= 1  # of 12 at 95 %
    rows = np.loadtxt("f.csv", delimiter=",", skiprows=1)
    e, ev = rows[:-1, 1] - rows[:-1, 7], rows[:-1, 4] - rows[:-1, 10]
    X = np.c_[-e, -ev, -np.cumsum(e) * 0.02, np.gradient(rows[:, 10], 0.02)[:-1], 0 * e + 1]
    damping = np.linalg.lstsq(X, rows[1:, 13], rcond=None)[0][1]
    assert (damping < gains(loop, "damping")[0].low) != seen


def test_terms_that_are_not_there_are_none():
    fly()
    rows = np.loadtxt("f.csv", delimiter=",", skiprows=1)
    e, ev = rows[:, 1:4] - rows[:, 7:10], rows[:, 4:7] - rows[:, 10:13]
    rows[:, 13:] = -2 * e - 3 * ev
    np.savetxt("pd.csv", rows, "%.9g", ",", header=NAMES, comments="")
    loop = position("pd.csv")
    assert {g.word for t in ("integral", "feedforward") for g in gains(loop, t)} == {"none"}
    assert [g.value for g in gains(loop, "damping")] == pytest.approx([3, 3, 3], rel=1e-5)


@pytest.mark.ci("flies thrice")
def test_flights_of_a_law_share_their_gains():
    for k in range(2):
        fly(f"{k}.csv", noise=0.03, seed=k, seconds=12)
    together, alone = position("0.csv", "1.csv"), position("0.csv")
    widths = [[g.high - g.low for g in gains(x, "stiffness")] for x in (together, alone)]
    assert sum(widths[0]) < sum(widths[1])
    Path("flights.csv").write_text("file,law\n0.csv,a\n1.csv,b\n")
    said = refusal(EqtError, position, "flights.csv")
    assert says(said, "law: expected one of a, b…; got none")
    assert position("flights.csv", law="a").delay == alone.delay


def test_what_no_motion_tells_is_not_identifiable():
    """Along x, the damping error is twice the position error in all rows."""
    t = np.arange(0, 20, 0.02)
    e = np.stack([0.1 * np.exp(-t / 5), 0.1 * np.sin(2 * t), 0.1 * np.sin(3 * t)], axis=1)
    ev = np.c_[-0.2 * e[:, 0], 0.2 * np.cos(2.3 * t), 0.3 * np.cos(3.7 * t)]
    u = -3 * e - 2 * ev
    rows = np.c_[t, e, ev, np.zeros((len(t), 6)), u]
    np.savetxt("f.csv", rows, "%.15g", ",", header=NAMES, comments="")
    loop = position()
    assert [g.word for g in gains(loop, "stiffness")] == ["not identifiable", "", ""]
    assert {"stiffness", "damping"} <= {*loop.axes[0].alike}


# Bad input ----------------------------------------------------------------------------------------


@pytest.mark.ci("flies once more")
def test_a_command_at_its_limits_all_along_is_refused():
    fly(most=0.3)
    said = refusal(EqtError, position)
    assert mentions(said, "f.csv: the command is at a limit in…% of its rows; identify a part")


def test_rows_at_limits_are_left_out():
    fly(most=3.0)
    loop = position()
    assert max(loop.limits) > 0.005
    values = [g.value for g in gains(loop, "damping")]
    np.testing.assert_allclose(values, KV, rtol=0.02)


def test_a_flight_at_rest_tells_nothing():
    rows = np.zeros((500, 16))
    rows[:, 0], rows[:, 15] = 0.02 * np.arange(500), 9.81
    np.savetxt("f.csv", rows, "%.9g", ",", header=NAMES, comments="")
    assert mentions(refusal(EqtError, position), "f.csv: its command hardly changes")


@pytest.mark.ci("flies 40 s")
def test_gains_that_change_in_flight_are_told():
    fly(change=1.5 * KP, seconds=40)
    assert any(mentions(x, "did the gains change in flight?") for x in position().changes)


@pytest.mark.ci("flies once more")
def test_rows_with_the_law_off_are_left_out():
    fly()
    rows = np.loadtxt("f.csv", delimiter=",", skiprows=1)
    rows[-200:, 13:] = 0
    np.savetxt("f.csv", rows, "%.9g", ",", header=NAMES, comments="")
    np.testing.assert_allclose([g.value for g in gains(position(), "damping")], KV, rtol=5e-3)


def test_a_log_without_commands_says_what_it_needs():
    fly()
    said = refusal(EqtError, eqt_cli.identify_law, ["f.csv"])
    assert mentions(said, "f.csv: has no command of a loop…`command: {thrust: …}`")


# The attitude loop --------------------------------------------------------------------------------


def turn(*, feedforward, flips=False):
    """A body under Lee's law; without feedforward, with Wie's quaternion feedback."""
    h, t, rows = 0.02, np.arange(0, 16, 0.02), []
    d = 1e-4

    def attitude(x):
        x = np.asarray(x)
        angles = [0.4 * np.sin(0.8 * x), 0.3 * np.sin(1.3 * x + 1), 0.5 * np.sin(0.6 * x + 2)]
        return Rotation.from_euler("ZYX", np.stack(angles, axis=-1))

    def rate(x):
        return (attitude(x - d).inv() * attitude(x + d)).as_rotvec() / (2 * d)

    goals, rates, changes = attitude(t), rate(t), (rate(t + 1e-3) - rate(t - 1e-3)) / 2e-3
    kp, kd = np.array([0.8, 1.0, 1.2]), np.array([0.15, 0.2, 0.25])
    R, w, gust = goals[0] * Rotation.from_rotvec([0.3, -0.2, 0.2]), np.zeros(3), np.zeros(3)
    random = np.random.default_rng(3)
    for k in range(len(t)):
        E = goals[k].inv() * R
        q, seen = E.as_quat(canonical=True), E.inv().apply(rates[k])
        if feedforward:
            more = E.inv().apply(changes[k]) - np.cross(w, seen)
            u = -kp * 2 * q[3] * q[:3] - kd * (w - seen) + np.cross(w, J * w) + J * more
        else:
            u = -kp * 2 * q[:3] - kd * (w - seen)
        sign = -1 if flips and k % 3 else 1
        rows.append([t[k], *(sign * R.as_quat()), *w, *goals[k].as_quat(), *rates[k], *u])
        for _ in range(4):
            w = w + h / 4 * (u + gust - np.cross(w, J * w)) / J
            R = R * Rotation.from_rotvec(h / 4 * w)
        gust = gust - gust * h + 0.1 * np.sqrt(h) * random.normal(size=3)
    names = "t,qx,qy,qz,qw,wx,wy,wz,qx_d,qy_d,qz_d,qw_d,wx_d,wy_d,wz_d,torque_x,torque_y,torque_z"
    np.savetxt("f.csv", rows, "%.12g", ",", header=names, comments="")
    return kp, kd


@pytest.mark.ci("flies a body")
def test_the_attitude_law_of_lee_is_found_with_its_inertia():
    kp, kd = turn(feedforward=True)
    (loop,) = eqt_cli.identify_law(["f.csv"]).loops
    assert loop.form.words == "½(E − Eᵀ)^∨, ω − Eᵀω_d"
    expected = {"stiffness": kp, "damping": kd, "feedforward": J}
    expected["gyroscopic"] = np.roll(J, -2) - np.roll(J, -1)
    for term, values in expected.items():
        # The feedforward is a difference of rates over 40 ms.
        np.testing.assert_allclose([g.value for g in gains(loop, term)], values, rtol=0.02)
    assert loop.nearest == "`lee2010`"


@pytest.mark.ci("flies a body")
def test_signs_of_quaternions_do_not_matter():
    kp, kd = turn(feedforward=False, flips=True)
    (loop,) = eqt_cli.identify_law(["f.csv"]).loops
    assert (loop.form.stiffness, loop.nearest) == ("2 sgn(q_w) q_v", "`quaternion`")
    np.testing.assert_allclose([g.value for g in gains(loop, "stiffness")], kp, rtol=2e-3)
    np.testing.assert_allclose([g.value for g in gains(loop, "damping")], kd, rtol=2e-3)
    assert {g.word for t in ("gyroscopic", "feedforward") for g in gains(loop, t)} <= {
        "none",
        "not identifiable",
    }
