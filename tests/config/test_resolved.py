"""The resolved configuration reproduces itself; its digest sees what counts and nothing else."""

import math
import re
from pathlib import Path

import jsonschema
import pytest
from case_tables import from_yaml
from ci_cases import mostly_ci
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from said import sections_of

from eqt_cli.base.errors import ConfigError
from eqt_cli.base.yaml_source import dump, load
from eqt_cli.config import shipped
from eqt_cli.config.document import Document, Place, read_config
from eqt_cli.config.json_schema import json_schema
from eqt_cli.config.preflight import build
from eqt_cli.config.remarks import remarks


def built(data):
    """The experiment of a configuration that went through YAML."""
    source = load(dump(data), "c.yaml")
    return build(Document(source, source.data, Place(Path())))


# Configurations that are fine -------------------------------------------------------------------

# As users write them: whole numbers, decimals, constant expressions.
positive = st.integers(1, 3) | st.floats(0.1, 3.0) | st.sampled_from(["pi/2", "sqrt(2)", "1e-1"])
real = st.integers(-3, 3) | st.floats(-3.0, 3.0) | st.sampled_from(["-pi", "exp(1)"])
torques = st.sampled_from(["cos(t)", "t**2/2", "exp(-t)*sin(pi*t)", 0, -1.5])


def lists(entries, length):
    return st.lists(entries, min_size=length, max_size=length)


def diagonal(entries):
    n = len(entries)
    return [[entries[i] if i == j else 0 for j in range(n)] for i in range(n)]


def matrices(n):
    """Positive definite: a number, a diagonal, or rows."""
    return positive | lists(positive, n) | lists(positive, n).map(diagonal)


def inertias(m):
    changing = st.sampled_from(["1 + t", "2 + sin(t)", "exp(t)", 3.5])
    starting = st.sampled_from(["1 + t", "exp(t)", "cos(t/9)", 1])
    return st.one_of(
        matrices(m),
        st.fixed_dictionaries(
            {"matrix": lists(changing, m).map(diagonal), "leaves": st.booleans()}
        ),
        st.fixed_dictionaries(
            {
                "initial": matrices(m),
                "factor": lists(starting, m).map(diagonal),
                "leaves": st.booleans(),  # which a mass that varies must say
            }
        ),
    )


controllers = st.lists(
    st.sampled_from(["eqt", "gt", "nog", "asym"])
    | st.fixed_dictionaries(
        {"kind": st.just("family")},
        optional={
            "gyroscopic": st.floats(-1, 1) | st.integers(-1, 1),
            "transport": st.floats(-1, 1),
            "connection": st.integers(-1, 1),
            "damping": st.sampled_from(["spatial", "body"]),
        },
    ),
    min_size=1,
    max_size=3,
).map(lambda entries: [_labelled(entry, f"law {k}") for k, entry in enumerate(entries)])


def _labelled(entry, label):
    return {"kind": entry, "label": label} if isinstance(entry, str) else entry | {"label": label}


solvers = st.fixed_dictionaries(
    {},
    optional={
        "engine": st.just("solve_ivp"),
        "method": st.sampled_from(["DOP853", "RK45", "Radau"]),
        "rtol": st.sampled_from([1e-6, "1e-6", "1/10**6"]),
        "atol": st.sampled_from([1, "1e-9"]),
        "block": st.integers(1, 9) | st.none(),
        "cross_check": st.integers(0, 3),
        "max_error": st.none() | positive,
        "error_estimate": st.booleans(),
    },
).map(lambda keys: {"engine": "solve_ivp"} | keys if {"method", "block"} & {*keys} else keys)


