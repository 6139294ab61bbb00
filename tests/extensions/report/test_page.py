"""The page as a file: complete, small, safe, and the same whenever it is made."""

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

import eqt_cli
from eqt_cli.analysis.comparison import ClaimVerdict
from eqt_cli.api.loading import open_at
from eqt_cli.cli.tables import _STYLES
from eqt_cli.extensions.proofs.certificates import Row, Verdict, certificate_table
from eqt_cli.extensions.report.document import TEMPLATES, Wanted, _typeset, report
from eqt_cli.results.metrics import QUANTITIES

MEANS = ("early_torque", "mean_pose_error", "final_pose_error", "final_velocity_error")
HOSTILE = "</script><img src=x onerror=alert(1)>"


class Page(HTMLParser):
    """Identifiers, references and scripts of a page."""

    def __init__(self, text):
        super().__init__()
        self.ids, self.links, self.sources, self.tags = [], [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attributes):
        given = dict(attributes)
        self.tags.append(tag)
        self.ids += [given["id"]] if "id" in given else []
        self.links += [given["href"]] if tag in ("a", "use") else []
        self.sources += [given[name] for name in ("src", "data", "poster") if name in given]


@pytest.fixture(scope="module")
def text(page_of, paper_result):
    return page_of(paper_result, "paper", "distributions").read_text(encoding="utf-8")


@pytest.fixture(scope="module")
def page(text):
    return Page(text)


def test_page_loads_nothing(text, page):
    assert page.sources == []
    assert "link" not in page.tags and "iframe" not in page.tags
    assert "@import" not in text and "fetch(" not in text and "XMLHttpRequest" not in text
    assert "default-src 'none'" in text


def test_identifiers_are_unique_and_links_lead_somewhere(page):
    assert len(page.ids) == len(set(page.ids))
    assert all(link.startswith("#") and link[1:] in page.ids for link in page.links)


def test_parts_of_a_figure_are_named_within_it(text, page):
    assert set(re.findall(r"url\(#([\w-]+)\)", text)) - {*page.ids} == set()


@pytest.mark.ci("draws all figures")
def test_page_of_the_paper_stays_below_3_megabytes(page_of, paper_result):
    text = page_of(paper_result).read_text(encoding="utf-8")
    # The picker's curves grow with the runs, up to 1.4 MB; of the rest, a row per run of the table,
    # which takes some 100 bytes.
    curves = len(re.search(r'id="data-curves"[^>]*>(.*?)</script>', text, re.DOTALL)[1])
    assert len(text.encode()) - curves + 1_400_000 + 4 * 140 * 100 < 3_000_000


@pytest.mark.ci("draws all figures, twice")
@pytest.mark.usefixtures("unarranged")
def test_equal_results_give_equal_pages(paper_result):
    with open_at(paper_result) as results:
        assert report(results) == report(results)


def test_every_run_is_in_the_table(text):
    table = json.loads(re.search(r'id="data-runs"[^>]*>(.*?)</script>', text, re.DOTALL)[1])
    assert (len(table["rows"]), table["total"]) == (240, 240)
    shown = [column["metric"] for column in table["columns"]]
    assert shown == [metric.name for metric in QUANTITIES.values() if metric.name in shown]
    assert {"effort", "settling_time", "energy_residual"} <= set(shown)
    assert table["columns"][3] == {
        "metric": "early_torque",
        "name": "mean ‖τ‖, first 5 s",
        "unit": "N m",
        "better": "lower",
    }


def test_what_was_run_is_there_to_read(text):
    assert '<p class="facts">SO(3) · 4 laws · 60 runs of 20 s each · solve_ivp DOP853 · 20' in text
    assert "seed: 2025" in text and "<dt>python</dt>" in text


def test_the_answer_and_the_figure_come_first_and_the_claims_in_their_section(text):
    finding = "“the EqT control requires"
    order = ("<main", 'class="finding"', 'class="strip"', 'id="figure1"', 'id="experiment"')
    order += ('id="claims"', finding, 'id="answer-table"')
    places = [text.index(each) for each in order]
    assert places == sorted(places)


