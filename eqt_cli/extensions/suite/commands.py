"""`eqt suite`: a law in one file beside the laws of the archive, on standard tasks."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from enum import StrEnum
from pathlib import Path
from shlex import quote
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base.errors import EqtError
from eqt_cli.cli import options, output
from eqt_cli.cli.options import Command, Group, example

if TYPE_CHECKING:
    from eqt_cli.extensions.suite.archive import Archive
    from eqt_cli.extensions.suite.tasks import Task

TableFormat = StrEnum(
    "TableFormat", {"TEXT": "text", "LATEX": "latex", "CSV": "csv", "HTML": "html", "JSON": "json"}
)


class _Suite(Group):
    """The group, in which a law's file stands for ``run FILE``."""

    def resolve_command(self, ctx: Any, args: list[str]) -> Any:
        """Return the command that is named, or `run`."""
        is_named = args[0] in self.commands or args[0].startswith("-")
        return super().resolve_command(ctx, args if is_named else ["run", *args])


app = typer.Typer(
    cls=_Suite,
    help="Judge tracking laws on standard tasks, at a bounded effort, beside those of an archive.",
    epilog=example("eqt suite", "mylaw.py"),
    invoke_without_command=True,
)

Tasks = Annotated[str | None, options.option("--tasks")]
Laws = Annotated[str | None, options.option("--laws")]


def _names(listed: str | None) -> list[str]:
    """Return the names in an option; without the option none, which stands for all."""
    if listed is None:
        return []
    names = [name.strip() for name in listed.split(",")]
    if not all(names):
        raise EqtError(f"expected names as A,B, got '{listed}'; without the option, all are meant")
    return names


@app.callback()
def main(ctx: typer.Context, json: options.Json = False) -> None:
    """Judge tracking laws on standard tasks, at a bounded effort, beside those of an archive."""
    if ctx.invoked_subcommand is not None:
        return
    from eqt_cli.extensions.suite.actions import current
    from eqt_cli.extensions.suite.archive import shipped_archive
    from eqt_cli.extensions.suite.overview import overview_record, overview_table
    from eqt_cli.extensions.suite.tasks import all_tasks

    tasks = all_tasks()
    archive = current(shipped_archive(), tasks, "the archive")
    if json:
        return output.print_json(overview_record(tasks, archive))
    output.print_text(*overview_table(tasks, archive))


