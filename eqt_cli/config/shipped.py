"""Finds the configurations that are shipped with eqt."""

from collections.abc import Iterator
from pathlib import Path
from typing import Any

from eqt_cli.base.errors import EqtError, suggestion


def folder() -> Path:
    """Return the folder of the shipped configurations."""
    package = Path(__file__).parents[1]
    in_wheel = package / "configs"
    return in_wheel if in_wheel.is_dir() else package.parent / "configs"


def names() -> list[str]:
    """Return the names of the shipped configurations."""
    return sorted(path.stem for path in folder().glob("*.yaml"))


def text(name: str) -> str:
    """Return the text of a shipped configuration."""
    if name not in names():
        hint = suggestion(name, names()) or f"; shipped are: {', '.join(names())}"
        raise EqtError(f"unknown configuration '{name}'{hint}")
    return (folder() / f"{name}.yaml").read_text(encoding="utf-8")


def summary(name: str) -> str:
    """Return the first sentence of a shipped configuration; of a long one, up to a colon."""
    from eqt_cli.base.yaml_source import heading  # slow to import, and most commands need no list

    return heading(text(name))


def using(kind: str) -> tuple[str, Any]:
    """Return a shipped configuration with a component, and its shortest part with it; or nothing.

    The part is a mapping as in the configuration, without other keys beside the component.
    """
    import yaml  # loaded by no help page

    examples = [
        (name, {key: part})
        for name in names()
        if kind in text(name)  # parsing all of them takes 0.3 s
        for key, value in yaml.safe_load(text(name)).items()
        for part in _parts(value, kind, by_key=key == "sweep")
    ]
    return min(examples, key=lambda pair: len(str(pair[1])), default=("", {}))


def _parts(data: Any, kind: str, *, by_key: bool) -> Iterator[Any]:
    """Yield the parts of a value with a component: by ``kind: NAME``, a name alone, or a key."""
    if data == kind:
        yield data
    elif isinstance(data, list):
        yield from ([part] for item in data for part in _parts(item, kind, by_key=by_key))
    elif isinstance(data, dict) and (data.get("kind") == kind or (by_key and kind in data)):
        yield data
    elif isinstance(data, dict):
        inner = ((key, _parts(value, kind, by_key=by_key)) for key, value in data.items())
        yield from ({key: part} for key, parts in inner for part in parts)