def test_the_first_screen_says_the_finding_and_draws_its_intervals(text, paper_result):
    screen = text[text.index("<main") : text.index('id="experiment"')]
    says = re.search(r'class="finding">(.*?)</p>', screen)[1].replace("\u00a0", " ")
    # Section 7 of the paper: GT tracks faster than EqT, which is superior to nog.
    assert re.match(r"Smaller mean attitude error than EqT: .*GT \(−.*Larger: nog \(\+", says)
    assert "<code>" not in screen and "--" not in re.sub("<!--|-->", "", screen)
    first = re.search(r'<table class="interval".*?</table>', screen, re.DOTALL)[0]
    rows = re.findall(r'<tr data-law="(\d)" .*?class="(\w+)">(.*?)</tr>', first, re.DOTALL)
    with open_at(paper_result) as results:
        error = results["mean_attitude_error"]
        labels = results.labels
    away = 100 * np.median(error / error[0] - 1, axis=1)
    assert [int(law) for law, _, _ in rows] == np.argsort(away).tolist()
    assert [word for law, word, _ in rows if labels[int(law)] in ("gt", "nog")] == [
        "better",
        "worse",
    ]
    # Of a dot, the place on the scale that its two ticks and the median give.
    dots = [float(re.search(r'class="dot" style="left:([\d.]+)%', row)[1]) for _, _, row in rows]
    ticks = re.findall(r'<span style="left:([\d.]+)%">([^<]+)<', first)
    places, values = np.array([(at, value.replace("−", "-")) for at, value in ticks], float).T
    assert dots == pytest.approx(np.interp(sorted(away), values, places), abs=0.3)


def test_a_law_is_better_or_worse_in_words_for_those_who_hear_the_page(text):
    answer = text[text.index('id="answer-table"') :].partition("</table>")[0]
    rows = re.findall(r"<tr>(.*?)</tr>", answer, re.DOTALL)
    assert " deg</td>".replace(" ", "\xa0") in rows[1]  # the means of EqT with their units
    # Section 7 of the paper: GT tracks faster than EqT, which is superior to nog.
    marks = [re.findall(r'aria-label="(\w+)"', row)[0] for row in rows[2:4]]
    assert marks == ["better", "worse"]


def test_the_first_screen_has_the_comment_of_the_configuration_and_no_command(text):
    opening = text[: text.index("<nav")]
    assert "<h1>The paper&#39;s experiment, section 7 and Figure 3</h1>" in opening
    assert "eqt 0.1.0" in opening and "eqt run" not in opening


def test_folders_of_the_author_are_nowhere(text, paper_result):
    assert "<dd>eqt run paper.yaml --set=ensemble.runs=60" in text
    assert str(Path(__file__).parents[3]) not in text
    assert str(paper_result.parent) not in text


def test_pairs_with_another_law_than_the_first_are_folded(text):
    section = text[text.index('<section id="comparison"') :].partition("</section>")[0]
    shown, folded = section.split('<details class="folded">')
    assert re.findall(r"(\w+) against (\w+),", shown) == [
        (law, "EqT") for law in ("GT", "nog", "asym")
    ]
    # Of four laws, 4 · 3/2 = 6 pairs.
    assert "The other 3 pairs" in folded
    assert len(re.findall(r"\w+ against \w+,", folded)) == 3


def test_claims_of_another_experiment_are_left_out(paper_result, monkeypatch):
    monkeypatch.setattr("eqt_cli.analysis.claims.Hampsey2025.experiment", {"group": "SE3"})
    with open_at(paper_result) as results:
        text = report(results, [])
    assert 'id="claims"' not in text and "Hampsey et al. (2025), section 7" not in text


@pytest.mark.parametrize(
    ("text", "page"),
    [
        ("rms of ‖p − p_d‖", "rms of ‖p\xa0−\xa0p<sub>d</sub>‖"),
        ("τ_ff of Ad_{Q_d} V_d", "τ<sub>ff</sub> of Ad<sub>Q<sub>d</sub></sub> V<sub>d</sub>"),
        (r"along $\tau_{x_{1}}$.", "along τ<sub>x<sub>1</sub></sub>."),
        ("`ensemble.runs` and gains.k_R", "<code>ensemble.runs</code> and gains.k_R"),
        ("from $5 to $6, settling_time", "from $5 to $6, settling_time"),
        ("−14 % [−15, −11]", "−14\xa0% [−15,\xa0−11]"),
        (r"$\lt b$ <b>", "&lt;b &lt;b&gt;"),
    ],
)
def test_symbols_and_keys_are_typeset(text, page):
    assert _typeset(text) == page


