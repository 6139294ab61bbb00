"""What a result says where it is not known whether its samples are too far apart."""

from __future__ import annotations

from collections.abc import Iterator

from eqt_cli.base import purposes
from eqt_cli.base.store_reader import ResultFile

UNJUDGED_ROWS = "unjudged_rows"
"""Attribute of a result with the sentence."""


@purposes.remarks_on_a_result
def remarks(result: ResultFile) -> Iterator[str]:
    """Yield the sentence, if there is one."""
    if text := result.attributes.get(UNJUDGED_ROWS):
        yield str(text)
