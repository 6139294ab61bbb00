"""What a figure is, and of what; it knows no single figure and no file format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Protocol, TypeVar

from eqt_cli.analysis.certificates import Row
from eqt_cli.core.registry import Registry
from eqt_cli.plots.drawing.ensembles import error
from eqt_cli.plots.drawing.good_metrics import GoodMetrics
from eqt_cli.plots.drawing.good_runs import GoodRuns
from eqt_cli.plots.drawing.swept import Swept
from eqt_cli.plots.drawing.verified import Verified
from eqt_cli.store.reader import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from eqt_cli.plots.drawing.style import Style, Width


class Subject(Protocol):
    """What of results a figure shows."""

    def notes(self) -> list[str]:
        """What a reader must know of what is not shown."""


S = TypeVar("S", bound=Subject)


@dataclass(frozen=True)
class Figure(ABC, Generic[S]):
    """A picture of results: a frozen dataclass whose fields are its options.

    Attributes
    ----------
    name
        As written after ``--figure``, and of the files.
    controllers
        Labels of the controllers to show; all if empty.
    """

    name: ClassVar[str]
    # Read by pydantic when options are given: no other keys, no silent conversions.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    controllers: Sequence[str] = ()

    def draw(
        self,
        results: Sequence[Results],
        width: Width = "column",
        *,
        style: Style | None = None,
        certificates: Sequence[Row] = (),
    ) -> Drawing:
        """Draw what `subject` takes from results, with remarks on what it leaves out.

        Parameters
        ----------
        results
            Open; they may be closed afterwards.
        width
            One ``column`` of a journal (3.5 in) or the ``page`` (7.16 in).
        style
            The look; eqt's own if None.
        certificates
            What the verification of the results found; figures of runs and sweeps need none.

        Raises
        ------
        EqtError
            If the results lack what the figure shows, or it cannot be drawn in this style.
        """
        from eqt_cli.plots.drawing.layout import add_remarks, freeze
        from eqt_cli.plots.drawing.style import HOUSE, house_style

        shown = self.subject(results, certificates)
        with house_style(style or HOUSE):
            drawing = self.compose(shown, width)
            add_remarks(drawing, shown.notes())
            freeze(drawing)
        return drawing

    @abstractmethod
    def subject(self, results: Sequence[Results], certificates: Sequence[Row]) -> S:
        """What of the results is shown."""

    @abstractmethod
    def compose(self, shown: S, width: Width) -> Drawing:
        """Draw panels and legend, within the style sheet; `draw` adds the remarks."""


@dataclass(frozen=True)
class OverTime(Figure[GoodRuns]):
    """A figure of trajectories, of one result or several."""

    def subject(self, results: Sequence[Results], certificates: Sequence[Row]) -> GoodRuns:
        """The runs that did not fail."""
        return GoodRuns(results, self.name, self.controllers)


@dataclass(frozen=True)
class OfMetrics(Figure[GoodMetrics]):
    """A figure of metrics of single runs, of one result or several; it needs no trajectories.

    Attributes
    ----------
    metrics
        What is shown, by names in the result; if empty, a choice of what it holds.
    """

    metrics: Sequence[str] = ()

    def subject(self, results: Sequence[Results], certificates: Sequence[Row]) -> GoodMetrics:
        """The runs that did not fail, and what was measured of each."""
        return GoodMetrics(results, self.name, self.controllers, self.metrics)


@dataclass(frozen=True)
class OfSweep(Figure[Swept]):
    """A figure of the metrics of one sweep."""

    def subject(self, results: Sequence[Results], certificates: Sequence[Row]) -> Swept:
        """The points and what was measured at each."""
        if len(results) > 1:
            raise error(results[1], self.name, "shows one sweep at a time")
        return Swept(results[0], self.name, self.controllers)


@dataclass(frozen=True)
class OfCertificates(Figure[Verified]):
    """A figure of what the verification of one result found."""

    def subject(self, results: Sequence[Results], certificates: Sequence[Row]) -> Verified:
        """The certificates that have a number and a bound."""
        if len(results) > 1:
            raise error(results[1], self.name, "shows one result at a time")
        return Verified(results[0], certificates, self.name, self.controllers)


# Beside the base class, so that a plugin that imports one is known to the other.
figures = Registry("figure", "eqt_cli.plots.figures", Figure, "eqt.plots")
