"""`eqt verify` and `eqt margins`: the statements of the paper, and the stability margins."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import EqtError
from eqt_cli.base.extensions import function_for
from eqt_cli.base.files import is_intact_file
from eqt_cli.base.reporting import Block, TextTable, listed
from eqt_cli.cli import options
from eqt_cli.cli.output import complain, count_of, laid_out, print_findings

if TYPE_CHECKING:
    from rich.text import Text

    from eqt_cli.config.experiment import Experiment
    from eqt_cli.config.study import Study
    from eqt_cli.extensions.proofs.certified import Certified, LawRates
    from eqt_cli.extensions.proofs.margins import GainMargin, LawMargins, Margins
    from eqt_cli.extensions.proofs.verification import Verification


RECORDS = ("manifest.json", "tuning.json", "worst.json")
"""Names of the records in a result folder, which have a checksum."""


FINDINGS = ("lacks", "differs")
"""What may be wrong with a law in code, the worst last."""


def verify(
    target: Annotated[
        Path, typer.Argument(metavar="CONFIG|RESULT", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    engine: options.Engine = None,
    runs: Annotated[int | None, options.option("--runs", min=1)] = None,
    exact: Annotated[bool, options.option("--exact")] = False,
    file: Annotated[bool, options.option("--file")] = False,
    code: Annotated[str | None, options.option("--code")] = None,
    adapter: Annotated[Path | None, options.option("--adapter")] = None,
    fail_on: Annotated[str | None, options.option("--fail-on", names=FINDINGS)] = None,
    as_: Annotated[str | None, options.option("--as", names="controllers")] = None,
    plant: Annotated[str | None, options.option("--plant")] = None,
    simulator: Annotated[bool, options.option("--simulator")] = False,
    point: options.Point = None,
    workers: options.Workers = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    verbose: options.Verbose = False,
    quiet: options.Quiet = False,
) -> None:
    """Test the paper's theorems on an experiment; exit 4 if one fails.

    This prints the totals, what fails, and the open statements, a line for each cause; --verbose
    prints all statements.

    Options
    -------
    Experiment
        --runs N  Runs per law of a CONFIG. Default: 20.
        --file  Only test whether the files of a RESULT have the bytes that eqt wrote.
        --exact  Also prove identities, by exact numbers at random states, and rates of small errors
            (extra `certify`).
        --code FILE[:FUNCTION]  Judge the control law in this C, C++ or Python file instead of the
            laws of a CONFIG. Python needs the function, as in lee.py:Lee(2.0).compute.
        --as NAME  The control law that the code claims to be. Default: eqt names the nearest one.
        --adapter FILE  YAML with the conventions of the code's inputs and outputs. Default:
            NAME.adapter.yaml in its folder, if it is there.
        --fail-on FINDING  Exit 4 only where the code lacks terms of the law or differs otherwise
            (lacks), or only where it differs otherwise (differs), whatever else fails.
        --plant FILE:FUNCTION  Judge the vehicle model in this Python file instead: is it the
            plant of CONFIG, with its inertia, forces and thrusters?
        --simulator  Of a --plant that is a step, also print its error over control.period.
    """
    from eqt_cli import api
    from eqt_cli.config.document import overridden

    subject: Path | Study = target
    is_result = target.suffix == ".h5" or target.is_dir()
    if is_result and (set_ or engine or runs or code or plant):
        raise EqtError(
            f"{target}: a result is verified as it is; --set, --engine, --runs, --code and --plant "
            "are for a configuration"
        )
    others = {"--code": code, "--as": as_, "--runs": runs, "--exact": exact, "--file": file}
    _check_subject(plant, simulator, adapter, fail_on, others)
    if file and is_result:
        return _verify_files(target, json=json)
    if not is_result:
        document = options.document_of(target, None, trust_plugins=trust_plugins)
        if code:
            document = function_for(purposes.verify_code)(document, code, as_, adapter)
        document = overridden(document, options.overrides(set_, engine))
        subject = options.study_at(document, point, "verified without")
        if plant:
            of_plant = subject.experiment(0), plant, adapter, simulator, fail_on
            record, pieces, passes = _verify_plant(*of_plant)
            print_findings(record, *pieces, json=json)
            if quiet and not (passes or json):
                complain(f"{target}: {pieces[0]}", "error")
            raise typer.Exit(0 if passes else 4)
        point = None  # the configuration is already that of the point
    workers = workers or options.cores()
    result = api.verify(
        subject, runs=runs, point=point, trust_plugins=trust_plugins, workers=workers, exact=exact
    )
    judged = any(row.kind == "code" for row in result.rows)
    answers = function_for(purposes.answers_on_code) if judged else lambda *_: ()
    code_answers = [*answers(result.rows, result.experiment)]
    findings = {
        "verified": str(target),
        "name": result.experiment.name,
        "group": result.experiment.group.name,
        "engine": result.experiment.engine.name,
        "runs": result.runs,
        "failed": result.failed_runs,
        "holds": not result.failures,
        "causes": result.causes({}),
        "rows": result.records(),
        "code": code_answers,
    }
    said = [code_answer["answer"] for code_answer in code_answers]
    print_findings(findings, *said, *_pieces(result, verbose=verbose), json=json)
    causes = said or result.causes(result.experiment.titles)
    only_complaints = causes if quiet and not json else []
    for cause in only_complaints:
        complain(f"{target}: {cause}", "error")
    if result.failed_runs:
        raise typer.Exit(3)
    worst = FINDINGS[FINDINGS.index(fail_on) :] if fail_on else ()
    if (
        any(code_answer["finding"] in worst for code_answer in code_answers)
        if fail_on
        else result.failures
    ):
        raise typer.Exit(4)


def _check_subject(
    plant: str | None,
    simulator: bool,
    adapter: Path | None,
    fail_on: str | None,
    others: Mapping[str, Any],
) -> None:
    """Refuse options that are not about what is judged."""
    if fail_on not in (None, *FINDINGS):
        raise EqtError(f"--fail-on: expected lacks or differs, got '{fail_on}'")
    if plant and (beside := next((name for name, value in others.items() if value), "")):
        raise EqtError(f"{beside}: is not about a plant; leave it or --plant out")
    if simulator and not plant:
        raise EqtError("--simulator is about a step; give its file with --plant")
    if (others["--as"] or adapter) and not (plant or others["--code"]):
        name = "--as" if others["--as"] else "--adapter"
        raise EqtError(f"{name} is about a law in code; give its file with --code")


def _verify_plant(
    experiment: Any, plant: str, adapter: Path | None, simulator: bool, fail_on: str | None
) -> tuple[dict[str, Any], list[Any], bool]:
    """Return the document and the text on a plant, and whether it passes."""
    record, answer, table = function_for(purposes.verify_plant)(
        experiment, plant, adapter, simulator
    )
    passing = ("is", "lacks") if fail_on == "differs" else ("is",)
    return {"plant": [record]}, [answer, "", laid_out(table)], record["finding"] in passing


def _verify_files(target: Path, *, json: bool) -> None:
    """Print which files of a result have other bytes than eqt wrote; exit 4 if some have."""
    sealed = {".h5", ".npy"}
    names = (f for f in [target, *target.rglob("*")] if f.suffix in sealed or f.name in RECORDS)
    intact = {str(path): is_intact_file(path) for path in sorted(names)}
    damaged = [path for path, is_intact in intact.items() if not is_intact]
    for path in damaged:
        complain(f"{path}: has other bytes than eqt wrote; copy it again or run it again", "error")
    counted = f"{target}: {len(damaged)} of {count_of(len(intact), 'file')} damaged"
    print_findings({"files": [*intact], "damaged": damaged}, counted, json=json)
    if damaged:
        raise typer.Exit(4)


def _pieces(result: Verification, *, verbose: bool) -> Iterator[str | Text]:
    """Yield the printed text: the answer, then the rows that fail, or all."""
    from eqt_cli.extensions.proofs.certificates import certificate_table, with_titles

    yield from result.answer()
    rows = result.titled
    if not verbose:
        assumed = sum(row.kind == "hypothesis" for row in rows)
        stated = count_of(len(rows) - assumed, "statement")
        yield f"checked: {stated}; hypotheses: {assumed}; --verbose lists them all"
    shown = rows if verbose else with_titles(result.failures, result.experiment.titles)
    if shown and (table := certificate_table(shown)) is not None:
        for block in table.blocks:
            notes = table.notes if block is table.blocks[-1] else []
            yield from ("", block.title)
            yield laid_out(replace(table, caption="", blocks=[Block("", block.rows)], notes=notes))


# Margins ------------------------------------------------------------------------------------------


def margins(
    config: options.Config,
    set_: options.Set = None,
    certified: Annotated[bool, options.option("--certified")] = False,
    velocity: Annotated[list[float] | None, options.option("--velocity", min=0)] = None,
    push: Annotated[float, options.option("--push", min=0)] = 0.0,
    start: Annotated[float, options.option("--from", min=0)] = 0.0,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Print eigenvalues, delay and gain margins of each law; exit 4 if a loop is unstable.

    This linearises the loop about its reference, without a simulation. It ignores limits, steps and
    noise, and names those that it ignores.

    Options
    -------
    Experiment
        --certified  Instead, prove the rate at which small errors decay along every reference whose
            velocity stays in a box (extra `certify`).
        --velocity V  The box: each component of V_d within ±V. Repeatable. Default: the box around
            the velocity of this reference, as sampled over the horizon.
        --push F  Also prove by how much a wrench of at most F N m turns a law on SO(3), for small
            errors.
        --from ANGLE  Also prove a rate for large errors on SO(3): from every start with no more
            energy L than a turn by ANGLE degrees at rest. Takes up to a minute a law.
    """
    from eqt_cli import api

    document = options.document_of(config, set_, trust_plugins=trust_plugins)
    study = options.study_at(document, point, "without")
    if certified or velocity or push or start:
        titles = study.experiment(0).titles
        rates = api.certified(study, velocity or (), push=push, start=start)
        print_findings(_rates_document(rates), *_rates_pieces(titles, rates), json=json)
        return
    result = api.margins(study)
    causes = [f"the loop of '{law.label}' is unstable" for law in result.laws if law.is_unstable]
    about = {"name": result.experiment.name, "group": result.experiment.group.name}
    loop = {"period": result.period, "left_out": result.left_out, "refused": result.refused}
    findings = about | loop | {"causes": causes, "laws": result.records()}
    print_findings(findings, *_margins_pieces(result), json=json)
    if quiet and not json:
        for cause in causes:
            complain(f"{config}: {cause}", "error")
    if causes:
        raise typer.Exit(4)


