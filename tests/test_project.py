"""The project around the code: what the wheel holds, and descriptions that must agree."""

import json
import re
import subprocess
import sys
import tomllib
from email import message_from_bytes
from pathlib import Path
from zipfile import ZipFile

import pytest
import tiers
import yaml
from mutants import __main__ as mutants
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from packaging.version import Version

import eqt_cli

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def wheel(tmp_path_factory):
    folder = tmp_path_factory.mktemp("wheel")
    build = [sys.executable, "-m", "hatchling", "build", "--target", "wheel", "--directory", folder]
    done = subprocess.run(build, cwd=ROOT, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
    (path,) = folder.glob("*.whl")
    with ZipFile(path) as archive:
        yield archive


def test_wheel_holds_the_package_and_the_shipped_configs(wheel):
    code = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("eqt_cli/**/*.py")}
    code |= {
        path.relative_to(ROOT).as_posix()
        for path in ROOT.glob("eqt_cli/extensions/report/templates/*")
    }
    code |= {path.relative_to(ROOT).as_posix() for path in ROOT.glob("eqt_cli/**/*.h")}
    assert "eqt_cli/engines/c/advance.h" in code
    configs = {f"eqt_cli/configs/{path.name}" for path in ROOT.glob("configs/*.yaml")}
    assert "eqt_cli/configs/paper.yaml" in configs
    assert code | configs | {"eqt_cli/py.typed"} <= set(wheel.namelist())


def _needed_by_all(wheel, platform):
    """The names of what pip installs on this platform for the extra `all` and nothing else."""
    (name,) = (name for name in wheel.namelist() if name.endswith("/METADATA"))
    stated = message_from_bytes(wheel.read(name)).get_all("Requires-Dist")
    environment = {"sys_platform": platform, "extra": "all"}
    needed = [each for each in map(Requirement, stated) if "extra" in str(each.marker)]
    return {each.name for each in needed if each.marker.evaluate(environment)}


def test_all_installs_every_extra_and_a_compiler_on_windows_only(wheel):
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    extras = project["optional-dependencies"]
    # MuJoCo is large, and tested with the oracles; `live` needs what `native` does.
    others = extras.keys() - {"all", "native", "live", "mujoco"}
    expected = {Requirement(each).name for extra in others for each in extras[extra]}
    assert _needed_by_all(wheel, "linux") == expected
    assert _needed_by_all(wheel, "win32") == expected | {"ziglang"}


def test_wheel_and_citation_carry_the_package_version(wheel):
    (name,) = (name for name in wheel.namelist() if name.endswith("/METADATA"))
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    metadata = message_from_bytes(wheel.read(name))
    assert {metadata["Version"], citation["version"]} == {eqt_cli.__version__}


def test_workflows_name_every_action_by_its_commit():
    for path in (ROOT / ".github" / "workflows").glob("*.yml"):
        actions = re.findall(r"uses: (\S+)( #.*)?$", path.read_text(encoding="utf-8"), re.MULTILINE)
        for action, version in actions:
            assert re.fullmatch(r"[\w/-]+@[0-9a-f]{40}", action), f"{path.name}: {action}"
            assert re.fullmatch(r" # v\d+\.\d+\.\d+", version), f"{path.name}: {action}"
        text = path.read_text(encoding="utf-8")
        assert text.count("actions/checkout@") == text.count("persist-credentials: false"), (
            path.name
        )


def test_the_quick_tests_run_on_machines_of_strangers():
    workflow = yaml.safe_load((ROOT / ".github/workflows/ci.yml").read_text(encoding="utf-8"))
    job = workflow["jobs"]["machines"]
    systems = job["strategy"]["matrix"]["system"]
    assert [re.sub(r"[-\d.]+", " ", system) for system in systems] == [
        "ubuntu ",
        "ubuntu arm",
        "macos ",
        "windows ",
    ]
    commands = [step.get("run", "") for step in job["steps"]]
    assert not any("make" in command for command in commands)
    assert sum('-m "not ci"' in command for command in commands) == 1
    assert {"workflow_dispatch", "push"} <= workflow[True].keys()  # YAML reads `on` as true
    install = (ROOT / "docs" / "install.md").read_text(encoding="utf-8")
    assert "No job of it has run yet" in install


