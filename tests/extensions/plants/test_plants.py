"""Plants of a textbook in several conventions are right; planted faults in them are named."""

import json
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import yaml
from case_tables import from_yaml, in_ci

from eqt_cli.config.document import read_config
from eqt_cli.config.study import study
from eqt_cli.extend import EqtError
from eqt_cli.extensions.plants import plant_verdict

HERE = Path(__file__).parent
CONVENTIONS = yaml.safe_load((HERE / "conventions.yaml").read_text(encoding="utf-8"))
"""Configuration, file, function and adapter of the right plants, by name."""


@cache
def experiment(name):
    return study(read_config(HERE / f"{name}.yaml", [], False)).experiment(0)


@pytest.fixture(autouse=True)
def _in_a_folder(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)


def written(convention, *changes, **adapter):
    """Write a plant with parts of its text replaced, and its adapter; return its place."""
    how = CONVENTIONS[convention]
    text = (HERE / how["file"]).read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text, old
        text = text.replace(old, new)
    Path("sim.py").write_text(text, encoding="utf-8")
    data = how["adapter"] | adapter
    Path("sim.adapter.yaml").write_text(yaml.safe_dump(data, sort_keys=False), encoding="utf-8")
    return f"sim.py:{how['function']}"


def judged(convention, *changes, simulator=False, **adapter):
    """Return what is said of a plant."""
    place = written(convention, *changes, **adapter)
    of = experiment(CONVENTIONS[convention]["config"])
    return plant_verdict.judged(of, place, None, simulator)[0]


@pytest.mark.parametrize(
    "convention",
    [
        pytest.param(name, marks=[] if name == "turns" else pytest.mark.ci("one of them is fast"))
        for name in CONVENTIONS
    ],
)
def test_a_right_plant_is_the_plant(convention):
    record = judged(convention)
    assert (record["finding"], record["sentences"]) == ("is", [])
    assert {part["finding"] for part in record["parts"]} == {""}


@from_yaml
def test_a_planted_fault_is_named(plant, was, becomes, said):
    assert "; ".join(judged(plant, (was, becomes))["sentences"]) == said


@from_yaml
def test_a_plant_that_cannot_be_judged(plant, was, becomes, adapter, said):
    with pytest.raises(EqtError) as error:
        judged(plant, (was, becomes), **adapter)
    assert said in str(error.value)


# The command --------------------------------------------------------------------------------------

LACKS = (" - np.cross(w, J @ w)", "")


@pytest.mark.parametrize(
    ("change", "fail_on", "code", "answer"),
    [
        (("J", "J"), (), 0, "is the plant, within what 250 states show"),
        (LACKS, ("--fail-on", "differs"), 0, "is the plant but lacks ω × Jω"),
        in_ci("a document is fast", LACKS, (), 4, "is the plant but lacks ω × Jω"),
        (("2.0", "2.2"), ("--fail-on", "differs"), 4, "differs: Jy is 2.2, expected 2"),
    ],
)
def test_the_answer_and_the_exit_code(change, fail_on, code, answer, invoke):
    place = written("turns", change)
    out = invoke("verify", HERE / "turns.yaml", "--plant", place, *fail_on, code=code).stdout
    assert out.startswith(f"f in sim.py {answer}\n")
    table = dict(line.split("  ", 1) for line in out.splitlines() if line.startswith("torque "))
    assert table["torque x"].split() == ["1", "τx", "1", "τx"]


def test_a_document(invoke):
    place = written("turns", LACKS)
    config = HERE / "turns.yaml"
    [record] = json.loads(invoke("verify", config, "--plant", place, "--json", code=4).stdout)[
        "plant"
    ]
    assert (record["finding"], record["sentences"]) == ("lacks", ["lacks ω × Jω"])
    # (J_y − J_z)/J_x of diag(1, 2, 3.5)
    gyroscopic = {"part": "ω × Jω x", "coefficient": "0", "expected": "−1.5 ωy ωz"}
    assert gyroscopic | {"finding": "differs"} in record["parts"]
    assert record["step"] == {}


EULER = """
def step(y, u, h):
    return y + h * f(0.0, y, u)
"""


def test_the_error_of_a_step_is_that_of_its_scheme():
    """Euler's method leaves h²/2 ω̈ after a step; ω̈ here by differences of Euler's equations."""
    place = written(
        "turns",
        ("import numpy as np", "import numpy as np"),
        call="step(x, u, h)",
        returns={"state": "h"},
        input={"as": "wrench", "range": [-1, 1]},
    )
    Path("sim.py").write_text(Path("sim.py").read_text(encoding="utf-8") + EULER, encoding="utf-8")
    record, answer, table = plant_verdict.judged(steady(), place, None, True)
    assert answer == "f in sim.py is the plant, within what 250 states show"
    assert record["step"] == {"attitude": "explicit Euler", "rates": "explicit Euler"}
    assert "order 1.0" in table.notes[0]
    J, h, worst = np.array([1.0, 2.0, 3.5]), 0.005, 0.0
    judge = plant_verdict.Judge(plant_of(place))
    for w, u in zip(judge.states[0].V[:30], judge.states[0].inputs[:30], strict=True):

        def rate(w, u=u):
            return (u - np.cross(w, J * w)) / J

        second = (rate(w + 1e-6 * rate(w)) - rate(w - 1e-6 * rate(w))) / 2e-6
        worst = max(worst, h * h / 2 * np.linalg.norm(second))
    # The next term of the series is of h³: a share of h times some rad/s.
    assert record["period"]["rates"] == pytest.approx(worst, rel=0.1)


def steady():
    """The experiment of turns.yaml with a period of control."""
    return study(read_config(HERE / "turns.yaml", ["control.period=5 ms"], False)).experiment(0)


def plant_of(place):
    file, _, function = place.partition(":")
    loop = steady().loops["eqt"]
    how = plant_verdict.adapter_in(Path("sim.adapter.yaml"), loop.group)
    model = plant_verdict.Model.of(loop, how.input.axes)
    return plant_verdict.Plant(how, model, Path(file), function)


@from_yaml
def test_what_is_said_of_options(options, said, invoke):
    written("turns")
    error = invoke("verify", HERE / "turns.yaml", *options, code=2).stderr
    assert said in " ".join(error.split())


def test_another_group_is_not_covered(invoke):
    place = written("turns")
    config = {"group": "SE2", "inertia": [1.0, 1.0, 1.0], "gains": {"kp": 1, "kd": 1}}
    config |= {"controllers": ["eqt"], "time": {"duration": 1}, "reference": {"kind": "constant"}}
    Path("c.yaml").write_text(yaml.safe_dump(config), encoding="utf-8")
    error = invoke("verify", "c.yaml", "--plant", place, code=2).stderr
    assert "--plant: SE2 is not covered; SO3 and SE3 are" in error
