"""Base classes of figures, by the data of a result that they show."""

from abc import abstractmethod
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import ClassVar, Generic, NamedTuple, Protocol, TypeVar, cast

from matplotlib.figure import Figure as Drawing

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.core.errors import EqtError, Problems, suggestion
from eqt_cli.core.option_types import Count, validated
from eqt_cli.core.registry import Component, Registry, blamed
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.logs.recording import Recording
from eqt_cli.plots.drawing.layout import add_letters, add_remarks, freeze
from eqt_cli.plots.drawing.style import HOUSE, Style, Width, house_style
from eqt_cli.plots.shown.certificates import ShownCertificates
from eqt_cli.plots.shown.controllers import Chosen, TimeRange
from eqt_cli.plots.shown.metrics import ShownMetrics
from eqt_cli.plots.shown.reference import ShownReference
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.plots.shown.trajectories import ShownRuns
from eqt_cli.results.result import Result


class Extras(NamedTuple):
    """Data that figures show beside results.

    Attributes
    ----------
    certificates
        Verdicts of the verification of the results.
    measured
        A recording on the group of the results.
    """

    certificates: Sequence[Row] = ()
    measured: Recording | None = None


NO_EXTRAS = Extras()


class Subject(Protocol):
    """Data of results that a figure shows."""

    def notes(self) -> list[str]:
        """Return the notes for the reader about data that is not shown."""


S = TypeVar("S", bound=Subject)

_TYPED = str.maketrans({"ω": "w"})
"""Letters in names of panels, and how users type them."""


@dataclass(frozen=True)
class Figure(Component, Generic[S]):
    """A picture of results: a frozen dataclass whose fields are its options.

    Attributes
    ----------
    name
        Name after ``--figure`` and of the files.
    controllers
        Labels of the controllers to show; all if empty.
    focus
        Controllers in colour, with the others in grey; the first six laws if empty.
    colours
        Colours by controller, as Matplotlib names them; those of the style for the others.
    """

    needs_runs: ClassVar[bool] = True
    """Whether the figure shows results, and not an experiment that has not been run."""

    controllers: Sequence[str] = ()
    focus: Sequence[str] = ()
    colours: Mapping[str, str] = field(default_factory=dict)

    def draw(
        self,
        results: Sequence[Result | Experiment],
        width: Width = "column",
        *,
        style: Style | None = None,
        extras: Extras = NO_EXTRAS,
        arranged: bool = True,
        captions: list[str] | None = None,
    ) -> Drawing:
        """Draw the data that `subject` takes from results, with remarks on what it leaves out.

        Parameters
        ----------
        results
            Open results; they may be closed afterwards. A figure without runs takes an experiment.
        width
            One ``column`` of a journal (3.5 in), the ``page`` (7.16 in) or a ``slide`` (13.3 in).
        style
            Style of the figure; eqt's own if None.
        extras
            Data that some figures show beside the results.
        arranged
            Whether to arrange the panels. The numbers behind the curves do not need it, and it
            takes half of the time.
        captions
            List that receives the remarks; they go below the panels if None.

        Raises
        ------
        EqtError
            If an option is invalid, the results lack what the figure shows, or it cannot be drawn
            in this style.
        """
        problems = Problems(lambda path: f"figure '{self.name}'")
        validated(type(self), vars(self), problems)
        self.check(problems)
        problems.raise_if_any()
        for one in results if self.needs_runs else ():
            if isinstance(one, Experiment):
                others = [name for name in figures.names() if not figures.get(name).needs_runs]
                raise EqtError(
                    f"{one.source.path}: figure '{self.name}' shows results, and this is a "
                    f"configuration; run it first, or draw what needs no run: {', '.join(others)}"
                )
        with house_style(replace(style or HOUSE, width=width)):
            shown = self.subject(cast(Sequence[Result], results), extras)
            with blamed():
                drawing = self.compose(shown, width)
            add_letters(drawing)
            if captions is None:
                add_remarks(drawing, shown.notes())
            else:
                captions += shown.notes()
            if arranged:
                freeze(drawing)
        return drawing

    def check(self, problems: Problems) -> None:
        """Add problems of the options that their types cannot exclude."""

    @property
    def chosen(self) -> Chosen:
        """Selection of controllers and their colours."""
        return Chosen(self.controllers, self.focus, colours=self.colours)

    def _only(self, results: Sequence[Result], what: str) -> Result:
        """Return the only result; refuse several."""
        if len(results) > 1:
            raise results[1].error(f"figure '{self.name}' shows one {what} at a time")
        return results[0]

    @abstractmethod
    def subject(self, results: Sequence[Result], extras: Extras) -> S:
        """Return the data of the results that is shown."""

    @abstractmethod
    def compose(self, shown: S, width: Width) -> Drawing:
        """Draw panels and legend, within the style sheet; `draw` adds the remarks."""


