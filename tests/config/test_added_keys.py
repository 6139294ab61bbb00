"""Keys that extensions bring: they are keys as those of the core, and one extension has each."""

import os
import subprocess
import sys
from typing import Annotated

import pytest
from said import says
from small_experiment import mapping

from eqt_cli.base.errors import ConfigError, Problems
from eqt_cli.base.extensions import Extension, shipped
from eqt_cli.base.option_types import known_keys, validated
from eqt_cli.config import schema
from eqt_cli.extend import WORDS, NotSwept, Section

pytestmark = pytest.mark.needs("search", "live", "merging")


class Budget(Section):
    """A key of somebody else.

    Attributes
    ----------
    mass_budget
        The mass that the parts may have, kg.
    """

    mass_budget: Annotated[float | None, WORDS, NotSwept("is of no run")] = None


class Other(Section):
    mass_budget: str = ""
    other: str = ""


class Taken(Section):
    gains: str = ""


def added(name, *places):
    extension = Extension(name, __name__)
    for place in places:
        extension.add_keys(place)
    return extension


def test_a_key_of_an_extension_has_type_meaning_and_marks():
    keys = schema.with_keys_of([added("mine", "Budget")])
    data, problems = mapping(), Problems()
    assert validated(keys, data | {"mass_budget": 2.0}, problems).mass_budget == 2.0
    assert known_keys(keys, ())["mass_budget"] == "The mass that the parts may have, kg"
    assert WORDS in keys.model_fields["mass_budget"].metadata
    assert [*keys.model_fields][:-1] == [*schema.with_keys_of([]).model_fields]
    validated(keys, data | {"mass_budgt": 2.0}, problems.at("file"))
    with pytest.raises(ConfigError) as error:
        problems.raise_if_any()
    assert says(str(error.value), "…mass_budgt…did you mean 'mass_budget'?")


@pytest.mark.parametrize(
    ("second", "owner"), [("Other", "extension 'mine'"), ("Taken", "eqt"), ("Absent", "Absent")]
)
def test_of_two_with_one_key_the_second_is_left_out(second, owner, told):
    keys = schema.with_keys_of([added("mine", "Budget"), added("other", second)])
    assert keys.model_fields["mass_budget"].annotation == float | None
    assert "other" not in keys.model_fields
    (remark,) = told.remarks
    assert says(str(remark), f"…'other'…{owner}…")


def test_a_key_whose_extension_is_absent_says_so(monkeypatch):
    monkeypatch.setattr(schema, "Config", schema.with_keys_of([]))
    problems = Problems()
    assert schema.without_absent({"group": "SO3", "tune": {}}, problems) == {"group": "SO3"}
    with pytest.raises(ConfigError) as error:
        problems.raise_if_any()
    assert says(str(error.value), "tune: belongs to search, which is not installed…")


def test_the_core_names_the_keys_of_all_extensions():
    owners = {}
    for extension in shipped():
        keys = schema.with_keys_of([extension]).model_fields.keys()
        owners |= dict.fromkeys(keys - schema.with_keys_of([]).model_fields, extension.name)
    assert owners == schema.OF_EXTENSIONS


STRANGER = """
from typing import Annotated
from eqt_cli.extend import WORDS, Section

class Keys(Section):
    mass_budget: Annotated[float | None, WORDS] = None

def register(extension):
    extension.add_keys("Keys")
"""

SESSION = """
import sys
from pathlib import Path
from small_experiment import configuration, study_of
keys = ({}, {"mass_budget": "2.0"})
plain, more = (study_of(Path(), configuration(**more)) for more in keys)
print(more.base.config.mass_budget, plain.digest == more.digest)
"""


@pytest.mark.ci("starts an interpreter")
def test_a_distribution_brings_a_key(tmp_path):
    (tmp_path / "heavy.py").write_text(STRANGER)
    info = tmp_path / "heavy-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: heavy\nVersion: 1\n")
    (info / "entry_points.txt").write_text("[eqt.extensions]\nheavy = heavy:register\n")
    path = os.pathsep.join([str(tmp_path), *filter(None, sys.path)])
    done = subprocess.run(
        [sys.executable, "-c", SESSION],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
        env=os.environ | {"PYTHONPATH": path},
    )
    assert (done.stdout, done.stderr) == ("2.0 True\n", "")
