"""`eqt budget`: what each imperfection costs."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from eqt_cli.base.errors import EqtError
from eqt_cli.cli import options, output, run
from eqt_cli.cli.compare import TableFormat
from eqt_cli.cli.output import be_quiet

if TYPE_CHECKING:
    from eqt_cli.extensions.budget.tables import BudgetInWords


def budget(
    config: options.Config,
    error: Annotated[str, options.option("--error")] = "",
    window: Annotated[str, options.option("--window")] = "",
    quantile: Annotated[list[float] | None, options.option("--quantile")] = None,
    total: Annotated[bool, options.option("--total")] = False,
    point: options.Point = None,
    set_: options.Set = None,
    engine: options.Engine = None,
    workers: options.Workers = None,
    executor: options.ExecutorName = None,
    figure: Annotated[Path | None, options.option("--figure")] = None,
    format: Annotated[TableFormat, options.option("--format")] = TableFormat.TEXT,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: Annotated[bool, options.option("--quiet", "-q", callback=be_quiet)] = False,
) -> None:
    """Print what each noise, force, limit, delay or wrong number adds to the error.

    Each is switched off alone and on alone, from the same starts and draws. Laws and filters stay
    as designed.

    Options
    -------
    Experiment
        --error NAME  attitude_angle, pointing_error, position_error or heading_error. Default: the
            first one that the loops have.
        --window START:STOP  Times over which errors count, s; 20: leaves out the first 20 s.
            Default: `measure` of the configuration, or the whole time.
        --quantile P  A quantile of the whole error, such as 0.997. Repeatable.
        --total  Compute the whole loop only, with its quantiles, and not what each source costs.
    Result
        --figure FILE  Draw the sources in a pdf, svg or png.
        --format NAME  text, csv or latex.
    Output
        --quiet  Print the answer only, without its tables.
    """
    from eqt_cli.cli.tables import as_csv, as_latex
    from eqt_cli.extensions.budget.budget import SHARES
    from eqt_cli.extensions.budget.budget import budget as budget_of
    from eqt_cli.extensions.budget.tables import BudgetInWords, in_latex
    from eqt_cli.results.quantity import Window

    if json and format is not TableFormat.TEXT:
        raise EqtError("--json prints one document; leave --format out")
    if total and (figure or format is not TableFormat.TEXT):
        raise EqtError("--figure, csv and latex are of the sources, which --total leaves out")
    shares = _shares(quantile or SHARES)
    if figure:
        from eqt_cli.figures.render import format_of

        format_of(figure)  # before the runs
    over = Window.parse(window) if window else None
    document = options.document_of(config, set_, engine, trust_plugins=trust_plugins)
    study = options.study_at(document, point, "computed without")
    setup = options.Setup(engine=engine, workers=workers, executor=executor)
    chosen = run.executor_from(study, setup)
    answer = budget_of(study, chosen, error=error, window=over, shares=shares, total=total)
    say = BudgetInWords(answer)
    if figure:
        from eqt_cli.extensions.budget.figures import draw

        draw(say, figure)
    if json:
        output.print_json({"path": str(config), **answer.record()})
    elif format is TableFormat.CSV:
        output.print_verbatim(as_csv(answer.records()))
    elif format is TableFormat.LATEX:
        of_laws = (as_latex(in_latex(say.sources(law))) for law in answer.laws)
        output.print_verbatim("\n\n".join(of_laws))
    elif quiet:
        output.print_verbatim("\n".join(line for law in answer.laws for line in say.answer(law)))
    else:
        _print(say)


def _print(say: BudgetInWords) -> None:
    """Print the answer on each law with its sources, then the quantiles of all."""
    for law in say.budget.laws:
        output.print_text(*say.answer(law))
        if law.rows:
            output.print_text("", output.laid_out(say.sources(law)))
        output.print_text("")
    output.print_text(output.laid_out(say.quantiles()))


def _shares(wished: Sequence[float]) -> tuple[float, ...]:
    """Return the shares of quantiles, none of them in per cent."""
    for share in wished:
        if not 0 < share < 1:
            hint = f"; {share:g} % is {share / 100:g}" if 1 <= share < 100 else ""
            raise EqtError(f"--quantile: expected a share between 0 and 1, got {share:g}{hint}")
    return tuple(wished)
