"""The looks at flights that grow in number, kept beside the answer: a second one is told."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pydantic import TypeAdapter, ValidationError

from eqt_cli.base.errors import OTHER_FOLDER, EqtError
from eqt_cli.base.files import read_record, refusals, write_record
from eqt_cli.extensions.flights.flights import FlightComparison, content_of_option
from eqt_cli.extensions.flights.judging import Design

FILE, MOST = "looks.json", 1_000
"""File of the output folder with the looks, and of how many: the last ones."""


@dataclass(frozen=True)
class Look:
    """A comparison that somebody saw.

    Attributes
    ----------
    how
        All options of the numbers of flights; of files, their content.
    every_look
        Whether its answer holds at every look.
    A, B
        The flights of both sides, as digest and file.
    words
        What it said, by the quantity.
    """

    how: dict[str, str]
    every_look: bool
    A: list[tuple[str, str]]
    B: list[tuple[str, str]]
    words: dict[str, str]

    @property
    def digests(self) -> list[list[str]]:
        """The flights of both sides."""
        return [[digest for digest, _ in side] for side in (self.A, self.B)]

    def repeats(self, other: "Look") -> bool:
        """Whether it is at the same flights, in the same way, for the same quantities."""
        one, two = ((x.how, x.every_look, x.digests, [*x.words]) for x in (self, other))
        return one == two

    def shares(self, other: "Look") -> bool:
        """Whether it has a flight of the other one."""
        return any({*x} & {*y} for x, y in zip(self.digests, other.digests, strict=True))


def kept_looks(
    folder: Path, comparison: FlightComparison, how: Mapping[str, Any], design: Design
) -> list[str]:
    """Add a look to those in a folder, and say what the earlier ones mean for its words.

    Raises
    ------
    EqtError
        If the file is not eqt's, or the answer is for every look, and a flight of an earlier look
        is left out or stands elsewhere.
    """
    file, looks = folder / FILE, list[Look]()
    if file.exists():
        with refusals(file, "read", OTHER_FOLDER):
            if (record := read_record(file, "looks")) is None:
                raise ValueError("eqt did not write it")
            try:
                looks = TypeAdapter(list[Look]).validate_python(record["looks"])
            except ValidationError as error:
                raise ValueError("its looks are not of the shape that eqt writes") from error
    of_side = {
        side: [(flight.digest, flight.file) for flight in comparison.flights if flight.side == side]
        for side in "AB"
    }
    options = {name: content_of_option(x) for name, x in how.items()}
    words = {one.metric: f"{one}" for one in comparison.pairs}
    look = Look(options, design.blocks is not None, of_side["A"], of_side["B"], words)
    others = [one for one in looks if not one.repeats(look)]
    lines = [*_remarks(file, [one for one in others if one.shares(look)], look)]
    with refusals(file, "written", OTHER_FOLDER):
        folder.mkdir(parents=True, exist_ok=True)
        write_record(file, {"looks": [asdict(one) for one in [*others, look][-MOST:]]})
    return lines


def _remarks(file: Path, earlier: Sequence[Look], look: Look) -> Iterator[str]:
    """Say how many looks there were before, or refuse flights in another order."""
    if not earlier:
        return
    number = len(earlier) + 1
    if look.every_look:
        for k, one in enumerate(earlier, 1):
            for side, flights, now in zip("AB", (one.A, one.B), look.digests, strict=True):
                for place, (digest, name) in enumerate(flights):
                    if now[place : place + 1] != [digest]:
                        needs = "all flights of earlier looks, in the order flown"
                        raise EqtError(
                            f"{file}: {name} was flight {place + 1} of {side} at look {k}, and is "
                            f"not now; an answer that holds at every look needs {needs}",
                            OTHER_FOLDER,
                        )
        yield f"look {number} at these flights: p and interval hold at every look"
        return
    sizes = ", ".join(f"{len(one.A)} and {len(one.B)}" for one in earlier[-5:])
    yield (
        f"look {number}, after looks at {sizes} flights: looks until flights differ find "
        "differences that do not exist (11 % with looks at 5 to 10 of each); use --sequential"
    )
    if any(one.how != look.how for one in earlier):
        yield "errors were measured in another way before (--of, --period, --begin, …): choose one"
