"""`eqt tune`: search for the best gains of each law, and compare the winners on held-out runs."""

from __future__ import annotations

from typing import TYPE_CHECKING

import typer

from eqt_cli.cli.shared import options
from eqt_cli.cli.shared.output import as_remark, laid_out, print_json, print_text, warn
from eqt_cli.cli.shared.progress import progress
from eqt_cli.cli.shared.run_and_report import executor_from
from eqt_cli.core.errors import InterruptedRun
from eqt_cli.core.interruptions import Interrupted

if TYPE_CHECKING:
    from eqt_cli.tuning.evolution import Population
    from eqt_cli.tuning.law_search import LawSearch
    from eqt_cli.tuning.search import Search
    from eqt_cli.tuning.tune import Tuning


def tune(
    config: options.Config,
    out: options.Out = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    scheduler: options.Scheduler = None,
    dry_run: options.DryRun = False,
    force: options.Force = False,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Find the best gains of each law and store the result in results/NAME-tuned.

    After an interruption, run the same command again to continue. The exit code is 4 if a law has
    no feasible gains.
    """
    from eqt_cli import api
    from eqt_cli.cli.shared.search_plan import print_search_plan
    from eqt_cli.config.source import read_config
    from eqt_cli.experiment.study import Study
    from eqt_cli.tuning.search import search_from
    from eqt_cli.tuning.tune import folder_of

    source = read_config(config, options.overrides(set_, engine))
    search = search_from(source, trust_plugins=trust_plugins)
    starting = api.LoadedExperiment(Study(None, search.base))
    if dry_run:
        print_search_plan(search, executor_from(starting, executor, workers, scheduler), json=json)
        return
    out = out or folder_of(search)
    best: dict[str, str] = {}
    try:
        with progress(search.all_runs) as advance:

            def told(law: LawSearch, generation: int, population: Population) -> None:
                best[law.label] = _best(search, law, population)
                of = f"{law.label}, generation {generation} of {search.all_generations}"
                advance.note = f"{of}: {best[law.label]}"

            done = api.tune(
                search,
                out,
                executor=executor_from(starting, executor, workers, scheduler),
                force=force,
                progress=advance,
                resumed=advance.skip,
                remark=warn,
                told=told,
            )
    except Interrupted as error:
        raise InterruptedRun(
            f"interrupted; what was found is kept in {out}: run the same command again to "
            "continue, or with --force to start over",
            error.exit_code,
            [f"  best so far, {label}: {text}" for label, text in best.items()],
        ) from None
    _report(done, json=json)


def _best(search: Search, law: LawSearch, population: Population) -> str:
    """The best of a law so far, in words."""
    from eqt_cli.results.quantity_table import QUANTITIES
    from eqt_cli.tuning.tables import values_text

    best, scored = population.best, population.scores
    if not scored.feasible[best]:
        return f"no feasible point, least violation {scored.violation[best]:.3g}"
    values = values_text(law.values(population.shares[best].tolist()))
    name = search.objectives[0]
    front = f", {len(population.front)} on the front" if len(search.objectives) > 1 else ""
    return f"{name} {QUANTITIES[name].cost(scored.objectives[best, 0]):.4g} at {values}{front}"


def _report(done: Tuning, *, json: bool) -> None:
    """Print what came out, and exit with 3 or 4 where runs failed or a law has no winner."""
    from eqt_cli.results.result import open_result
    from eqt_cli.tuning.tables import tuning_tables

    path, failed = done.confirmed.folder.path, done.confirmed.failed
    lost = [law for law in done.laws if not law.winners]
    causes = [
        f"no feasible point of {each.law.label}: the least violation is {each.least_violation:.3g}"
        for each in lost
    ]
    causes += ["some held-out runs failed"] if failed else []
    if json:
        print_json({"folder": str(path), **done.record, "failed": failed, "causes": causes})
    else:
        with as_remark(), open_result(path) as result:
            for table in tuning_tables(result, done.record):
                print_text(laid_out(table), "")
            print_text(*causes, f"results  {path}")
            first = next((each for each in done.record["laws"] if each["winners"]), None)
            if first:
                print_text(f"next     eqt run {path / first['winners'][0]['config']}")
    if lost:
        raise typer.Exit(4)
    if failed:
        raise typer.Exit(3)
