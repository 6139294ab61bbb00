"""The figure of certificates: every number at its place, every verdict to be seen."""

import pytest
from said import error_of

from eqt_cli.analysis.certificates import Row, Verdict
from eqt_cli.figures.comparison_figures import Certificates
from eqt_cli.figures.figure import Extras

pytestmark = pytest.mark.usefixtures("unarranged")


def row(name, controller="", measured=1e-16, bound=1e-14, verdict=Verdict.HOLDS, kind="identity"):
    return Row(name, "Theorem 4.1", kind, controller, measured, bound, verdict)


ROWS = [
    row("equivariance"),
    row("rate of L", "eqt", 2e-16),
    row("rate of L", "gt", 3e-14, verdict=Verdict.FAILS),
    row("decrease of L", "eqt", 0.0, 1e-7, kind="trajectory"),
    row("Q → Q_d", "eqt", 0.3, 0.05, Verdict.UNDECIDED, "trajectory"),
    row("K_d is positive definite", measured=0.5, bound=0.0, kind="hypothesis"),
]


@pytest.fixture
def marks(so3, opened):
    """Every marker of the figure of `ROWS` by its name."""
    (axes,) = Certificates().draw([opened(so3)], extras=Extras(ROWS)).axes
    return {line.get_label(): line for line in axes.lines if len(line.get_xdata()) == 1}


def test_markers_are_at_what_was_measured_over_its_bound(marks):
    assert marks["equivariance"].get_xdata()[0] == 1e-16 / 1e-14
    assert marks["rate of L gt"].get_xdata()[0] == 3e-14 / 1e-14
    assert marks["Q → Q_d eqt"].get_xdata()[0] == 0.3 / 0.05


def test_hypotheses_have_no_marker(marks):
    assert len(marks) == 5


def test_an_exact_zero_is_left_of_all_others_and_named(so3, opened, marks):
    at = marks["decrease of L eqt"].get_xdata()[0]
    assert at < min(m.get_xdata()[0] for name, m in marks.items() if name != "decrease of L eqt")
    (axes,) = Certificates().draw([opened(so3)], extras=Extras(ROWS)).axes
    labels = {
        tick: text.get_text()
        for tick, text in zip(axes.get_xticks(), axes.get_xticklabels(), strict=True)
    }
    assert labels[at] == "0"


def test_equal_sides_that_allow_no_error_are_an_exact_zero(so3, opened):
    exact = row("rate of Ad_{Q_d⁻¹}", measured=0.0, bound=0.0)
    drawing = Certificates().draw([opened(so3)], extras=Extras([*ROWS, exact]))
    (axes,) = drawing.axes
    at = {line.get_label(): line.get_xdata()[0] for line in axes.lines}
    assert at[exact.name] == at["decrease of L eqt"]
    assert drawing.get_supxlabel() == ""


def test_verdicts_can_be_told_apart(marks):
    assert marks["rate of L gt"].get_marker() == "x"
    assert marks["Q → Q_d eqt"].get_markerfacecolor() == "#ffffff"
    assert marks["rate of L eqt"].get_markerfacecolor() != "#ffffff"


def test_each_verdict_of_a_measured_number_has_a_look_of_its_own(so3, opened):
    verdicts = [Verdict[name] for name in "HOLDS FAILS UNDECIDED UNCLAIMED NOT_COVERED".split()]
    rows = [row(f"statement {k}", "eqt", verdict=verdict) for k, verdict in enumerate(verdicts)]
    legend = Certificates().draw([opened(so3)], extras=Extras(rows)).legends[0]
    looks = {
        text.get_text(): (line.get_marker(), line.get_fillstyle(), line.get_markerfacecolor())
        for text, line in zip(legend.get_texts(), legend.get_lines(), strict=True)
    }
    assert len({looks[str(verdict)] for verdict in verdicts}) == len(verdicts)


def test_the_legend_says_what_the_markers_mean_and_remarks_what_has_none(so3, opened):
    undecidable = row("rate of Ad_{Q_d⁻¹}", "eqt", None, None, Verdict.UNDECIDED)
    drawing = Certificates().draw([opened(so3)], extras=Extras([*ROWS, undecidable]))
    names = [text.get_text() for text in drawing.legends[0].get_texts()]
    assert names[-3:] == ["holds", "FAILS", "undecided"]
    assert drawing.get_supxlabel().splitlines() == [
        r"rate of $\mathrm{Ad}_{Q_{\mathrm{d}}^{-1}}$ (eqt): undecided."
    ]


def test_one_law_may_be_chosen(so3, opened):
    (axes,) = Certificates(controllers=["gt"]).draw([opened(so3)], extras=Extras(ROWS)).axes
    names = [line.get_label() for line in axes.lines if len(line.get_xdata()) == 1]
    assert names == ["equivariance", "rate of L gt"]


def test_without_certificates_there_is_nothing_to_show(so3, opened):
    assert error_of(Certificates().draw, [opened(so3)]) == (
        f"{so3}: figure 'certificates' finds no certificate to show; see `eqt verify`"
    )