def test_where_all_runs_of_a_law_failed_the_page_says_so(make_result):
    nothing = [[1.0] * 6, [np.nan] * 6]
    metrics = dict.fromkeys((*MEANS, "energy_residual"), nothing)
    results = make_result(["eqt", "gt"], metrics=metrics, status=[[0] * 6, [1] * 6])
    page = report(results, [])
    assert " · 6 runs failed" in page.partition("<nav")[0]
    assert "failed runs, no part of means: GT 6 of 6" in page


def test_where_no_law_has_a_good_run_no_law_has_the_least_error(make_result):
    metrics = dict.fromkeys((*MEANS, "energy_residual"), [[np.nan] * 6] * 2)
    page = report(make_result(["eqt", "gt"], metrics=metrics, status=[[1] * 6] * 2), [])
    assert '<p class="finding">All 6 runs of each law failed.</p>' in page
    assert 'class="interval"' not in page


def test_a_single_law_opens_with_what_it_reaches(make_result):
    """Student's or resampled, the half width of 1, …, 6 with mean 3.5 is 1 to 2."""
    one = [[1.0, 2.0, 3.0, 4.0, 5.0, 6.0]]
    page = report(make_result(["eqt"], metrics=dict.fromkeys(MEANS, one)), [])
    says = re.search(r'class="finding">(.*?)</p>', page)[1].replace("\u00a0", " ")
    assert re.match(r"EqT: .* 3\.5 ± 1\.\d", re.sub("<.*?>", "", says)), says


def test_the_experiment_has_its_equations_and_values(text):
    section = text[text.index('<section id="experiment"') :].partition("</section>")[0]
    assert "1, 0.5, 0.5, 0" in section  # asym
    assert "<mtext>1.135</mtext>" in section
    assert "torque: torque (cos(t), sin(t), cos(t)*sin(t))" in section
    assert section.count('<math display="block">') == 4


def test_author_and_notes_stand_at_the_top(make_result):
    metrics = {name: [[1.0] * 6] for name in (*MEANS, "energy_residual")}
    results = make_result(["eqt"], metrics=metrics | {"mean_pose_error": [[1.2e-8] * 6]})
    head = {"title": "Symmetry", "author": "A. Noether", "date": "1918"}
    page = report(results, [], notes="One.\n\nTwo\nlines.", **head)
    texts = (
        "<title>Symmetry – eqt report</title>",
        "<h1>Symmetry</h1>",
        '<p class="facts">A. Noether · ',
        " · 1918",
        '<p class="remark">One.</p>',
        ">Two lines.<",
    )
    assert [text for text in texts if text not in page.partition("<nav")[0]] == []
    assert '<td class="number">1.20e−08 ± ' in page  # and no 0.000


@pytest.mark.usefixtures("unarranged")
def test_texts_of_a_stranger_stay_texts(make_result):
    values = make_result.constant([1.0] * 6, [2.0] * 6)
    signals = dict.fromkeys(("pose_error", "velocity_error", "torque_norm", "lyapunov"), values)
    metrics = {name: [[1.0] * 6, [2.0] * 6] for name in (*MEANS, "energy_residual")}
    results = make_result([HOSTILE, "gt"], signals, metrics, kinds=["eqt", "gt"], title=HOSTILE)
    page = Page(report(results, author=HOSTILE, notes=HOSTILE, wanted=[Wanted("paper")]))
    assert "img" not in page.tags
    assert page.sources == []


@pytest.mark.ci("verifies a result for one figure")
@pytest.mark.usefixtures("unarranged")
def test_command_writes_the_page(invoke, paper_result, tmp_path):
    done = invoke("report", paper_result, "--out", tmp_path / "page.html", "--figure", "torque")
    assert done.stdout.startswith(f"report   {tmp_path / 'page.html'}  (")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert 'id="figure1"' in text and 'id="figure2"' not in text


def test_command_verifies_what_the_page_is_about(text, page):
    section = text[text.index('<section id="certificates"') :].partition("</section>")[0]
    judged = re.search(
        r"checked on this experiment: (\d+) hold, (?:\d+ undecided, )?0 fail<", section
    )
    assert section.count('<span class="verdict supported">holds</span>') >= int(judged[1]) > 30
    assert "energy balance" in section and "Theorems 3.2, 6.2" in section
    assert "Q → Q<sub>d</sub>" in section
    assert page.ids.count("certificates-caption") == 1


