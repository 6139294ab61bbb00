"""The remark on derived rates in a wind that the model does not know, by the closed form."""

from pathlib import Path

import pytest

import eqt_cli
from eqt_cli.config.remarks import remarks

pytestmark = pytest.mark.needs("underactuated")
LEE = Path(__file__).parents[3] / "configs" / "quadrotor_lee.yaml"
WEIGHT = {"kind": "restoring", "up": [0, 0, -1]}
RATIO = 1 + (2.54 * 5.6 + 0.082 * 16) / 8.81  # (k_Ω k_v + J k_x)/k_R


@pytest.mark.parametrize(("force", "rates", "says", "weight"), [
    ([0, 3.47, 0], "model", True, {"weight": 42.5754}),
    ([0, 3.47, 0], "model", True, {"gravity": 9.81}),  # which the model weighs by its mass
    ([0, 0, 3.47], "model", False, {"weight": 42.5754}),  # along the push, which tilts nothing
    ([0, 3.47, 0], "filter", False, {"weight": 42.5754}),
    ([0, 0.3, 0], "model", False, {"weight": 42.5754}),  # it moves the body by 8 mm more
])  # fmt: skip
def test_a_wind_that_the_model_does_not_know_is_remarked_on(force, rates, says, weight):
    config = eqt_cli.load_experiment(LEE).document.data
    law = (
        config["controllers"][0]
        | {"rates": rates}
        | ({"bandwidth": 60} if rates == "filter" else {})
    )
    push = {"kind": "constant", "force": [0, 0, 0, *force], "frame": "spatial"}
    still = {"kind": "flat", "position": [0, 0, 0], "along": [0, 0, -1]}
    config = config | {
        "controllers": [law],
        "reference": still,
        "plant": {"forces": [WEIGHT | weight, push]},
        "model": {"forces": [WEIGHT | weight]},
    }
    if rates == "model":  # gains along another axis than the force's
        law["position"] = law["position"] | {"kx": [40, 16, 40], "kv": [9, 5.6, 9]}
    said = [
        str(x)
        for x in remarks(eqt_cli.load_experiment(config).base)
        if "controllers[0].rates" in str(x)
    ]
    assert len(said) == says
    if says:
        assert f"by {RATIO * 3.47 / 4.34 / 16:.2g} m, {RATIO:.2g} times as far" in said[0]
