"""The base classes of figures, by what of a result they show."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Generic, NamedTuple, Protocol, TypeVar, cast

from eqt_cli.analysis.certificates.base import Row
from eqt_cli.core.component import Component
from eqt_cli.core.error_origin import blamed
from eqt_cli.core.errors import EqtError, suggestion
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import Registry
from eqt_cli.experiment.experiment import Experiment
from eqt_cli.logs.recording import Recording
from eqt_cli.plots.drawing.layout import add_letters, add_remarks, freeze
from eqt_cli.plots.drawing.style import HOUSE, house_style
from eqt_cli.plots.shown.certificates import ShownCertificates
from eqt_cli.plots.shown.controllers import Chosen, TimeRange
from eqt_cli.plots.shown.fronts import ShownFronts
from eqt_cli.plots.shown.measured import ShownMeasured
from eqt_cli.plots.shown.metrics import ShownMetrics
from eqt_cli.plots.shown.reference import ShownReference
from eqt_cli.plots.shown.sweep import ShownSweep
from eqt_cli.plots.shown.trajectories import ShownRuns
from eqt_cli.plots.shown.worst import ShownWorst
from eqt_cli.results.result import Result

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from eqt_cli.plots.drawing.style import Style, Width


class Alongside(NamedTuple):
    """What figures show beside results.

    Attributes
    ----------
    certificates
        What the verification of the results found.
    measured
        A recording on their group.
    """

    certificates: Sequence[Row] = ()
    measured: Recording | None = None


NOTHING = Alongside()


class Subject(Protocol):
    """What of results a figure shows."""

    def notes(self) -> list[str]:
        """What a reader must know of what is not shown."""


S = TypeVar("S", bound=Subject)

_TYPED = str.maketrans({"ω": "w"})
"""How letters in names of panels are typed."""


@dataclass(frozen=True)
class Figure(Component, Generic[S]):
    """A picture of results: a frozen dataclass whose fields are its options.

    Attributes
    ----------
    name
        As written after ``--figure``, and of the files.
    controllers
        Labels of the controllers to show; all if empty.
    focus
        Those of them in colour, and the others in grey; the first six laws if empty.
    """

    needs_runs: ClassVar[bool] = True
    """Whether it shows results, and not an experiment that has not been run."""

    controllers: Sequence[str] = ()
    focus: Sequence[str] = ()

    def draw(
        self,
        results: Sequence[Result | Experiment],
        width: Width = "column",
        *,
        style: Style | None = None,
        alongside: Alongside = NOTHING,
        arranged: bool = True,
        captions: list[str] | None = None,
    ) -> Drawing:
        """Draw what `subject` takes from results, with remarks on what it leaves out.

        Parameters
        ----------
        results
            Open; they may be closed afterwards. A figure that needs no runs takes an experiment.
        width
            One ``column`` of a journal (3.5 in), the ``page`` (7.16 in) or a ``slide`` (13.3 in).
        style
            The look; eqt's own if None.
        alongside
            What some figures show beside the results.
        arranged
            Whether its panels have their places. The numbers behind its curves need none, and to
            find them takes half of the time.
        captions
            Where the remarks go; below the panels if None.

        Raises
        ------
        EqtError
            If an option will not do, the results lack what the figure shows, or it cannot be drawn
            in this style.
        """
        problems = Problems(lambda path: f"figure '{self.name}'")
        self.check(problems)
        problems.raise_if_any()
        if self.needs_runs:
            self._require_results(results)
        shown = self.subject(cast(Sequence[Result], results), alongside)
        with house_style(replace(style or HOUSE, width=width)):
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
        """Note what of the options will not do, as far as their types cannot say it."""

    @property
    def chosen(self) -> Chosen:
        """Which controllers are shown, and in which colours."""
        return Chosen(self.controllers, self.focus)

    def _require_results(self, results: Sequence[Result | Experiment]) -> None:
        for one in results:
            if isinstance(one, Experiment):
                others = [name for name in figures.names() if not figures.get(name).needs_runs]
                raise EqtError(
                    f"{one.source.path}: figure '{self.name}' shows results, and this is a "
                    f"configuration; run it first, or draw what needs no run: {', '.join(others)}"
                )

    def _only(self, results: Sequence[Result], what: str) -> Result:
        """The one result, which is all that such a figure shows."""
        if len(results) > 1:
            raise results[1].error(f"figure '{self.name}' shows one {what} at a time")
        return results[0]

    @abstractmethod
    def subject(self, results: Sequence[Result], alongside: Alongside) -> S:
        """What of the results is shown."""

    @abstractmethod
    def compose(self, shown: S, width: Width) -> Drawing:
        """Draw panels and legend, within the style sheet; `draw` adds the remarks."""


@dataclass(frozen=True)
class Timed(Figure[S]):
    """A figure over time.

    Attributes
    ----------
    start, end
        s, from when to when it is drawn; all that there is if not given.
    """

    start: float | None = None
    end: float | None = None

    @property
    def chosen(self) -> Chosen:
        """As of every figure, and of what times."""
        return super().chosen._replace(time=TimeRange(self.start, self.end))


@dataclass(frozen=True)
class Panelled:
    """What a figure has whose panels can be chosen.

    Attributes
    ----------
    panels
        Those to draw, by name; all if empty.
    """

    name: ClassVar[str]

    panels: Sequence[str] = ()

    def picked(self, known: Sequence[str]) -> list[str]:
        """The names of the panels to draw, in their order.

        Raises
        ------
        EqtError
            If there is none of a name.
        """
        plain = {each.translate(_TYPED): each for each in known}
        wanted = [plain.get(each.translate(_TYPED), "") for each in self.panels]
        for each, found in zip(self.panels, wanted, strict=True):
            if not found:
                hint = suggestion(each, list(plain)) or f"; there are: {', '.join(plain)}"
                raise EqtError(f"figure '{self.name}': panels: no panel '{each}'{hint}")
        return [each for each in known if not wanted or each in wanted]


@dataclass(frozen=True)
class OverTime(Timed[ShownRuns]):
    """A figure of trajectories, of one result or several."""

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownRuns:
        """The runs that did not fail."""
        return ShownRuns(results, self.name, self.chosen)


@dataclass(frozen=True)
class OfFirstRuns(OverTime):
    """A figure of single runs as paths with their starts, ends and directions, before a density.

    Attributes
    ----------
    runs
        How many runs of each controller are drawn at most, the first ones.
    density
        Shade where all runs pass.
    """

    runs: int = 5
    density: bool = True

    def check(self, problems: Problems) -> None:
        """At least one run is drawn."""
        if self.runs < 1:
            problems.at("runs").add(f"expected 1 or more, got {self.runs}")


@dataclass(frozen=True)
class OfMetrics(Figure[ShownMetrics]):
    """A figure of metrics of single runs, of one result or several; it needs no trajectories.

    Attributes
    ----------
    metrics
        What is shown, by names in the result; if empty, a choice of what it holds.
    """

    metrics: Sequence[str] = ()

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownMetrics:
        """The runs that did not fail, and what was measured of each."""
        return ShownMetrics(results, self.name, self.chosen, self.metrics)


@dataclass(frozen=True)
class OfSweep(Figure[ShownSweep]):
    """A figure of the metrics of one sweep."""

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownSweep:
        """The points and what was measured at each."""
        return ShownSweep(self._only(results, "sweep"), self.name, self.chosen)


@dataclass(frozen=True)
class OfOneMetric(OfSweep):
    """A figure of one metric of a sweep.

    Attributes
    ----------
    metric
        What is shown, by its name in the result; by default the mean pose error, of the first part
        where parts have units of their own.
    """

    metric: str = ""

    def metric_of(self, swept: ShownSweep) -> str:
        """The name of what is shown."""
        return self.metric or swept.of_one_unit("mean_pose_error")


@dataclass(frozen=True)
class OfCertificates(Figure[ShownCertificates]):
    """A figure of what the verification of one result found."""

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownCertificates:
        """The certificates that have a number and a bound."""
        shown = self._only(results, "result")
        return ShownCertificates(shown, alongside.certificates, self.name, self.chosen)


@dataclass(frozen=True)
class OfMeasured(Timed[ShownMeasured]):
    """A figure of a recording beside a run of one result.

    Attributes
    ----------
    run
        Which run, by its number.
    """

    run: int = 0

    def check(self, problems: Problems) -> None:
        """A run has a number from 0."""
        if self.run < 0:
            problems.at("run").add(f"expected 0 or more, got {self.run}")

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownMeasured:
        """The run of one controller, in time with the recording."""
        shown = self._only(results, "result")
        time = self.chosen.time
        return ShownMeasured(shown, alongside.measured, self.name, self.controllers, self.run, time)


@dataclass(frozen=True)
class OfReference(Timed[ShownReference]):
    """A figure of the desired motion, of one result or of an experiment before it is run."""

    needs_runs: ClassVar[bool] = False

    def subject(
        self, results: Sequence[Result | Experiment], alongside: Alongside
    ) -> ShownReference:
        """The reference over the whole horizon."""
        if len(results) > 1:
            raise EqtError(f"figure '{self.name}' shows one reference at a time")
        return ShownReference(results[0], self.name, self.chosen)


@dataclass(frozen=True)
class OfTuning(Figure[ShownFronts]):
    """A figure of what a search found, on its held-out runs."""

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownFronts:
        """The fronts of the laws."""
        return ShownFronts(self._only(results, "search"), self.name, self.chosen)


@dataclass(frozen=True)
class OfWorst(Figure[ShownWorst]):
    """A figure of what a search for the worst run found."""

    def subject(self, results: Sequence[Result], alongside: Alongside) -> ShownWorst:
        """The runs along each key."""
        return ShownWorst(self._only(results, "search"), self.name, self.chosen)


# Beside the base class, so that a plugin that imports one is known to the other.
figures = Registry("figure", "eqt_cli.plots.figures", Figure, "eqt.plots")
