"""The configurations that come with eqt, found from a wheel and from a checkout alike."""

from pathlib import Path

from eqt_cli.core.errors import EqtError, suggestion


def folder() -> Path:
    """Where the shipped configurations lie."""
    package = Path(__file__).parents[1]
    inside = package / "configs"  # in a wheel
    return inside if inside.is_dir() else package.parent / "configs"


def names() -> list[str]:
    """The names of the shipped configurations."""
    return sorted(path.stem for path in folder().glob("*.yaml"))


def text(name: str) -> str:
    """The text of a shipped configuration."""
    if name not in names():
        hint = suggestion(name, names()) or f"; shipped are: {', '.join(names())}"
        raise EqtError(f"unknown configuration '{name}'{hint}")
    return (folder() / f"{name}.yaml").read_text(encoding="utf-8")
