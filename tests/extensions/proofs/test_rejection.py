"""Margins of laws that reject disturbances against a matrix, and what `eqt verify` says of them."""

import json

import numpy as np
import pytest
from case_tables import in_ci
from scipy.linalg import expm
from scipy.signal import butter

import eqt_cli
from eqt_cli.api.loading import experiment_at
from eqt_cli.extensions.designed_laws.rejection import Indi
from eqt_cli.extensions.proofs.margins import delayed
from eqt_cli.loop.linearised import linearised

J, K_R, K_OMEGA, LAG, T, CUTOFF, RATE = (0.04, 0.05, 0.08), 4.0, 0.8, 0.05, 0.002, 20.0, 88.9
LAW = {"kind": "indi", "law": "lee2010", "cutoff": CUTOFF}
OBSERVER = {"kind": "observer", "law": "lee2010", "rate": RATE}
REST = {
    "name": "rest",
    "group": "SO3",
    "inertia": list(J),
    "gains": {"k_R": K_R, "k_Omega": K_OMEGA},
    "reference": {"kind": "constant"},
    "controllers": [LAW, OBSERVER],
    "actuators": [{"kind": "lag", "time_constant": LAG}],
    "control": {"period": T},
    "time": {"duration": 1.0},
}


def step_of(inertia, law, lag=LAG, period=T, true=1.0):
    """A, B, C of one axis over a period: x = (ε, ω, τ, û, ω before, two inputs, two outputs of H).

    Of the observer, the last is P̂. The command, u = C x, is given at the begin of the period.
    """
    # ε' = ω, J ω' = τ, τ' = (u − τ)/T_a, and the held u.
    flow = np.zeros((4, 4))
    flow[0, 1], flow[1, 2], flow[2, 2:] = 1.0, 1.0 / (true * inertia), [-1 / LAG, 1 / LAG]
    moved = expm(flow * period)
    A, B, C = np.zeros((9, 9)), np.zeros((9, 1)), np.zeros((1, 9))
    A[:3, :3], B[:3, 0] = moved[:3, :3], moved[:3, 3]
    pd = np.array([-K_R, -K_OMEGA, *[0.0] * 7])
    u_hat, before = np.eye(9)[3], np.eye(9)[4]
    fall = np.exp(-period / lag)
    if law == "indi":
        b, a = butter(2, CUTOFF, fs=1 / period)
        r = u_hat - inertia * (np.eye(9)[1] - before) / period
        y = b[0] * r + b[1:] @ np.eye(9)[5:7] - a[1:] @ np.eye(9)[7:9]
        C[0] = pd + y
        A[4], A[5], A[6], A[7], A[8] = np.eye(9)[1], r, np.eye(9)[5], y, np.eye(9)[7]
    else:
        delta_hat = RATE * (inertia * np.eye(9)[1] - np.eye(9)[8])
        C[0] = pd - delta_hat
    A[3] = fall * u_hat + (1 - fall) * C[0]  # the law's own command, which waits nowhere
    if law == "observer":
        A[8] = np.eye(9)[8] + period * (A[3] + delta_hat)
    return A, B, C


def radius_of(law, factor=1.0, periods=0, **changes):
    """The largest modulus of all axes, with a multiple of the torque and of waiting periods."""
    sizes = []
    for inertia in J:
        A, B, C = step_of(inertia, law, **changes)
        closed = A + factor * B @ C if not periods else delayed([(A, B, C)], periods)
        sizes.append(np.abs(np.linalg.eigvals(closed)).max())
    return max(sizes)


CASES = ("known lag", "half the lag", "plant 1.5", "100 Hz")


