"""Tables of the outcome of a search, from its record and its judged runs."""

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations, product
from typing import Any

import numpy as np

from eqt_cli.analysis.compare import compare
from eqt_cli.analysis.comparison_tables import text_tables
from eqt_cli.analysis.intervals import FEWEST, Resampling, intervals_of_means
from eqt_cli.analysis.maps import NOBODY, RULE, decide
from eqt_cli.base.arrays import Array
from eqt_cli.base.reporting import Block, TextTable, brief, count_of, listed, significant
from eqt_cli.extensions.search import fronts, ratios
from eqt_cli.extensions.search.exchanges import FEWEST_EXCHANGING, FINISHED, more_of, rounds_of
from eqt_cli.extensions.search.fronts import SHARES, Constraint, cases_of, equal_cost_table
from eqt_cli.extensions.search.record import AGREEING, AS_IT_IS, agree, values_text
from eqt_cli.results.origin import law_title
from eqt_cli.results.quantity import Plain
from eqt_cli.results.result import Result, mean_over_runs
from eqt_cli.results.summary import compared_first

Record = Mapping[str, Any]

Range = tuple[float, float]

_WRITE = Plain()


def measured(result: Result, name: str) -> str:
    """Return the name of a metric with its unit, for captions."""
    unit = _WRITE.unit(result.units(name))
    return f"{_WRITE.name(result.quantity(name))}{f' in {unit}' if unit else ''}"


def _means_over(result: Result) -> str:
    """``means over 6 held-out runs ± half the 95 % interval``; few runs have no interval."""
    interval = " ± half the 95 % interval" if result.runs >= FEWEST else ""
    return f"means over {count_of(result.runs, 'held-out run')}{interval}"


def is_sampled(record: Record) -> bool:
    """Whether laws were tuned on training samples: neither for fronts nor by proofs."""
    return "budget" in record


def tuning_tables(result: Result, record: Record) -> list[TextTable]:
    """Return the tables of winners against starting gains, of bounds, and of pairs of winners.

    Parameters
    ----------
    result
        The opened result of the held-out runs.
    record
        Record of the search.
    """
    cases, result = cases_of(result, record), fronts.held_out(result, record)
    bounds = _bounds(cases, record)
    if len(record["objectives"]) > 1:
        equal_cost = equal_cost_table(result, record, _WRITE, Resampling())
        tables = [equal_cost, _front_points(result, record), bounds]
        return [table for table in tables if table.blocks]
    tuned = [winner["label"] for law in record["laws"] for winner in law["winners"]]
    sought = [*record["objectives"], *(bound["metric"] for bound in record["constraints"])]
    sought = list(dict.fromkeys(sought))
    pairs: list[TextTable] = []
    if is_sampled(record):
        of_pairs = ratios.ratios(result, record, sought)
        said = ratios.sentences(result, of_pairs[: math.comb(len(tuned), 2)], record["samples"])
        table = ratios.ratio_table(result, of_pairs, record["samples"], _WRITE)
        pairs.append(replace(table, notes=[*said, *table.notes]))
        pairs.append(ratios.spending_table(result, record, _WRITE))
        pairs.append(_samples(result, record))
    elif len(tuned) > 1:
        comparison = compare(result, metrics=sought, labels=tuned)
        table = text_tables(comparison, _WRITE)["pairs"]
        ranking = _ranking(result, record["objectives"][0], tuned)
        rule = f"A law is better where it is {RULE}, with p times the pairs."
        pairs = [replace(table, notes=[*table.notes, ranking, rule])]
    names = list(dict.fromkeys([*record["objectives"], *compared_first(result)]))
    winners = _winners(result, record, names)
    tables = [winners, _by_case(cases, record), bounds, *pairs]
    return [table for table in tables if table.blocks]


