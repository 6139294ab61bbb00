"""The purposes for which extensions have functions: who asks, with what, and for what.

Each purpose is a signature and a sentence; `Extension.add_function` names a function for it. Of
`one`, a command refuses without the extension; of `every`, any number may answer. The types are
those of `eqt_cli.extend`.
"""

# mypy: disable-error-code="empty-body"

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

from eqt_cli.base.extensions import every, one

if TYPE_CHECKING:
    from eqt_cli import extend as core  # for types only, and so no import upward

Answer: TypeAlias = "tuple[dict[str, Any], list[dict[str, Any]], list[core.TextTable], list[str]]"
"""A document, rows, tables and remarks."""

Group: TypeAlias = "core.MatrixLieGroup"

Names: TypeAlias = "Sequence[str]"

# Configurations and experiments -------------------------------------------------------------------


@one("extends")
def extends(document: core.Document) -> core.Document:
    """Return a configuration with all that it takes over; `eqt run` and all that reads one."""


@one("rules of a sweep")
def rules_of_a_sweep(
    entries: Mapping[Any, Mapping[str, Any]], swept: Names, problems: core.Problems
) -> Any:
    """Return what follows from swept keys by `set` and `without`; `eqt sweep`, `tune`."""


@every
def text_of_a_recording(
    path: Path, missing: str, kind: type[core.EqtError], limit: int, smaller: str
) -> str:
    """Return a recording as the text of a table; whatever names a file of one."""


@one("initial.file")
def initial_file(text: str, name: str, G: Group, mapping: Any) -> Any:
    """Return the starts in a file: poses, velocities and notes; `initial.file`."""


@one("log in a file")
def log_in_a_file(component: Any, G: Group) -> Any:
    """Return the log in the file of a component; references and laws that read a file."""


@one("reference.smoothing")
def reference_smoothing(reference: core.WaypointsReference, G: Group) -> Any:
    """Return waypoints on a smooth motion; `reference.smoothing`."""


@every
def proposed_smoothing(G: Group, times: core.Array, poses: core.Array) -> str:
    """Return the option `smoothing` that the noise of a recording needs, or ""; remarks."""


@every
def remarks_on_waypoints(reference: core.WaypointsReference, G: Group) -> Iterator[str]:
    """Yield the oddities of the file of waypoints; `eqt config check`, `eqt run`."""


@every
def remarks_on_an_experiment(
    experiment: core.Experiment, shown: Any
) -> Iterable[tuple[core.KeyPath, str]]:
    """Yield remarks with the key that they are about; `eqt config check`, `eqt run`."""


@every
def checks_of_an_experiment(experiment: core.Experiment, problems: core.Problems) -> None:
    """Note what no run can have; every command that builds an experiment."""


@every
def remarks_on_other_values(
    base: core.Experiment, others: Iterable[tuple[str, core.Experiment]]
) -> tuple[str, ...]:
    """Tell remarks that `base` has not; points of sweeps and ends of ranges, with where."""


@one("draws")
def draws(document: core.Document, problems: core.Problems, take: Any) -> dict[str, Any]:
    """Return the data of a configuration, its formulas in names of `draws` parsed."""


@one("draws of initial states")
def starts_of_draws(
    start: Any, config: Any, document: core.Document, problems: core.Problems, take: Any, G: Group
) -> Any:
    """Return the starts of runs, with the names and the table of `draws`."""


@every
def meaning_of_an_experiment(experiment: core.Experiment, shown: Any) -> Iterable[Any]:
    """Yield tables and lines on what the numbers of an experiment mean; `eqt config check`."""


@every
def check_of_a_configuration(document: core.Document) -> None:
    """Raise a `ConfigError` with the errors of a section, or remark; `eqt config check`."""


@one("config new of a vehicle")
def configuration_of_a_vehicle(
    source: str | None, options: Mapping[str, Any]
) -> tuple[str, str, list[str]]:
    """Return a configuration as text, its name, and lines on its vehicle; `eqt config new`."""


# Runs and results ---------------------------------------------------------------------------------


