r"""Text by LaTeX: what its failures say, and, where it is installed, that every label survives.

Debian and Ubuntu have all that is needed in texlive-latex-extra, cm-super and dvipng.
"""

import os
import shutil
import subprocess
import sys

import pytest
from said import cases

from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.recordings.figures import MeasuredFigure
from eqt_cli.figures.figure import OfCertificates, OfSweep, figures
from eqt_cli.figures.render import encode, render
from eqt_cli.figures.style import WIDTHS, Style, house_style

TEX = Style(tex=True)
MEND = (
    "change the text or the preamble of the style sheet, install what is missing of TeX Live "
    "(Debian, Ubuntu: apt-get install texlive-latex-extra cm-super dvipng; others: tlmgr install "
    "cm-super dvipng type1cm underscore), or draw without LaTeX"
)
NAMES = [
    name
    for name in figures.names()
    if not issubclass(figures.get(name), OfSweep | OfCertificates | MeasuredFigure)
]


def _works():
    try:
        TEX.prepare(("pdf", "png"))
    except EqtError as error:
        return str(error)
    return ""


WHY_NOT = _works() if shutil.which("latex") else "no program 'latex'"
with_latex = pytest.mark.skipif(bool(WHY_NOT), reason=f"needs LaTeX: {WHY_NOT}")


def explained(message, kind=RuntimeError):
    with pytest.raises(EqtError) as caught, house_style(TEX):
        raise kind(message)
    return str(caught.value)


def refused(text, *log, program="latex"):
    """What Matplotlib raises."""
    quoted = repr(text.encode("unicode_escape"))
    lines = "\n".join(["This is pdfTeX", "(./file.tex", *log, "No pages of output."])
    return (
        f"{program} was not able to process the following string:\n{quoted}\n\n"
        f"Here is the full command invocation and its output:\n\n{program} file.tex\n\n{lines}\n\n"
    )


def test_a_missing_latex_is_named_before_anything_is_drawn(monkeypatch, so3, opened, tmp_path):
    sheet = tmp_path / "new.mplstyle"  # with a preamble for which Matplotlib has cached no text
    sheet.write_text(f"text.latex.preamble: \\def\\new{{{tmp_path}}}\n", encoding="utf-8")
    monkeypatch.setenv("PATH", str(tmp_path))
    style = Style((str(sheet),), tex=True)
    with pytest.raises(EqtError) as caught:
        render([opened(so3)], "paper", tmp_path / "new", ("json", "svg"), style=style)
    assert str(caught.value) == f"LaTeX does not work: latex could not be found; {MEND}"
    assert not (tmp_path / "new").exists()


def test_numbers_need_no_latex(monkeypatch, so3, opened, tmp_path):
    monkeypatch.setenv("PATH", str(tmp_path))
    with house_style(TEX):
        TEX.prepare([])


@pytest.mark.parametrize(
    ("log", "reason"),
    [
        *cases(r"""
["! LaTeX Error: File `type1cm.sty' not found.", "", Type X to quit] → File `type1cm.sty' not found
["! Package matplotlib-support Error: Missing cm-super package, required by Matplotlib.", ""] →
    Package matplotlib-support Error: Missing cm-super package, required by Matplotlib
["! Undefined control sequence.", "<recently read> \\oops ", l.14 \oops] →
    Undefined control sequence \oops
["! Undefined control sequence.", "l.28 {\\rmfamily $a\\oops", "          b$}%"] →
    Undefined control sequence \oops
["! Double superscript.", "l.28 {\\rmfamily $x^a^"] → Double superscript
["! Missing } inserted.", <inserted text>, "       }"] → Missing } inserted
[] → it gives no reason
"""),
        (
            [
                "! LaTeX Error: Unicode character 世 (U+4E16)",
                "               not set up for use with LaTeX.",
                "",
                "See the LaTeX manual.",
            ],
            "Unicode character 世 (U+4E16) not set up for use with LaTeX",
        ),
    ],
)
def test_a_text_that_cannot_be_set_is_named_with_the_reason(log, reason):
    assert explained(refused("τ $\\oops$", *log)) == (
        f"LaTeX cannot set 'τ $\\oops$': {reason}; {MEND}"
    )


