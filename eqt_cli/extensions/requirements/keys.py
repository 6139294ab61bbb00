"""The keys of a configuration for requirements, and for windows of time by name."""

from typing import Annotated, Any, Literal

from pydantic import Field

from eqt_cli.base.option_types import Positive, Real, Unit
from eqt_cli.config.marks import WORDS, NotSwept, Section

Share = Annotated[float, Field(gt=0, lt=1)]


class NamedWindow(Section):
    """Times of the runs that have a name.

    Attributes
    ----------
    start, stop
        Where it begins and ends, s after the start of the runs; default: with the runs.
    """

    start: Annotated[Real, Unit("s")] = 0.0
    stop: Annotated[Positive | None, Unit("s")] = None


class Requirement(Section):
    """A bound that a law has to keep.

    Attributes
    ----------
    metric
        A metric, such as peak_attitude_error; a signal, such as attitude_angle; or delay_margin,
        gain_margin or gain_reduction of the linear loop.
    max, min
        The bound, with its unit: 0.05 deg. One of both.
    share
        The share of runs, of the time, or of both, in which it must be kept, such as 0.997; none
        for a margin.
    of
        What the share is of: ensemble (runs), temporal (the time of a run), mixed (both at random).
    of_runs
        Of a temporal requirement: the share of the runs of which it must hold.
    window
        The name of one of `windows`, or {start: 200 s, stop: 320 s}. Default: that of `measure`.
    relative
        An exposure, s: the error counts from its mean over each such time in the window. Only of
        attitude_angle.
    confidence
        How sure *meets* and *fails* are, each one-sided.
    looks
        How often a result that grows is going to be looked at; the level is spent over them.
    """

    metric: str
    max: Any = None
    min: Any = None
    share: Share | None = None
    of: Literal["ensemble", "temporal", "mixed"] = "ensemble"
    of_runs: Share | None = None
    window: str | NamedWindow | None = None
    relative: Annotated[Positive | None, Unit("s")] = None
    confidence: Annotated[float, Field(ge=0.5, lt=1)] = 0.95
    looks: Annotated[int, Field(strict=True, ge=1, le=100)] = 1


class Keys(Section):
    """Keys of requirements.

    Attributes
    ----------
    windows
        Windows of time by name, such as {slew: {stop: 90 s}, pointing: {start: 200 s}}.
    require
        Bounds that each law has to keep, and in which share of runs or of time.
    """

    windows: Annotated[dict[str, NamedWindow] | None, NotSwept("names times"), WORDS] = None
    require: Annotated[list[Requirement] | None, NotSwept("judges a result"), WORDS] = None
