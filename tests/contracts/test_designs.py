"""What every design of a sweep must do, whoever wrote it."""

import pickle

import jsonschema
import pytest
import yaml

from eqt_cli.config.document import read_config
from eqt_cli.config.json_schema import json_schema
from eqt_cli.config.study import study
from eqt_cli.extend import EqtError

CONFIG = """\
group: SO3
inertia: [2, 1, 3]
gains: {kp: 1.0, kd: 0.5}
reference: {torque: ["cos(t)", "sin(t)", "0"]}
controllers: [eqt, gt]
initial: {pose: haar, velocity: normal}
ensemble: {runs: 3, seed: 1}
time: {duration: 1, samples: 3}
solver: {rtol: 1.0e-5, cross_check: 0}
sweep:
"""
SECTIONS = {
    "concat": "[[{grid: {gains.kp: [1]}}], [{grid: {gains.kp: [2, 3]}}]]",
    "cases": "{stiff: {gains.kp: 2}, slow and damped: {gains.kp: 0.5, gains.kd: 1}, ideal: {}}",
    **dict.fromkeys(["grid", "zip", "star"], "{gains.kp: [1, 2], gains.kd: [0.5, 1]}"),
}
"""Designs are drawn from ranges, if not told otherwise here."""
DRAWN = "{points: 4, seed: 1, axes: {gains.kp: {low: 1, high: 2}, gains.kd: {low: 1, high: 3}}}"


@pytest.fixture
def found(design_class, load_plugins, tmp_path):
    """A study whose sweep has one block of the design, and its configuration."""
    load_plugins("designs")
    name = design_class.name
    path = tmp_path / "config.yaml"
    path.write_text(f"{CONFIG}  - {name}: {SECTIONS.get(name, DRAWN)}\n", encoding="utf-8")
    return study(read_config(path)), path


def test_every_point_has_a_value_for_every_key(found):
    sweep = found[0].sweep
    assert len(sweep) > 1
    points = [sweep.values(point) for point in range(len(sweep))]
    assert {len(values) for values in points} == {len(sweep.keys)}
    assert len(set(points)) == len(points)


def test_a_value_does_not_depend_on_when_it_is_asked_for(found):
    sweep = found[0].sweep
    forth = [sweep.values(point) for point in range(len(sweep))]
    back = [sweep.values(point) for point in reversed(range(len(sweep)))]
    assert forth == back[::-1]


def test_every_value_has_a_place_in_the_section(found):
    sweep, path = found[0].sweep, found[1]
    section = yaml.safe_load(path.read_text())["sweep"]
    for point in range(len(sweep)):
        for key in sweep.keys:
            written = section
            for step in sweep.place(point, key):
                written = written[step]


def test_it_survives_the_way_to_a_worker(found):
    there = pickle.loads(pickle.dumps(found[0])).sweep
    assert [there.values(k) for k in range(len(there))] == [
        found[0].sweep.values(k) for k in range(len(there))
    ]


def test_editors_accept_its_section(found):
    editor = jsonschema.Draft202012Validator(json_schema())  # which test_json_schema.py checks
    editor.validate(yaml.safe_load(found[1].read_text()))


def test_what_is_no_design_is_a_message_with_its_place(design_class, load_plugins, tmp_path):
    load_plugins("designs")
    path = tmp_path / "config.yaml"
    path.write_text(f"{CONFIG}  - {design_class.name}: 3\n", encoding="utf-8")
    with pytest.raises(EqtError) as caught:
        study(read_config(path))
    assert f"config.yaml:11:5: sweep[0].{design_class.name}: " in str(caught.value)
