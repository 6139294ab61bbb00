"""The JSON schema that editors check a configuration with, and what else keys say of themselves."""

from pathlib import Path

import jsonschema
import pytest
import yaml
from case_tables import from_yaml, table_of

from eqt_cli.base.errors import ConfigError
from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.option_types import Scale, option_names
from eqt_cli.base.registry import Registry, registry
from eqt_cli.base.yaml_source import load
from eqt_cli.components.initial_states import pose_distributions, velocity_distributions
from eqt_cli.components.laws import controllers
from eqt_cli.components.references import references
from eqt_cli.config import shipped
from eqt_cli.config.designs import designs
from eqt_cli.config.document import Document, Place
from eqt_cli.config.json_schema import json_schema, of_files, scale_of
from eqt_cli.config.study import study
from eqt_cli.engines.engine import SolverChecks, engines


@pytest.fixture(scope="module")
def schema():
    """Without plugins that other tests have loaded."""
    with pytest.MonkeyPatch.context() as patch:
        for kind in all_kinds():
            patch.setattr(registry(kind), "_plugins", {})
        return json_schema()


@pytest.fixture(scope="module")
def validator(schema):
    return jsonschema.Draft202012Validator(of_files(schema))


def paper(**changes):
    data = load(shipped.text("paper"), "paper.yaml").data | changes
    return {key: value for key, value in data.items() if value is not None}


@pytest.mark.ci("checks all of it; what configurations need of it is checked by their tests")
def test_it_is_a_schema(schema):
    jsonschema.Draft202012Validator.check_schema(schema)


@pytest.mark.parametrize("name", shipped.names())
def test_shipped_configurations_fit(validator, name):
    validator.validate(load(shipped.text(name), name).data)


def test_an_editor_may_read_them_as_plain_yaml(validator):
    validator.validate(yaml.safe_load(shipped.text("paper")))


@from_yaml
def test_what_is_wrong_does_not_fit(validator, changes):
    assert validator.is_valid(paper())
    assert not validator.is_valid(paper(**changes))


def kinds(place):
    """The options by kind among the alternatives at a place of the schema."""
    return {
        entry["properties"]["kind"]["const"]: set(entry["properties"]) - {"kind"}
        for entry in place["anyOf"]
        if "properties" in entry
    }


OF_LAWS = {"label", "gains", "known_forces", "setpoint", "inner"}


@pytest.mark.parametrize(
    ("registry", "path", "common"),
    [
        (controllers, ["properties", "controllers", "items"], OF_LAWS),
        (references, ["properties", "reference"], set()),  # each says what it starts from
        (pose_distributions, ["$defs", "PoseDistribution"], set()),
        (velocity_distributions, ["$defs", "InitialSection", "properties", "velocity"], set()),
    ],
    ids=lambda value: value.kind if isinstance(value, Registry) else "",
)
def test_every_component_is_there_with_all_its_options(schema, registry, path, common):
    place = schema
    for step in path:
        place = place[step]
    assert kinds(place) == {
        component.name: {*option_names(component), *getattr(component, "starts_from", common)}
        for component in registry.all()
    }


def test_every_engine_is_there_with_all_its_options(schema):
    solver = schema["properties"]["solver"]["properties"]
    owners = [SolverChecks, *engines.all()]
    assert set(solver) == {"engine", *(name for owner in owners for name in option_names(owner))}
    assert solver["engine"]["enum"] == ["auto", *engines.names()]
    assert solver["engine"]["default"] == "auto"


# Sweeps: the schema accepts what the parser accepts -----------------------------------------------


def is_accepted(block):
    """By the parser; what a schema cannot say (the same keys twice, …) is not in the tables."""
    data = paper(sweep=[block], controllers=[{"kind": "eqt", "label": "eqt"}])
    try:
        study(Document(load("{}", "paper.yaml"), data, Place(Path())))
    except ConfigError:
        return False
    return True


@from_yaml
def test_the_schema_accepts_what_the_parser_accepts(validator, block):
    assert is_accepted(block)
    validator.validate(paper(sweep=[block]))


@from_yaml
def test_the_schema_refuses_what_the_parser_refuses(validator, block):
    assert not is_accepted(block)
    assert not validator.is_valid(paper(sweep=[block]))


def test_every_design_is_in_the_tables():
    good = table_of(test_the_schema_accepts_what_the_parser_accepts)
    assert {next(iter(case["block"])) for case in good} == set(designs.names())


@pytest.mark.parametrize("sweep", [None, []])
def test_no_sweep_fits(validator, sweep):
    validator.validate(paper() | {"sweep": sweep})


def test_the_keys_of_an_axis_are_offered(schema):
    offered = schema["$defs"]["SweepBlock"]["properties"]["grid"]["properties"]
    assert {"gains.kp", "controllers[0].gyroscopic", "initial.pose.std", "solver.rtol"} <= set(
        offered
    )
    assert offered["gains.kd"]["description"].startswith("Rayleigh tensor")
    assert not {"name", "sweep", "store.decimate", "ensemble.runs"} & set(offered)


# What options say of themselves along an axis of a figure

CONFIG = {
    "controllers": [{"kind": "family"}, {"kind": "eqt"}],
    "plant": {"forces": [{"kind": "gust"}], "inertia": {"relative": 0.1}},
    "actuators": [{"kind": "rate_limit"}, {"kind": "of_a_plugin"}],
    "initial": {"velocity": {"kind": "speed", "translation": {"speed": 1.0}}},
    "solver": {"engine": "native"},
}


@pytest.mark.parametrize(
    ("key", "scale"),
    [
        ("plant.forces[0].time_constant", Scale("time constant of the gust", "s")),
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
