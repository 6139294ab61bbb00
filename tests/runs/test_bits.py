"""Native gives the same bits by any kernel of BLAS, loops of NumPy and build of the C library."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.runs.arithmetic import dependent

OTHER = {"OPENBLAS_CORETYPE": "Prescott"}
OLDEST = {
    "OPENBLAS_CORETYPE": "Sandybridge",
    "NPY_DISABLE_CPU_FEATURES": "X86_V3",
    "GLIBC_TUNABLES": "glibc.cpu.hwcaps=-AVX2,-FMA,-FMA4,-AVX",
}
CHANGES = {
    "paper": {"time.duration": 7.0},
    "se23": {"time.duration": 2.0},
    "crazyflie": {"time.duration": 1.0},
    "satellite_slew": {"time.duration": 30.0, "reference.from": {"rotvec": [0.3, -0.2, 0.5]}},
}
"""Configurations with starts and a reference that is integrated, with the inverse of a matrix, an
allocation, and with given poses and the pieces of a slew; and what is changed there."""
PROGRAM = """
import json, sys
from hashlib import sha256

import h5py
import yaml
import eqt_cli
from eqt_cli.runs.arithmetic import arithmetic

bits = {}
for path, changes in json.loads(sys.argv[1]).items():
    laws = yaml.safe_load(open(path))["controllers"][:1]
    changes |= {"controllers": laws, "time.samples": 201, "ensemble.runs": 20}
    changes |= {"solver.engine": "native", "solver.cross_check": 0}
    with eqt_cli.run(eqt_cli.load_experiment(path, changes), out="out", force=True):
        pass
    with h5py.File("out/results.h5") as file:
        for name in file:
            if file[name].dtype.kind in "fi":
                bits[f"{path}: {name}"] = sha256(file[name][()].tobytes()).hexdigest()
print(json.dumps([arithmetic(), bits]))
"""


def computed(setting, cwd):
    """The digest of the arithmetic, and digests of the numbers of all results, in a process."""
    folder = Path(__file__).parents[2] / "configs"
    changes = {str(folder / f"{name}.yaml"): CHANGES[name] for name in CHANGES}
    words = [sys.executable, "-c", PROGRAM, json.dumps(changes)]
    done = subprocess.run(
        words, env=os.environ | setting, cwd=cwd, capture_output=True, text=True, check=True
    )
    return json.loads(done.stdout.splitlines()[-1])


@pytest.mark.ci("runs four experiments in three processes")
def test_the_bits_of_native_are_those_of_any_arithmetic(tmp_path):
    here, bits = computed({}, tmp_path)
    others = [computed(setting, tmp_path) for setting in (OTHER, OLDEST)]
    if all(there == here for there, _ in others):
        pytest.skip("no other arithmetic on this machine")
    assert len(bits) > 150
    for _, found in others:
        assert [name for name in bits if found[name] != bits[name]] == []


@pytest.mark.ci("builds all shipped configurations")
def test_what_depends_on_the_arithmetic_is_named():
    paths = sorted((Path(__file__).parents[2] / "configs").glob("*.yaml"))
    studies = {path.stem: study(read_config(path, ["solver.engine=native"])) for path in paths}
    assert {name: of for name, each in studies.items() if (of := dependent(each))} == {
        "crazyflie": "force 'gust'",
        "planar_vtol": "reference 'flat'",
        "quadrotor_recovery": "actuator 'thrusters'",
        "quadrotor_speeds": "controller 'lqr'",
        "se3_survey": "reference 'waypoints'",
        "sweep_lqr": "controller 'lqr'",
    }
