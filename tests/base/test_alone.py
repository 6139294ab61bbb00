"""eqt without one of its extensions: the others stay as they are."""

import os
import re
import shutil
import subprocess
import sys
from collections import defaultdict
from functools import cache
from pathlib import Path

import pytest
from said import says

import eqt_cli
from eqt_cli.base import purposes
from eqt_cli.base.extensions import Every, Extension, Purpose, shipped, usable
from eqt_cli.base.registry import Registry
from eqt_cli.extend import Controller

PACKAGE = Path(eqt_cli.__file__).parent
EXTENSIONS = PACKAGE / "extensions"
NAMES = [extension.name for extension in shipped()]
ROOT = PACKAGE.parent
PAIRS = {("flights", "logs"), ("gym", "network"), ("live", "report"), ("suite", "search")}
PURPOSES = {name: x for name, x in vars(purposes).items() if isinstance(x, Purpose)}

pytestmark = pytest.mark.needs("proofs")

PROBE = """
import sys
from eqt_cli import api, extend
from eqt_cli.base.extensions import all_kinds, imported, shipped
from eqt_cli.base.registry import registry
from eqt_cli.cli import main
for kind in all_kinds():
    registry(kind).all()
for extension in shipped():
    for place in (*extension.functions, *extension.commands.values()):
        imported(place.function)
for module in (api, extend):
    for name in module.__all__:
        getattr(module, name)
for words in (["--help"], ["list"], ["list", "controllers"], *map(str.split, sys.argv[1:])):
    sys.argv = ["eqt", *words]
    try:
        main()
    except SystemExit as end:
        assert not end.code, (words, end.code)
"""
"""All registered places import, and the commands answer."""


def imports_of(module):
    """The extensions that a module imports, also within functions, and by `eqt_cli.extend`."""
    text = module.read_text(encoding="utf-8")
    names = {*re.findall(r"from eqt_cli\.extensions(?:\.| import )(\w+)", text)}
    for listed in re.findall(r"from eqt_cli\.extend import (\([^)]*\)|[^\n]*)", text):
        words = {*re.findall(r"\w+", listed)}
        names |= {extension for extension, of in offered().items() if of & words}
    return names


@cache
def offered():
    """The names that extensions add to `eqt_cli.extend`."""
    stubs = {path.parent.name: path.read_text() for path in EXTENSIONS.glob("*/extend.pyi")}
    return {name: {*re.findall(r" as (\w+)", text)} for name, text in stubs.items()}


def test_extensions_import_no_others_but_for_four_pairs():
    """Components of a kind are asked for by who adds the kind, as certificates by proofs."""
    kinds = {kind: extension.name for extension in shipped() for kind in extension.kinds}
    pairs = defaultdict(set)
    for extension in shipped():
        places = defaultdict(set)
        for kind, components in extension.components.items():
            for place in components.values():
                places[place.rpartition(".")[2]].add(kinds.get(kind))
        for module in (EXTENSIONS / extension.name).rglob("*.py"):
            answers_to = places.get(module.stem, set())
            for name in imports_of(module) - {extension.name}:
                if answers_to != {name}:
                    pairs[extension.name, name].add(module.name)
    assert set(pairs) == PAIRS == {(x.name, name) for x in shipped() for name in x.needs}


