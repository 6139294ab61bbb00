"""The numbers that the guides to vehicles and own parts state of their examples."""

from pathlib import Path

import numpy as np
import pytest
import yaml
from scipy.special import gammainc

import eqt_cli
from eqt_cli.extend import Native

EXAMPLES = Path(__file__).parents[2] / "examples"

pytestmark = [
    pytest.mark.ci("compiles laws and runs examples"),
    pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler"),
]


@pytest.fixture(autouse=True)
def _native_by_default(monkeypatch):
    """As for a user; the other engine takes minutes."""
    monkeypatch.delenv("EQT_ENGINE")


CROSSING = {"by speed": 0.064, "by torque": 4.375, "without friction": 0.009}
PULSES = {"proportional": (5.38, 0.01), "width": (5.27, 0.32), "modulator": (5.30, 0.31)}


def swept(name, folder):
    """A sweep of examples/effects, and what reads its points by the names of their cases."""
    file = EXAMPLES / "effects" / f"{name}.yaml"
    eqt_cli.run(file, out=folder / name)
    [block] = yaml.safe_load(file.read_text(encoding="utf-8"))["sweep"]
    for point, case in enumerate(block["cases"]):
        with eqt_cli.open_result(folder / name, point=point) as data:
            yield case, data


@pytest.mark.needs("spacecraft")
@pytest.mark.filterwarnings("ignore:.*friction brings wheels")  # as the page shows
def test_errors_of_wheels_that_pass_through_speed_0(tmp_path):
    for case, data in swept("crossing", tmp_path):
        assert round(data["attitude_angle"][0, 0].max(), 3) == CROSSING[case]
        speed = data["wheel_speed"][0, 0]
        assert (speed[1:] * speed[:-1] < 0).any()


def test_propellant_and_errors_of_jets(tmp_path):
    for case, data in swept("pulses", tmp_path):
        propellant, error = PULSES[case]
        assert round(1e3 * data["propellant"][0].mean(), 2) == propellant
        assert round(data["attitude_angle"][0, :, 200:].max(), 2) == error


def test_the_dead_time_answers_by_the_distribution_of_erlang(tmp_path):
    eqt_cli.run(EXAMPLES / "parts" / "late.yaml", out=tmp_path / "late")
    with eqt_cli.open_result(tmp_path / "late") as late:
        t = late["time"][:10]
        command, torque = (late[name][0, 0, :10] for name in ("command", "torque"))
    limit = [1, 1, 1, 5, 5, 5]
    answer = np.clip(command, np.negative(limit), limit) * gammainc(8, 8 * t / 0.2)[:, None]
    assert torque == pytest.approx(answer, abs=1e-8)