@pytest.mark.parametrize(
    ("law", "case"),
    [
        ("indi", "half the lag"),
        *(in_ci("as the others", law, case) for law in ("indi", "observer") for case in CASES),
    ],
)
def test_margins_are_those_of_a_matrix(law, case):
    """Modulus and limits of the torque to 1e-9; the delay margin is the same whole number."""
    written = LAW if law == "indi" else OBSERVER
    config, changes = REST | {"controllers": [written]}, {}
    if case == "half the lag":
        config, changes = config | {"controllers": [written | {"lag": 0.025}]}, {"lag": 0.025}
    elif case == "plant 1.5":
        config, changes = config | {"plant": {"inertia": {"relative": 0.5}}}, {"true": 1.5}
    elif case == "100 Hz":
        config, changes = config | {"control": {"period": 0.01}}, {"period": 0.01}
    [found] = eqt_cli.margins(config).laws
    assert found.size == pytest.approx(radius_of(law, **changes), rel=0, abs=1e-9)
    periods = found.delay_periods
    assert (
        radius_of(law, periods=periods, **changes)
        < 1
        < radius_of(law, periods=periods + 1, **changes)
    )
    effect = found.gains["effectiveness"]
    for end in filter(None, (effect.lower, effect.upper)):
        grown = radius_of(law, factor=end, **changes)
        assert grown == pytest.approx(1.0, rel=0, abs=1e-9)


@pytest.mark.ci("many delays")
def test_the_lag_is_multiplied_where_the_law_believes_it():
    """The limit of the believed lag, and the delays with half and twice of it."""
    laws = {law.label: law for law in eqt_cli.margins(REST).laws}
    for name, law in laws.items():
        assert radius_of(name, lag=law.gains["lag"].lower * LAG) == pytest.approx(1.0, abs=1e-9)
        assert law.gains["lag"].upper is None
        for factor, delay in zip((0.5, 2.0), law.lag_delays, strict=True):
            periods = round(delay / T)
            stable, not_so = (
                radius_of(name, lag=factor * LAG, periods=periods + more) for more in (0, 1)
            )
            assert stable < 1 < not_so
    # As a trial had them with another program.
    assert laws["indi"].size == pytest.approx(0.9899243507588, abs=1e-12)
    assert (laws["indi"].delay_periods, laws["indi"].gains["kp"].upper) == (
        13,
        pytest.approx(3.897840235, abs=1e-8),
    )


@pytest.mark.ci("many delays")
def test_the_table_has_what_only_these_laws_have(eqt, tmp_path):
    path = tmp_path / "rest.yaml"
    path.write_text(json.dumps(REST | {"controllers": ["lee2010", LAW]}), encoding="utf-8")
    header, _, lee, indi, *_ = eqt("margins", str(path)).out.splitlines()
    title = "of effectiveness of lag delay margin if lag × 0.5, × 2 verdict"
    assert " ".join(header.split()).endswith(title)
    assert " ".join(lee.split()).endswith("not used - stable")
    assert " ".join(indi.split()).endswith("0.294 to 7.38 above 0.148 0.012 s, 0.04 s stable")
    [_, law] = json.loads(eqt("margins", str(path), "--json").out)["laws"]
    assert law["delay_margins_of_lags"] == {"0.5": pytest.approx(0.012), "2.0": pytest.approx(0.04)}
    assert law["gain_margins"]["lag"]["upper"] is None


@pytest.mark.ci("margins of two laws")
def test_without_a_lag_the_table_has_the_effectiveness_only(eqt, tmp_path):
    path = tmp_path / "rest.yaml"
    bare = {"controllers": ["lee2010", LAW], "actuators": []}
    path.write_text(json.dumps(REST | bare), encoding="utf-8")
    header, _, _, indi, *notes = eqt("margins", str(path)).out.splitlines()
    assert " ".join(header.split()).endswith("of both of effectiveness verdict")
    [law] = eqt_cli.margins(REST | bare | {"controllers": [LAW]}).laws
    effect = law.gains["effectiveness"]
    assert f"{effect.lower:.3g} to {effect.upper:.3g} stable" in " ".join(indi.split())
    text = " ".join(notes)
    assert "effectiveness: the torque for each command" in text and "believes" not in text


BODY = REST | {
    "group": "SE3",
    "inertia": [*J, 1.3, 1.3, 1.3],
    "gains": {"kp": 2.0, "kd": [0.8, 0.8, 0.8, 3.0, 3.0, 3.0]},
    "model": {"forces": [{"kind": "restoring", "weight": 12.753}]},
}


