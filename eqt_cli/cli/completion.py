"""What a shell completes; read from source files, as importing them would be felt at every Tab.

So it knows what is eqt's own, and no component of a plugin or of another distribution.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from eqt_cli.config.catalogue import KINDS

if TYPE_CHECKING:
    import ast

Completions = list[tuple[str, str]]
"""What may stand there, and what it means."""

_PLACES = {
    "controllers[0]": "eqt_cli.controllers",
    "reference": "eqt_cli.references",
    "initial.pose": "eqt_cli.ensemble.poses",
    "initial.velocity": "eqt_cli.ensemble.velocities",
    "solver": "eqt_cli.engines",
}
"""Where in a configuration the options of which components stand."""


def names(kind: str) -> Callable[[str], Completions]:
    """Completes the name of a component."""

    def complete(incomplete: str) -> Completions:
        return _starting(incomplete, _names(KINDS[kind]))

    return complete


def kinds(incomplete: str) -> Completions:
    """Completes a kind of components, for `eqt list`."""
    return _starting(incomplete, dict.fromkeys([*KINDS, "configs"], ""))


def shipped(incomplete: str) -> Completions:
    """Completes the name of a shipped configuration."""
    from eqt_cli.config.shipped import names

    return _starting(incomplete, dict.fromkeys(names(), ""))


def words(*known: str) -> Callable[[str], Completions]:
    """Completes one of these words."""
    return lambda incomplete: _starting(incomplete, dict.fromkeys(known, ""))


def keys(incomplete: str) -> Completions:
    """Completes a key of any configuration."""
    return _starting(incomplete, _all_keys(None))


def settings(ctx: typer.Context, incomplete: str) -> Completions:
    """Completes ``KEY=``, a key of any configuration or of the one that is given."""
    # What is not parsed yet, as the line ends in an option without its value, is in `args`.
    words = [ctx.params.get("config"), ctx.params.get("target"), *ctx.args]
    given = next((Path(word) for word in words if word and Path(word).is_file()), None)
    return _starting(incomplete, {f"{key}=": text for key, text in _all_keys(given).items()})


def figure_options(ctx: typer.Context, incomplete: str) -> Completions:
    """Completes ``KEY=``, an option of the figures that are asked for, or of any; and of one."""
    classes = _classes("eqt_cli.plots.base") | _classes(KINDS["figures"])
    wanted = ctx.params.get("figure") or _names(KINDS["figures"])
    found = [
        (str(_name(node)), option)
        for node in classes.values()
        if _name(node) in wanted
        for option in _fields(node, classes)
    ]
    plain = {f"{option}=": "" for _, option in found}
    dotted = {f"{name}.{option}=": "" for name, option in found} if "." in incomplete else {}
    return _starting(incomplete, plain | dotted)


def _starting(incomplete: str, known: dict[str, str]) -> Completions:
    return [(word, text) for word, text in known.items() if word.startswith(incomplete)]


# Keys of configurations ---------------------------------------------------------------------------


def _all_keys(given: Path | None) -> dict[str, str]:
    """Keys that a configuration may have, with the meanings of those that have one."""
    sections = _classes("eqt_cli.config.schema")
    found = dict(_section("Config", "", sections))
    for place, package in _PLACES.items():
        classes = _classes(package)
        options = [option for node in classes.values() for option in _options(node, classes)]
        found |= {f"{place}.{option}": "" for option in ["kind", *options]}
    del found["solver.kind"]  # there it is `engine`
    judgement = _classes("eqt_cli.config.schema")
    own = ["engine", *_fields(judgement["Judgement"], judgement)]
    found |= {f"solver.{key}": "" for key in own}
    found |= dict.fromkeys(("controllers[0].label", "reference.pose", "reference.velocity"), "")
    return found | {key: found.get(key, "") for key in _written(given)}


def _section(name: str, prefix: str, sections: dict[str, ast.ClassDef]) -> Iterator[Any]:
    for key, (annotation, meaning) in _fields(sections[name], sections).items():
        yield f"{prefix}{key}", meaning
        if annotation in sections:
            yield from _section(annotation, f"{prefix}{key}.", sections)


def _written(path: Path | None) -> list[str]:
    """The keys in a file; none where it cannot be read."""
    from eqt_cli.config.yaml_source import load
    from eqt_cli.core.errors import EqtError

    try:
        data = load(Path(path).read_bytes(), "").data if path else {}
    except (EqtError, OSError):
        return []
    return list(_below(data, ""))


def _below(data: Any, prefix: str) -> Iterator[str]:
    entries: list[tuple[str, Any]] = []
    if isinstance(data, dict):
        entries = [(f"{prefix}.{key}" if prefix else key, value) for key, value in data.items()]
    elif isinstance(data, list) and any(isinstance(entry, dict) for entry in data):
        entries = [(f"{prefix}[{index}]", value) for index, value in enumerate(data)]
    for key, value in entries:
        yield key
        yield from _below(value, key)


# Classes in source files --------------------------------------------------------------------------


def _names(package: str) -> dict[str, str]:
    """The components of a package, with their summaries."""
    import ast

    found = {
        name: (ast.get_docstring(node) or "").partition("\n")[0]
        for node in _classes(package).values()
        if (name := _name(node))
    }
    return dict(sorted(found.items()))


def _classes(module: str) -> dict[str, ast.ClassDef]:
    """The classes at the top level of a module, or of all modules of a package, by name."""
    import ast

    import eqt_cli

    path = Path(eqt_cli.__file__).parent.joinpath(*module.split(".")[1:])
    files = sorted(path.glob("*.py")) if path.is_dir() else [path.with_suffix(".py")]
    trees = (ast.parse(file.read_bytes()) for file in files)
    return {
        node.name: node for tree in trees for node in tree.body if isinstance(node, ast.ClassDef)
    }


def _name(node: ast.ClassDef) -> str:
    """The name of the component that a class is; empty if it is none."""
    import ast

    for entry in node.body:
        if isinstance(entry, ast.AnnAssign | ast.Assign) and isinstance(entry.value, ast.Constant):
            targets = entry.targets if isinstance(entry, ast.Assign) else [entry.target]
            if any(isinstance(target, ast.Name) and target.id == "name" for target in targets):
                return str(entry.value.value)
    return ""


def _options(node: ast.ClassDef, classes: dict[str, ast.ClassDef]) -> list[str]:
    """The options of a component; none if the class is no component."""
    return list(_fields(node, classes)) if _name(node) else []


def _fields(node: ast.ClassDef, classes: dict[str, ast.ClassDef]) -> dict[str, tuple[str, str]]:
    """What a class and its bases annotate: types in a word, and docstrings below."""
    import ast

    found: dict[str, tuple[str, str]] = {}
    for base in node.bases:
        name = ast.unparse(base).partition("[")[0]
        if name in classes:
            found |= _fields(classes[name], classes)
    for entry, after in zip(node.body, [*node.body[1:], None], strict=True):
        if not isinstance(entry, ast.AnnAssign):
            continue
        kind, default = ast.unparse(entry.annotation), ast.unparse(entry.value or entry.target)
        if kind.startswith("ClassVar") or "init=False" in default:
            continue
        said = after.value if isinstance(after, ast.Expr) else None
        text = str(said.value) if isinstance(said, ast.Constant) else ""
        found[ast.unparse(entry.target)] = kind.partition(" ")[0], " ".join(text.split())
    return found