def verdict_records(result: Result, record: Record) -> dict[str, Any]:
    """Return the verdicts on laws that were tuned on samples, and their pairs, for programs."""
    if not is_sampled(record):
        return {}
    result = fronts.held_out(result, record)
    pairs = ratios.ratios(result, record, record["objectives"])
    said = ratios.said_first(result, record)
    return {"pairs": ratios.answer_record(pairs), "remarks": said}


def tuning_answer(result: Result, record: Record) -> list[TextTable]:
    """Return the table with the answer alone: the winners, or fronts at the middle equal cost.

    Its notes name the bounds that the winners violate, which laws are better, and the ranges that
    are too narrow. `tuning_tables` returns the rest.
    """
    cases, result = cases_of(result, record), fronts.held_out(result, record)
    bounds = _bounds(cases, record).rows
    broken = [f"{law} ({what}: {reached})" for law, what, reached, _, ok in bounds if ok != "holds"]
    notes = (
        [f"Bounds violated on the held-out runs: {'; '.join(broken) or 'none'}."] if bounds else []
    )
    if len(record["objectives"]) > 1:
        table = equal_cost_table(result, record, _WRITE, Resampling())
        if not table.blocks:  # of a single law, or of fronts of different costs
            return [_front_points(result, record)]
        middle = Block("", table.rows[len(SHARES) // 2 :: len(SHARES)])
        table = replace(table, blocks=[middle]).without(["error", "error of the other"])
        notes = [f"better: the law that is {RULE}", *notes, *_notes(result, record, ())]
        return [replace(table, notes=notes)]
    tuned = [winner["label"] for law in record["laws"] for winner in law["winners"]]
    starts = [law["start"] for law in record["laws"] if law["over"]]
    notes += _notes(result, record, tuned, starts)
    if is_sampled(record):
        pairs = ratios.ratios(result, record, record["objectives"])
        said = ratios.sentences(result, pairs, record["samples"])
        notes = [*ratios.said_first(result, record), *said, *notes]
    elif len(tuned) > 1:
        notes.insert(0, _ranking(result, record["objectives"][0], tuned))
    notes = [*record.get("proved", {}).get("answer", ()), *notes]
    return [replace(_winners(result, record, record["objectives"]), notes=notes)]


def _samples(result: Result, record: Record) -> TextTable:
    """Return the table of what was found on each training sample."""
    name, rows = record["objectives"][0], []
    means = dict(zip(result.labels, mean_over_runs(result.counted(name)).tolist(), strict=True))
    for law in record["laws"]:
        for search in law["searches"]:
            label, cost = search["label"], ["no feasible point", "-", "-", "-"]
            if label is not None:
                trained = float(result.quantity(name).cost(search["objectives"][0][0]))
                failed = f"{100 * search['failed']:.3g} %"
                values = values_text(search["values"]) or AS_IT_IS
                cost = [values, significant(trained), significant(means[label]), failed]
            gained = search.get("gained")
            ended = [str(search["points"]), "-" if gained is None else f"{100 * gained:.2f} %"]
            number = f"{search['sample']}{' *' if label == law['label'] else ''}"
            rows.append([law_title(law["label"]), number, *cost, *ended])
    caption = f"{measured(result, name)} by training sample"
    header = [
        "law",
        "sample",
        "best values",
        "training",
        "held out",
        "failed",
        "points",
        "last gain",
    ]
    notes = [
        "*: the sample with the middle error on its training runs, whose gains stand for the law",
        "failed: share of the training runs",
    ]
    if record["samples"] >= FEWEST_EXCHANGING:
        notes.append(
            "last gain: of the last exchange, in which a sample tries the best points of the "
            f"others; a search is finished where it is at most {100 * FINISHED:g} % on all samples"
        )
    elif any(x["ended"] != "sure" for law in record["laws"] for x in law["searches"]):
        notes.append("Some searches were not yet sure of their best point when tune.budget ended.")
    return TextTable("samples", caption, header, [Block("", rows)] if rows else [], notes)


def _ranking(result: Result, name: str, tuned: Collection[str]) -> str:
    """Say which of the tuned laws are better than which, each pair as a point of a map."""
    laws = [k for k, label in enumerate(result.labels) if label in tuned]
    pairs = np.array(list(combinations(laws, 2)))
    costs = result.quantity(name).cost(result.counted(name))[pairs]
    decisions = decide(costs, np.count_nonzero(~result.good[pairs], axis=-1), Resampling.confidence)
    verdicts: dict[str, list[str]] = {}
    for pair, winner in zip(pairs.tolist(), decisions.winner.tolist(), strict=True):
        both, verdict = [result.titles[k] for k in pair], f"{decisions.without_winner}:"
        if winner != NOBODY:
            verdict = f"{both.pop(winner)} is better than"
        verdicts.setdefault(verdict, []).append(" – ".join(both))
    said = "; ".join(f"{verdict} {listed(laws)}" for verdict, laws in verdicts.items())
    return f"By {result.quantity(name).described}: {said}."


def _by_case(cases: Mapping[str, Result], record: Record) -> TextTable:
    """Return the table of each winner's objective in each case; empty without cases."""
    labels = [winner["label"] for law in record["laws"] for winner in law["winners"]]
    (name,) = record["objectives"]
    rows = []
    if record["cases"]:
        for case, result in cases.items():
            values = result.counted(name)[[result.labels.index(label) for label in labels]]
            rows.append([case, *_spreads(values)])
    result = next(iter(cases.values()))
    caption = f"{measured(result, name)} of the tuned laws in each case: {_means_over(result)}"
    header = ["case", *(result.title_of[label] for label in labels)]
    return TextTable("cases", caption, header, [Block("", rows)] if rows and labels else [])


def _spreads(values: Array) -> list[str]:
    """Format the mean over runs of each row with half its interval."""
    means = intervals_of_means(values.T, Resampling())
    ends = zip(means.mean.tolist(), means.low.tolist(), means.high.tolist(), strict=True)
    return [_WRITE.spread(*three) for three in ends]


def _front_points(result: Result, record: Record) -> TextTable:
    """Return the table of all winners of the fronts and of the starting gains."""
    cells = [_spreads(result.counted(name)) for name in record["objectives"]]
    rows = []
    for law in record["laws"]:
        winners = {w["label"]: values_text(w["values"]) for w in law["winners"]}
        for label, values in ({law["start"]: ""} | winners).items():
            k = result.labels.index(label)
            rows.append([result.titles[k], values, *(column[k] for column in cells)])
    names = [
        f"{_WRITE.name(result.quantity(name))} {_WRITE.unit(result.units(name))}".strip()
        for name in record["objectives"]
    ]
    caption = f"Points of the fronts: {_means_over(result)}"
    notes = list(_notes(result, record))
    return TextTable("points", caption, ["law", "tuned", *names], [Block("", rows)], notes)


def _winners(result: Result, record: Record, names: Sequence[str]) -> TextTable:
    blocks = []
    for name in names:
        spreads = dict(zip(result.labels, _spreads(result.counted(name)), strict=True))
        rows = []
        for law in record["laws"]:
            before = spreads[law["start"]] if law["over"] else ""
            for winner in law["winners"]:
                label, best = winner["label"], values_text(winner["values"]) or AS_IT_IS
                after, more = spreads[label], [winner["proved"]] if "proved" in winner else []
                if is_sampled(record):
                    after = _WRITE.spread(*ratios.means(result, law, name))
                rows.append([result.titles[result.labels.index(label)], best, before, after, *more])
            if not law["winners"]:
                more = ["-"] if "proved" in record else []
                rows.append([law_title(law["label"]), "no feasible point", before, "-", *more])
        blocks.append(Block(measured(result, name), rows))
    caption = f"Tuned laws against their starting gains: {_means_over(result)}"
    if is_sampled(record) and record["samples"] > 1:
        caption += f"; tuned: over {record['samples']} training samples, too"
    header = ["law", "best values", "start", "tuned"]
    if "proved" in record:
        header.append(record["proved"]["column"])
    said = ratios.said_first(result, record) if is_sampled(record) else []
    return TextTable("tuned", caption, header, blocks, [*said, *_notes(result, record)])


def _notes(
    result: Result, record: Record, of: Collection[str] | None = None, starts: Collection[str] = ()
) -> Iterator[str]:
    """Notes on values at the end of their range, cases, and failed or unsettled runs of some laws.

    Without labels, those of all laws follow the size of the search. Of starting gains only failed
    runs are counted.
    """
    if of is None and "proved" in record:
        yield from record["proved"]["answer"]
    elif of is None:
        yield searched(record)
    if is_sampled(record):
        yield from ratios.unequal(record)
    if fixed := [law_title(law["label"]) for law in record["laws"] if not law["over"]]:
        yield f"{AS_IT_IS.capitalize()}, since tune.over has no key of it: {listed(fixed)}."
    near = dict.fromkeys(
        f"{key} {end:g} of {law_title(law['label'])}"
        for law in record["laws"]
        for key, (low, high) in law["over"].items()
        for end, winner in product((low, high), law["winners"])
        if _is_at(winner["values"][key] / ratios.factor(winner, key), end, high - low)
    )
    if near:
        yield (
            f"At the end of its range: {listed([*near])}; widen the range in tune.over, or bound "
            "what the law may spend by tune.equal or tune.subject_to."
        )
    if cases := record["cases"]:
        worst = "from the case in which the mean over all runs is worst"
        meaning = worst if record["over_cases"] == "worst" else "the mean over the cases"
        yield f"Over the cases {listed(cases)}: each number is {meaning}."
    yield from _counted(result, result.labels if of is None else of, starts)


def _is_at(value: float, end: float, width: float) -> bool:
    return abs(value - end) <= ratios.AT_AN_END * min(abs(end) or np.inf, width)


def searched(record: Record) -> str:
    """Describe the size of a search in a sentence."""
    cases = f" in each of {len(record['cases'])} cases" if record.get("cases") else ""
    if is_sampled(record):
        laws = [law for law in record["laws"] if law["over"]]
        points = [search["points"] for law in laws for search in law["searches"]]
        ends = " to ".join(dict.fromkeys(map(str, (min(points), max(points)))))
        samples = count_of(record["samples"], "training sample")
        added = ""
        if record["samples"] >= FEWEST_EXCHANGING:
            rounds, more = rounds_of(record["budget"]), more_of(record["budget"])
            added = f" and {rounds} × {more} after exchanges between the samples"
        return (
            f"Searched: {ends} points for every "
            f"{'law' if len(laws) == len(record['laws']) else 'searched law'} on {samples} of "
            f"{count_of(record['runs'], 'run')}{cases}; at most {record['budget']}{added}."
        )
    generations, runs, seeds = record["generations"], record["runs"], record["seeds"]
    return (
        f"Searched: {count_of(generations, 'generation')} of {record['population']} points, each "
        f"of {count_of(runs, 'run')}{cases}, for every law, with the "
        f"seed{'s' if len(seeds) > 1 else ''} {listed([*map(str, seeds)])}."
    )


def _counted(result: Result, labels: Collection[str], starts: Collection[str]) -> Iterator[str]:
    """Count the held-out runs that failed, of starting gains too, or had not settled at the end."""
    unsettled = result.censored("settling_time").sum(axis=-1)
    if (unsettled == result.runs).all():
        yield f"All {result.runs} runs of every law are unsettled at the end; see time.duration."
        unsettled = 0 * unsettled
    with_starts = dict.fromkeys([*labels, *starts])  # means of both are without what failed
    failed, late = result.failed.values(), "unsettled at the end"
    for what, counts, of in (("failed", failed, with_starts), (late, unsettled, labels)):
        of_law = dict(zip(result.labels, counts, strict=True))
        listed = [f"{result.title_of[x]}: {of_law[x]}" for x in of if of_law[x]]
        if listed:
            yield f"Runs {what}, of {result.runs}: {'; '.join(listed)}."


def _bounds(cases: Mapping[str, Result], record: Record) -> TextTable:
    """Return the table of the bounds on the held-out runs, in each case."""
    rows = []
    labels = [
        label
        for law in record["laws"]
        for label in dict.fromkeys((*(winner["label"] for winner in law["winners"]), law["start"]))
    ]
    for entry, (case, result) in product(record["constraints"], cases.items()):
        bound = Constraint(**entry)
        if bound.equal:  # what laws spend of it has a table of its own
            continue
        values = result.counted(bound.metric)
        over = fronts.excess(bound, values)
        worst = np.max if bound.above else np.min
        reached = worst(values, axis=-1) if bound.every_run else mean_over_runs(values)
        beyond = ~(values <= bound.bound if bound.above else values >= bound.bound)
        for k in map(result.labels.index, labels):
            has_value = np.isfinite(reached[k])
            by = f" by {100 * over[k]:.2g} %" if has_value else ": a run has no value"
            title = f"{result.titles[k]}, {case}" if case else result.titles[k]
            verdict = "holds" if over[k] == 0 else f"violated{by}"
            number = significant(float(reached[k]))
            rows.append([title, str(bound), number, str(int(beyond[k].sum())), verdict])
    header = ["law", "constraint", "measured", "runs beyond", "verdict"]
    blocks = [Block("", rows)] if rows else []
    return TextTable("bounds", "Constraints on the held-out runs", header, blocks)


def worst_tables(result: Result, record: Record) -> list[TextTable]:
    """Return the table of the worst run of each law, its place, and the agreement of the searches.

    Parameters
    ----------
    result
        The opened result of all laws along each key.
    record
        Record of the search.
    """
    what = measured(result, record["objective"])
    rows = [
        [
            law_title(law["label"]),
            "a run failed" if law["failed"] else significant(law["value"]),
            values_text(law["values"]),
            str(law["run"]),
            f"{law['unsettled']} of {law['runs']}",
            f"{law['first']['unsettled']} of {law['first']['runs']}",
            f"{law['agreeing']} of {len(law['searches'])}",
        ]
        for law in record["laws"]
    ]
    header = ["law", "worst found", "at", "run", "not settled", "in the box", "agree"]
    title = f"The worst run that was found: {what}"
    return [TextTable("worst", title, header, [Block("", rows)], list(_worst_notes(record)))]


def _worst_notes(record: Record) -> Iterator[str]:
    yield f"{searched(record)} Worse runs may exist: a search is not a proof."
    for law in record["laws"]:
        seen = [search["value"] for search in law["searches"]]
        values = ", ".join("a failed run" if v is None else brief(v) for v in seen)
        if "certified" in law:
            where = "at this point, for references within its velocities"
            yield f"{law_title(law['label'])}, proved {where}: {law['certified']}."
        if law["in_profile"]:
            yield (
                f"{law_title(law['label'])}: this run lies on the lines through the worst that the "
                f"searches found ({values}), and is worse; a larger worst.budget finds more."
            )
        elif not law["failed"] and (None in seen or not any(agree(law["value"], v) for v in seen)):
            yield (
                f"{law_title(law['label'])}: together with other points, the searches found "
                f"{values}; the run amplifies rounding, so its value is no more certain than that."
            )
    yield (
        "Not settled: of the runs at the point that was found; in the box: of all runs of "
        "the first generations, whose points are spread over the ranges. A failed run has not "
        "settled. "
        f"Agree: searches whose worst is within {100 * AGREEING:g} % of the worst of all."
    )