def offset_of(config, law, **changes):
    """ε where the loop with this law rests."""
    loop = experiment_at({**config, **changes, "controllers": [law]}, None).loop
    still, pose = np.zeros((1, loop.group.dimension)), loop.group.identity[None]
    linear = linearised(loop, np.zeros(1), pose, still)
    assert linear.is_constant
    return linear.offset[0]


@pytest.mark.parametrize("law", ["lee2010", LAW, LAW | {"linear": "accelerometer"}, OBSERVER])
def test_offsets_are_those_of_a_balance_of_forces(law):
    """arcsin |δ|/k_R; F/(m k_x); g/(2 k_x) with rotors twice as strong. None with an estimate."""
    rejects = law != "lee2010"
    if not (rejects and law.get("linear")):
        push = {"forces": [{"kind": "constant", "force": [0.3, 0.0, 0.0]}]}
        expected = 0.0 if rejects else np.arcsin(0.3 / K_R)
        assert offset_of(REST, law, plant=push) == pytest.approx(
            [expected, 0, 0], rel=0.01, abs=1e-6
        )
    side = {"kind": "constant", "force": [0, 0, 0, 0.5, 0, 0], "frame": "spatial"}
    found = offset_of(BODY, law, plant={"forces": [*BODY["model"]["forces"], side]})
    expected = 0.0 if rejects else 0.5 / 2.0
    assert found[3:] == pytest.approx([expected, 0.0, 0.0], rel=0.01, abs=1e-6)
    strong = [{"kind": "scale", "factor": 2.0}, *REST["actuators"]]
    expected = 0.0 if rejects else 12.753 / (2 * 2.0)
    found = offset_of(BODY, law, actuators=strong)
    assert found[3:] == pytest.approx([0.0, 0.0, expected], rel=0.01, abs=1e-6)


def rows_of(config):
    found = eqt_cli.verify({**config, "ensemble": {"runs": 1}, "time": {"duration": 0.1}})
    return {row.controller: row for row in found.rows if row.name == "δ̂ tends to δ"}, found


@pytest.mark.ci("runs and identities of three laws")
def test_verify_finds_the_wrench_and_covers_no_theorem():
    acceleration = LAW | {"linear": "accelerometer", "label": "felt"}
    rows, found = rows_of(BODY | {"controllers": [LAW, acceleration, OBSERVER]})
    assert {name: row.verdict.value for name, row in rows.items()} == dict.fromkeys(
        ("indi", "felt", "observer"), "holds"
    )
    assert not found.failures
    covered = [row for row in found.rows if row.name == "theorem for the law"]
    assert {row.verdict.value for row in covered} == {"not covered"}
    assert all("disturbance observer in the law" in row.remark for row in covered)


@pytest.mark.ci("runs and identities of a law")
@pytest.mark.parametrize(("share", "verdict"), [(1.0, "holds"), (0.9, "FAILS")])
def test_verify_finds_an_estimate_that_is_wrong(monkeypatch, share, verdict):
    """A law that takes a part of its estimate rests where this is not δ."""
    estimated = Indi.estimated

    def wrong(self, s, actuated, is_first, period):
        estimate, states = estimated(self, s, actuated, is_first, period)
        return share * estimate, states

    monkeypatch.setattr(Indi, "estimated", wrong)
    rows, _ = rows_of(REST | {"controllers": [LAW]})
    assert rows["indi"].verdict.value == verdict


@pytest.mark.ci("runs and identities of a law")
def test_verify_decides_nothing_where_the_loop_does_not_rest():
    rows, _ = rows_of(REST | {"control": {"period": T, "delay": 20}, "controllers": [LAW]})
    assert (rows["indi"].verdict.value, rows["indi"].remark) == ("unknown", "does not rest")


def test_no_rate_is_certified():
    pytest.importorskip("clarabel")
    [law] = eqt_cli.certified(REST | {"controllers": [LAW]}, [0.5])
    assert law.refused.startswith("is sampled")