@one("run --grow")
def run_grow(session: Any, *, drops: bool) -> Any:
    """Make a result the result of another study: compute what it lacks; `eqt run --grow`."""


@one("run --rerun-failed")
def run_rerun_failed(session: Any) -> Any:
    """Compute the failed runs of a result again; `eqt run --rerun-failed`."""


@one("pack --out")
def pack_out(paths: Sequence[Path], out: Path, *, trusted: bool) -> Any:
    """Write the result of all points, laws and seeds of several results; `eqt pack --out`."""


@every
def variables_of_a_result(study: core.Study) -> Mapping[str, core.Variable]:
    """Return further variables of a result by name; `eqt run`."""


@one("metrics that judge constraints")
def judge_constraints(batch: Any, names: Names, first: Any, threads: int) -> Any:
    """Return a solution with what the motion between samples says of constraints; `eqt run`."""


@every
def errors_of_a_result(study: core.Study) -> Mapping[str, Any]:
    """Return attributes of a result on how much its numbers err; `eqt run`, after the runs."""


@every
def remarks_on_a_result(result: core.ResultFile) -> Iterable[str]:
    """Yield lines on how a result was computed; `eqt show`, `eqt compare`."""


@every
def laws_that_runs_flatter(document: core.Document, which: str) -> Iterable[str]:
    """Yield a sentence on each law trained on the runs of a document; `tune`, `worst`, `suite`."""


@every
def seeds_of_judges(document: core.Document) -> Iterable[tuple[str, int]]:
    """Yield keys and seeds of further runs that judge the laws of a document; `gym.make`."""


@one("tasks by name")
def task_by_name(
    name: str,
) -> tuple[core.Document, core.KeyPath, str, Mapping[str, float], Mapping[str, int]]:
    """Return a task, the place of its law, its objective, bound and seeds; `gym.make`."""


@every
def conclusion_of_a_result(result: core.Result) -> core.Conclusion | None:
    """Return tables, default figures and laws to compare, or None; `show`, `compare`, `report`."""


@every
def answers_of_a_result(result: core.Result) -> tuple[dict[str, Any], list[core.TextTable]] | None:
    """Return an answer for programs, and tables that stand before all others; `show`, `compare`."""


@every
def answer_of_compare(
    result: core.Result, how: core.Resampling, write: core.Plain, metrics: Names, laws: Names
) -> tuple[dict[str, Any], list[dict[str, Any]], list[core.TextTable]] | None:
    """Return document, rows and tables in place of the usual ones, or None; `eqt compare`."""


@one("compare --fail-on")
def compare_fail_on(
    fail_on: Names, baseline: core.Result, candidate: core.Result, windows: Sequence[core.Window]
) -> Callable[[Any, Mapping[str, str]], list[Any]]:
    """Return what says whether each rule holds in a comparison; `eqt compare --fail-on`."""


@one("compare --pooled")
def compare_pooled(
    result: core.Result,
    how: core.Resampling,
    write: core.Plain,
    metrics: Names,
    laws: Names,
    negligible: float,
) -> Answer:
    """Return the findings over all points of a sweep; `eqt compare --pooled`."""


@one("compare --measured")
def compare_measured(
    result: Path,
    measured: Path,
    mapping: Path | None,
    *,
    format: str,
    run: int,
    controllers: Names,
    point: int | None,
    units: Names,
) -> Sequence[Any]:
    """Return what runs explain of a recording, by law; `eqt compare --measured`."""


@one("findings on a recording")
def findings_on_a_recording(
    explanations: Sequence[Any], measured: Path, write: core.Plain, whole: bool
) -> Answer:
    """Return what `eqt compare --measured` prints of what runs explain."""


@one("plot --measured")
def plot_measured(path: Any, G: Group, mapping: Any, format: str) -> Any:
    """Return a recording that stands beside a run; `eqt plot --measured`."""


@every
def figure_of_loads(
    runs: core.ShownRuns, width: Any, members: Mapping[str, int], signal: str, run: int
) -> Any:
    """Return a drawing with a row for each thruster, in place of curves; figure `torque`."""


