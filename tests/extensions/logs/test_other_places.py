"""Tables as spreadsheets of other places write them are read where they have one meaning."""

import pytest

from eqt_cli.base.errors import EqtError, InputError
from eqt_cli.extensions.logs.tables import text_of_recording

PLAIN = "t,qx,qw\n0.1,-0.017452,0.999848\n0.25,1e-3,1\n"
GERMAN = PLAIN.replace(",", ";").replace(".", ",")


def read(path):
    return text_of_recording(path, "", EqtError, 10_000, "")


@pytest.mark.parametrize(
    "raw",
    [
        PLAIN.replace(",", ";").encode(),
        PLAIN.replace(",", "\t").encode(),
        GERMAN.encode(),
        GERMAN.replace(";", "\t").replace("\n", "\r\n").encode(),
        f"sep=;\n{GERMAN}".encode(),
        f'"sep=;"\r\n{GERMAN}'.encode(),
        f"sep=,\n{PLAIN}".encode(),
        f"\ufeff{GERMAN}".encode(),
        PLAIN.encode("utf-16"),
        GERMAN.encode("utf-16"),
        "\ufeff".encode("utf-16-be") + GERMAN.encode("utf-16-be"),
    ],
)
def test_a_table_of_another_place(tmp_path, raw):
    path = tmp_path / "log.csv"
    path.write_bytes(raw)
    text = read(path).lstrip("\ufeff")
    assert text.lstrip("\n") == PLAIN
    assert text.startswith("\n") == (b"sep=" in raw)  # lines keep their numbers


@pytest.mark.parametrize(
    "text", ["x;y\n1,234;5,678\n", "x;y\n0,5;0.25\n", "x;y\n1.234,5;2\n", "x;y\n1,234,567;2\n"]
)
def test_commas_of_two_meanings_are_told_with_the_remedy(tmp_path, text):
    path = tmp_path / "log.csv"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="save the table with decimal points"):
        read(path)
