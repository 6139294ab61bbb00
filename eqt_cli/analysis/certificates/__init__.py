"""Certificates: numerical checks of the theory. One file per topic, found by scanning."""

from collections.abc import Iterable
from typing import TypeVar

from eqt_cli.analysis.certificates.base import (
    Certificate,
    Hypothesis,
    Identity,
    Row,
    TrajectoryCheck,
)
from eqt_cli.analysis.certificates.base import LiteralForm as LiteralForm
from eqt_cli.analysis.certificates.base import Verdict as Verdict
from eqt_cli.analysis.evidence.runs import Runs, Setting
from eqt_cli.analysis.evidence.sample import Sample
from eqt_cli.core.registry import Registry
from eqt_cli.core.reporting import reporter, step

T = TypeVar("T")

certificates = Registry("certificate", __name__, Certificate)


CHECKED = "certificates checked"
"""Title of the step in which identities are checked."""


def identity_rows(
    common: Sample, laws: Iterable[Sample], cascades: Iterable[Sample] = ()
) -> list[Row]:
    """Check every identity: on each law or cascade or, if it concerns no law, on `common`."""
    laws, cascades, rows = list(laws), list(cascades), []
    due = [
        (certificate, sample)
        for certificate in _of_kind(Identity)
        for sample in (
            cascades if certificate.of_whole else laws if certificate.per_law else [common]
        )
        if certificate.applies(sample.loop)
    ]
    with step(CHECKED, len(due)):
        for certificate, sample in due:
            rows += certificate.check(sample)
            reporter().advance(1)
    return _in_order(rows)


def trajectory_rows(runs: Iterable[Runs]) -> list[Row]:
    """Check every statement about solutions on the runs of every law."""
    checks = _of_kind(TrajectoryCheck)
    rows = [check.check(each) for each in runs for check in checks if check.applies(each)]
    return _in_order(rows)


def hypothesis_rows(setting: Setting) -> list[Row]:
    """Check every hypothesis."""
    rows = [row for hypothesis in _of_kind(Hypothesis) for row in hypothesis.check(setting)]
    return _in_order(rows)


def _of_kind(kind: type[T]) -> list[T]:
    return [certificate() for certificate in certificates.all() if issubclass(certificate, kind)]


def _in_order(rows: list[Row]) -> list[Row]:
    """Sort rows by the paper's sections; laws keep their order."""
    sections = {each.name: (each.section, each.name) for each in certificates.all()}
    return sorted(rows, key=lambda row: sections[row.name])
