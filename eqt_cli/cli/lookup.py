"""`eqt list` and `eqt config`: components and configurations."""

from __future__ import annotations

import re
import textwrap
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from eqt_cli.base import purposes
from eqt_cli.base.errors import ConfigError, EqtError, Problems, suggestion
from eqt_cli.base.extensions import all_kinds, function_for, functions_for
from eqt_cli.base.extensions import shipped as shipped_extensions
from eqt_cli.base.files import new_file, refusals
from eqt_cli.base.registry import load_plugin, registry, summary
from eqt_cli.cli import completion, options, output
from eqt_cli.cli.options import Command, Group, example
from eqt_cli.cli.output import print_findings
from eqt_cli.config import shipped

if TYPE_CHECKING:
    from rich.text import Text


# `eqt list`: the available components ------------------------------------------------------------


def list_components(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="KIND|NAME|WORD",
            help=f"{', '.join(all_kinds())}, configs, laws or starts, in singular or plural; "
            "or the name of a component, or a word to search for. Default: counts all kinds.",
            autocompletion=completion.listed,
        ),
    ] = None,
    plugin: Annotated[
        list[Path] | None,
        typer.Option("--plugin", metavar="FILE", help="Load a plugin file first. Repeatable."),
    ] = None,
    json: options.Json = False,
) -> None:
    """List the available components, such as laws and sensors, or the options of one of them."""
    kinds, kind = [*all_kinds(), "configs"], " ".join(words or ()) or None
    if plugin:
        for name in all_kinds():
            registry(name)  # a plugin may define any kind
    for path in plugin or ():
        load_plugin(path)
    named = kinds if kind is None else [name for name in kinds if name in _plurals(kind)]
    if not named:
        return _explain(str(kind), kinds, json)
    listed = {name: _described(name) for name in named}
    if json or kind is None:
        counts = [[name, str(len(of))] for name, of in listed.items()]
        more = "`eqt list KIND` shows one kind, `eqt list NAME` one of its components"
        print_findings(listed, output.table(["kind", "number"], counts), "", more, json=json)
        return
    for name, entries in listed.items():
        output.print_text(f"{name}:")
        header = ["name", "meaning", *list(entries[0])[2:]]
        output.print_records(header, [[*entry.values()] for entry in entries], json=False)


def _plurals(word: str) -> set[str]:
    """Return the kinds that a word may mean, in singular or plural; starts are two kinds."""
    one = word.removesuffix("s")
    meant = {"law": {"controllers"}, "start": {"poses", "velocities"}}
    return meant.get(one, {word, f"{word}s", f"{word.removesuffix('y')}ies"})


def _explain(name: str, kinds: list[str], json: bool) -> None:
    """Print the options of the components of this name, and an example from a configuration."""
    from eqt_cli.base.yaml_source import dump
    from eqt_cli.config.json_schema import keys_of_component

    components = _of_name(name)
    of_words, more = dict[str, Any](), list[Any]()
    for tell in functions_for(purposes.meaning_of_a_word):
        of_words, more = tell(name, {component.name for component in components.values()})
    if not components and not more:
        names = [
            *kinds,
            *(component for kind in all_kinds() for component in registry(kind).names()),
        ]
        hint = suggestion(name, names) or f"; kinds: {', '.join(kinds)}"
        raise EqtError(f"unknown kind or component '{name}'{hint}")
    name = min((component.name for component in components.values()), default=name)
    config, part = shipped.using(name) if components else ("", {})
    records = []
    texts: list[str | Text] = []
    for kind, component in components.items():
        keys = [asdict(entry) for entry in keys_of_component(component)]
        records.append({"kind": kind, "name": name, "summary": summary(component), "options": keys})
        texts += [*([""] if texts else []), f"{name}, of {kind}: {summary(component)}"]
        if keys:
            rows = [[text.replace("`", "") for text in entry.values()] for entry in keys]
            texts += ["", output.table(["option", "value", "default", "meaning"], rows)]
    if config:
        texts += ["", f"example, from configs/{config}.yaml; it runs by `eqt run {config}`:", ""]
        texts.append(textwrap.indent(dump(part).rstrip(), "  "))
    document = {"components": records, "config": config or None, "example": part or None}
    print_findings({**document, **of_words}, *texts, *more, json=json)


