"""Loads the plugins that a configuration names or a result stores.

The plugins of a YAML configuration are the user's own. Those of a result file or folder may be
somebody else's, so no command executes them without permission.
"""

from eqt_cli.config.source import ConfigSource, source_of
from eqt_cli.core.errors import ComponentError, Remedy
from eqt_cli.core.files import text_of
from eqt_cli.core.problems import Problems
from eqt_cli.core.registry import load_plugin
from eqt_cli.core.validation import shown
from eqt_cli.store.reader import ResultFile


def load_plugins(source: ConfigSource, trusted: bool, problems: Problems) -> dict[str, str]:
    """Load every plugin, and return the sources by their paths in the configuration.

    Plugins of a result file or folder are executed only if they are `trusted`.
    """
    paths = source.data.get("plugins", [])
    if not isinstance(paths, list):
        expected = "expected a list of paths to Python files"
        problems.at("plugins").add(f"{expected}, got {shown(paths)}")
        return {}
    sources: dict[str, str] = {}
    owners: dict[str, str] = {}
    for index, path in enumerate(paths):
        with problems.catching("plugins", index):
            text = trusted_text(source, path, trusted)
            added = load_plugin(source.folder / path, text)
            sources[path] = text
            for component in added:
                if component in owners:
                    message = f"{owners[component]} already defines {component}; rename one of them"
                    problems.at("plugins", index).add(message)
                owners[component] = path
    return sources


def load_stored_plugins(results: ResultFile) -> None:
    """Execute the plugins in a trusted result.

    Raises
    ------
    ConfigError
        If a plugin cannot be loaded.
    """
    source = source_of(results)
    problems = Problems(source.place)
    load_plugins(source, trusted=True, problems=problems)
    problems.raise_if_any()


def trusted_text(source: ConfigSource, path: object, trusted: bool, subject: str = "plugin") -> str:
    """Return the text of a plugin, or of other code that is executed.

    Raises
    ------
    ComponentError
        If the file cannot be read, or may not be executed.
    """
    if not isinstance(path, str):
        raise ComponentError(f"expected the path of a Python file, got {shown(path)}")
    if source.stored_plugins is None:
        relative = f"{subject} paths are relative to the configuration's folder"
        file = source.folder / path
        if source.of_folder and not trusted:
            raise ComponentError(
                f"the result folder contains {file}, which eqt executes only on request",
                Remedy("read this file, then add {}", "trust_plugins"),
            )
        return text_of(file, relative, ComponentError, f"{subject} {file}")
    if not trusted:
        raise ComponentError(
            f"the result contains the source of {path}, which eqt executes only on request",
            Remedy("read it with `eqt show --plugins`, then add {}", "trust_plugins"),
        )
    if path not in source.stored_plugins:
        raise ComponentError(f"the result does not contain the source of {path}")
    return source.stored_plugins[path]
