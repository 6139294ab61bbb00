"""Every command and snippet of the documentation works as it stands, and says what is true."""

import ast
import re
import shutil
import subprocess
import sys
from pathlib import Path
from pkgutil import resolve_name

import docs_runner
import pytest
import yaml
from slow_cases import mostly_slow

from eqt_cli.engines.native import Native
from eqt_cli.extensions.recordings import figures as growth
from eqt_cli.figures.figure import figures

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAGES = sorted(path.relative_to(DOCS).as_posix() for path in DOCS.glob("**/*.md"))
EQUATIONS = yaml.safe_load((DOCS / "explanation" / "equations.yaml").read_text(encoding="utf-8"))


@pytest.fixture(autouse=True)
def _engine_by_choice(monkeypatch):
    """As for a user, who has not set the variable."""
    monkeypatch.delenv("EQT_ENGINE")


@pytest.fixture
def folder(tmp_path):
    """A checkout as a new user has it, without results."""
    for name in ("configs", "examples"):
        shutil.copytree(ROOT / name, tmp_path / name)
    return tmp_path


def _text(page):
    return (DOCS / page).read_text(encoding="utf-8")


ALL = ["../README.md", *PAGES]
COMPUTING = [page for page in ALL if docs_runner.computes(_text(page))]
WHY = "computes what the page computes, and draws its figures"


@mostly_slow("page", COMPUTING, {*COMPUTING} - {"howto/lqr.md"}, "solves for gains")
def test_commands_and_configurations_are_accepted(page, folder, monkeypatch):
    """Without what takes its time, which the next test does; it does all of the other pages."""
    monkeypatch.chdir(folder)
    with docs_runner.without_plugins():
        docs_runner.read(_text(page))


@mostly_slow("page", ALL, {*ALL} - {*COMPUTING}, WHY)
@pytest.mark.usefixtures("unarranged")
def test_commands_and_snippets(page, folder, monkeypatch):
    monkeypatch.chdir(folder)
    with docs_runner.without_plugins():
        docs_runner.carry_out(_text(page))


NOTEBOOKS = re.findall(
    r"^```\{literalinclude\} \.\./\.\./(examples/notebooks/\w+\.py)\n.*?^```output\n(.*?)^```$",
    (DOCS / "howto" / "notebook.md").read_text(encoding="utf-8"),
    re.MULTILINE | re.DOTALL,
)
WRITTEN = {"sweep": ["gains.pdf"], "tuned": ["tuned.md", "tuned.tex"]}


def test_the_page_shows_every_notebook():
    files = {path.relative_to(ROOT).as_posix() for path in ROOT.glob("examples/notebooks/*.py")}
    assert {file for file, _ in NOTEBOOKS} == files
    assert {*WRITTEN} == {Path(file).stem for file in files}


@pytest.mark.parametrize(("file", "_"), NOTEBOOKS)
def test_a_notebook_uses_the_public_interface_only(file, _):
    tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
    assert ast.get_docstring(tree).split("\n\n")[1].startswith("At the end you have ")
    nodes = list(ast.walk(tree))
    modules = [node.module for node in nodes if isinstance(node, ast.ImportFrom)]
    modules += [name.name for node in nodes if isinstance(node, ast.Import) for name in node.names]
    assert [module for module in modules if module.startswith("eqt_cli")] == ["eqt_cli"]
    attributes = [node for node in nodes if isinstance(node, ast.Attribute)]
    assert not [node.attr for node in attributes if node.attr.startswith("_")]


@pytest.mark.slow("runs a notebook as it stands")
@pytest.mark.skipif(not all(map(docs_runner.installed, ("xarray", "h5netcdf"))), reason="xarray")
@pytest.mark.parametrize(("file", "shown"), NOTEBOOKS)
def test_a_notebook_prints_what_the_page_shows(file, shown, folder, monkeypatch):
    monkeypatch.setenv("MPLBACKEND", "agg")
    command = [sys.executable, "-W", "error", file]
    done = subprocess.run(command, capture_output=True, text=True, cwd=folder)
    assert done.returncode == 0, done.stderr
    assert docs_runner.matches(shown, done.stdout), done.stdout
    written = sorted(path.name for path in folder.iterdir() if path.is_file())
    assert written == WRITTEN[Path(file).stem]


