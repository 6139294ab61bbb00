"""What was drawn for each run is in the result, by its key."""

from zlib import crc32

import numpy as np
import pytest
from small_experiment import configuration, study_of

from eqt_cli import api
from eqt_cli.config.document import read_config
from eqt_cli.config.preflight import build
from eqt_cli.extensions.failures.drawn import drawn_numbers, values_of, variables
from eqt_cli.results.result import open_result

PLANT = """{inertia: {relative: {uniform: [-0.2, 0.3]}}, forces: [
  {kind: constant, force: [{normal: [0, 0.1]}, 0, {uniform: [1, 2]}]},
  {kind: drag, linear: [[{uniform: [1, 2]}, 0, 0], [0, 1, 0], [0, 0, 1]]}]}"""
SENSORS = "{velocity: [{kind: bias, value: {normal: [0, 0.01]}}]}"


def philox(seed, run, place):
    """The generator of a part of the vehicle of a run, as the reference says."""
    sequence = np.random.SeedSequence(seed, spawn_key=(3, run, crc32(place.encode())))
    return np.random.Generator(np.random.Philox(sequence))


@pytest.fixture
def experiment(tmp_path):
    (tmp_path / "c.yaml").write_text(
        configuration(plant=PLANT, sensors=SENSORS, control="{period: 0.1}")
    )
    return build(read_config(tmp_path / "c.yaml", {}))


def test_drawn_numbers_have_the_keys_and_units_of_the_configuration(experiment):
    assert {number.key: number.unit for number in drawn_numbers(experiment)} == {
        "plant.inertia.relative": "1",
        "plant.forces[0].force[0]": "N m",
        "plant.forces[0].force[2]": "N m",
        "plant.forces[1].linear[0][0]": "N m s/rad",
        "sensors.velocity[0].value": "rad/s",
    }


def test_they_are_what_the_generators_of_the_parts_draw(experiment):
    values = values_of(experiment, drawn_numbers(experiment))
    for run in range(3):
        of_forces = philox(1, run, "plant.forces[0]")
        expected = [
            philox(1, run, "plant.inertia").uniform(-0.2, 0.3),
            of_forces.normal(0, 0.1),
            of_forces.uniform(1, 2),
            philox(1, run, "plant.forces[1]").uniform(1, 2),
            philox(1, run, "sensors.velocity[0]").normal(0, 0.01),
        ]
        np.testing.assert_array_equal(values[:, run], expected)


@pytest.mark.needs("disturbances")
def test_the_inertia_below_a_payload_is_one_of_them(tmp_path):
    plant = """{inertia: {relative: {uniform: [-0.2, 0.3]}}, forces: [
      {kind: restoring, weight: 9.81}, {kind: payload, mass: 0.1}]}"""
    (tmp_path / "c.yaml").write_text(
        configuration(
            group="SE3", inertia="[2, 2, 2, 1, 1, 1]", reference="{kind: constant}", plant=plant
        )
    )
    experiment = build(read_config(tmp_path / "c.yaml", {}))
    drawn = philox(1, 0, "plant.inertia").uniform(-0.2, 0.3)
    assert values_of(experiment, drawn_numbers(experiment))[0, 0] == drawn


def test_the_filter_starts_with_its_own_error(tmp_path):
    estimator = "{kind: invariant, initial_pose_std: 0.2}"
    sensors = "{pose: [{kind: noise, std: 0.1}], velocity: [{kind: noise, std: 0.1}]}"
    (tmp_path / "c.yaml").write_text(
        configuration(estimator=estimator, sensors=sensors, control="{period: 0.1}")
    )
    experiment = build(read_config(tmp_path / "c.yaml", {}))
    numbers = drawn_numbers(experiment)
    assert [n.key for n in numbers] == [f"estimator.initial_error[{k}]" for k in range(3)]
    expected = 0.2 * philox(1, 0, "estimator").standard_normal(3)
    np.testing.assert_allclose(values_of(experiment, numbers)[:, 0], expected, rtol=1e-15)


def test_points_that_draw_differently_have_their_own(tmp_path):
    swept = study_of(
        tmp_path,
        configuration(plant=PLANT),
        grids=["plant.inertia.relative.uniform[1]=0.3,0.6", "gains.kp=1,2"],
    )
    held = study_of(tmp_path, configuration(plant=PLANT), grids=["gains.kp=1,2"])
    name = "drawn.plant.inertia.relative"
    by_point, once = variables(swept)[name], variables(held)[name]
    assert (by_point.dims, once.dims) == (("point", "run"), ("run",))
    first = philox(1, 0, "plant.inertia").uniform(-0.2, 0.6)
    assert np.unique(by_point.data[:, 0]).tolist() == pytest.approx(sorted([first, once.data[0]]))


def test_places_of_thrusters_have_the_keys_of_their_options(tmp_path):
    first = "{at: [{normal: [0.3, 0.1]}, 0], along: [0, {uniform: [0.9, 1]}]}"
    others = "{at: [0, 1], along: [1, 0]}, {at: [0, -1], along: [1, 0]}"
    text = configuration(
        group="SE2",
        inertia="[1, 2, 2]",
        gains="{kp: [1, 1, 1], kd: [1, 1, 1]}",
        reference="{kind: constant}",
        controllers="[gt]",
        actuators=f"[{{kind: thrusters, thrusters: [{first}, {others}]}}]",
    )
    (tmp_path / "c.yaml").write_text(text)
    experiment = build(read_config(tmp_path / "c.yaml", {}))
    numbers = drawn_numbers(experiment)
    where = "actuators[0].thrusters[0]"
    assert {n.key: n.unit for n in numbers} == {f"{where}.at[0]": "m", f"{where}.along[1]": "1"}
    draws = philox(1, 1, "actuators[0]")
    expected = [draws.normal(0.3, 0.1), draws.uniform(0.9, 1)]
    np.testing.assert_array_equal(values_of(experiment, numbers)[:, 1], expected)


@pytest.mark.ci("two results")
def test_results_hold_them_and_the_same_without_draws_holds_nothing_more(tmp_path):
    for name, plant in (("drawn", PLANT), ("fixed", None)):
        (tmp_path / f"{name}.yaml").write_text(configuration(plant=plant))
        api.run(tmp_path / f"{name}.yaml", out=tmp_path / name)
    with open_result(tmp_path / "fixed") as fixed, open_result(tmp_path / "drawn") as drawn:
        assert not [name for name in fixed.names if "drawn" in name]
        assert drawn.units("drawn.plant.forces.0.force.2") == "N m"
        value = philox(1, 2, "plant.inertia").uniform(-0.2, 0.3)
        assert drawn["drawn.plant.inertia.relative"][2] == value
        assert "drawn.plant.inertia.relative" not in drawn.metrics  # laws do not differ in it