def _at_rest(experiment: Experiment) -> str:
    """Return a reference at rest, as written, that all laws take."""
    if not any(loop.controller.reads_flat_output for loop in experiment.loops.values()):
        return "{kind: constant}"
    translation = experiment.group.translation
    assert translation is not None  # a cascade has a position
    axes = translation.axes
    return f"{{kind: flat, position: {[0] * (axes.stop - axes.start)}}}"


def _margins_pieces(result: Margins) -> Iterator[str | Text]:
    """Yield the printed text: of which loop the numbers are, then the table of them."""
    from eqt_cli.extensions.proofs.authority import authority_table

    titles, varying = result.experiment.titles, [law for law in result.laws if law.changes]
    laws = [law for law in result.laws if not law.changes or law.delay is not None]
    first = [*_of_another_loop(result, varying), *_of_one_time(result, laws)]
    if grown := [f"{titles[x.label]} at {x.growth.at:.3g} s" for x in varying if x.delay is None]:
        first.append(f"Frozen at the worst of nine times, errors do not decay: {listed(grown)}.")
    yield from first
    if laws:
        yield from ([""] if first else [])
        yield laid_out(_margins_table(result, laws))
    if result.refused:
        yield ""
    for label, why in result.refused.items():
        yield f"No margins of {titles[label]}: {why}."
    if left := authority_table(result.experiment):
        yield from ("", left)


