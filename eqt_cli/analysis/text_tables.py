"""Text tables: blocks of rows under a header, independent of contents and output formats."""

import re
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

_UNIT = r"(?:%|\(N m\)² s|N m\b|(?:deg|rad|kg|1|N|J|m|s)\b(?:/s)?)"

WORD = re.compile(
    r"(?:‖[^‖]*‖|\|\|[^|]*\|\||∫.*? dt|\[[-−+\d.e, ]{1,40}\]|p = \d|N m\b|\(N m\)² s"
    rf"|(?<=[\d\]]) {_UNIT}|(?<=\w) − (?=\w)|\S)+"
)
"""A piece of a text that stays on one line: a word, a norm, two laws, a number with its unit."""


def words(text: str) -> list[str]:
    """Return the pieces of a text between which a line may be broken."""
    return WORD.findall(text)


def listed(words: Sequence[str]) -> str:
    """Join words: ``a, b and c``."""
    return " and ".join(filter(None, [", ".join(words[:-1]), words[-1]]))


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
        Name of the table, for options and files.
    caption
        Sentence that describes the content.
    header
        Headings of the columns.
    blocks
        Blocks of rows.
    notes
        Notes below the table.
    spare
        Headings of columns that a narrow display may leave out, the least important first.
    keys
        Number of leading columns that identify a row.
    """

    name: str
    caption: str
    header: list[str]
    blocks: list[Block]
    notes: list[str] = field(default_factory=list)
    spare: tuple[str, ...] = ()
    keys: int = 1

    def of_columns(self, columns: Sequence[int]) -> "TextTable":
        """Some of its columns, by position."""

        def those(row: Sequence[str]) -> list[str]:
            return [row[k] for k in columns]

        blocks = [Block(block.title, list(map(those, block.rows))) for block in self.blocks]
        return replace(self, header=those(self.header), blocks=blocks)

    def without(self, headings: Sequence[str]) -> "TextTable":
        """Return the table without some columns, and without the notes that explain them."""
        kept = [k for k, heading in enumerate(self.header) if heading not in headings]
        return replace(self.of_columns(kept), notes=self.notes_without(headings))

    def notes_without(self, headings: Sequence[str]) -> list[str]:
        """Return the notes but those that explain one of these columns: ``d: mean over …``."""
        return [note for note in self.notes if note.partition(":")[0] not in headings]

    def narrow(self, most: int) -> "list[TextTable]":
        """Return the table split into tables of at most so many columns.

        Spare columns are left out first. Each table repeats the first columns.
        """
        kept = list(range(len(self.header)))
        for heading in self.spare:
            if len(kept) > most and heading in self.header:
                kept.remove(self.header.index(heading))
        keys, others = kept[: self.keys], kept[self.keys :]
        room = max(1, most - len(keys))
        parts = [others[k : k + room] for k in range(0, len(others), room)] or [[]]
        made = [self.of_columns([*keys, *part]) for part in parts]
        return [replace(table, notes=[]) for table in made[:-1]] + made[-1:]

    @property
    def rows(self) -> list[list[str]]:
        """Rows of all blocks."""
        return [row for block in self.blocks for row in block.rows]
