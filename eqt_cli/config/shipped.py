"""Finds the configurations that are shipped with eqt, in a wheel or in a checkout."""

from pathlib import Path

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
