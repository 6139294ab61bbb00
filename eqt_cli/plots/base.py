"""What a figure is; it knows no single figure and no file format."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, ClassVar

from eqt_cli.plots.good_runs import GoodRuns
from eqt_cli.store.reader import Results

if TYPE_CHECKING:
    from matplotlib.figure import Figure as Drawing

    from eqt_cli.plots.style import Width


@dataclass(frozen=True)
class Figure(ABC):
    """A picture of a result: a frozen dataclass whose fields are its options.

    Attributes
    ----------
    name
        As written after ``--figure``, and of the files.
    controllers
        Labels of the controllers to show; all if empty.
    """

    name: ClassVar[str]
    sweeps: ClassVar[bool] = False
    """Whether it draws sweeps, and not single experiments."""
    # Read by pydantic when options are given: no other keys, no silent conversions.
    __pydantic_config__: ClassVar[dict[str, Any]] = {"extra": "forbid", "strict": True}

    controllers: Sequence[str] = ()

    def draw(self, results: Results, width: Width = "column") -> Drawing:
        """Draw the good runs of a result.

        Parameters
        ----------
        results
            Open; it may be closed afterwards.
        width
            One ``column`` of a journal (3.5 in) or the ``page`` (7.16 in).

        Raises
        ------
        EqtError
            If the result lacks what the figure shows.
        """
        from eqt_cli.plots.layout import add_remarks, freeze
        from eqt_cli.plots.style import house_style

        runs = GoodRuns(results, self.name, self.controllers)
        with house_style():
            drawing = self.compose(runs, width)
            add_remarks(drawing, runs.notes())
            freeze(drawing)
        return drawing

    @abstractmethod
    def compose(self, runs: GoodRuns, width: Width) -> Drawing:
        """Draw panels and legend, within the style sheet; `draw` adds the remarks."""
