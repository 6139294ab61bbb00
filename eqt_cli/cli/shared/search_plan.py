"""What `--dry-run` prints of a search: points, runs and time."""

from dataclasses import asdict

from eqt_cli.cli.shared.output import count_of, duration, print_found
from eqt_cli.execution.executors import Executor
from eqt_cli.tuning.generations import expected
from eqt_cli.tuning.law_search import Searches


def print_search_plan(search: Searches, executor: Executor, *, json: bool) -> None:
    """Print what a search will take, without searching."""
    section, found = search.section, expected(search, executor)
    runs = search.base.config.ensemble.runs
    factors = [
        count_of(len(search.laws), "law"),
        f"{section.seeds} search{'es' if section.seeds > 1 else ''}",
        count_of(section.budget, "generation"),
        count_of(section.population, "point"),
    ]
    lines = [
        f"{' × '.join(factors)} = {found.points}",
        f"runs     {search.searched_runs} ({count_of(runs, 'run')} at each point), and at most "
        f"{found.runs - search.searched_runs} to judge the outcome",
        f"time     about {duration(found.seconds)} with {count_of(found.workers, 'worker')}",
    ]
    print_found(asdict(found), "\n".join(lines), json=json)