@pytest.mark.slow("computes the 800 runs of the paper")
@pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")
def test_table_of_the_first_tutorial(folder):
    """Its digits do not depend on the engine; the energy residuals, in the last column, do."""
    command = [sys.executable, "-m", "eqt_cli", "run", "configs/paper.yaml", "--engine", "native"]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=folder)
    shown = _rows((DOCS / "tutorials" / "paper.md").read_text(encoding="utf-8"))
    assert len(shown) == 4
    assert _rows(done.stdout) == shown


def _rows(text):
    lines = re.findall(r"^(?:EqT|GT|nog|asym) +\d+/200 .*", text, re.MULTILINE)
    return [line.split()[:-1] for line in lines]


@pytest.mark.parametrize("entry", EQUATIONS, ids=lambda entry: entry["paper"])
def test_equations_name_what_exists(entry):
    for name in entry["code"]:
        assert resolve_name(name) is not None
    assert entry["tests"]
    for test in entry["tests"]:
        file, _, function = test.partition("::")
        tree = ast.parse((ROOT / file).read_text(encoding="utf-8"))
        functions = {node.name for node in tree.body if isinstance(node, ast.FunctionDef)}
        assert function in functions, test


def test_every_numbered_equation_is_listed():
    listed = " ".join(entry["paper"] for entry in EQUATIONS)
    assert [n for n in range(1, 29) if not re.search(rf"\({n}\)", listed)] == []


GALLERY = re.findall(
    r"\[!\[[^]]+\]\(figures/([^)]+)\)\]\(([^)#]+)#([^)]+)\) \| [^|`\n]*`([^`]+)`",
    (DOCS / "gallery.md").read_text(encoding="utf-8"),
)


def test_the_gallery_has_every_picture():
    pictures = {path.name for path in (DOCS / "figures").glob("*.png")}
    assert {picture for picture, *_ in GALLERY} == pictures


def test_the_gallery_has_every_kind_of_figure():
    """Those that `eqt list figures` lists, and that of `eqt replay`."""
    text = (DOCS / "gallery.md").read_text(encoding="utf-8")
    assert sorted(re.findall(r"\*\*(\w+)\*\*", text)) == sorted([*figures.names(), growth.NAME])


@pytest.mark.parametrize(("picture", "page", "anchor", "command"), GALLERY)
def test_a_picture_leads_to_its_command(picture, page, anchor, command):
    sections = re.split(r"^#+ ", (DOCS / page).read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = [s for s in sections if _anchor(s.partition("\n")[0]) == anchor]
    assert [command in section for section in found] == [True]


def _anchor(heading):
    """As a forge and Sphinx name a heading."""
    return re.sub(r"[^\w\s-]", "", heading.lower()).replace(" ", "-")


def test_links_and_files_of_the_site_need_no_network():
    """What the theme would load is checked when the site is built; here, what the pages say."""
    for page in PAGES:
        text = (DOCS / page).read_text(encoding="utf-8")
        assert not re.search(r"!\[[^]]*\]\(https?:|<(?:script|img|iframe)", text), page


def test_files_that_the_readme_points_to_exist():
    links = re.findall(r"\]\((?!https?:)([^)]+)\)", (ROOT / "README.md").read_text("utf-8"))
    assert links
    for link in links:
        path, _, heading = link.partition("#")
        page = ROOT / (path or "README.md")
        assert page.exists(), link
        if heading:
            titles = re.findall(r"^#+ (.*)$", page.read_text("utf-8"), re.M)
            assert heading in [
                re.sub(r"[^\w -]", "", one).lower().replace(" ", "-") for one in titles
            ]
