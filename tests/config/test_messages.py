"""What is said of a configuration that is wrong, and where.

Every case changes sections of the configuration in small_experiment.py, whose sections stand on
lines of their own; a new section is line 10. Of places, the tables leave out the file.
"""

from case_tables import from_yaml
from said import says, sections_of

from eqt_cli.components.laws import controllers
from eqt_cli.components.references import references


def names(registry):
    return ", ".join(registry.names())


def in_file(said):
    return "\n".join(f"c.yaml:{line}" for line in said.splitlines())


@from_yaml
def test_what_is_said_of_a_line(message, line, said):
    assert says(message(**sections_of(line)), in_file(said))


def test_an_unknown_component(message):
    said = "5:15: controllers[0]: unknown controller 'wholly_new'; known: "
    assert message(controllers="[wholly_new]") == in_file(said + names(controllers))


def test_a_kind_that_is_missing(message):
    assert message(controllers="[{label: a}]") == (
        "c.yaml:5:15: controllers[0].kind: missing; expected a controller, one of "
        f"{names(controllers)}"
    )


def test_a_kind_that_is_no_text(message):
    assert message(reference="{kind: 3}") == (
        f"c.yaml:4:13: reference.kind: expected a reference, one of {names(references)}, got 3"
    )


def test_controllers_of_another_task(message):
    tracking = [kind.name for kind in controllers.all() if "track" in kind.tasks]
    assert message(controllers="[stabilising]") == (
        "c.yaml:5:15: controllers[0]: stabilising is a law for task: stabilise; for "
        f"task: track use {', '.join(tracking)}"
    )


def test_shapes_are_those_of_the_group(message):
    said = message(
        group="SE3",
        reference="{torque: [1], pose: {rotvec: 1, position: [1]}, velocity: [1]}",
        initial="{pose: {kind: euler, velocity: {std: 1}, position: {std: [1]}}}",
    ).splitlines()
    assert [line.split(" ")[:2] for line in said] == [
        ["c.yaml:4:13:", "reference.torque:"],
        ["c.yaml:4:44:", "reference.pose.position:"],
        ["c.yaml:4:60:", "reference.velocity:"],
        ["c.yaml:6:31:", "initial.pose.velocity:"],
        ["c.yaml:6:62:", "initial.pose.position.std:"],
    ]
    assert says(said[0], "…expected 6…for SE3, got 1") and says(
        said[4], "…a list of 3, got a list of 1"
    )


PRODUCT = {
    "group": "SO3*R3",
    "inertia": "1",
    "gains": "{kp: 1, kd: 1}",
    "reference": "{kind: constant}",
    "initial": "{}",
}


@from_yaml
def test_a_product_of_groups(message, line, said):
    assert says(message(**PRODUCT | sections_of(line)), in_file(said))


def test_everything_is_reported_in_the_order_of_the_file(message):
    """Of all keys; `messages.yaml` has what is said of what is built from them."""
    said = message(
        inertia="[[1, 2, 3], [4, 5, 6]]",
        gains="{kp: pii, kd: 0, Ki: 1}",
        reference='{torque: ["cos(t", "1", "2"], pose: [[1, 0, 0]], velocty: 1}',
        controllers="[eqt, eqt, 3]",
        initial="{pose: 3, velocity: {kind: normal, std: -1}}",
        time="{duration: -1, samples: 1}",
        solver="{method: RK4, rtoll: 1, rtol: 2}",
        store="{decimate: 0}",
        gian="1",
    ).splitlines()
    assert [line.partition(": ")[2].partition(":")[0] for line in said] == (
        "gains.kp gains.Ki reference.pose reference.velocty controllers[2] initial.pose "
        "initial.velocity.std time.duration time.samples solver.method solver.rtoll "
        "store.decimate gian"
    ).split()


def test_a_hundred_errors_within_a_section_have_their_places(message):
    said = message(reference=f"{{kind: constant, velocity: {['x'] * 200}}}").splitlines()
    assert len(said) == 101
    assert said[0].startswith("c.yaml:4:40: reference.velocity[0]: expected a number, got 'x'")
    assert said[-1] == "and more; only the first 100 are shown"
