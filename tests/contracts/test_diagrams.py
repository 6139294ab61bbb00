"""Every force, actuator and sensor is in the diagram of a loop that has it, whoever wrote it."""

from dataclasses import replace

import pytest

from eqt_cli.components.vehicle import Vehicle
from eqt_cli.components.vehicle_parts import Sampling

pytestmark = [pytest.mark.needs("diagram"), pytest.mark.ci("draws every component")]


def titles(loop, **parts):
    """What the boxes of a loop with some parts of a vehicle say."""
    from eqt_cli.extensions.diagram.boxes import Loop

    vehicle = Vehicle(**parts, control=Sampling(0.1)).of_run(loop.group)
    stages = Loop(replace(loop, vehicle=vehicle)).stages()
    words = [text for boxes in stages.values() for box in boxes for text in (box.title, *box.lines)]
    return " ".join(words)


def test_a_force_is_drawn(force_class, make, loop_with):
    name = force_class.name.replace("_", " ")
    assert name in titles(loop_with("SE3"), forces=(make(force_class, 6),))


def test_an_actuator_is_drawn(actuator_class, make, loop_with):
    part = make(actuator_class, 6)
    words = [*part.members] or [actuator_class.name.replace("_", " ")]
    group = "SO3" if actuator_class.name in ("gyros", "wheels", "magnetorquers", "b_dot") else "SE3"
    shown = titles(loop_with(group), actuators=(make(actuator_class, 6 if group == "SE3" else 3),))
    assert all(word in shown for word in words)


def test_a_sensor_is_drawn(sensor_class, make, loop_with):
    signal = "more_sensors" if sensor_class.name == "lever" else "velocity_sensors"
    part = (make(sensor_class, 6),)
    shown = titles(loop_with("SE3"), **{signal: ((), part, ()) if signal[0] == "m" else part})
    assert sensor_class.name.replace("_", " ") in shown
