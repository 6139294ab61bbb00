"""Whose curve one is, as far as its look depends on it; it knows no colour and no Matplotlib."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Look:
    """On what the look of a curve depends.

    Attributes
    ----------
    index
        The controller's position, or the curve's place in the figure.
    pair
        The positions of its colour and its dashes, where these mean two different things.
    pairs
        How many colours and dashes the figure needs for that.
    """

    index: int
    pair: tuple[int, int] = (0, 0)
    pairs: tuple[int, int] = (0, 0)