@app.command("run", cls=Command, epilog=example("eqt suite run", "mylaw.py"))
def run(
    law: Annotated[
        str,
        typer.Argument(
            metavar="LAW",
            help="The law's file: .py, .c[:FUNCTION], .yaml of a network; or a label.",
        ),
    ],
    gains: Annotated[Path | None, options.option("--gains")] = None,
    tasks: Tasks = None,
    out: options.Out = None,
    workers: options.Workers = None,
    force: Annotated[bool, options.option("--force")] = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Tune a law on each task, judge it on held-out runs, and print it beside the archive.

    The word `run` may be left out. After an interruption, run the same command again.

    Options
    -------
    Experiment
        --gains FILE  YAML with your gains by task, {quad_att: {kp: 2.0, kd: 0.4}}, which are
            judged as they are.
        --tasks A,B  Only these tasks; then there is no mean over tasks.
    """
    from eqt_cli.extensions.suite.api import suite

    cores = workers or options.cores()
    table = suite(law, _names(tasks), gains=gains, out=out, force=force, workers=cores)
    _print(table.archive, table.tasks, TableFormat.TEXT, json=json, laws=[table.law])
    if json:
        return
    output.print_text(
        f"results  {table.folder}", f"next     eqt suite pack {quote(str(table.folder))}"
    )


@app.command("show", cls=Command, epilog=example("eqt suite show", "results/suite/mylaw"))
def show(
    results: Annotated[
        list[Path] | None,
        typer.Argument(
            metavar="[DIR…]",
            help="Folders of judged laws, or packs; or a task, as late. Default: none.",
        ),
    ] = None,
    format: Annotated[TableFormat, options.option("--format")] = TableFormat.TEXT,
    laws: Laws = None,
    figure: Annotated[Path | None, options.option("--figure")] = None,
    json: options.Json = False,
) -> None:
    """Print judged laws beside those of the archive, or the file of a task; nothing is computed.

    Options
    -------
    What to show
        --laws A,B  Only these laws, and those in the folders.
        --figure FILE  Draw the ratios by task, in a .pdf, .svg, .png or .tiff.
    Output
        --format NAME  text, latex, csv, html or json.
    """
    from eqt_cli.extensions.suite import actions
    from eqt_cli.extensions.suite.tasks import chosen_tasks, text_of_task

    if results and len(results) == 1 and (text := text_of_task(results[0])):
        output.print_findings({"task": results[0].name, "text": text}, text.rstrip(), json=json)
        return
    tasks = chosen_tasks([])
    archive, labels = actions.beside_archive(results or [], tasks, _names(laws))
    if figure is not None:
        from eqt_cli.extensions.suite.figures import forest
        from eqt_cli.extensions.suite.verdicts import verdicts

        forest(verdicts(archive, tasks), archive, figure)
    _print(archive, tasks, format, json=json, laws=labels)
    if figure is not None:
        output.say(f"figure   {figure}")


@app.command("pack", cls=Command, epilog=example("eqt suite pack", "results/suite/mylaw"))
def pack(
    result: Annotated[Path, typer.Argument(metavar="DIR", help="Folder of a judged law.")],
    out: Annotated[Path | None, options.option("--out")] = None,
    json: options.Json = False,
) -> None:
    """Write one file with gains, held-out numbers and the source of a law, to attach to a paper.

    Options
    -------
    Result
        --out FILE  File to write. Default: the law's name and .eqtsuite.zip.
    """
    from eqt_cli.extensions.suite import actions

    path = actions.pack(result, out)
    size = path.stat().st_size
    answer = {"file": str(path), "bytes": size}
    lines = [f"{path}, {size / 1e3:.0f} kB", f"next     eqt suite check {quote(str(path))}"]
    output.print_findings(answer, *lines, json=json)


@app.command("check", cls=Command, epilog=example("eqt suite check", "mylaw.eqtsuite.zip"))
def check(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="A pack, or a folder. Default: the archive."),
    ] = None,
    law: Annotated[str | None, options.option("--law")] = None,
    laws: Laws = None,
    tasks: Tasks = None,
    share: Annotated[float, options.option("--share", min=0, max=1)] = 0.1,
    no_fresh: Annotated[bool, options.option("--no-fresh")] = False,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compute a share of the runs again, and judge the laws on fresh runs.

    The exit code is 4 if runs differ, or if a law on fresh runs fails, is worse than on the public
    ones by more than chance and 1 %, or spends more than stated. A file is data: it runs nothing.

    Options
    -------
    Experiment
        --law FILE  The law of a user in the file, which you have read: it is executed. Its source
            must be that in the file.
        --laws A,B  Only these laws.
        --tasks A,B  Only these tasks.
        --share X  Share of the runs that are computed again. The hash of the numbers draws them.
        --no-fresh  Compute no fresh runs.
    """
    from eqt_cli.extensions.suite import actions

    outcome = actions.check(
        file,
        law,
        _names(laws),
        _names(tasks),
        workers or options.cores(),
        share=share,
        has_fresh=not no_fresh,
    )
    output.print_findings(outcome.record(), *outcome.answer(), json=json)
    if not outcome.holds:
        raise typer.Exit(4)


@app.command("propose", cls=Command, epilog=example("eqt suite propose", "mytask.yaml"))
def propose(
    task: Annotated[Path, typer.Argument(metavar="TASK", help="YAML of a task.")],
    laws: Laws = None,
    out: options.Out = None,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Judge a task: does it tell laws apart, is it a copy, or is it decided by tuning noise.

    Tunes the laws of the archive on it, which takes some minutes. The exit code is 4 if it is no
    task for a suite.

    Options
    -------
    Experiment
        --laws A,B  Only these laws of the archive.
    """
    from eqt_cli.extensions.suite import actions

    proposed = actions.propose(task, _names(laws), out, workers or options.cores())
    output.print_findings(proposed.record(), *proposed.lines(), json=json)
    if proposed.faults:
        raise typer.Exit(4)


@app.command("archive", cls=Command, epilog=example("eqt suite archive", "--out archive.zip"))
def archive(
    out: Annotated[Path | None, options.option("--out")] = None,
    laws: Laws = None,
    tasks: Tasks = None,
    folder: Annotated[Path | None, options.option("--folder")] = None,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Compute the archive anew: all its laws on all tasks, which takes 20 CPU minutes.

    Searches that the folder holds are used again.

    Options
    -------
    Experiment
        --laws A,B  Only these laws.
        --tasks A,B  Only these tasks.
    Result
        --out FILE  File of the archive. Needed for a part. Default: that of the installed eqt.
        --folder DIR  Folder of the searches. Default: results/suite.
    """
    from eqt_cli.extensions.suite import actions
    from eqt_cli.extensions.suite import archive as archives
    from eqt_cli.extensions.suite.tasks import chosen_tasks

    if out is None and (laws or tasks):
        raise EqtError("a part would replace the whole archive; name another file by --out")
    path, cores = out or archives.ARCHIVE, workers or options.cores()
    whole = actions.write_archive(
        _names(laws), _names(tasks), path, folder or actions.FOLDER, cores
    )
    _print(whole, chosen_tasks(_names(tasks)), TableFormat.TEXT, json=json)
    if json:
        return
    output.print_text(f"archive  {path}, {path.stat().st_size / 1e6:.2f} MB")


@app.command("repeat", cls=Command, epilog=example("eqt suite repeat", "--tasks sat_ideal"))
def repeat(
    laws: Laws = None,
    tasks: Tasks = None,
    seed: Annotated[int | None, options.option("--seed", min=0)] = None,
    folder: Annotated[Path | None, options.option("--folder")] = None,
    workers: options.Workers = None,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Tune the archive's laws on other training samples: is a resolved verdict reversed.

    All laws on all tasks take 20 CPU minutes. The exit code is 4 if a resolved verdict is reversed.

    Options
    -------
    Experiment
        --laws A,B  Only these laws, and GT.
        --tasks A,B  Only these tasks.
        --seed N  Seed of the first training sample. Default: 100 more than in the task.
    Result
        --folder DIR  Folder of the searches. Default: results/suite-again.
    """
    from eqt_cli.extensions.suite import actions

    again = actions.repeat(
        _names(laws), _names(tasks), seed, folder or actions.AGAIN, workers or options.cores()
    )
    output.print_findings(again.record(), *again.lines(), json=json)
    if again.reversed:
        raise typer.Exit(4)


def _print(
    archive: Archive,
    tasks: Mapping[str, Task],
    format: TableFormat,
    *,
    json: bool,
    laws: Sequence[str] = (),
) -> None:
    """Print what is said of judged laws, the given ones first."""
    from eqt_cli.cli.tables import as_csv, as_latex
    from eqt_cli.extensions.suite import tables, verdicts
    from eqt_cli.extensions.suite.page import page
    from eqt_cli.results.quantity import Latex, Plain

    if json or format is TableFormat.JSON:
        return output.print_json(tables.judged_records(archive, tasks))
    write = Latex() if format is TableFormat.LATEX else Plain()
    of_tasks = verdicts.verdicts(archive, tasks)
    rows = verdicts.overall(of_tasks, archive, tasks)
    shown = [tables.overall_table(rows, archive, write)] if rows else []
    shown.append(tables.task_table(of_tasks, archive, tasks, write))
    if format is TableFormat.CSV:
        return output.print_verbatim(as_csv([judgement.record() for judgement in of_tasks]))
    if format is TableFormat.LATEX:
        # Each task has a table of its own: all of them are longer than a page.
        parts = [replace(table, blocks=[block]) for table in shown for block in table.blocks]
        lines = [f"% {tables.heading(tasks)}; needs booktabs", *map(as_latex, parts)]
        return output.print_verbatim("\n\n".join(lines))
    said = [
        line for law in laws for line in tables.answer(law, of_tasks, rows, archive.laws[law].title)
    ]
    if format is TableFormat.HTML:
        return output.print_verbatim(page(tables.heading(tasks), said, shown))
    output.print_text(*said, *([""] if said else []))
    for table in shown:
        output.print_text(output.laid_out(table), "")
    output.print_text(f"suite    {tables.heading(tasks)}")