def _of_another_loop(result: Margins, varying: Sequence[LawMargins]) -> Iterator[str]:
    """Say whose numbers are of a loop without its estimator, and whose loop varies in time."""
    from eqt_cli.components.vehicle import navigates

    titles, vehicle = result.experiment.titles, result.experiment.loop.vehicle
    if bare := [titles[law.label] for law in result.laws if not law.has_filter]:
        settles = "it settles only where the loop hardly changes"
        why = "a filter by an accelerometer settles late" if navigates(vehicle) else settles
        yield (
            f"No margin here is a margin of the file: the loop of {listed(bare)} is computed "
            f"without its estimator, because {why}."
        )
    if not varying:
        return
    cause, remedy = "The inertia or an actuator varies", ""
    if result.experiment.reference_over_horizon().velocity.any():
        cause = "The reference moves"
        proof = "--certified, which tries to prove a rate for all such references, or "
        rest = _at_rest(result.experiment)
        remedy = f"--set 'reference={rest}', which gives the margins at rest"
        remedy = f" For a sure answer, add {proof * vehicle.is_ideal}{remedy}."
    elif vehicle.forces:
        cause = "A force varies"
        remedy = " For a sure answer, add --set plant.forces=[], which leaves all forces out."
    yield (
        f"{cause}, so the loop of "
        f"{listed([titles[law.label] for law in varying])} varies in time: eigenvalues at "
        f"single times are no rates, and do not decide whether it is stable.{remedy}"
    )


