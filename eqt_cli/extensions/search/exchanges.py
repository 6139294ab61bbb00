"""How often training samples exchange their best points, and when a search is finished."""

from collections.abc import Sequence

from eqt_cli.base.reporting import count_of

ROUNDS, MORE = 3, 40
"""How often the samples of a law exchange their best points at most, and how many points each of
them may try after an exchange. A budget below 60 has proportionally fewer, one above 100 a further
exchange for every 40 points."""

FEWEST_EXCHANGING = 3
"""Number of samples below which there is no exchange, since nothing is said of so few."""

SETTLED = 0.003
"""Largest gain of an exchange, as a share of the objective, after which there is no further one."""

FINISHED = 0.005
"""Largest gain of the last exchange, as a share of the objective, of a search that is finished:
half of what verdicts tell apart. What a search still misses was up to twice its last gain."""


def rounds_of(budget: int) -> int:
    """Return how often samples exchange their best points at most."""
    return ROUNDS + max(0, (budget - 100) // MORE)


def more_of(budget: int) -> int:
    """Return how many points a sample may try after an exchange."""
    return min(MORE, 2 * budget // 3)


def enough(numbers: int) -> int:
    """Return the budget at which searches for so many numbers were measured."""
    return 60 + 40 * max(0, numbers - 2)


def is_small(budget: int, numbers: int) -> bool:
    """Whether a budget is too small for a search to be called finished.

    On a wheel with two gains, laws that gained at most `FINISHED` in their last exchange missed
    more than that in 37 of 38 cases at budgets of 2 to 7, in 8 of 25 at 8 to 10, in 2 of 23 at 12
    and 16, and in none of 24 at 24 and 40.
    """
    return budget < enough(numbers) / 2


def larger(budget: int) -> int:
    """Return the least budget of a search that goes on where one with this budget ended."""
    return 100 + MORE * (rounds_of(budget) + 1 - ROUNDS)


NOT_FINISHED = "search not finished"
"""Said in place of a verdict on a law whose search has not ended near its best gains."""


def unfinished(gained: Sequence[float | None]) -> bool:
    """Whether some sample gained too much in the last exchange, or had none, which is None."""
    return any(share is None or not share <= FINISHED for share in gained)


def ending(title: str, gained: Sequence[float | None], budget: int, numbers: int) -> str:
    """Say how the search for a law ended on its samples, and what would go on; '' if finished."""
    if not unfinished(gained):
        return ""
    if is_small(budget, numbers):
        few = f"has too few points for {count_of(numbers, 'number')}"
        return f"{NOT_FINISHED}: {title} {few}; set tune.budget to {enough(numbers)}"
    shares = [share for share in gained if share is not None]
    largest = max(shares, default=0.0)
    what = f"gained {100 * largest:.1f} % in its last exchange between samples"
    if len(shares) < len(gained):
        what = "has gains on too few samples for an exchange between them"
    elif largest >= 1:
        what = "found its first gains that keep the bounds of a sample only in the last exchange"
    return f"{NOT_FINISHED}: {title} {what}; tune.budget: {larger(budget)} would go on"
