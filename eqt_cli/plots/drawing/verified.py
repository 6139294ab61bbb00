"""What the verification of a result found, as figures need it; it must not know how it is drawn."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from eqt_cli.analysis.certificates import Row, Verdict
from eqt_cli.plots.drawing.ensembles import Ensemble, ensembles, error
from eqt_cli.plots.drawing.labels import notation
from eqt_cli.store.reader import Results

_DECIDED = (Verdict.HOLDS, Verdict.FAILS)


class Verified:
    """Certificates that have a number and a bound: those of identities and of trajectories.

    Parameters
    ----------
    results
        The open result.
    rows
        What was found about it.
    figure
        Name of the figure, for messages.
    chosen
        Labels of the controllers to show; all if empty.

    Attributes
    ----------
    names : list of str
        Of the certificates, in the paper's order.
    laws : list of Ensemble
        The controllers.

    Raises
    ------
    EqtError
        If the result is a sweep, there is no such controller, or there are no certificates.
    """

    def __init__(
        self, results: Results, rows: Sequence[Row], figure: str, chosen: Sequence[str] = ()
    ) -> None:
        self.laws: list[Ensemble] = ensembles([results], figure, chosen)
        labels = ["", *(law.label for law in self.laws)]
        judged = [row for row in rows if row.kind != "hypothesis" and row.controller in labels]
        self._shown = [row for row in judged if _has_place(row)]
        self._left_out = [row for row in judged if row not in self._shown]
        if not self._shown:
            raise error(results, figure, "finds no certificate to show; see `eqt verify`")
        self.names = list(dict.fromkeys(row.name for row in self._shown))

    def rows(self, name: str) -> list[Row]:
        """The rows of a certificate, one per law where it is about laws."""
        return [row for row in self._shown if row.name == name]

    def notes(self) -> list[str]:
        """What was checked and has no number."""
        return list(self._notes())

    def _notes(self) -> Iterator[str]:
        open_ends = [str(row.verdict) for row in self._shown if row.verdict not in _DECIDED]
        if open_ends:
            yield f"Hollow markers: {', '.join(dict.fromkeys(open_ends))}."
        if any(row.verdict is Verdict.FAILS for row in self._shown):
            yield "Crosses: fails."
        for row in self._left_out:
            law = f" ({row.controller})" if row.controller else ""
            yield f"{notation(row.name)}{law}: {row.verdict}."


def _has_place(row: Row) -> bool:
    """Whether it has a ratio of measured to bound; 0 over 0, an exact equality, counts as 0."""
    if row.measured is None or row.bound is None:
        return False
    return row.bound != 0 or row.measured == 0
