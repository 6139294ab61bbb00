"""The table of quantities: names, symbols and units, and what follows from them."""

import pytest

from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.results.metrics import QUANTITIES, quantity_of
from eqt_cli.results.quantity import Quantity
from eqt_cli.runs.folder import quantities


def test_parts_of_a_number_are_of_the_part_of_its_signal():
    part = QUANTITIES["effort"].part("rotation")
    assert (part.name, part.signals) == ("effort_rotation", ("torque_norm_rotation",))
    assert (part.described, part.stored) == ("effort rotation ∫‖τ‖² dt", False)


def test_what_a_later_version_stores_is_known_by_its_long_name():
    later = quantity_of("jerk", "largest rate of ||tau||")
    assert (later.described, later.of, later.windowed) == ("largest rate of ||tau||", None, False)


@pytest.mark.parametrize(
    ("pattern", "unit", "expected"),
    [
        ("({})^2 s", "N m", "(N m)^2 s"),
        ("({})^2 s", "rad/s", "(rad/s)^2 s"),
        ("({})^2 s", "N", "N^2 s"),
        ("({})^2 s", "1", "s"),
        ("({})^2 s", "mixed", "mixed"),
        ("{}", "1", "1"),
        ("s", "mixed", "s"),
    ],
)
def test_only_what_has_several_symbols_is_in_brackets(pattern, unit, expected):
    assert Quantity("effort", "control effort", units=pattern).unit(unit) == expected


def test_an_experiment_settles_units_and_attributes(tmp_path):
    config = tmp_path / "c.yaml"
    config.write_text(
        "group: SE3\ninertia: 1\ngains: {kp: 1, kd: 1}\nreference: {kind: constant}\n"
        "controllers: [eqt]\ntime: {duration: 1, samples: 2}\nsettling_threshold: 0.2\n"
    )
    found = {quantity.name: quantity for quantity in quantities(build(read_config(config)))}
    assert found["effort"].attributes["units"] == "mixed"
    assert found["torque_norm_translation"].attributes == {
        "units": "N",
        "long_name": "torque norm ||tau||, translation part",
    }
    assert found["settling_time"].attributes["threshold"] == 0.2
    assert found["early_torque"].attributes["window_s"] == 5.0
    assert "units" not in found["message"].attributes
    assert "actuator_work" not in found