def test_zenodo_and_citation_describe_the_same_program():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    zenodo = json.loads((ROOT / ".zenodo.json").read_text(encoding="utf-8"))
    for ours, theirs in (("title", "title"), ("license", "license"), ("type", "upload_type")):
        assert citation[ours] == zenodo[theirs]


def test_citation_names_the_paper():
    citation = yaml.safe_load((ROOT / "CITATION.cff").read_text(encoding="utf-8"))
    paper = citation["preferred-citation"]
    assert [author["family-names"] for author in paper["authors"]] == [
        "Hampsey",
        "Goor",
        "Banavar",
        "Mahony",
    ]
    assert paper["doi"] == "10.48550/arXiv.2511.18800"


@pytest.mark.needs
def test_contributing_lays_out_every_folder_of_the_package():
    text = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    for indent, folder in (("  ", "eqt_cli"), ("    ", "eqt_cli/extensions")):
        described = set(re.findall(rf"^{indent}(\w+)/ +\S", text, flags=re.MULTILINE))
        assert described == {path.parent.name for path in ROOT.glob(f"{folder}/*/__init__.py")}


def test_lower_bounds_are_the_versions_that_test_lowest_installs():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    extras = project["project"]["optional-dependencies"]
    assert extras.pop("all")[0].startswith("eqt-cli[")
    assert extras.pop("mujoco")  # tested with the oracles
    stated = {
        _bound(requirement, ">=")
        for requirements in (
            project["project"]["dependencies"],
            *extras.values(),
            project["dependency-groups"]["test"],
        )
        for requirement in requirements
    }
    lines = (ROOT / "tests" / "lowest.txt").read_text(encoding="utf-8").splitlines()
    tested = {_bound(line, "==") for line in lines if "==" in line}
    assert tested == stated


LOCKS = {
    "lock": "test lint docs release ci",
    "lock-oracles": "oracles",
    "lock-notebook": "notebook",
    "lock-basilisk": "basilisk",
}


@pytest.mark.parametrize("name", [*LOCKS, "lock-lowest"])
def test_continuous_integration_installs_by_hash_what_the_project_needs(name):
    """`make lock` writes these files."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    groups, extras = project["dependency-groups"], project["project"]["optional-dependencies"]
    needed = [] if name == "lock-basilisk" else [*project["project"]["dependencies"]]
    if name in ("lock", "lock-lowest"):
        kept = extras.keys() - {"mujoco"}  # which lock-oracles has
        needed += [each for extra in kept for each in extras[extra] if "eqt-cli" not in each]
    for group in LOCKS.get(name, "test").split():
        needed += [each for each in groups[group] if isinstance(each, str)]
    entries = (ROOT / ".ci" / f"{name}.txt").read_text(encoding="utf-8").replace("\\\n", "")
    found = [line.partition(" --hash=sha256:") for line in entries.splitlines()]
    assert all(hashes for _, _, hashes in found)
    pinned = {}
    for parsed in (Requirement(entry) for entry, _, _ in found):
        pinned.setdefault(canonicalize_name(parsed.name), []).append(_bound(f"{parsed}", "==")[1])
    for wanted in map(Requirement, needed):
        versions = pinned[canonicalize_name(wanted.name)]
        assert all(version in wanted.specifier for version in versions), wanted


def _bound(requirement, operator):
    parsed = Requirement(requirement)
    (version,) = (spec.version for spec in parsed.specifier if spec.operator == operator)
    return parsed.name, Version(version)


def test_tests_that_the_list_of_quick_ones_names_exist():
    """`make tiers` writes it anew."""
    gone = []
    for name in [*tiers.tiers().functions, *tiers.tiers().cases, *tiers.tiers().longer]:
        file, _, function = name.partition("[")[0].partition("::")
        path = ROOT / file
        if not path.exists() or f"def {function}(" not in path.read_text(encoding="utf-8"):
            gone.append(name)
    assert gone == []


def test_tests_that_mutants_are_tried_on_exist():
    """A test that was moved would end `make mutants` before its first mutant."""
    assert [path for path in mutants.TESTS if not (ROOT / path).exists()] == []
