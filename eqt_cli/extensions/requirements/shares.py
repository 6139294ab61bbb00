r"""Whether a share is at least as large as required, and how sure, whatever the distribution.

Of n independent runs, of which f do not keep a bound, f is binomial. The required share s is *met*
where f or fewer would have a probability of at most α at the share s (and, as at any smaller one,
at most that), and *failed* where f or more would: one-sided exact tests (Clopper and Pearson,
Biometrika 26, 1934). For a result that is looked at while it grows, the level is spent over the
planned looks in equal parts, with what earlier looks could not spend since counts are whole numbers
(Slud and Wei, JASA 77, 1982); the boundaries are exact, by the distribution of the counts that were
undecided before.

The mean of shares of time, one number in [0, 1] a run, is tested by betting (Waudby-Smith and
Ramdas, J. R. Statist. Soc. B 86, 2024, section 4): where the mean is at most s, the capital
∏ (1 + λ (xᵢ − s)) has a mean of at most 1 at any time, and exceeds 1/α at some time with a
probability of at most α (Ville). So its words hold at every look.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

import numpy as np

from eqt_cli.base.arrays import Array

Word = Literal["meets", "fails", "not shown"]

MOST_RUNS, MOST_TIMES = 10**6, 30
"""Runs beyond which a number that would do is not told, and times the present number."""

_NEAR = np.array([0.999, 0.97, 0.9, 0.75, 0.5, 0.25])
"""Parts of the largest bet on a share above the required one, which loses all at a share of 0."""

_WEIGHTS = np.array([0.5, 0.1, 0.1, 0.1, 0.1, 0.1])
"""Parts of the capital for each; half for the one that is best where no run fails."""


class Statement(NamedTuple):
    """What a number of runs shows of a share.

    Attributes
    ----------
    word
        Whether it is at least as large as required.
    low, high
        One-sided bounds of the share, each at the confidence.
    needed
        The number of runs, all told, that would show it if no further one failed; 0 where it is
        shown, or where that many are beyond `MOST_RUNS` or fail too often.
    """

    word: Word
    low: float
    high: float
    needed: int = 0


def share_of_runs(
    keeps: Array,
    possible: Array,
    share: float,
    level: float,
    earlier: Sequence[int] = (),
    planned: int = 1,
) -> Statement:
    """State whether runs keep a bound in at least a share of all runs.

    Parameters
    ----------
    keeps, possible : (runs,)
        Whether a run keeps the bound for sure, and whether it may do so.
    share
        The required share, between 0 and 1.
    level
        The largest probability of a false *meets*, and of a false *fails*.
    earlier
        Numbers of runs at earlier looks, which are the first ones.
    planned
        The number of looks that were planned.
    """
    n, bad = len(keeps), 1 - share
    looks = [*sorted({m for m in earlier if m < n}), n]
    words: list[Word] = []
    for number, m in enumerate(looks, 1):
        lost, gone = (m - int(np.count_nonzero(x[:m])) for x in (keeps, possible))
        met = lost <= boundary(looks[:number], bad, level, planned)
        failed = gone >= boundary(looks[:number], bad, level, planned, above=True)
        words.append("meets" if met else "fails" if failed else "not shown")
    lost, gone = (n - int(np.count_nonzero(x)) for x in (keeps, possible))
    # The first look that decides counts, unless the runs since then speak against it.
    word: Word = next((word for word in words if word != "not shown"), "not shown")
    part = level / planned
    low, high = 1 - _upper(lost, n, part), _upper(n - gone, n, part)
    if (word == "meets" and low < share - 1e-12) or (word == "fails" and high > share + 1e-12):
        word = words[-1]
    if word != "not shown" or (lost >= bad * n and gone >= bad * n):
        return Statement(word, low, high)
    return Statement(word, low, high, _needed(looks, lost, bad, level, planned))


def boundary(
    looks: Sequence[int], bad: float, level: float, planned: int = 1, *, above: bool = False
) -> int:
    """Return the number of failures up to which, or from which on, the last look decides.

    Parameters
    ----------
    looks
        Rising numbers of runs; none of the earlier looks decided.
    bad
        The share of failures at which a decision would be false.
    above
        Whether so many failures or more decide; else so many or fewer, where -1 is none.
    """
    alive, first, before, spent, edge = np.ones(1), 0, 0, 0.0, -1
    for number, n in enumerate(looks, 1):
        more, start = _binomial(n - before, bad)
        alive, first = np.convolve(alive, more), first + start
        allowed = level * min(number, planned) / planned - spent
        order = alive[::-1] if above else alive
        summed = np.cumsum(order)
        count = int(np.searchsorted(summed, allowed * (1 + 1e-12), side="right"))
        spent += float(summed[count - 1]) if count else 0.0
        if above:
            edge = first + len(alive) - count
            alive = alive[: len(alive) - count]
        else:
            edge = first + count - 1 if count or first else -1
            alive, first = alive[count:], first + count
        if not len(alive):
            alive = np.zeros(1)
        before = n
    return edge


def _binomial(n: int, p: float) -> tuple[Array, int]:
    """Return probabilities of counts from a first one on, and this one."""
    from scipy.special import gammaln, xlog1py, xlogy

    most = 12 * np.sqrt(n * p * (1 - p)) + 80  # beyond it, less than 1e-30
    k = np.arange(max(0, np.floor(n * p - most)), min(n, np.ceil(n * p + most)) + 1)
    logs = gammaln(n + 1.0) - gammaln(k + 1) - gammaln(n - k + 1) + xlogy(k, p) + xlog1py(n - k, -p)
    return np.exp(logs), int(k[0])


def _upper(failures: int, n: int, level: float) -> float:
    """Return the one-sided upper bound of Clopper and Pearson."""
    from scipy.special import betaincinv

    return 1.0 if failures >= n else float(betaincinv(failures + 1, n - failures, 1 - level))


def _needed(looks: Sequence[int], lost: int, bad: float, level: float, planned: int) -> int:
    """Return the number of runs that would do at the next look, if none of the others fails."""
    return least(lambda n: lost <= boundary([*looks, n], bad, level, planned), looks[-1] + 1)


def least(shows: Callable[[int], bool], first: int) -> int:
    """Return the least number from a first one on at which a rising condition holds; 0 if none."""
    low, high = first - 1, first
    while not shows(high):
        if high > min(MOST_RUNS, MOST_TIMES * first):
            return 0
        low, high = high, 2 * high
    while high - low > 1:
        middle = (low + high) // 2
        low, high = (low, middle) if shows(middle) else (middle, high)
    return high


def share_of_time(shares: Array, possible: Array, share: float, level: float) -> Statement:
    """State whether the mean over runs of shares of time is at least as large as required.

    Parameters
    ----------
    shares, possible : (runs,)
        The share of the time in which a run keeps the bound for sure, and in which it may do so.
    share, level
        As `share_of_runs` has them.
    """
    need = np.log(1 / level)
    met = _capital(shares, share) >= need
    failed = _capital(1 - possible, 1 - share) >= need
    word: Word = "meets" if met else "fails" if failed else "not shown"
    low = _largest(lambda s: _capital(shares, s) >= need)
    high = 1 - _largest(lambda s: _capital(1 - possible, s) >= need)
    # Bounds of all looks together may leave the mean of the last one outside.
    low, high = min(low, float(shares.mean())), max(high, float(possible.mean()))
    n, mean, needed = len(shares), float(shares.mean()), 0
    if word == "not shown" and mean > share:
        needed = least(lambda m: _capital(np.resize(shares, m), share) >= need, n + 1)
    return Statement(word, low, high, needed)


def _capital(x: Array, mean: float) -> float:
    """Return the log of the largest capital of bets that the mean of x is above another one."""
    bets = _NEAR / mean if mean > 0.5 else np.append(2.0 ** np.arange(-2, 30), 0.0)
    bets = np.minimum(bets, 0.999 / mean)
    bets = np.unique(bets[bets > 0])[::-1]
    weights = _WEIGHTS if mean > 0.5 else np.full(len(bets), 1 / len(bets))
    grown = np.cumsum(np.log1p(bets[:, None] * (x - mean)), axis=1) + np.log(weights)[:, None]
    return float(np.logaddexp.reduce(grown, axis=0).max(initial=-np.inf))


def _largest(shown: Callable[[float], bool]) -> float:
    """Return the largest share that is shown, to 1e-6; 0 if none is."""
    low, high = 0.0, 1.0
    while high - low > 1e-6:
        middle = (low + high) / 2
        low, high = (middle, high) if shown(middle) else (low, middle)
    return low