def _of_one_time(result: Margins, laws: Sequence[LawMargins]) -> Iterator[str]:
    """Say whose numbers are those where the reference begins."""
    titles = result.experiment.titles
    if starting := [titles[law.label] for law in laws if law.starts]:
        yield (
            "The reference moves, and an estimator settles at rest only: the numbers of "
            f"{listed(starting)} are those at rest, where the reference begins."
        )
    if frozen := [titles[law.label] for law in laws if law.freezes]:
        yield (
            "An estimator settles only where the forces stay as they are. While errors decay, the "
            f"forces hardly change the loop, so the numbers of {listed(frozen)} are those with the "
            "forces as they are where the reference begins."
        )


LAGGING = "delay margin if lag × 0.5, × 2"
"""Title of the column of the delay margins with other believed lags."""


def _margins_table(result: Margins, laws: Sequence[LawMargins]) -> TextTable:
    """Return the table of some laws, and notes on how to read it."""
    sampled, gains = result.period is not None, _gains(result)
    size = "largest |eigenvalue|" if sampled else "largest real part, 1/s"
    factors = [f"{'of' if k else 'multiples of'} {name}" for k, name in enumerate(gains)]
    header, rows = ["law", size, "delay margin", *factors, LAGGING, "verdict"], []
    for law in laws:
        largest = "-" if law.changes else f"{law.size:.{6 if sampled else 3}g}"
        ranges = ["-"] * len(gains)
        if law.growth.is_stable:
            ranges = [_factors(law.gains.get(name)) for name in gains]
        title = result.experiment.titles[law.label]
        title += "" if law.has_filter else ", without its estimator"
        lags = ", ".join(_delay(replace(law, delay=x, delay_periods=None)) for x in law.lag_delays)
        rows.append([title, largest, _delay(law), *ranges, lags or "-", law.verdict])
    notes = list(_notes(result, laws))
    table = TextTable("margins", "", header, [Block("", rows)], notes, spare=("of both",))
    empty = []
    if all(law.changes for law in laws):
        empty.append(size)
    if not any(law.lag_delays for law in laws):
        empty.append(LAGGING)
    return table.without(empty)


def _notes(result: Margins, laws: Sequence[LawMargins]) -> Iterator[str]:
    """Say what the columns mean, and what is left out."""
    titles = result.experiment.titles
    yield from _legend(_gains(result))
    for law in laws:
        if beside := _beside(result, law):
            yield f"{titles[law.label]} stays {beside} away from its reference; linearised there"
    for cycle in sorted({law.cycle for law in result.laws if law.cycle} - {result.period}):
        of = ", ".join(titles[law.label] for law in result.laws if law.cycle == cycle)
        yield f"eigenvalues of {of}: over {cycle:g} s, when all clocks coincide again"
    if result.left_out and any(x.is_indicative and not x.changes for x in result.laws):
        yield (
            "indicative: the numbers hold for the loop without the parts that are left out, not "
            "for the whole loop"
        )
    single = [titles[law.label] for law in result.laws if law.delay_is_frozen and not law.changes]
    if single:
        yield (
            f"{', '.join(single)}: the errors of the law obey the same equation at all times, the "
            "command does not; its delay margin is the least of nine times, and indicative"
        )
    if frozen := [f"{titles[law.label]} {law.growth.at:.3g} s" for law in laws if law.changes]:
        yield (
            "indicative: delay and multiples are those of the loop frozen at the worst of nine "
            f"times: {', '.join(frozen)}"
        )
    for words in dict.fromkeys(law.filters for law in result.laws if law.filters):
        yield f"{listed([titles[x.label] for x in result.laws if x.filters == words])}: {words}"
    if result.left_out:
        yield f"left out: {', '.join(result.left_out)}"


def _legend(gains: Sequence[str]) -> Iterator[str]:
    """Say how to read the columns."""
    from eqt_cli.extensions.proofs.scaled import LARGEST_FACTOR

    most = f"1/{LARGEST_FACTOR:g} to {LARGEST_FACTOR:g}"
    yield f"stable up to this further delay, and for these multiples; any: {most}"
    rejects = {"effectiveness": "the torque for each command", "lag": "the lag that a law believes"}
    if meant := [f"{name}: {of}" for name, of in rejects.items() if name in gains]:
        yield ", ".join(meant)
    if "position" in gains:
        yield "kp, kd: of the attitude law of a cascade; position: its kx, kv and ki"


