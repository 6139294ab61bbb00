"""Reproducible files of drawings, equal byte for byte; it knows no result."""

import logging
import os
import re
from collections.abc import Iterable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from hashlib import sha256
from io import BytesIO
from string import ascii_uppercase
from typing import Any, Literal

from matplotlib import rc_context, rcParams
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.version import __version__
from eqt_cli.plots.drawing.style import ENLARGED, HOUSE, Style, house_style

Format = Literal["pdf", "svg", "png"]

_DATE = "SOURCE_DATE_EPOCH"

_SIZE = re.compile(rb'(?<= )(width|height)="([0-9.]+)pt"')
"""Width or height in an SVG file; those of the whole picture come first."""

_MAKER = f"eqt {__version__}"


def encode(
    drawing: Drawing, format: Format, title: str = "", description: str = "", style: Style = HOUSE
) -> bytes:
    """Return the content of a file of a drawing, in its style; its panels are frozen already.

    The content holds no date and no random name.
    """
    buffer = BytesIO()
    times = ENLARGED[style.width]
    more: dict[str, Any] = {"metadata": _metadata(format, title, description)}
    pdf = _steady_names_of_fonts() if format == "pdf" else nullcontext()
    larger = _larger_pages(times) if format == "pdf" else nullcontext()
    with house_style(style), _arranged(), _quiet_font_tools(), pdf, larger, _without_date():
        drawing.set_layout_engine(None)
        if format == "png":
            dots = drawing.dpi if rcParams["savefig.dpi"] == "figure" else rcParams["savefig.dpi"]
            more |= {"dpi": times * dots, "pil_kwargs": {"dpi": (dots, dots)}}
        drawing.savefig(buffer, format=format, **more)
    return _enlarged(buffer.getvalue(), times) if format == "svg" else buffer.getvalue()


def _arranged() -> AbstractContextManager[None]:
    """Switch off the layout of the style, for which Matplotlib draws everything twice."""
    return rc_context({"figure.constrained_layout.use": False})


def _enlarged(svg: bytes, times: float) -> bytes:
    """Return the picture enlarged by a factor."""
    return _SIZE.sub(lambda size: b'%s="%gpt"' % (size[1], times * float(size[2])), svg, count=2)


@contextmanager
def _replaced(owner: Any, name: str, by: Any) -> Iterator[None]:
    """Replace an attribute within a block."""
    own = vars(owner)[name]  # static methods as they are
    setattr(owner, name, by)
    try:
        yield
    finally:
        setattr(owner, name, own)


def _larger_pages(times: float) -> AbstractContextManager[None]:
    """Enlarge the pages of PDF files by a factor, with all that is on them."""
    from matplotlib.backends.backend_pdf import Op, PdfFile  # slow to import

    own: Any = PdfFile.newPage

    def new_page(self: Any, width: float, height: float) -> None:
        own(self, times * width, times * height)
        self.output(times, 0, 0, times, 0, 0, Op.concat_matrix)

    return _replaced(PdfFile, "newPage", new_page) if times != 1 else nullcontext()


@contextmanager
def _without_date() -> Iterator[None]:
    """Hide the build date variable, which Matplotlib reads even if a file is to hold no date."""
    given = os.environ.pop(_DATE, None)
    try:
        yield
    finally:
        if given is not None:
            os.environ[_DATE] = given


@contextmanager
def _quiet_font_tools() -> Iterator[None]:
    """Silence remarks on the dates inside of Matplotlib's own fonts."""
    log = logging.getLogger("fontTools")
    level = log.level
    log.setLevel(logging.ERROR)
    try:
        yield
    finally:
        log.setLevel(level)


def _steady_names_of_fonts() -> AbstractContextManager[None]:
    """Name the subsets of fonts in PDF files after their content.

    For fonts of TeX, Matplotlib uses Python's hash, which differs between processes.
    """
    from matplotlib.backends.backend_pdf import PdfFile  # slow to import

    def prefix(glyphs: Iterable[object]) -> str:
        digest = sha256(" ".join(sorted(map(str, glyphs))).encode()).digest()
        return "".join(ascii_uppercase[byte % 26] for byte in digest[:6]) + "+"

    name = "_get_subset_prefix"
    if name not in vars(PdfFile):  # Matplotlib before 3.10 embeds fonts of TeX whole
        return nullcontext()
    return _replaced(PdfFile, name, staticmethod(prefix))


def _metadata(format: Format, title: str, description: str) -> dict[str, str | None]:
    title, description = _printable(title), _printable(description)
    if format == "pdf":
        return {"Title": title, "Subject": description, "Creator": _MAKER, "CreationDate": None}
    if format == "svg":
        return {"Title": title, "Description": description, "Creator": _MAKER, "Date": None}
    return {"Title": title, "Description": description, "Software": _MAKER}


def _printable(text: str) -> str:
    """Return text without control characters, which XML cannot hold."""
    return "".join(character if character.isprintable() else " " for character in text)
