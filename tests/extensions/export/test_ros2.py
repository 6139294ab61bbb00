"""The node of ROS 2 in the examples, with headers that stand in for ROS."""

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from plain import hat
from scipy.spatial.transform import Rotation

import eqt_cli

ROOT = Path(__file__).parents[3]
ROS = ROOT / "examples" / "ros2"
STUB = ROOT / "tests" / "shared" / "ros2_stub"
J, KP, KD = np.diag([0.020, 0.021, 0.040]), 2.0, 0.4
needs_compilers = pytest.mark.skipif(
    not (shutil.which("gcc") and shutil.which("g++")), reason="needs gcc and g++"
)


def test_the_package_is_short():
    package = [
        path
        for path in (ROS / "eqt_attitude").rglob("*")
        if path.is_file() and path.parent.name != "law"
    ]
    lines = sum(len(path.read_text(encoding="utf-8").splitlines()) for path in package)
    assert lines <= 150
    assert f"a package of {lines} lines" in (ROS / "README.md").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def play(tmp_path_factory):
    """Run the node on messages and return the torques that it publishes."""
    folder = tmp_path_factory.mktemp("ros")
    lee = {"controllers": [{"kind": "lee2010", "label": "law"}]}
    experiment = eqt_cli.load_experiment(ROS / "attitude.yaml", lee)
    eqt_cli.export(experiment, folder / "law")
    law, node = folder / "law" / "law.c", ROS / "eqt_attitude" / "src" / "attitude_node.cpp"
    c = ["gcc", "-std=c99", "-O2", "-c", law, "-o", folder / "law.o"]
    subprocess.run(c, check=True)
    cpp = ["g++", "-std=c++17", "-Wall", "-Wextra", "-Werror", f"-I{STUB}", f"-I{folder / 'law'}"]
    subprocess.run([*cpp, node, folder / "law.o", "-o", folder / "node"], check=True)

    def run(*messages):
        done = subprocess.run(
            [folder / "node"], input="\n".join(messages), capture_output=True, text=True, check=True
        )
        period, *torques = done.stdout.splitlines()
        assert float(period) == 0.01
        return np.array([line.split() for line in torques], dtype=float)

    return run


def message(time, kind, attitude, *vectors):
    w = attitude.as_quat(scalar_first=True)
    return " ".join([str(time), kind, *(repr(float(x)) for x in np.concatenate([w, *vectors]))])


@needs_compilers
@pytest.mark.ci("compiles C++")
def test_its_torque_is_that_of_the_formula(play):
    """Lee, Leok and McClamroch (2010), eq. (11), with k_R = 2 k_p."""
    random, messages, expected = np.random.default_rng(1), [], []
    for k in range(20):
        R, Rd = Rotation.random(2, rng=random)
        W, Wd, Ad = random.standard_normal((3, 3))
        time = 0.01 * k
        messages += [message(time, "m", R, W, np.zeros(3)), message(time, "s", Rd, Wd, Ad)]
        messages += [f"{time} t"]
        E = Rd.as_matrix().T @ R.as_matrix()
        U = KP * (E - E.T)
        stiffness = np.array([U[2, 1], U[0, 2], U[1, 0]])
        transport = hat(W) @ E.T @ Wd - E.T @ Ad
        expected.append(-stiffness - KD * (W - E.T @ Wd) + np.cross(W, J @ W) - J @ transport)
    # Rounding of torques of about 5, and of quaternions of length 1 to rounding.
    np.testing.assert_allclose(play(*messages), expected, rtol=0, atol=1e-13)


@needs_compilers
@pytest.mark.ci("compiles C++")
def test_without_a_fresh_attitude_there_is_no_torque(play):
    still, turned = Rotation.identity(), Rotation.from_rotvec([0.1, 0, 0])
    zero, none = np.zeros(3), "0.3 m 0 0 0 0 1 1 1 0 0 0"
    setpoint = message(0.0, "s", still, zero, zero)
    torques = play(
        "0 t",
        message(0.0, "m", turned, zero, zero),
        "0.01 t",  # no setpoint
        setpoint,
        "0.02 t",
        "0.15 t",  # the attitude is older than 0.1 s
        message(0.2, "m", turned, zero, zero),
        "0.21 t",
        none,  # no quaternion
        "0.31 t",
    )
    on = [-2 * KP * np.sin(0.1), 0, 0]
    np.testing.assert_allclose(torques, [zero, zero, on, zero, on, zero], atol=1e-15)
