"""Matplotlib reads each formula once, and not once per renderer; it knows no formula."""

from collections.abc import Iterator, MutableMapping
from contextlib import contextmanager
from typing import Any

from matplotlib.mathtext import MathTextParser


@contextmanager
def read_once(known: MutableMapping[Any, Any]) -> Iterator[None]:
    """Let Matplotlib look formulas up in `known` before it reads them.

    Reading one takes longer than drawing it. Matplotlib keeps what it has read, but 50 formulas at
    most, and each renderer by itself.

    Parameters
    ----------
    known
        What was read under the same settings.
    """
    parser: Any = MathTextParser
    own = getattr(parser, "_parse_cached", None)
    if own is None:  # of another version: then it reads them as it does
        yield
        return

    uncached = getattr(own, "__wrapped__", own)

    def parsed(self: Any, *on: Any) -> Any:
        key = self._output_type, *on
        if key not in known:
            known[key] = uncached(self, *on)
        return known[key]

    parser._parse_cached = parsed
    try:
        yield
    finally:
        parser._parse_cached = own
