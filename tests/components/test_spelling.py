"""Names of groups and laws as people write them."""

import subprocess
import sys

import pytest
from said import error_of

import eqt_cli
from eqt_cli.base.errors import bare
from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.registry import registry
from eqt_cli.extend import group_named
from eqt_cli.results.origin import label_named

FEW = {"ensemble.runs": 2, "time.duration": 1, "time.samples": 5}


@pytest.mark.parametrize(
    ("written", "name"),
    [
        *[(text, "SO3") for text in ("SO3", "so3", "SO(3)", "SO₃", "so 3")],
        *[(text, "SE23") for text in ("SE_2(3)", "SE₂(3)", "se23")],
        *[(text, "R3") for text in ("R^3", "ℝ³", "R(3)")],
        *[(text, "SO3*R3") for text in ("SO(3)*R^3", "so(3) × r3")],
    ],
)
def test_a_group_as_people_write_it(written, name):
    assert group_named(written).name == name


@pytest.mark.parametrize(
    ("written", "said"),
    [
        ("SO(4)", "unknown group 'SO(4)'; did you mean 'SO3'?"),
        ("R10", "unknown group 'R10'; did you mean 'R1'?"),
        ("SO3**R3", "group 'SO3**R3': a factor is missing next to '*'"),
    ],
)
def test_another_name_is_refused_and_the_nearest_said(written, said):
    assert error_of(group_named, written) == said


def test_an_experiment_is_the_same_however_it_is_written():
    names = {"group": "SO3", "controllers": ["eqt", "gt", "lee2010"]}
    other = {"group": "so(3)", "controllers": ["EqT", {"kind": "GT"}, "Lee 2010"]}
    other |= {"reference.kind": "Torque", "initial.pose": "Haar"}
    first = eqt_cli.load_experiment("paper", {**FEW, **names, "initial.pose": "haar"})
    second = eqt_cli.load_experiment("paper", {**FEW, **other})
    assert first.controllers == second.controllers == ["eqt", "gt", "lee2010"]
    assert (first.digest, first.resolved) == (second.digest, second.resolved)


@pytest.mark.parametrize("kind", all_kinds())
def test_no_two_components_are_written_alike(kind):
    names = registry(kind).names()
    assert len({*map(bare, names)}) == len(names)


@pytest.mark.parametrize(
    ("name", "label"),
    [("GT", "gt"), ("gt", "gt"), ("Eq-T", "eqt"), ("mine", "mine"), ("Mine", "Mine"), ("no", "no")],
)
def test_a_law_is_selected_by_label_or_title(name, label):
    titled = {"gt": "GT", "eqt": "EqT", "mine": "Law", "MINE": "law"}
    assert label_named(name, titled) == label


@pytest.mark.needs("designed_laws")
@pytest.mark.ci("starts an interpreter")
def test_a_name_that_needs_no_other_spelling_loads_no_other_law():
    code = (
        "import sys; from eqt_cli.components.laws import controllers as c; "
        "print(c.written('gt'), 'eqt_cli.extensions.designed_laws.lqr' in sys.modules, "
        "c.written('LQR'))"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "gt False lqr\n"
