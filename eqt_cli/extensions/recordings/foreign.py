"""Names files of other programs by their first bytes, and says what reads them."""

import re
from contextlib import suppress
from pathlib import Path
from typing import Any

from eqt_cli.base import yaml_source
from eqt_cli.base.errors import InputError
from eqt_cli.base.files import open_regular


def require_text(path: Path) -> None:
    """Raise an `InputError` for a file that is known to be no table."""
    with suppress(OSError, ValueError), open_regular(path) as stream:  # whoever reads reports them
        begin = stream.read(512).decode("latin-1")
        table = Path(__file__).with_suffix(".yaml")
        data: Any = yaml_source.load(table.read_text("utf-8"), table.name).data
        for start, title, remedy in data["files"]:
            if re.match(start, begin, re.DOTALL):
                raise InputError(f"{path}: is {title}, not a table that eqt reads; {remedy}")
