"""Writes the errata of arXiv 2511.18800 from the documentation: errata.md, and a letter to print.

``python docs/paper/errata.py`` writes errata.md; with ``--pdf``, also errata.pdf, one page of US
letter, which needs Chromium and the packages of the documentation.
"""

import re
import subprocess
import sys
import tempfile
from pathlib import Path

HERE = Path(__file__).resolve().parent
PAGE = HERE.parent / "explanation" / "paper.md"
FONT = HERE.parent / "_static" / "stix-two-math-subset.woff2"
SECTIONS = "Theorem 6.2: four corrections", "Theorem 3.2", "A Morse function", "Other errata"
HEAD = """# Errata of arXiv 2511.18800

M. Hampsey, P. van Goor, R. Banavar, R. Mahony: *Equivariant Tracking Control for Fully Actuated
Mechanical Systems on Matrix Lie Groups*, 2025. Found while the experiment of §7 was reproduced with
eqt, which supports three of its four claims, and the fourth in part.
"""
STYLE = """
@page { size: letter; margin: 14mm 16mm }
body { font: 9.6pt/1.3 "DejaVu Serif", serif }
@font-face { font-family: formulas; src: url("FONT") }
math { font-family: formulas, math; font-size: 11.5pt }
h1 { font-size: 14pt; margin: 0 } h2 { font-size: 10pt; margin: 1.6mm 0 .6mm }
p, ul { margin: .8mm 0 } ul { padding-left: 4mm } li { margin: .4mm 0 }
"""


def errata() -> str:
    """The sections of the page without their links, below the head."""
    page = PAGE.read_text(encoding="utf-8")
    parts = [page.partition(f"\n## {title}\n")[2].partition("\n## ")[0] for title in SECTIONS]
    assert all(parts)
    text = "".join(
        f"\n## {title}\n\n{part.strip()}\n" for title, part in zip(SECTIONS, parts, strict=True)
    )
    text = re.sub(r"\s\(\[computed\]\([^)]*\)\)", "", text)
    return HEAD + re.sub(r"\[([^]]+)\]\([^)]*\)", r"\1", text)


def html(text: str) -> str:
    """The same as a page of HTML with formulas in MathML."""
    from latex2mathml.converter import convert
    from markdown_it import MarkdownIt

    formulas: list[str] = []

    def kept(formula: re.Match[str]) -> str:
        formulas.append(convert(formula[1]))
        return f"@{len(formulas) - 1}@"

    body = MarkdownIt().render(re.sub(r"\$([^$]+)\$", kept, text))
    body = re.sub(r"@(\d+)@", lambda place: formulas[int(place[1])], body)
    style = STYLE.replace("FONT", FONT.as_uri())
    return f'<!doctype html><meta charset="utf-8"><style>{style}</style>{body}'


if __name__ == "__main__":
    (HERE / "errata.md").write_text(errata(), encoding="utf-8")
    if "--pdf" in sys.argv:
        with tempfile.TemporaryDirectory() as folder:
            page = Path(folder) / "errata.html"
            page.write_text(html(errata()), encoding="utf-8")
            browser = ["chromium", "--headless", "--no-sandbox", "--no-pdf-header-footer"]
            target = f"--print-to-pdf={HERE / 'errata.pdf'}"
            subprocess.run([*browser, target, page.as_uri()], check=True, capture_output=True)