def test_the_rules_name_the_pairs():
    rules = " ".join((ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8").split())
    assert {*re.findall(r"`(\w+)` imports `(\w+)`", rules)} == PAIRS


def test_an_extension_that_needs_an_absent_one_is_left_out(monkeypatch):
    monkeypatch.setattr("pkgutil.iter_modules", lambda _: map(Module, {*NAMES} - {"logs"}))
    names = {extension.name for extension in shipped.__wrapped__()}
    assert {*NAMES} - names == {"logs", "flights"}


class Module:
    def __init__(self, name):
        self.name = name


# Purposes


@cache
def asked_for():
    asked = re.compile(r"functions?_for\(\s*purposes\.(\w+)")
    texts = (path.read_text("utf-8") for path in PACKAGE.rglob("*.py"))
    return {name for text in texts for name in asked.findall(text)}


@pytest.mark.parametrize("name", PURPOSES)
def test_a_purpose_is_asked_for_and_has_a_function(name):
    """Each is stated with a sentence; somebody asks for it, and an extension answers."""
    purpose = PURPOSES[name]
    assert len(purpose.signature.__doc__.split(";")) <= 3
    functions = [f for extension in shipped() for f in extension.functions if f.purpose is purpose]
    assert functions
    assert name in asked_for()
    assert isinstance(purpose, Every) or len(functions) == 1


def test_functions_carry_the_purpose_for_which_they_are_named():
    """So that the checker of types compares their signature with that of the purpose."""
    for extension in shipped():
        for place in extension.functions:
            module, _, name = place.function.rpartition(".")
            text = ROOT.joinpath(*module.split(".")).with_suffix(".py").read_text("utf-8")
            purpose = f"purposes.{place.purpose.signature.__name__}"
            carried = rf"(?m)^@{purpose}\n(@.*\n)*(def|class) {name}\b|^{purpose}\({name}\)$"
            assert re.search(carried, text), place.function


def test_a_wrong_purpose_fails_where_it_is_named():
    with pytest.raises(AttributeError, match="remarks_on_a_experiment"):
        Extension("mine", "mine").add_function(purposes.remarks_on_a_experiment, "mine.remarks")


def test_functions_of_others_come_behind_those_of_eqt(monkeypatch):
    other = Extension("other", "tests")
    other.add_function(purposes.command_for_a_word, "hint")
    monkeypatch.setattr("eqt_cli.base.extensions.installed", lambda: (other,))
    usable.cache_clear()
    try:
        assert usable()[-1] is other
    finally:
        usable.cache_clear()


TAKEN = """
from eqt_cli.extend import Lee2010

class Free(Lee2010):
    name = "free"

class Other(Lee2010):
    name = "EqT"
"""


def test_a_component_of_others_gets_no_name_that_exists(monkeypatch, tmp_path, told):
    (tmp_path / "taken.py").write_text(TAKEN, encoding="utf-8")
    monkeypatch.syspath_prepend(tmp_path)
    one, two = Extension("one", "taken"), Extension("two", "taken")
    for extension, name in ((one, "EqT"), (one, "free"), (two, "free")):
        extension.add_component("controllers", name)
    monkeypatch.setattr("eqt_cli.base.extensions.installed", lambda: (one, two))
    monkeypatch.setattr("eqt_cli.base.registry._registries", [])
    laws = Registry("controller", "controllers", Controller, ("components.laws",))
    assert {"eqt", "free"} <= {*laws.names()} and "EqT" not in laws.names()
    first, second = told.remarks
    assert says(first, "controller 'EqT' of…'one' is left out: 'eqt' already exists; rename yours")
    assert says(second, "controller 'free' of…'two' is left out: 'free' already exists…")


# One extension removed at a time, as a user would


@pytest.fixture
def without(tmp_path):
    """The package as links, without the folder of one extension."""

    def remove(name):
        package = tmp_path / "eqt_cli"
        shutil.copytree(
            PACKAGE, package, copy_function=os.symlink, ignore=shutil.ignore_patterns("__pycache__")
        )
        shutil.rmtree(package / "extensions" / name)
        (tmp_path / "configs").symlink_to(ROOT / "configs")
        return tmp_path

    return remove


@pytest.mark.ci("starts Python for every extension")
@pytest.mark.parametrize("name", NAMES)
def test_without_an_extension_all_places_of_the_others_import(without, name):
    run_in(without(name))


def run_in(folder, *commands):
    process = subprocess.run(
        [sys.executable, "-c", PROBE, *commands],
        env={**os.environ, "PYTHONPATH": str(folder), "PYTHONDONTWRITEBYTECODE": "1"},
        cwd=folder,
        capture_output=True,
        text=True,
        check=False,
    )
    assert process.returncode == 0, process.stderr[-2000:]