def _of_name(name: str) -> dict[str, Any]:
    """Return the components of this name by their kind."""
    named = {kind: (registry(kind), registry(kind).written(name)) for kind in all_kinds()}
    return {kind: of.get(same) for kind, (of, same) in named.items() if same in of.names()}


def _described(kind: str) -> list[dict[str, Any]]:
    import yaml  # loaded by no help page

    from eqt_cli.base.option_types import has_options, option_names

    if kind == "configs":
        return [
            {"name": config, "summary": shipped.summary(config), "options": []}
            for config in shipped.names()
        ]
    if kind == "metrics":
        from eqt_cli.base.stored import signal_of
        from eqt_cli.results.metrics import METRICS, own_quantity

        listed = []
        for metric in (*METRICS, *map(own_quantity, registry(kind).all())):
            of_signal = getattr(signal_of(metric.signals[0]), "unit", "unit of the signal")
            unit = metric.unit(of_signal.replace("_", " "))  # such as the force unit of the group
            listed.append({"name": metric.name, "summary": metric.long_name, "unit": unit})
        return listed
    first = yaml.safe_load(shipped.text("paper"))["controllers"]  # the paper's laws lead the list
    ordered = sorted(registry(kind).all(), key=lambda law: [*first, law.name].index(law.name))
    return [
        {
            "name": component.name,
            "summary": summary(component),
            "options": option_names(component) if has_options(component) else [],
        }
        for component in ordered
    ]


# `eqt config`: configurations ---------------------------


VEHICLES = ("quadrotor", "satellite", "auv", "boat")
"""Vehicles whose configuration follows from some numbers."""

VEHICLE_FILES = (".sdf", ".urdf", ".xacro", ".xml", ".mjcf", ".jinja")
"""Suffixes of files of vehicles."""

MOST_CHECKED = 300
"""Maximum number of points of a sweep that are checked, spread over all of them."""

app = typer.Typer(
    cls=Group,
    help="Write, check and describe configurations.",
    epilog=example("eqt config", "keys gains.kp"),
    no_args_is_help=True,
)


