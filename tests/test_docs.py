"""Every command and snippet of the documentation works as it stands, and says what is true."""

import ast
import json
import os
import re
import shlex
import shutil
import subprocess
import sys
from decimal import Decimal
from pathlib import Path
from pkgutil import resolve_name

import docs_runner
import numpy as np
import pytest
import yaml
from ci_cases import mostly_ci

from eqt_cli import open_result
from eqt_cli.extend import Native
from eqt_cli.figures.figure import figures

ROOT = Path(__file__).parent.parent
DOCS = ROOT / "docs"
PAPER = DOCS / "paper"  # for a journal, no page
PAGES = sorted(
    path.relative_to(DOCS).as_posix() for path in DOCS.glob("**/*.md") if path.parent != PAPER
)
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


@mostly_ci("page", COMPUTING, {*COMPUTING} - {"howto/lqr.md"}, "solves for gains")
def test_commands_and_configurations_are_accepted(page, folder, monkeypatch):
    """Without what takes its time, which the next test does; it does all of the other pages."""
    monkeypatch.chdir(folder)
    with docs_runner.without_plugins():
        docs_runner.read(_text(page))


@mostly_ci("page", ALL, {*ALL} - {*COMPUTING}, WHY)
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


@pytest.mark.ci("runs a notebook as it stands")
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


FIRST = "tutorials/paper.md"
NEEDS_COMPILER = pytest.mark.skipif(Native.unavailable() is not None, reason="needs a C compiler")


@pytest.fixture(scope="module")
def paper(tmp_path_factory):
    """The folder with the paper's 800 runs, and what `eqt run` prints of them."""
    folder = tmp_path_factory.mktemp("paper")
    shutil.copytree(ROOT / "configs", folder / "configs")
    return folder, _printed(folder, "run", "configs/paper.yaml", "--engine", "native")


def _printed(folder, *arguments, **environment):
    command = [sys.executable, "-m", "eqt_cli", *arguments]
    environment = {**os.environ, **environment}
    done = subprocess.run(command, stdout=-1, text=True, check=True, cwd=folder, env=environment)
    return done.stdout


@pytest.fixture(scope="module")
def many(tmp_path_factory):
    """The folder with 5,000 runs of each law of the paper, by the command of the first pages."""
    folder = tmp_path_factory.mktemp("many")
    shutil.copytree(ROOT / "configs", folder / "configs")
    runs = {
        block.text.partition("eqt compare")[0]
        for page in ("index.md", "../README.md")
        for block in docs_runner.blocks(_text(page))
        if "results/many\neqt" in block.text
    }
    (run,) = runs  # the same on both pages
    _printed(folder, *shlex.split(run)[1:])
    return folder


@pytest.mark.ci("computes the 800 runs of the paper")
@NEEDS_COMPILER
def test_table_of_the_paper(paper):
    """Its digits do not depend on the engine."""
    shown = _rows(_text(FIRST))
    assert len(shown) == 4
    assert _rows(paper[1]) == shown


def _rows(text):
    lines = re.findall(r"^(?:EqT|GT|nog|asym) +\d+/200 .*", text, re.MULTILINE)
    return [line.split() for line in lines]


@pytest.mark.ci("computes the 800 runs of the paper")
@NEEDS_COMPILER
def test_comparison_of_the_paper(paper):
    printed = _printed(paper[0], "compare", "results/paper", COLUMNS="80")
    assert docs_runner.matches(_comparison(FIRST), printed)


def _comparison(page):
    texts = [block.text for block in docs_runner.blocks(_text(page)) if block.language == "text"]
    (shown,) = [text for text in texts if re.search(r"^GT +−", text, re.MULTILINE)][:1]
    return shown


@pytest.mark.ci("computes 20,000 runs")
@NEEDS_COMPILER
def test_numbers_of_the_first_pages(many):
    """Each has its interval, and comes from the command beside it."""
    printed = _printed(many, "compare", "results/many", COLUMNS="90")
    pages = ["index.md", "../README.md", "explanation/paper.md"]
    for page in pages[:2]:
        assert docs_runner.matches(_comparison(page), printed)
    compared = json.loads(_printed(many, "compare", "results/many", "--json", "--against", "gt"))
    rows = compared["pairs"]
    pairs = {(x["metric"], x["window_stop"], x["first"], x["second"]): x for x in rows}
    home, readme, findings = (" ".join(_text(page).split()) for page in pages)

    def percent(*measured):
        row = pairs[measured]
        names = "relative", "relative_low", "relative_high"
        mean, *ends = (abs(100 * row[name]) for name in names)
        return f"{mean:.1f}", *(f"{end:.1f}" for end in sorted(ends))

    torque, *less = percent("mean_torque", 5, "eqt", "gt")
    errors, *more = percent("mean_pose_error", 20, "eqt", "gt")
    rows = (
        f"| {torque} % less | {' to '.join(less)} |",
        f"| {errors} % more | {' to '.join(more)} |",
    )
    assert all(row in home for row in rows)
    torque, errors = f"{torque} % [{', '.join(less)}]", f"{errors} % [{', '.join(more)}]"
    assert f"EqT needs {torque} less torque than GT in the first 5 s" in readme
    asym = re.search(r"asym +−(\S+) % \[−(\S+), −(\S+)\]", printed)
    assert asym is not None
    median = f"{asym[1]} % [{asym[3]}, {asym[2]}] less attitude error than EqT in the median"
    assert f"asym, one of the two, has {median}" in readme
    assert f"less by {torque}" in findings and f"more by {errors}" in findings


def test_the_readme_says_what_make_paper_prints_last():
    texts = [block.text for block in docs_runner.blocks(_text("../README.md"))]
    (places,) = [text for text in texts if text.startswith("all runs ")]
    recipe = (ROOT / "Makefile").read_text("utf-8").replace("$(BIN)", ".venv/bin")
    assert all(f'"{line}"' in recipe for line in places.splitlines())


