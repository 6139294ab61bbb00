"""Tables of text: blocks of rows under a header; it knows neither contents nor output formats."""

from dataclasses import dataclass, field


@dataclass(frozen=True)
class Block:
    """Rows under a common heading, which may be empty."""

    title: str
    rows: list[list[str]]


@dataclass(frozen=True)
class TextTable:
    """A table.

    Attributes
    ----------
    name
        What it is called.
    caption
        What it shows, in a sentence.
    header
        One heading per column.
    blocks
        The rows.
    notes
        What a reader must know to read it.
    spare
        Headings of the columns that a narrow display leaves out, the least important first.
    keys
        How many of the first columns say what a row is about.
    """

    name: str
    caption: str
    header: list[str]
    blocks: list[Block]
    notes: list[str] = field(default_factory=list)
    spare: tuple[str, ...] = ()
    keys: int = 1

    @property
    def rows(self) -> list[list[str]]:
        """Those of all blocks."""
        return [row for block in self.blocks for row in block.rows]