@st.composite
def configurations(draw):
    group, d, m, parts = draw(
        st.sampled_from(
            [
                ("SO3", 3, 3, {"rotvec": 3}),
                ("SE3", 4, 6, {"rotvec": 3, "position": 3}),
                ("SE2", 3, 3, {"rotvec": 1, "position": 2}),
            ]
        )
    )
    poses = st.just("identity") | st.fixed_dictionaries(
        {}, optional={name: real | lists(real, length) for name, length in parts.items()}
    )
    spread = st.fixed_dictionaries({}, optional={"std": positive | lists(positive, 3)})
    kinds = [
        st.just("haar"),
        st.fixed_dictionaries({"kind": st.just("exp_normal")}, optional={"std": positive}),
        st.fixed_dictionaries({"kind": st.just("fixed")}, optional={"coordinates": lists(real, m)}),
    ]
    if group == "SE3":
        options = {"sequence": st.just("xyz"), "high": st.just("2*pi"), "position": spread}
        kinds.append(st.fixed_dictionaries({"kind": st.just("euler")}, optional=options))
    references = st.one_of(
        st.fixed_dictionaries(
            {"torque": lists(torques, m)},
            optional={"kind": st.just("torque"), "pose": poses, "velocity": real | lists(real, m)},
        ),
        st.fixed_dictionaries({"kind": st.just("constant")}, optional={"pose": poses}),
    )
    sections = st.fixed_dictionaries(
        {
            "group": st.just(group),
            "inertia": inertias(m),
            "gains": st.fixed_dictionaries({"kp": matrices(d), "kd": matrices(m)}),
            "reference": references,
            "controllers": controllers,
            "time": st.fixed_dictionaries(
                {"duration": positive}, optional={"samples": st.integers(2, 9)}
            ),
        },
        optional={
            "name": st.sampled_from(["a", "run-2", "v1.0_x"]),
            "initial": st.fixed_dictionaries(
                {},
                optional={
                    "pose": st.one_of(kinds),
                    "velocity": st.fixed_dictionaries(
                        {"kind": st.just("normal")}, optional={"std": positive | lists(positive, m)}
                    ),
                },
            ),
            "ensemble": st.fixed_dictionaries(
                {}, optional={"runs": st.integers(1, 9), "seed": st.integers(0, 2**63 - 1)}
            ),
            "solver": solvers,
            "store": st.fixed_dictionaries(
                {},
                optional={
                    "trajectories": st.sampled_from(["all", "none", 0, 2]),
                    "decimate": st.integers(1, 3),
                    "compression": st.sampled_from(["none", "gzip"]),
                },
            ),
            "settling_threshold": positive,
        },
    )
    data = draw(sections)
    if data.get("ensemble", {}).get("runs", 1) > 1:  # they must not be one run
        data["initial"] = {"velocity": "normal"} | data.get("initial", {})
    return data


@pytest.fixture(scope="module")
def schema():
    return jsonschema.Draft202012Validator(json_schema())


# To draw a whole configuration takes a while, and longer on a busy machine.
@settings(max_examples=12, suppress_health_check=[HealthCheck.too_slow])
@given(configurations())
def test_what_is_fine_fits_the_json_schema_and_reproduces_itself(schema, data):
    once = built(data)
    again = built(once.resolved)
    assert repr(again.resolved) == repr(once.resolved)  # repr tells 1 from 1.0
    assert again.digest == once.digest
    schema.validate(data)
    schema.validate(once.resolved)


@mostly_ci("name", shipped.names(), {*shipped.names()} - {"sweep_lqr"}, "solves equations")
def test_shipped_configurations_reproduce_themselves(schema, name):
    assert shipped.text(name).startswith("# ")  # which says what it is
    data = read_config(shipped.folder() / f"{name}.yaml").data
    assert data.get("name", name) == name
    once = built(data)
    assert built(once.resolved).resolved == once.resolved
    schema.validate(once.resolved)


# The digest -------------------------------------------------------------------------------------


NO_NUMBER = """
name=other | reference.velocity=0 | reference.velocity=0.0 | reference.pose=identity
solver.max_error= | solver.engine=solve_ivp | gains.kp=2/2 | initial.pose={kind: haar}
store.trajectories=all | controllers[0]={kind: eqt, label: eqt}
"""


@pytest.mark.parametrize("override", re.split(r" \| |\n", NO_NUMBER.strip()))
def test_the_digest_is_blind_to_what_changes_no_number(experiment, override):
    assert experiment(override).digest == experiment().digest


NUMBERS = """
inertia[0]=2.0000000000000004 | gains.kp=1.1 | gains.kd=0.6 | reference.torque[0]=sin(t)
reference.pose={rotvec: [0, 0, 1]} | reference.velocity=1 | controllers=[eqt]
controllers=[gt, eqt] | controllers[0]={kind: eqt, label: other}
controllers[0]={kind: family, label: eqt} | initial.pose=exp_normal
initial.velocity={kind: normal, std: 2} | ensemble.runs=4 | ensemble.seed=2 | time.duration=1.1
time.samples=12 | solver.method=RK45 | solver.rtol=1e-7 | solver.atol=1e-9 | solver.block=2
solver.max_steps=7 | solver.max_error=1 | solver.error_estimate=true | solver.cross_check=1
store.trajectories=1 | store.decimate=2 | store.compression=gzip | settling_threshold=0.1
"""


@pytest.mark.parametrize("override", re.split(r" \| |\n", NUMBERS.strip()))
def test_the_digest_sees_what_changes_a_number(experiment, override):
    assert experiment(override).digest != experiment().digest


