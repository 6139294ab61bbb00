"""Certificates with a measured number and a bound."""

from collections.abc import Sequence

from eqt_cli.analysis.certificates.base import Row, Verdict
from eqt_cli.plots.drawing.labels import notation
from eqt_cli.plots.shown.controllers import ALL, Chosen, ShownControllers, error_of
from eqt_cli.results.result import Result


class ShownCertificates:
    """Certificates with a measured number and a bound: identities and trajectories.

    Parameters
    ----------
    results
        The open result.
    rows
        The verdicts on it.
    figure, chosen
        See `ShownControllers`.

    Attributes
    ----------
    shown : list of Row
        The certificates.
    names : list of str
        Names of the certificates, in the paper's order.
    laws : list of Ensemble
        The controllers.

    Raises
    ------
    EqtError
        In the cases of `ShownControllers`, or if there are no certificates.
    """

    def __init__(
        self, results: Result, rows: Sequence[Row], figure: str, chosen: Chosen = ALL
    ) -> None:
        self.laws = ShownControllers([results], figure, chosen).ensembles
        labels = ["", *(law.label for law in self.laws)]
        judged = [row for row in rows if row.kind != "hypothesis" and row.controller in labels]
        self.shown = [row for row in judged if _has_place(row)]
        self._left_out = [row for row in judged if row not in self.shown]
        if not self.shown:
            raise error_of(results, figure, "finds no certificate to show; see `eqt verify`")
        self._told: list[str] = []
        self.names = list(dict.fromkeys(row.name for row in self.shown))

    def keep(self, names: Sequence[str]) -> None:
        """Show only these certificates, in the paper's order, and note how many there were."""
        if len(names) < len(self.names):
            shown = f"The {len(names)} of {len(self.names)} statements"
            self._told = [f"{shown} that come nearest to their bounds, or beyond."]
        self.names = [name for name in self.names if name in names]
        self.shown = [row for row in self.shown if row.name in names]

    def rows(self, name: str) -> list[Row]:
        """Return the rows of a certificate, one per law where it is about laws."""
        return [row for row in self.shown if row.name == name]

    @property
    def verdicts(self) -> list[Verdict]:
        """Verdicts of the rows that are shown, in the order of `Verdict`."""
        return [verdict for verdict in Verdict if verdict in {row.verdict for row in self.shown}]

    def notes(self) -> list[str]:
        """Return the notes on the figure: what was checked and has no number."""
        notes = list(self._told)
        for row in self._left_out:
            law = f" ({row.controller})" if row.controller else ""
            why = f", {row.remark}" if row.remark else ""
            notes.append(f"{notation(row.name)}{law}: {row.verdict}{why}.")
        return notes


def _has_place(row: Row) -> bool:
    """Whether a row has a ratio of measured to bound; 0/0, an exact equality, counts as 0."""
    if row.measured is None or row.bound is None:
        return False
    return row.bound != 0 or row.measured == 0