def test_certificates_keep_kinds_apart_and_failures_stand_out(paper_result):
    rows = [
        Row("drift", "eq. (5)", "trajectory", "eqt", 2e-3, 1e-6, Verdict.FAILS, HOSTILE),
        Row("rate of L", "Theorem 3.2", "identity", "", 0.0, 1e-12, Verdict.HOLDS),
        Row("𝕀_t is bounded", "Theorem 3.2", "hypothesis", "", 0.0, None, Verdict.HOLDS),
    ]
    with open_at(paper_result) as results:
        tables = {"certificates": certificate_table(rows)}
        tables["doubts"] = certificate_table(rows, brief=True)
        text = report(results, [], tables)
    assert "checked on this experiment: 1 hold, 1 fail" in text
    doubts, every, *_ = text[text.index('id="certificates-table"') :].split('class="folded"')
    assert "Trajectories, over the runs" in doubts and "Identities" not in doubts
    assert every.index("Identities, at random states") < every.index("Trajectories, over the runs")
    assert '<td class="number">2.0e−03</td>' in doubts
    assert '<span class="verdict not-supported">FAILS</span>' in text
    assert "𝕀<sub>t</sub> is bounded" in text  # a name has its index
    assert "img" not in Page(text).tags


def test_what_is_not_covered_is_said_where_nothing_is_in_doubt(paper_result):
    rows = [
        Row("rate of L", "Theorem 3.2", "identity", "", 0.0, 1e-12, Verdict.HOLDS),
        Row("decrease of L", "Theorem 3.2", "trajectory", "eqt", None, None, Verdict.NOT_COVERED),
    ]
    with open_at(paper_result) as results:
        tables = {"certificates": certificate_table(rows)}
        tables["doubts"] = certificate_table(rows, brief=True)
        text = report(results, [], tables)
    doubts = text[text.index('id="certificates-table"') :].split('class="folded"')[0]
    assert "decrease of L (eqt)" in doubts and "rate of L" not in doubts


@pytest.mark.usefixtures("unarranged")
def test_results_without_trajectories_have_a_page_which_says_why_they_are_not_verified(
    invoke, make_result, tmp_path
):
    metrics = {name: [[1.0] * 6] for name in (*MEANS, "energy_residual")}
    results = make_result(["eqt"], metrics=metrics)
    invoke("report", results.path, "--out", tmp_path / "page.html")
    text = (tmp_path / "page.html").read_text(encoding="utf-8")
    assert "The result could not be verified: " in text
    assert 'id="picker"' not in text
    assert "needs the trajectories of" in text


@pytest.mark.ci("computes a result twice, and draws its page")
@pytest.mark.usefixtures("unarranged")
def test_starting_over_removes_the_page_of_the_old_result(invoke, tmp_path):
    config = Path(__file__).parents[3] / "configs" / "paper.yaml"
    few = (
        "--set=ensemble.runs=2",
        "--set=time.duration=1",
        "--set=solver.cross_check=0",
        "--quiet",
    )
    folder = tmp_path / "result"
    invoke("run", config, "--out", folder, *few)
    invoke("report", folder, "--figure", "paper")
    assert (folder / "report.html").exists()
    invoke("run", config, "--out", folder, "--force", *few)
    assert not (folder / "report.html").exists()


def test_buttons_that_turn_pages_have_the_same_names(text):
    assert text.count("◀ Previous") == text.count("Next ▶") == 2


@pytest.mark.needs("diagram")
def test_the_loop_is_drawn_for_wide_and_for_narrow_pages(text):
    figure = text.partition('<figure id="loop"')[2].partition("</figure>")[0]
    assert figure.count("<svg") == 2 and "one of 4 laws" in figure


def test_a_quick_report_integrates_nothing(monkeypatch, paper_result, tmp_path):
    def refuse(*of, **options):
        raise AssertionError("verified")

    pages = []
    monkeypatch.setattr("eqt_cli.extensions.proofs.verification.verify_stored", refuse)
    monkeypatch.setattr(
        "eqt_cli.extensions.report.document.report", lambda *of: pages.append(of) or "page"
    )
    eqt_cli.report(paper_result, tmp_path / "page.html", quick=True)
    _, _, tables, reason, *_ = pages[0]
    assert ({*tables} - {"drawing"}, reason) == (
        set(),
        "The certificates were left out (--quick); `eqt verify` computes them.",
    )


def test_the_page_and_the_terminal_know_every_verdict_on_a_claim():
    template = (TEMPLATES / "report.html.j2").read_text(encoding="utf-8")
    coloured = {verdict for verdicts in _STYLES.values() for verdict in verdicts}
    for verdict in ClaimVerdict:
        assert f'"{verdict}": ' in template and str(verdict) in coloured