@pytest.mark.ci("computes the 800 runs of the paper")
@NEEDS_COMPILER
def test_shares_of_the_torque_in_the_findings(paper):
    """The figure's root mean squares over 5 s, and those of all torques, are what the page says."""
    page, folder = _text("explanation/paper.md"), paper[0]
    plot = ("plot", "results/paper", "--figure", "torque", "--to", "5", "--format", "json")
    for share in ("total", "feedforward", "feedback"):
        _printed(folder, *plot, "--option", f"share={share}", "--out", share)
        curves = json.loads((folder / share / "torque.json").read_text(encoding="utf-8"))
        drawn = {(curve["panel"], curve["name"]): np.array(curve["y"]) for curve in curves}
        eqt, gt = (np.sqrt(np.mean(drawn["ωz", law] ** 2)) for law in ("eqt", "gt"))
        assert f"(`share={share}`) | {eqt:.2f} | {gt:.2f} |" in page
    with open_result(folder / "results" / "paper") as result:
        early = result["torque"][:2, :, result.times <= 5]
    (x, y, z), (x_gt, y_gt, z_gt) = np.sqrt(np.mean(early**2, axis=(1, 2)))
    assert f"(`share=total`) | {z:.2f} | {z_gt:.2f} |" in page
    assert f"{x:.2f} and {y:.2f} against {x_gt:.2f} and {y_gt:.2f} N m" in page


COLUMNS = re.findall(
    r"^\| ([^|]+) \| (count|mean|largest) \| [^|]*\(`(\w+)`\) \|$", _text(FIRST), re.MULTILINE
)
OVER_RUNS = {"count": np.sum, "mean": np.mean, "largest": np.max}


@pytest.mark.ci("computes the 800 runs of the paper")
@NEEDS_COMPILER
def test_words_of_the_first_tutorial(paper):
    """What the page calls a mean or the largest is that of the metric it names, in its unit."""
    folder, printed = paper
    lines = printed.splitlines()
    start = next(number for number, line in enumerate(lines) if line.startswith("law "))
    assert re.split(r"  +", lines[start].strip()) == ["law", *(heading for heading, *_ in COLUMNS)]
    with open_result(folder / "results" / "paper") as result:
        for row, line in enumerate(lines[start + 2 : start + 6]):
            cells = line.replace("*", "").split()[1:]
            for (heading, word, metric), cell in zip(COLUMNS, cells, strict=True):
                unit = heading.rpartition(", ")[2] if ", " in heading else "1"
                assert result.units(metric) == unit, heading
                number = Decimal(cell.partition("/")[0])
                value = OVER_RUNS[word](result.metric(metric)[row])
                last = Decimal(1).scaleb(number.as_tuple().exponent)
                assert abs(Decimal(float(value)) - number) <= last * Decimal("0.51"), (row, heading)


SHOWN = [page for page in PAGES if page.startswith("tutorials/")]


@pytest.mark.parametrize("page", SHOWN)
def test_a_tutorial_explains_the_columns_of_its_tables(page):
    """Each heading of a printed table, without its unit, stands in the text around the table."""
    text = _text(page)
    prose = " ".join(docs_runner.BLOCK.sub(" ", text).replace("`", "").replace("*", "").split())
    for block in docs_runner.blocks(text):
        if block.language in ("text", "output"):
            for heading in _headings(block.text):
                assert heading.partition(",")[0].lower() in prose.lower(), heading


def _headings(printed):
    """Those of every table in a text: what stands above each piece of its rule."""
    lines = printed.splitlines()
    for number, line in enumerate(lines):
        if re.fullmatch(r" *─+(  ─+)+", line):
            first = number
            while first and lines[first - 1].strip() not in ("", "…"):
                first -= 1
            for column in re.finditer("─+", line):
                pieces = [above[slice(*column.span())].strip() for above in lines[first:number]]
                yield " ".join(filter(None, pieces))


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
    assert sorted(re.findall(r"\*\*(\w+)\*\*", text)) == sorted([*figures.names(), "replay"])


@pytest.mark.parametrize(("picture", "page", "anchor", "command"), GALLERY)
def test_a_picture_leads_to_its_command(picture, page, anchor, command):
    sections = re.split(r"^#+ ", (DOCS / page).read_text(encoding="utf-8"), flags=re.MULTILINE)
    found = [s for s in sections if _anchor(s.partition("\n")[0]) == anchor]
    assert [command in section.replace(" \\\n  ", " ") for section in found] == [True]


def _anchor(heading):
    """As a forge and Sphinx name a heading."""
    return re.sub(r"[^\w\s-]", "", heading.lower()).replace(" ", "-")


WIDEST = 72


@pytest.mark.parametrize("page", ALL)
def test_long_commands_continue_on_the_next_line(page):
    """A line is wider only where it is one argument, with its option."""
    shown = re.findall(r"^```sh\n(.*?)\n```$", _text(page), re.MULTILINE | re.DOTALL)
    lines = [line for block in shown for line in block.splitlines() if len(line) > WIDEST]
    assert [
        line for line in lines if not re.match(r"  (--\S+ )?(\S+|'[^']*'|\"[^\"]*\")( \\)?$", line)
    ] == []


def test_links_and_files_of_the_site_need_no_network():
    """What the theme would load is checked when the site is built; here, what the pages say."""
    for page in PAGES:
        text = (DOCS / page).read_text(encoding="utf-8")
        outside = r"!\[[^]]*\]\(https?:|<(?:script|img|iframe(?! src=.live/))"
        assert not re.search(outside, text), page


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