def _gains(result: Margins) -> list[str]:
    """Return the names of the gain margins: that of the position where a law has it."""
    from eqt_cli.extensions.proofs.margins import GAINS

    controllers = [loop.controller for loop in result.experiment.loops.values()]
    cascades = any(law.reads_flat_output for law in controllers)
    rejects = any(hasattr(law, "constant_disturbance") for law in controllers)
    lagging = any("lag" in law.gains for law in result.laws)
    shown = {"position": cascades, "effectiveness": rejects, "lag": lagging}
    return [name for name in GAINS if shown.get(name, True)]


def _delay(law: LawMargins) -> str:
    if law.delay is None:
        return "-"
    if law.delay == float("inf"):
        return "any"
    periods = law.delay_periods
    whole = "" if periods is None else f" ({count_of(periods, 'period')})"
    least = "at least " if law.delay_is_least else ""
    return f"{least}{law.delay:.4g} s{whole}"


def _factors(gain: GainMargin | None) -> str:
    if gain is None:
        return "not used"
    if gain.lower is None:
        return "any" if gain.upper is None else f"below {gain.upper:.3g}"
    if gain.upper is None:
        return f"above {gain.lower:.3g}"
    return f"{gain.lower:.3g} to {gain.upper:.3g}"


def _beside(result: Margins, law: LawMargins) -> str:
    """Return the offset of a loop from its reference, part by part; empty if it has none."""
    import numpy as np

    from eqt_cli.loop.linearised import AT_REST

    sizes = [
        (float(np.linalg.norm(law.offset[part.axes])), part.velocity_unit.removesuffix("/s"))
        for part in result.experiment.group.parts
    ]
    return " and ".join(f"{size:.3g} {unit}" for size, unit in sizes if size > AT_REST)


# Certified rates ----------------------------------------------------------------------------------


def _rates_document(laws: Sequence[LawRates]) -> dict[str, Any]:
    refused = [{"label": x.label, "certified": None, "why": x.refused} for x in laws if x.refused]
    proved: list[dict[str, Any]] = [
        {"label": law.label, "certified": asdict(one) | {"rate": one.rate and float(one.rate)}}
        for law in laws
        for one in law.rates
    ]
    return {"laws": proved + refused}


def _rates_pieces(titles: Mapping[str, str], laws: Sequence[LawRates]) -> Iterator[str | Text]:
    """Yield the printed text: the proved rates in each box, and what they mean."""
    header = ["law", "proved rate, 1/s", "overshoot", "slowest constant V_d", "its rate, 1/s"]
    with_rates, blocks, words = [law for law in laws if law.rates], list[Block](), list[str]()
    for rates in zip(*(law.rates for law in with_rates), strict=True):
        sides = [f"{low:g} to {high:g}".replace("-", "−") for low, high in rates[0].velocity]
        pairs, box = (
            [*zip(with_rates, rates, strict=True)],
            f"each V_d(t) within {', '.join(sides)}",
        )
        blocks.append(Block(box, [[titles[law.label], *_rate(one)] for law, one in pairs]))
        extras = ((titles[x.label], part) for x, one in pairs for part in (one.gain, one.region))
        words += [f"{title} {part}; {box}" for title, part in extras if part]
    notes = [
        "proved: along all references in the box, errors shrink like overshoot · exp(−rate · t)",
        "slowest constant V_d: no proof in the box can exceed its rate; below 0 it is unstable",
    ]
    if with_rates:
        yield laid_out(TextTable("certified", "", header, blocks, notes))
    yield from words
    for law in laws:
        if why := law.refused:
            lead = "" if why.startswith("has no") else "has no certified rate: it "
            yield f"{titles[law.label]} {lead}{why}"


def _rate(one: Certified) -> list[str]:
    """Return the cells of a proved rate, rounded down."""
    proved = [f"{int(one.rate * 10**4) / 10**4:.4f}", f"{one.overshoot:.3g}"] if one.rate else []
    at = ", ".join(f"{v:.3g}" for v in one.slowest_constant)
    return [*(proved or ["none", "-"]), f"({at})", f"{one.slowest_rate:.4f}"]