@app.command("new", cls=Command, epilog=example("eqt config new", "mine.yaml --from paper"))
def new(
    file: Annotated[
        Path | None,
        typer.Argument(metavar="FILE", help="File to write, or - for stdout. Default: NAME.yaml."),
    ] = None,
    source: Annotated[
        str | None, options.option("--from", autocompletion=completion.shipped)
    ] = None,
    vehicle: Annotated[str | None, options.option("--vehicle", names=VEHICLES)] = None,
    mass: Annotated[float | None, options.option("--mass")] = None,
    inertia: Annotated[str | None, options.option("--inertia")] = None,
    bandwidth: Annotated[float | None, options.option("--bandwidth")] = None,
    models: Annotated[list[Path] | None, options.option("--models")] = None,
    thrust: Annotated[str | None, options.option("--thrust")] = None,
    reversible: Annotated[bool, options.option("--reversible")] = False,
    without: Annotated[list[str] | None, options.option("--without")] = None,
    wingless: Annotated[bool, options.option("--wingless")] = False,
    arg: Annotated[list[str] | None, options.option("--arg")] = None,
    quiet: options.Quiet = False,
) -> None:
    """Create your own configuration from a shipped one, or of a vehicle: from its file or numbers.

    Options
    -------
    Experiment
        --from NAME|FILE  Shipped configuration to start from, or an SDF, URDF, xacro or MJCF file
            of a vehicle. Default: paper.
    A vehicle
        --vehicle NAME  quadrotor, satellite, auv or boat. Its gains follow from these numbers. Of a
            vehicle from a file, what moves it, if the file does not say.
        --mass M  Mass, kg.
        --inertia A,B,C  Principal moments of inertia, kg m²; of a boat the one about the vertical;
            or ixx,ixy,ixz,iyy,iyz,izz.
        --bandwidth W  Both closed-loop poles of each small error, rad/s.
    A vehicle from a file
        --models DIR  Folder of included models, or of ROS packages. Repeatable.
        --thrust LOW,HIGH  Limits of the thrust of each rotor, N, instead of those in the file.
        --reversible  Rotors push both ways.
        --without NAME  Link or included model to leave out. Repeatable.
        --wingless  Leave out the lift and drag of wings and fins.
        --arg NAME=VALUE  Argument of a xacro file. Repeatable.
    """
    of_vehicle = {
        "vehicle": vehicle,
        "mass": mass,
        "inertia": inertia,
        "bandwidth": bandwidth,
        "models": models,
        "thrust": thrust,
        "reversible": reversible or None,
        "without": without,
        "wingless": wingless or None,
        "arg": arg,
    }
    chosen = {option: value for option, value in of_vehicle.items() if value not in (None, [])}
    name, facts = source or "paper", list[str]()
    if chosen or Path(name).suffix in VEHICLE_FILES:
        of_a_vehicle = function_for(purposes.configuration_of_a_vehicle)
        text, name, facts = of_a_vehicle(source, chosen)
    else:
        text = shipped.text(name)
    if file == Path("-"):
        return output.print_verbatim(text)
    file = file or Path(f"{name}.yaml")
    with refusals(file, "written"):
        file.parent.mkdir(parents=True, exist_ok=True)
        try:
            new_file(file, text.encode())
        except FileExistsError:
            raise EqtError(f"{file}: already exists; give another name, or remove it") from None
    output.print_text(str(file), *facts)
    if facts:
        check(file)
    output.say(f"next: eqt run {file}")


