"""The `plugins` of a configuration: files of the user, or sources kept in a result."""

from __future__ import annotations

from pathlib import Path

from eqt_cli.core.errors import ComponentError
from eqt_cli.core.registry import load_plugin
from eqt_cli.experiment.problems import Problems
from eqt_cli.experiment.source import ConfigSource
from eqt_cli.experiment.translate import shown


def load_plugins(source: ConfigSource, trusted: bool, problems: Problems) -> dict[str, str]:
    """Load every plugin; returns their sources by path as written in the configuration.

    Sources that come from a result file are executed only if they are `trusted`.
    """
    paths = source.data.get("plugins", [])
    if not isinstance(paths, list):
        expected = "expected a list of paths to Python files"
        problems.add(("plugins",), f"{expected}, got {shown(paths)}")
        return {}
    sources: dict[str, str] = {}
    for index, path in enumerate(paths):
        if not isinstance(path, str):
            expected = "expected the path of a Python file"
            problems.add(("plugins", index), f"{expected}, got {shown(path)}")
            continue
        try:
            if source.stored_plugins is None:
                file = source.folder / path
                if not file.exists():
                    relative = "plugin paths are relative to the configuration's folder"
                    problems.add(("plugins", index), f"{file}: does not exist; {relative}")
                    continue
                load_plugin(file)
                sources[path] = file.read_text(encoding="utf-8")
            elif trusted:
                sources[path] = source.stored_plugins[path]
                load_plugin(Path(path), sources[path])
            else:
                problems.add(
                    ("plugins", index),
                    f"the result holds the source of {path}, which is executed only on request; "
                    "read it with `eqt show --plugins`, then add --trust-plugins",
                )
        except ComponentError as error:
            problems.add(("plugins", index), str(error))
    return sources
