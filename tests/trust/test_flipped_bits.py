"""One bit of a file that eqt wrote is flipped: each command that reads the file says so.

A flip is harmless where no reader uses the byte: then the numbers are those of the whole file.
"""

import collections
import json
import random
import shutil
from unittest import mock

import numpy as np
import pytest

import eqt_cli
from eqt_cli.base.files import is_intact_file
from eqt_cli.base.store_reader import open_results
from eqt_cli.extend import EqtError

CONFIG = """
group: SO3
inertia: [2, 1, 3]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "0"]}
controllers: [eqt, gt]
initial: {pose: haar, velocity: normal}
ensemble: {runs: 6, seed: 1}
store: {trajectories: 1, compression: COMPRESSION}
time: {duration: 1.0, samples: 11}
solver: {rtol: 1.0e-6, cross_check: 0}
"""


WHOLE, BEGUN = "whole", "begun"
FEW, MANY = 12, 100
"""Flips in each of four folders, in `make test` and in all tests: 1,000 together."""


def numbers_of(path):
    """All variables of a result, to the bit."""
    with open_results(path) as result:
        arrays = {name: np.asarray(result[name]) for name in result.names}
    return {name: (x.tolist() if x.dtype == object else x.tobytes()) for name, x in arrays.items()}


@pytest.fixture(scope="module", params=["none", "gzip"])
def made(request, tmp_path_factory):
    """A study and two folders: its result, and its parts of a session that ended before packing."""
    folder = tmp_path_factory.mktemp("bits")
    (folder / "a.yaml").write_text(CONFIG.replace("COMPRESSION", request.param))
    study = eqt_cli.load_experiment(folder / "a.yaml")
    eqt_cli.run(study, folder / WHOLE)
    with (
        mock.patch("eqt_cli.runs.run_study.pack", side_effect=KeyboardInterrupt),
        pytest.raises(KeyboardInterrupt),
    ):
        eqt_cli.run(study, folder / BEGUN)
    assert list((folder / BEGUN).glob("parts/0*.npy"))
    return folder, study


def flipped(path, bit):
    data = bytearray(path.read_bytes())
    data[bit // 8] ^= 1 << bit % 8
    path.write_bytes(data)


@pytest.mark.parametrize(
    "count",
    [FEW, pytest.param(MANY, marks=pytest.mark.ci("each flip of a part runs the experiment"))],
)
@pytest.mark.parametrize("state", [WHOLE, BEGUN])
@pytest.mark.filterwarnings("ignore:.*manifest.json is damaged:eqt_cli.base.errors.EqtWarning")
def test_no_flipped_bit_becomes_another_number(made, tmp_path, state, count):
    folder, study = made
    expected, random_ = numbers_of(folder / WHOLE), random.Random(count)
    found = collections.Counter()
    for _ in range(count):
        out = tmp_path / "out"
        shutil.copytree(folder / state, out)
        path = random_.choice(
            sorted([*out.rglob("*.h5"), *out.rglob("*.npy"), out / "manifest.json"])
        )
        flipped(path, random_.randrange(8 * path.stat().st_size))
        kind = path.name if path.parent == out else "part"
        assert not is_intact_file(path)  # of which `eqt verify --file` tells
        try:
            if state == BEGUN or kind == "manifest.json":
                eqt_cli.run(study, out)
            assert numbers_of(out) == expected, path
            found[kind, "the same numbers"] += 1
        except EqtError:
            found[kind, "told"] += 1
        shutil.rmtree(out)
    print(dict(found))
    if state == WHOLE:  # the mark of the checksum itself is 16 bytes of the file
        assert found["results.h5", "the same numbers"] <= 1


@pytest.mark.needs("proofs")
def test_verify_names_the_file(made, tmp_path, invoke):
    folder, _ = made
    shutil.copytree(folder / BEGUN, tmp_path / "out")
    done = invoke("verify", tmp_path / "out", "--file")
    assert done.stdout == f"{tmp_path / 'out'}: 0 of 4 files damaged\n"
    path = tmp_path / "out" / "parts" / "000001.npy"
    flipped(path, 12345)
    done = invoke("verify", tmp_path / "out", "--file", "--json", code=4)
    assert json.loads(done.stdout)["damaged"] == [str(path)]
    assert f"{path}: has other bytes than eqt wrote" in done.stderr
