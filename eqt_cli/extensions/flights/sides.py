"""Which flights are of which side, and which belong together: files, folders, and lists."""

from collections import Counter
from collections.abc import Sequence
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

from eqt_cli.api.loading import path_from
from eqt_cli.base.errors import EqtError
from eqt_cli.extensions.flights.every_look import MOST_IN_A_BLOCK
from eqt_cli.extensions.flights.judging import Sizes
from eqt_cli.extensions.logs.flight_list import ListedFlight, is_list, read_list, recordings_in


class Sides(NamedTuple):
    """The flights of A and of B.

    Attributes
    ----------
    flights
        Of both sides, in order.
    paired
        Whether they belong together in pairs, or in blocks.
    blocks
        Numbers of flights of A and of B in each block; empty if they do not belong together.
    places
        Rows of a list, from 0, in which they stand; empty for files.
    note
        Which side is which, where that was not said.
    """

    flights: list[list[ListedFlight]]
    paired: bool = False
    blocks: Sizes = ()
    places: Sequence[Sequence[int]] = ()
    note: str = ""


def listed_in(path: Any) -> list[ListedFlight]:
    """Return a recording, or those in a folder that is no bag, or in a list."""
    folder = path_from("paths", path)
    if is_list(folder):
        return read_list(folder)
    is_one = not folder.is_dir() or (folder / "metadata.yaml").exists()
    return [ListedFlight(file) for file in ([folder] if is_one else recordings_in(folder))]


def sides_for(
    paths: Sequence[Any],
    against: Sequence[Any],
    *,
    law: str,
    pair: bool,
    within: str,
    sequential: bool,
) -> Sides:
    """Return the flights of both sides: of a list, of two folders, or of files.

    Two folders of which nothing says which is which are those before a change and after it.
    """
    first = [path_from("paths", path) for path in paths[:2]]
    if first and is_list(first[0]):
        return sides_of_a_list(first[0], paths, law, against, pair, sequential)
    are_folders = all(x.is_dir() and not (x / "metadata.yaml").exists() for x in first)
    if against or within or len(paths) != 2 or not are_folders:
        return sides_of(paths, against, pair)
    before, after = first
    return sides_of([after], [before], pair)._replace(
        note=f"A: {after}, flown after B: {before}; --against names B in another order"
    )


def sides_of(paths: Sequence[Any], against: Sequence[Any], pair: bool) -> Sides:
    """Return the flights of files and folders.

    Raises
    ------
    EqtError
        If pairs are not complete, or not in one order.
    """
    sides = [[x for path in some for x in listed_in(path)] for some in (paths, against)]
    a, b = ([x.file.name for x in side] for side in sides)
    if pair and (len(a) != len(b) or ({*a} & {*b} and a != b)):
        got = f"{', '.join(a)} and {', '.join(b)}"
        raise EqtError(f"pair: expected as many files of both sides, in one order; got {got}")
    return Sides(sides, pair, ((1, 1),) * min(len(a), len(b)))


def sides_of_a_list(
    path: Path, paths: Sequence[Any], law: str, against: Sequence[Any], pair: bool, several: bool
) -> Sides:
    """Return the flights of two laws of a list, in the order of its rows, or of its pairs.

    Parameters
    ----------
    several
        Whether a pair may have several flights of a law, a block. Blocks are in the order in which
        they became complete, pairs in that of A.

    Raises
    ------
    EqtError
        If the laws are not clear, or a pair is not complete.
    """
    flights = read_list(path)
    laws = [*dict.fromkeys(x.law for x in flights if x.law)]
    names = ", ".join(laws) or "none; write it into its column law"
    if len(paths) > 1:
        raise EqtError(f"{path}: a list of flights stands alone; got {len(paths)} files")
    wanted = [f"{x}" for x in against]
    if len(wanted) != 1 or wanted[0] not in laws:
        got = ", ".join(wanted) or "none"
        raise EqtError(f"against: expected a law of {path} ({names}), got {got}")
    others = [x for x in laws if x != wanted[0]]
    if not law and len(others) != 1:
        raise EqtError(f"law: name the law of A; {path} has {names}")
    if (law or others[0]) not in others:
        raise EqtError(f"law: expected another law of {path} ({', '.join(others)}), got {law}")
    sides = [[x for x in flights if x.law == one] for one in (law or others[0], wanted[0])]
    in_pairs = [bool(x.pair) for side in sides for x in side]
    if pair or all(in_pairs) or (several and any(in_pairs)):
        return _in_blocks(sides, flights, several)
    places = [[flights.index(x) for x in side] for side in sides]
    return Sides(sides, False, ((1, 1),) * min(map(len, sides)), places)


def _in_blocks(
    sides: list[list[ListedFlight]], flights: list[ListedFlight], several: bool
) -> Sides:
    """Return the flights of both laws in the order of their pairs or blocks."""
    for side, other in (sides, sides[::-1]):
        counts, there = Counter(x.pair for x in side), {x.pair for x in other}
        for x in side:
            if not x.pair or (counts[x.pair] > 1 and not several) or x.pair not in there:
                one = "flights" if several else "one flight"
                and_one = "and" if several else "and one"
                why = f"expected {one} of law {other[0].law} {and_one} of {x.law} in a pair"
                raise EqtError(f"{x.place}: pair: {why}, got '{x.pair}'; empty the column of all")
    last = {x.pair: k for k, x in enumerate(flights) if x in sides[0] or x in sides[1]}
    order = (
        sorted(last, key=last.__getitem__)
        if several
        else [*dict.fromkeys(x.pair for x in sides[0])]
    )
    a, b = ([[x for x in side if x.pair == pair] for pair in order] for side in sides)
    blocks = tuple((len(x), len(y)) for x, y in zip(a, b, strict=True))
    for pair, size in zip(order, blocks, strict=True):
        if sum(size) > MOST_IN_A_BLOCK:
            raise EqtError(
                f"pair: '{pair}' has {sum(size)} flights; expected {MOST_IN_A_BLOCK} at most"
            )
    return Sides([[*chain(*a)], [*chain(*b)]], True, blocks)
