"""Reproducible files of drawings, equal byte for byte; it knows no result."""

import logging
import os
import re
from collections.abc import Iterable, Iterator, Mapping
from contextlib import AbstractContextManager, contextmanager, nullcontext
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from string import ascii_uppercase
from typing import Any, Literal

from matplotlib import rc_context, rcParams
from matplotlib.figure import Figure as Drawing

from eqt_cli.core.errors import OTHER_FOLDER, EqtError, Remedy
from eqt_cli.core.files import refusals
from eqt_cli.core.own_files import check_within, is_eqts
from eqt_cli.core.replacement import replace_file
from eqt_cli.core.version import __version__
from eqt_cli.plots.drawing.style import ENLARGED, HOUSE, Style, house_style

Format = Literal["pdf", "svg", "png"]

_DATE = "SOURCE_DATE_EPOCH"

_SIZE = re.compile(rb'(?<= )(width|height)="([0-9.]+)pt"')
"""Width or height in an SVG file; those of the whole picture come first."""

_MAKER = f"eqt {__version__}"


def encode(
    drawing: Drawing,
    format: Format,
    title: str = "",
    description: str = "",
    style: Style = HOUSE,
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


def check_targets(paths: Iterable[Path], home: Path) -> None:
    """Refuse, before the work, to write where it would fail or replace what is not eqt's.

    Parameters
    ----------
    home
        Folder below which no link is followed.

    Raises
    ------
    EqtError
        If a path is a folder, a link or a file that eqt did not write, or its parent is no folder
        that can be written to.
    """
    for path in paths:
        with refusals(path, "written", OTHER_FOLDER):
            if path.is_dir():
                example = path / "report.html"
                raise EqtError(f"{path}: is a folder; expected a file, such as {example}")
            check_within(home, path)
            if path.exists() and not is_eqts(path):
                raise EqtError(
                    f"{path}: exists, and is no figure or page that eqt wrote",
                    Remedy("choose another place with {}", "out"),
                )
            folder = next(parent for parent in path.absolute().parents if parent.exists())
            if not folder.is_dir():
                raise NotADirectoryError("not a directory")
            if not os.access(folder, os.W_OK | os.X_OK):
                raise PermissionError("permission denied")


def write(contents: Mapping[Path, bytes], home: Path) -> None:
    """Write each file atomically; missing folders are made.

    Parameters
    ----------
    home
        Folder below which no link is followed.

    Raises
    ------
    EqtError
        If a folder or file cannot be written, or would replace what eqt did not write.
    """
    check_targets(contents, home)
    for path, content in contents.items():
        with refusals(path, "written", OTHER_FOLDER):
            path.parent.mkdir(parents=True, exist_ok=True)
            replace_file(path, content)


def _arranged() -> AbstractContextManager[None]:
    """Switch off the layout of the style, for which Matplotlib draws everything twice."""
    return rc_context({"figure.constrained_layout.use": False})


def _enlarged(svg: bytes, times: float) -> bytes:
    """Return the picture enlarged by a factor."""
    return _SIZE.sub(lambda size: b'%s="%gpt"' % (size[1], times * float(size[2])), svg, count=2)


@contextmanager
def _larger_pages(times: float) -> Iterator[None]:
    """Enlarge the pages of PDF files by a factor, with all that is on them."""
    from matplotlib.backends.backend_pdf import Op, PdfFile  # slow to import

    file: Any = PdfFile
    own = file.newPage

    def new_page(self: Any, width: float, height: float) -> None:
        own(self, times * width, times * height)
        self.output(times, 0, 0, times, 0, 0, Op.concat_matrix)

    if times != 1:
        file.newPage = new_page
    try:
        yield
    finally:
        file.newPage = own


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


@contextmanager
def _steady_names_of_fonts() -> Iterator[None]:
    """Name the subsets of fonts in PDF files after their content.

    For fonts of TeX, Matplotlib uses Python's hash, which differs between processes.
    """
    from matplotlib.backends.backend_pdf import PdfFile  # slow to import

    file: Any = PdfFile
    own = getattr(file, "_get_subset_prefix", None)
    if own is None:  # Matplotlib before 3.10 embeds fonts of TeX whole
        yield
        return

    def prefix(glyphs: Iterable[object]) -> str:
        digest = sha256(" ".join(sorted(map(str, glyphs))).encode()).digest()
        return "".join(ascii_uppercase[byte % 26] for byte in digest[:6]) + "+"

    file._get_subset_prefix = staticmethod(prefix)
    try:
        yield
    finally:
        file._get_subset_prefix = staticmethod(own)


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
