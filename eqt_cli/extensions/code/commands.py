"""`eqt time`: how long calls of laws take."""

from eqt_cli.cli import options
from eqt_cli.cli.output import print_findings, table


def time(
    result: options.Result,
    controller: options.Controllers = None,
    point: options.Point = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
) -> None:
    """Time a call of each law again, at the inputs that a result has recorded.

    Times are CPU times of this machine; let it rest. Laws of eqt are timed as the C that `native`
    compiles. Calls too short for a clock are repeated in a loop, whose mean is the time of a call.

    Options
    -------
    What to show
        --controller NAME  Law to time. Repeatable. Default: all.
    """
    from eqt_cli import api
    from eqt_cli.base.reporting import significant
    from eqt_cli.results.timing import STATISTICS

    times = api.call_times(result, controller or (), point, trust_plugins)
    rows = []
    for row in times["laws"].values():
        numbers = (significant(1e6 * row[name], 3) for name in STATISTICS)
        rows.append([row["title"], *numbers, str(row["calls"]), row["how"]])
    where = "CPU time of a call on {machine}, {cpu_count} processors, load {load}"
    header = ["law", *(f"{name}, µs" for name in STATISTICS), "inputs", "called from"]
    said = where.format_map(times), *times["late"]
    print_findings(times, table(header, rows), "", *said, json=json)