@app.command("check", cls=Command, epilog=example("eqt config check", "mine.yaml --set gains.kp=2"))
def check(
    config: Annotated[
        Path, typer.Argument(metavar="CONFIG", help="YAML configuration, or a result.")
    ],
    set_: options.Set = None,
    resolved: Annotated[bool, options.option("--resolved")] = False,
    most_torque: Annotated[float | None, options.option("--most-torque")] = None,
    trust_plugins: options.TrustPlugins = False,
    json: options.Json = False,
    quiet: options.Quiet = False,
) -> None:
    """Check a configuration, and its reference over the whole horizon, without running it.

    It executes the plugins of a YAML configuration, and those of a result only on request.

    Options
    -------
    Output
        --resolved  Print the configuration with all defaults.
    Experiment
        --most-torque TORQUE  Report an error if the reference needs a larger torque.
    """
    from eqt_cli.base.yaml_source import dump
    from eqt_cli.components.vehicle import exactly_measured
    from eqt_cli.config.remarks import remarks, wheels_needed
    from eqt_cli.config.study import spread, study
    from eqt_cli.engines.horizon import check_reference
    from eqt_cli.runs.preflight import check_resources, rehearse

    document = options.document_of(config, set_, trust_plugins=trust_plugins)
    try:
        checked = study(document, most_checked=MOST_CHECKED)
        if len(checked.shapes) <= MOST_CHECKED:  # each takes a moment to build
            check_resources(checked, Path("results") / checked.name)
        problems = Problems(document.place)
        shown = checked.base.reference_over_horizon()
        jumps = check_reference(shown, most_torque, problems.at("reference"))
        problems.raise_if_any()
        untried = rehearse(checked, solves=True)
        points = spread(len(checked), MOST_CHECKED)[1:]
        for more in functions_for(purposes.remarks_on_other_values):
            more(checked.base, ((f"at point {k}", checked.experiment(k)) for k in points))
        # Extensions check sections of their own; each function takes the document, and raises a
        # `ConfigError` with what is wrong in it.
        for check_sections in functions_for(purposes.check_of_a_configuration):
            check_sections(document)
    except ConfigError as error:
        if not json:
            raise
        problem_records = output.problem_records(error.problems)
        output.print_json({"config": str(config), "fine": False, "problems": problem_records})
        raise typer.Exit(error.exit_code) from error
    if resolved:
        return output.print_source(checked.resolved, dump(checked.resolved), json=json)
    experiment = checked.base
    few = f"; {MOST_CHECKED} of {len(checked)} points were checked"
    text = (
        f"✓ {config}: valid{few if len(checked) > MOST_CHECKED else ''}\n"
        f"{experiment.name}: {experiment.group.name}, "
        + (f"{len(checked)} points × " if checked.sweep else "")
        + f"{output.count_of(len(experiment.loops), 'controller')} × "
        f"{output.count_of(experiment.config.ensemble.runs, 'run')}, "
        f"{experiment.config.time.duration:g} s, engine {experiment.engine.name}"
    )
    wheels = wheels_needed(experiment, shown)
    needed = [] if wheels is None else [f"wheels need up to {wheels.in_words}, for the reference"]
    if exact := exactly_measured(experiment.group, experiment.loop.vehicle):
        needed += [f"measured without errors: {exact}"]
    said = [*needed, *(f"reference: {x}" for x in jumps), *untried]
    # What the numbers of an experiment mean: each function yields tables and lines.
    meanings = functions_for(purposes.meaning_of_an_experiment)
    meant = [piece for meaning in meanings for piece in meaning(experiment, shown)]
    answer = {
        "config": str(config),
        "fine": True,
        "problems": [],
        "name": checked.name,
        "group": experiment.group.name,
        "points": len(checked),
        "controllers": list(experiment.loops),
        "runs": experiment.config.ensemble.runs,
        "duration": experiment.config.time.duration,
        "engine": experiment.engine.name,
    }
    print_findings(answer, text, *meant, *said, json=json)
    for remark in remarks(experiment, shown):
        output.warn(remark)


@app.command("keys", cls=Command, epilog=example("eqt config keys", "gains.kp"))
def keys(
    key: Annotated[
        str | None,
        typer.Argument(
            metavar="KEY",
            autocompletion=completion.keys,
            help="A key such as gains.kp, or a section such as gains. Default: all.",
        ),
    ] = None,
    json: options.Json = False,
) -> None:
    """Describe the keys of a configuration: value, default and meaning."""
    from eqt_cli.config.json_schema import json_schema, keys_of, within

    listed, (section, _, name) = keys_of(json_schema()), (key or "").rpartition(".")
    names = {entry.key for entry in listed}
    if key not in names and section in names and _of_name(name):
        return _explain(name, [], json)  # controllers.cascade
    if key is not None:
        listed = within(listed, key)
    if key is None and not json:
        sections = [entry.key for entry in listed if not re.search(r"[.\[]", entry.key)]
        output.print_text(
            f"{len(listed)} keys in {len(sections)} sections; `eqt config keys gains` shows one "
            f"section: {', '.join(sections)}",
            "",
        )
    rows = [[text.replace("`", "") for text in asdict(entry).values()] for entry in listed]
    output.print_records(["key", "value", "default", "meaning"], rows, json=json)


@app.command("schema", cls=Command, epilog=example("eqt config schema", "> eqt.schema.json"))
def schema() -> None:
    """Print the JSON schema of configurations, which editors use for completion and checks."""
    from eqt_cli.config.json_schema import json_schema, of_files

    output.print_json(of_files(json_schema()))


# Of eqt's own: this is read before others' extensions are, and told about them once.
for add_to in functions_for(purposes.commands_of_config, among=shipped_extensions()):
    add_to(app)
