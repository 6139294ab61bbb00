"""The key of a configuration for the sliders of its page."""

from typing import Annotated, Any

from eqt_cli.config.marks import WORDS, NotSwept, Section


class Keys(Section):
    """The key of sliders.

    Attributes
    ----------
    live
        Keys that sliders of `eqt live` move, and their ranges: {gains.kp: [0.1, 10]}, with a step
        [0.1, 10, 0.05], or null for the usual range. Default: gains, inertia and the start.
    """

    live: Annotated[dict[str, Any] | None, NotSwept("moves keys in a page"), WORDS] = None