def test_the_digest_sees_another_group(experiment):
    pair = {"inertia": "1", "reference": "{kind: constant}"}
    digests = {experiment(group=name, **pair).digest for name in ("SO2", "SO3", "SE2", "SE3")}
    assert len(digests) == 4


def test_angles_in_degrees_resolve_to_radians(experiment):
    found = experiment(
        group="SE3",
        inertia="1",
        reference="{kind: constant}",
        initial="{pose: {kind: angle, angle: [90 deg, 180 deg]}, velocity: {kind: speed, "
        "translation: {speed: 0.2, axis: [0, 0, 1]}}}",
        settling_threshold="{translation: 0.2, rotation: 90 deg}",
        worst="{over: {initial.velocity.speed: [0 deg, 90 deg]}, objective: effort}",
    )
    start, limits = found.resolved["initial"], found.resolved["settling_threshold"]
    assert start["pose"]["angle"] == [math.pi / 2, math.pi]
    assert start["velocity"]["translation"] == {"speed": 0.2, "axis": [0.0, 0.0, 1.0]}
    assert limits == {"translation": 0.2, "rotation": math.pi / 2}
    assert found.config.worst is not None
    assert found.config.worst.over == {"initial.velocity.speed": [0.0, math.pi / 2]}
    again = built(found.resolved)
    assert (again.resolved, again.digest) == (found.resolved, found.digest)


ON_SE3 = "group: SE3; inertia: 1; reference: {kind: constant}"


@from_yaml
def test_numbers_with_units_are_those_in_units_of_eqt(experiment, written, plain):
    """Up to rounding: a factor such as π/180 is rounded once."""
    left, right = (
        experiment(**sections_of(text.replace("SE3", ON_SE3))).resolved for text in (written, plain)
    )
    assert _numbers(left) == pytest.approx(_numbers(right), rel=1e-15)
    assert _numbers(left)


def _numbers(value):
    """All numbers of a configuration."""
    if isinstance(value, dict | list):
        entries = value.values() if isinstance(value, dict) else value
        return [number for entry in entries for number in _numbers(entry)]
    return [float(value)] if isinstance(value, int | float) else []


def test_one_unit_cannot_stand_for_angles_and_lengths(experiment):
    with pytest.raises(ConfigError) as raised:
        experiment(
            **sections_of(ON_SE3),
            initial="{pose: {kind: exp_normal, std: 1 deg}, velocity: {kind: normal, std: "
            "[1 deg/s, 0, 0, 0, 0, 1 rpm]}}",
        )
    assert [str(problem) for problem in raised.value.problems] == [
        "c.yaml:6:36: initial.pose.std: expected a list with an entry for each coordinate, because "
        "they are of different kinds (an angle and a length), got '1 deg'",
        "c.yaml:6:101: initial.velocity.std[5]: expected a number or a velocity in m/s, cm/s, "
        "mm/s or km/h, got '1 rpm', which is 0.10472 rad/s",
    ]


def test_sensors_that_no_instrument_is_are_remarked(experiment):
    """Of the rotation: a noise of 2 m is one. A distribution counts by its rms."""
    sensors = (
        "{pose: [{kind: noise, std: [2, 0.1, 0, 2, 2, 2]}], velocity: [{kind: noise, std: 0.1}, "
        "{kind: bias, value: [{normal: [0, 5]}, 0, 0, 9, 9, 9]}, {kind: bias, value: 0.4}, "
        "{kind: bias, value: [60 deg/s, 0, 0, 0, 0, 0]}]}"
    )
    found = experiment(**sections_of(ON_SE3), control="{period: 0.1}", sensors=sensors)
    said = [str(remark).partition("sensors.")[2] for remark in remarks(found)]
    assert sorted(text for text in said if text) == [
        "pose[0]: a noise of 2 rad leaves nothing of a measured rotation; if degrees or arc "
        "seconds were meant, write '2 deg' or '2 arcsec'",
        "velocity[1]: a bias of 5 rad/s is more than any gyro has; if degrees were meant, write "
        "'5 deg/s' or '5 deg/h'",
        "velocity[3]: a bias of 1.0472 rad/s is more than any gyro has",
    ]


# Names ------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("file", "name"),
    [
        ("paper.yaml", "paper"),
        ("my paper (1).yaml", "my-paper-1"),
        (".hidden.yaml", "hidden"),
        ("v1.2_x.yml", "v1.2_x"),
        ("ω.yaml", "experiment"),
    ],
)
def test_a_file_gives_its_name(folder, file, name):
    (folder / file).write_text(shipped.text("paper").replace("name: paper\n", ""), encoding="utf-8")
    assert build(read_config(folder / file)).name == name