@dataclass(frozen=True)
class Timed(Figure[S]):
    """A figure over time.

    Attributes
    ----------
    start, end
        Range of time that is drawn, s; all by default.
    """

    start: float | None = None
    end: float | None = None

    @property
    def chosen(self) -> Chosen:
        """Selection of controllers, colours and range of time."""
        return super().chosen._replace(time=TimeRange(self.start, self.end))


@dataclass(frozen=True)
class Panelled:
    """Mixin of figures whose panels can be chosen.

    Attributes
    ----------
    panels
        Panels to draw, by name; all if empty.
    """

    name: ClassVar[str]

    panels: Sequence[str] = ()

    def picked(self, known: Sequence[str]) -> list[str]:
        """Return the names of the panels to draw, in their order.

        Raises
        ------
        EqtError
            If there is no panel of a chosen name.
        """
        plain = {each.translate(_TYPED): each for each in known}
        wanted = [plain.get(each.translate(_TYPED), "") for each in self.panels]
        for each, chosen in zip(self.panels, wanted, strict=True):
            if not chosen:
                hint = suggestion(each, list(plain)) or f"; there are: {', '.join(plain)}"
                raise EqtError(f"figure '{self.name}': panels: no panel '{each}'{hint}")
        return [each for each in known if not wanted or each in wanted]


@dataclass(frozen=True)
class OverTime(Timed[ShownRuns]):
    """A figure of trajectories, of one result or several."""

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownRuns:
        """Return the runs that did not fail."""
        return ShownRuns(results, self.name, self.chosen)


@dataclass(frozen=True)
class OfFirstRuns(OverTime):
    """A figure of single runs as paths with their starts, ends and directions, before a density.

    Attributes
    ----------
    runs
        Most runs of each controller that are drawn, from the first.
    density
        Shade where all runs pass.
    """

    runs: Count = 5
    density: bool = True


@dataclass(frozen=True)
class OfMetrics(Figure[ShownMetrics]):
    """A figure of metrics of single runs, of one result or several; it needs no trajectories.

    Attributes
    ----------
    metrics
        Metrics to show, by names in the result; a selection of those it holds if empty.
    """

    metrics: Sequence[str] = ()

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownMetrics:
        """Return the metrics of the runs that did not fail."""
        return ShownMetrics(results, self.name, self.chosen, self.metrics)


@dataclass(frozen=True)
class OfSweep(Figure[ShownSweep]):
    """A figure of the metrics of one sweep."""

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownSweep:
        """Return the points and the metrics at each."""
        return ShownSweep(self._only(results, "sweep"), self.name, self.chosen)


@dataclass(frozen=True)
class OfOneMetric(OfSweep):
    """A figure of one metric of a sweep.

    Attributes
    ----------
    metric
        Metric to show, by its name in the result; by default the mean pose error, of the first part
        where parts have different units.
    """

    metric: str = ""

    def metric_of(self, swept: ShownSweep) -> str:
        """Return the name of the metric that is shown."""
        return self.metric or swept.of_one_unit("mean_pose_error")


@dataclass(frozen=True)
class OfDifferences(OfOneMetric):
    """A figure of differences between laws in one metric of a sweep.

    Attributes
    ----------
    confidence
        Confidence of each interval on its own; of a map, 1 minus the allowed share of false wins.
    """

    confidence: float = 0.95

    def check(self, problems: Problems) -> None:
        """Require a confidence between 0 and 1."""
        if not 0 < self.confidence < 1:
            expected = "expected a number between 0 and 1"
            problems.at("confidence").add(f"{expected}, got {self.confidence:g}")


@dataclass(frozen=True)
class OfSettled(OfSweep):
    """A figure of the share of runs that settle.

    Attributes
    ----------
    by
        Time by which a run must have settled for good, s; its end if 0.
    """

    by: float = 0.0

    def check(self, problems: Problems) -> None:
        """Require a time of 0 or more."""
        if not self.by >= 0:
            problems.at("by").add(f"expected a time of 0 s or more, got {self.by:g}")


@dataclass(frozen=True)
class OfCertificates(Figure[ShownCertificates]):
    """A figure of the verification of one result."""

    def subject(self, results: Sequence[Result], extras: Extras) -> ShownCertificates:
        """Return the certificates with a measured number and a bound."""
        shown = self._only(results, "result")
        return ShownCertificates(shown, extras.certificates, self.name, self.chosen)


@dataclass(frozen=True)
class OfReference(Timed[ShownReference]):
    """A figure of the desired motion, of one result or of an experiment before it is run."""

    needs_runs: ClassVar[bool] = False

    def subject(self, results: Sequence[Result | Experiment], extras: Extras) -> ShownReference:
        """Return the reference in the chosen range of time."""
        if len(results) > 1:
            raise EqtError(f"figure '{self.name}' shows one reference at a time")
        return ShownReference(results[0], self.name, self.chosen)


# In this module, so that a plugin that imports the base class is registered here.
figures = Registry("figure", "eqt_cli.plots.figures", Figure, "eqt.plots")
