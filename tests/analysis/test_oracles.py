"""Foreign plants: the comparison by a plain rigid body, and the real ones where installed."""

import numpy as np
import pytest

from eqt_cli import api
from eqt_cli.analysis.oracles import MuJoCo, Pinocchio, oracle_named
from eqt_cli.analysis.oracles.base import RigidBody, SteppingOracle
from eqt_cli.analysis.oracles.rows import oracle_rows
from eqt_cli.core.errors import EqtError
from eqt_cli.groups import group_named

CONFIG = {
    "group": "SO3",
    "inertia": [[0.824, 0, 0.12], [0, 1.135, 0], [0.12, 0, 1.759]],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "cos(t)*sin(t)"]},
    "controllers": ["eqt"],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 1, "seed": 1},
    "time": {"duration": 2.0, "samples": 5},
}
FLIES = {
    "plant": {
        "inertia": {"relative": 0.2},
        "forces": [{"kind": "constant", "force": [0.1, 0, 0], "frame": "spatial"}],
    },
    "actuators": [{"kind": "limit", "limit": 0.5}, {"kind": "lag", "time_constant": 0.1}],
}
BODY = {  # 10 kg, its centre of mass away from the origin of its frame
    "group": "SE3",
    "inertia": [
        [0.175, 0, 0.05, 0, -0.5, 0],
        [0, 0.295, 0, 0.5, 0, 1.0],
        [0.05, 0, 0.28, 0, -1.0, 0],
        [0, 0.5, 0, 10.0, 0, 0],
        [-0.5, 0, -1.0, 0, 10.0, 0],
        [0, 1.0, 0, 0, 0, 10.0],
    ],
    "reference": {"torque": ["cos(t)", "sin(t)", "0", "1", "cos(t)", "0"]},
}


class Euler(SteppingOracle):
    """Euler's equations about a fixed point, J ω̇ = τ − ω × Jω, with steps of first order."""

    name, title = "euler", "Euler"
    sign = 1.0

    @classmethod
    def version(cls):
        return "1"

    def __init__(self, body):
        self.J = body.inertia

    def acceleration(self, R, x, V, force):
        return np.linalg.solve(self.J, force - self.sign * np.cross(V, self.J @ V))

    def start(self, R, x, V):
        self.R, self.V = R, V

    def steps(self, force, step, count):
        G = group_named("SO3")
        for _ in range(count):
            rate = self.acceleration(self.R, (), self.V, force)
            self.R = self.R @ G.exp(step * (self.V + step / 2 * rate))
            middle = self.V + step / 2 * rate
            self.V = self.V + step * self.acceleration(self.R, (), middle, force)
        return self.R, np.zeros(0), self.V


class WrongSign(Euler):
    sign = -1.0


def rows_of(oracle, config=CONFIG):
    experiment = api.load_experiment(config).base
    found = oracle_rows(oracle, experiment, np.random.default_rng(3))
    return {row.name.split(" converges")[0]: row for row in found}


@pytest.fixture(scope="module", params=["ideal", "flies"])
def asked(request):
    return rows_of(Euler, CONFIG | (FLIES if request.param == "flies" else {}))


def test_accelerations_are_those_of_a_plain_rigid_body(asked):
    for name in ("acceleration of the reference", "acceleration of the plant"):
        assert asked[name].verdict == "holds"
        assert asked[name].measured < 1e-12


def test_a_loop_stepped_with_second_order_converges(asked):
    row = asked["sampled loop"]
    assert row.verdict == "holds"
    assert row.remark.endswith("2.00")


def test_a_wrong_gyroscopic_torque_fails_every_row():
    assert {row.verdict for row in rows_of(WrongSign).values()} == {"FAILS"}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        (
            {"group": "SO2", "inertia": 1.0, "reference": {"torque": ["1"]}},
            "no rigid body in space",
        ),
        ({"inertia": {"matrix": [["2+sin(t)", 0, 0], [0, 2, 0], [0, 0, 3]]}}, "varies in time"),
        (BODY | {"inertia": [0.28, 0.28, 0.28, 17.0, 24.2, 26.07]}, "no rigid body in space"),
    ],
)
def test_what_is_no_rigid_body_is_not_covered(changes, said):
    for row in rows_of(Euler, CONFIG | changes).values():
        assert row.verdict == "not covered"
        assert said in row.remark


def test_a_rigid_body_is_read_from_its_tensor():
    body = RigidBody.of(group_named("SE3"), np.array(BODY["inertia"]))
    assert body.mass == 10.0
    np.testing.assert_allclose(body.centre, [-0.1, 0, 0.05], atol=1e-15)
    np.testing.assert_allclose(body.inertia, np.diag([0.15, 0.17, 0.18]), atol=1e-15)


def test_an_oracle_that_is_not_installed_says_how_to_get_it(monkeypatch):
    monkeypatch.setattr(MuJoCo, "is_installed", classmethod(lambda cls: False))
    with pytest.raises(EqtError) as caught:
        oracle_named("mujoco")
    assert str(caught.value) == (
        "--oracle mujoco: MuJoCo is not installed; install it with pip install mujoco"
    )


def test_an_oracle_that_cannot_be_loaded_says_why(monkeypatch):
    def broken(cls):
        raise ImportError("liburdfdom.so: no such file")

    monkeypatch.setattr(Pinocchio, "is_installed", classmethod(lambda cls: True))
    monkeypatch.setattr(Pinocchio, "version", classmethod(broken))
    with pytest.raises(EqtError) as caught:
        oracle_named("pinocchio")
    assert str(caught.value) == (
        "--oracle pinocchio: Pinocchio cannot be loaded (liburdfdom.so: no such file); install it "
        "with pip install pin"
    )


def test_an_unknown_oracle_is_named():
    with pytest.raises(EqtError, match="no oracle 'mujco'; did you mean 'mujoco'"):
        oracle_named("mujco")


@pytest.mark.parametrize("oracle", [MuJoCo, Pinocchio], ids=["mujoco", "pinocchio"])
@pytest.mark.parametrize(
    "config", [CONFIG, CONFIG | BODY, CONFIG | FLIES], ids=["SO3", "SE3", "flies"]
)
def test_an_installed_oracle_agrees(oracle, config):
    if not oracle.is_installed():
        pytest.skip(f"{oracle.title} is not installed; {oracle.remedy}")
    found = rows_of(oracle, config)
    assert {row.verdict for row in found.values()} == {"holds"}
    assert len(found) == (3 if issubclass(oracle, SteppingOracle) else 2)