@one("--option certified")
def figure_certified(swept: Any, angle: float) -> Iterable[str]:
    """Yield the proofs for starts within an angle; `eqt plot --option certified=`."""


@one("show --run")
def show_run(result: core.Result, run: int, names: Names, *, json: bool) -> None:
    """Print how a run ended under each law; `eqt show --run`."""


@one("show --failures")
def show_failures(result: core.Result, names: Names, *, json: bool) -> None:
    """Print where laws fail; `eqt show --failures`."""


@one("show --export")
def show_export(result: core.Result, path: Path, laws: list[str], run: int) -> None:
    """Write a run as a file of another program; `eqt show --export`."""


@one("show --diagram")
def show_diagram(config: Path, out: Path | None, point: int | None, trust_plugins: bool) -> None:
    """Print the block diagram of a loop, or write it; `eqt show --diagram`."""


@every
def boxes_of_a_diagram(experiment: core.Experiment) -> Iterable[tuple[str, str, list[str]]]:
    """Yield stage, title and lines of further boxes; `eqt show --diagram`."""


@every
def certificates_of_a_report(
    result: core.Result, trust_plugins: bool, workers: int
) -> Mapping[str, Any]:
    """Return tables by their place in the page; `eqt report`."""


@every
def diagram_of_a_report(result: core.Result, trust_plugins: bool) -> str:
    """Return the diagram of a loop as a part of a page; `eqt report`."""


@one("report --live")
def report_live(result: core.Result, trusted: bool) -> dict[str, str]:
    """Return a part with sliders, its `html` and `css`; `eqt report --live`."""


@every
def citations(folder: Path) -> tuple[list[str], list[str]]:
    """Return kinds of laws and entries of BibTeX of a folder; `eqt cite`."""


# Proofs, code and searches ------------------------------------------------------------------------


@one("verify --code")
def verify_code(
    document: core.Document, code: str, claimed: str | None, adapter: Path | None
) -> core.Document:
    """Return the configuration with a law in code as its only one; `eqt verify --code`."""


@one("answers on code")
def answers_on_code(rows: Iterable[Any], experiment: Any) -> Iterable[dict[str, str]]:
    """Yield for each law in code whether it is what it claims to be; `eqt verify --code`."""


@one("verify --plant")
def verify_plant(
    experiment: Any, plant: str, adapter: Path | None, simulator: bool
) -> tuple[dict[str, Any], str, core.TextTable]:
    """Return record, answer and table on a plant of somebody else; `eqt verify --plant`."""


@one("--adapter")
def adapter_of_code(file: Path, G: Group) -> Any:
    """Return names, frames and units in which code has what a law reads; `export --adapter`."""


@one("code in Python")
def function_in_python(
    file: str,
    function: str,
    text: str,
    arguments: Mapping[str, core.Array],
    *,
    call: str,
    result: str,
    returns: int,
    period: float,
) -> Any:
    """Return a function that runs in a separate process, after a call; `eqt verify --plant`."""


@one("signals of code")
def signal_of_code(**keys: Any) -> Any:
    """Return a signal as code has it: in a frame, an order and a unit; `verify --plant`."""


@every
def identities_of_laws(experiment: core.Experiment) -> Mapping[str, str]:
    """Return by label how many identities of a law hold, in words; the README of `eqt export`."""


@every
def proved_objective() -> Any:
    """Return what finds the best gains by proofs; `tune.objective`, by the key it is named by."""


@one("worst --certified")
def worst_certified(angle: float) -> Callable[[Path, str], str]:
    """Return what states the proof of a law for starts within an angle; `worst --certified`."""


# Commands -----------------------------------------------------------------------------------------


@every
def commands_of_config(app: Any) -> None:
    """Add a command to the group `eqt config`."""


@every
def commands_of_log(app: Any) -> None:
    """Add a command to the group `eqt log`."""


@every
def meaning_of_a_word(word: str, but: Collection[str]) -> tuple[dict[str, Any], list[Any]]:
    """Return what a word leads to, as data, and as text and tables; `eqt list WORD`."""


@every
def command_for_a_word(word: str) -> str:
    """Return the command for a word that is none, or ""; any unknown command."""
