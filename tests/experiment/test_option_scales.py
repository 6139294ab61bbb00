"""What options say of themselves along an axis of a figure."""

import pytest

from eqt_cli.config.json_schema import scale_of
from eqt_cli.core.option_types import Scale

CONFIG = {
    "controllers": [{"kind": "family"}, {"kind": "eqt"}],
    "plant": {"forces": [{"kind": "gravity_gradient"}], "inertia": {"relative": 0.1}},
    "actuators": [{"kind": "rate_limit"}, {"kind": "of_a_plugin"}],
    "initial": {"velocity": {"kind": "speed", "translation": {"speed": 1.0}}},
    "solver": {"engine": "native"},
}


@pytest.mark.parametrize(
    ("key", "scale"),
    [
        ("plant.forces[0].rate", Scale("rate of the orbit", "rad/s")),
        ("actuators[0].rate", Scale("limit of the torque's rate", "torque/s")),
        ("actuators[1].rate", None),
        ("actuators[2].rate", None),
        ("controllers[0].gyroscopic", Scale("gyroscopic weight g")),
        ("controllers[1].gains.kp", Scale("k_p", "stiffness", is_symbol=True)),
        ("gains.kp", Scale("k_p", "stiffness", is_symbol=True)),
        ("gains.kp[0]", None),
        ("plant.inertia.relative", Scale("relative error of the inertia")),
        ("initial.velocity.speed", Scale("initial angular speed", "rad/s")),
        ("initial.velocity.translation.speed", Scale("initial speed of translation", "m/s")),
        ("solver.rtol", Scale("relative tolerance")),
        ("control.period", Scale("control period", "s")),
        ("group", None),
    ],
)
def test_a_key_has_the_scale_of_its_option(key, scale):
    assert scale_of(CONFIG, key) == scale


def test_a_configuration_that_cannot_be_read_leaves_what_no_component_says():
    assert scale_of(None, "time.duration") == Scale("horizon", "s")
    assert scale_of(None, "actuators[0].rate") is None
