"""Fonts that were installed after Matplotlib made its list."""

import matplotlib
import pytest

from eqt_cli.base.errors import EqtError
from eqt_cli.figures import style

FONT = f"{matplotlib.get_data_path()}/fonts/ttf/DejaVuSans.ttf"


def test_a_font_that_is_newer_than_the_list_is_taken(monkeypatch):
    monkeypatch.setattr(style.fontManager, "ttflist", [])
    monkeypatch.setattr(style, "findSystemFonts", list)
    monkeypatch.setitem(style._PRESENT, "font.family", [])
    with pytest.raises(EqtError, match=r"no installed font has the letter ж"):
        style.give_letters(["ж"])
    monkeypatch.setattr(style, "findSystemFonts", lambda: [FONT])
    style.give_letters(["ж"])
    assert style._PRESENT["font.family"] == ["DejaVu Sans"]