@pytest.mark.parametrize(
    ("error", "message"),
    [
        (LookupError, "The font map 'x.map' is missing a PostScript font associated to 'tcrm0800'"),
        (
            ValueError,
            "No usable font file found for CMR10 (cmr10); the font may lack a Type-1 version",
        ),
        (FileNotFoundError, "Matplotlib's TeX implementation searched for a file named 'x.tfm'"),
    ],
)
def test_missing_fonts_are_named(error, message):
    assert explained(message, error) == f"LaTeX does not work: {message}; {MEND}"


@pytest.mark.parametrize("error", [RuntimeError("other"), KeyError("other")])
def test_other_errors_pass(error):
    with pytest.raises(type(error), match="other"), house_style(TEX):
        raise error


@with_latex
@pytest.mark.parametrize(
    ("name", "width", "result"),
    [
        (name, [*WIDTHS][k % len(WIDTHS)], ("so3", "odd_names")[k % 2])
        for k, name in enumerate(NAMES)
    ],
)
def test_every_figure_can_be_drawn(name, width, result, opened, request, caplog):
    drawing = figures.get(name)().draw([opened(request.getfixturevalue(result))], width, style=TEX)
    for format in ("pdf", "svg", "png"):
        assert encode(drawing, format, style=TEX)
    with house_style(TEX):
        inked = drawing.get_tightbbox()
    # Half a line width of a frame, 0.5 pt, may touch the edge.
    assert inked.x0 >= -0.01
    assert inked.x1 <= drawing.get_figwidth() + 0.01
    assert not caplog.records


@with_latex
@pytest.mark.parametrize(
    "label",
    [
        *"\\{}$&%#_^~<>|\"'`-,;:!?*()[]@",
        "50 % of a_b & c#1 ~ {x} \\input{file} ^^41",
        "ä ß ł ő ñ Ç “quoted” 5–9 — … ° µ ² § ½",
        "αβγ ΓΔΩ ωx₁ v² ‖τ‖ ≤ ∞ − × · ± →",
        r"$g = \frac{1}{2}$, 5 % & $\mathcal{L}_{\mathrm{max}}$",
        "$5 and $\\oops$",
        "",
    ],
)
def test_every_label_can_be_set(label, simulate, opened):
    law = {"kind": "family", "label": label or "x"}
    results = opened(simulate(controllers=[law], ensemble={"runs": 2, "seed": 1}))
    drawing = figures.get("paper")().draw([results], style=TEX)
    assert encode(drawing, "pdf", style=TEX).startswith(b"%PDF")


@with_latex
def test_a_label_that_latex_cannot_set_is_named_without_the_log(simulate, opened):
    law = {"kind": "family", "label": "law 世"}
    with pytest.raises(EqtError) as caught:
        figures.get("paper")().draw([opened(simulate(controllers=[law]))], style=TEX)
    assert str(caught.value) == (
        "LaTeX cannot set 'law 世': Unicode character 世 (U+4E16) not set up for use with "
        f"LaTeX; {MEND}"
    )


@with_latex
def test_files_are_equal_byte_for_byte_in_every_process(so3, tmp_path):
    code = (
        "from pathlib import Path\n"
        "from eqt_cli.figures.render import render\n"
        "from eqt_cli.figures.style import Style\n"
        "from eqt_cli.api.loading import open_at\n"
        f"with open_at({str(so3)!r}) as results:\n"
        "    render([results], 'paper', Path.cwd(), style=Style(tex=True))\n"
    )
    found = []
    for seed in ("1", "2"):
        folder = tmp_path / seed
        folder.mkdir()
        # With a cache of its own, so that LaTeX runs again.
        changes = {"PYTHONHASHSEED": seed, "MPLCONFIGDIR": str(folder / "cache")}
        command = [sys.executable, "-W", "error", "-c", code]
        subprocess.run(command, cwd=folder, env={**os.environ, **changes}, check=True)
        found.append([(folder / f"paper.{end}").read_bytes() for end in ("pdf", "svg", "png")])
    assert found[0] == found[1]
