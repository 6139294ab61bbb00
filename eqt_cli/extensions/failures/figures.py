"""Figure `failures`: bad runs among the others, over the two numbers that tell most."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, ClassVar

from matplotlib.axes import Axes
from matplotlib.figure import Figure as Drawing
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from eqt_cli.extensions.failures.causes import BadRuns, Candidate, Cause, of_result
from eqt_cli.extensions.failures.views import answer
from eqt_cli.figures.figure import Figure
from eqt_cli.figures.labels import free_text, in_words
from eqt_cli.figures.layout import add_legend, add_title, blank_sheet, open_frame, rows_of
from eqt_cli.figures.shown import Ensemble, ShownControllers
from eqt_cli.figures.style import Width, ink, line_style
from eqt_cli.results.result import Result

_COLUMNS: dict[Width, int] = {"column": 2, "page": 3, "slide": 4}
_HEIGHTS: dict[Width, float] = {"column": 1.9, "page": 2.2, "slide": 2.6}
_CHARACTERS: dict[Width, int] = {"column": 22, "page": 30, "slide": 24}
"""Most characters in a line of the label of an axis."""
_MOST: dict[Width, int] = {"column": 6, "page": 9, "slide": 12}
"""Most laws with a panel, so that the figure fits a page with its caption."""


class ShownFailures(ShownControllers):
    """The bad runs of each law, and what tells them from the others.

    Attributes
    ----------
    answers
        Bad runs and causes of each law, in the order of `ensembles`.
    """

    answers: list[tuple[BadRuns, list[Cause]]]

    def notes(self) -> list[str]:
        """Return what tells the bad runs from the others, of each law where something does."""
        (result,) = self.results
        telling = [x for x in self.answers if any(row.telling for row in x[1])]
        return [f"{answer(result, law, rows)}." for law, rows in telling] + self.remarks


@dataclass(frozen=True)
class Failures(Figure[ShownFailures]):
    """Where laws fail: each run over the two numbers that tell bad runs from the others most.

    Bad runs are those that failed or did not settle; where these are fewer than five, the worst
    tenth. The numbers are those that were drawn for a run, and the errors at its start. A dotted
    line is where the first of them parts bad runs from the others best, if the rank test finds it.
    Of more laws than fit a page, those with the least p are drawn.

    Attributes
    ----------
    x, y
        The numbers on the axes, such as plant.inertia.relative. Default: those that tell most.
    """

    name: ClassVar[str] = "failures"

    x: str = ""
    y: str = ""

    def subject(self, results: Sequence[Result], measured: Any) -> ShownFailures:
        """Return the bad runs of the laws of one result."""
        result = self._only(results, "result")
        shown = ShownFailures([result], self.name, self.chosen)
        laws = [ensemble.law for ensemble in shown.ensembles]
        shown.answers = of_result(result, laws, f"figure '{self.name}'")
        return shown

    def compose(self, shown: ShownFailures, width: Width) -> Drawing:
        """Draw a panel for each law."""
        laws = self._shown_laws(shown, _MOST[width])
        mosaic = rows_of([law.label for law in laws], min(len(laws), _COLUMNS[width]))
        drawing, panels = blank_sheet(width, mosaic, _HEIGHTS[width])
        answers = zip(shown.ensembles, shown.answers, strict=True)
        for ensemble, (law, rows) in [(e, of) for e, of in answers if e in laws]:
            panel = panels[ensemble.label]
            if len(laws) > 1:
                add_title(panel, ensemble.title)
            self._fill(panel, shown, ensemble, law, rows, _CHARACTERS[width])
        look: dict[str, Any] = {"linestyle": "none", "color": ink()}
        handles = [Line2D([], [], marker="x", **look), Line2D([], [], marker=".", **look)]
        bad = " or ".join(dict.fromkeys(law.words for law, _ in shown.answers))
        add_legend(drawing, handles, [bad, "other runs"])
        return drawing

    def _shown_laws(self, shown: ShownFailures, most: int) -> list[Ensemble]:
        """Return the laws whose bad runs are told best, if there are too many for a page."""
        laws, which = shown.ensembles, "with the least p"
        if len(laws) <= most:
            return laws
        least = {
            e.label: min((row.p_value for row in rows), default=1.0)
            for e, (_, rows) in zip(laws, shown.answers, strict=True)
        }
        best = sorted(laws, key=lambda e: least[e.label])[:most]
        left_out = ", ".join(e.title for e in laws if e not in best)
        shown.remarks.append(f"The {most} laws {which}; no room for {left_out}.")
        shown.note = f"{most} of {len(laws)} laws, {which}"
        return [e for e in laws if e in best]

    def _fill(
        self,
        panel: Axes,
        shown: ShownFailures,
        ensemble: Ensemble,
        law: BadRuns,
        rows: Sequence[Cause],
        characters: int,
    ) -> None:
        """Draw the runs of a law."""
        candidates = {row.candidate.name: row.candidate for row in rows}
        for option, name in (("x", self.x), ("y", self.y)):
            if name and name not in candidates:
                raise shown.error(
                    f"{option}: no number '{name}'; there are: {', '.join(candidates)}"
                )
        wanted = [name for name in (self.x, self.y) if name]
        free = (name for name in candidates if name not in wanted)
        names = [self.x or next(free, ""), self.y or next(free, "")]
        axes = [candidates[name] for name in names if name]
        first = axes[0]
        # One number alone is drawn over the number of the run.
        second = axes[1] if len(axes) > 1 else Candidate("run", "1", shown.results[0]["run"])
        colour = line_style(ensemble.look)["color"]
        for runs, mark, tint, size in ((law.others, ".", ink(0.35), 3), (law.bad, "x", colour, 4)):
            panel.plot(
                first.values[runs],
                second.values[runs],
                mark,
                color=tint,
                markersize=size,
                label=f"{ensemble.label}, {'bad runs' if mark == 'x' else 'others'}",
            )
        row = next(row for row in rows if row.candidate is first)
        if row.telling and row.way in ("high", "low"):
            name = f"{ensemble.label}, cut"
            panel.axvline(row.cut, linestyle=":", color=colour, linewidth=1, label=name)
        panel.margins(0.05)
        panel.set_xlabel(_label(first, characters))
        panel.set_ylabel(_label(second, characters))
        panel.xaxis.set_major_locator(MaxNLocator(nbins=3, steps=[1, 2, 5, 10]))
        open_frame(panel)


def _label(candidate: Candidate, characters: int) -> str:
    words = free_text(candidate.name, characters)
    if candidate.unit in ("", "1"):
        return words
    label = in_words(words, candidate.unit)
    is_long = len(words.split("\n")[-1]) + len(candidate.unit) + 3 > characters
    return label.replace(" $(", "\n$(") if is_long else label
