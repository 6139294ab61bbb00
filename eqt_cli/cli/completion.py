"""Shell completion of names and keys, cached in a file because importing them delays every Tab.

The first Tab after eqt or the installed packages have changed takes a second longer. Components of
plugin files are not completed.
"""

import os
import sysconfig
from collections.abc import Iterator, Sequence
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import typer

from eqt_cli.base.errors import EqtError
from eqt_cli.base.extensions import all_kinds
from eqt_cli.base.files import read_record, write_record
from eqt_cli.base.registry import registry, summary

if TYPE_CHECKING:
    from eqt_cli.results.result import Result

Completions = list[tuple[str, str]]
"""Possible words, each with its meaning."""


def words(names: str | Sequence[str], incomplete: str) -> Completions:
    """Complete one of these words or, for the name of a kind, the name of a component."""
    texts = _completions()["names"][names] if isinstance(names, str) else dict.fromkeys(names, "")
    return _starting(incomplete, texts)


def listed(incomplete: str) -> Completions:
    """Complete a kind of components or, from its first letter, the name of a component."""
    kinds = dict.fromkeys((*all_kinds(), "configs"), "")
    names = {
        name: text for of_kind in _completions()["names"].values() for name, text in of_kind.items()
    }
    return _starting(incomplete, kinds | names if incomplete else kinds)


def shipped(incomplete: str) -> Completions:
    """Complete the name of a shipped configuration."""
    from eqt_cli.config.shipped import names

    return _starting(incomplete, dict.fromkeys(names(), ""))


def keys(incomplete: str) -> Completions:
    """Complete a key of any configuration."""
    return _starting(incomplete, _completions()["keys"])


def settings(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete ``KEY=``, a key of any configuration or of the given one."""
    # `args` holds words not parsed yet, where the line ends in an option without its value.
    words = [ctx.params.get("config"), ctx.params.get("target"), *ctx.args]
    file = next((Path(word) for word in words if word and Path(word).is_file()), None)
    keys = dict.fromkeys(_written(file), "") | _completions()["keys"]
    return _starting(incomplete, {f"{key}=": text for key, text in keys.items()})


def figure_options(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete ``KEY=`` or ``FIGURE.KEY=``, an option of the requested figures or of any."""
    options = _completions()["figure_options"]
    wanted = ctx.params.get("figure") or options
    offered = [(name, option) for name in wanted for option in options.get(name, ())]
    plain = {f"{option}=": "" for _, option in offered}
    dotted = {f"{name}.{option}=": "" for name, option in offered} if "." in incomplete else {}
    return _starting(incomplete, plain | dotted)


def laws(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete the label of a law in the results on the line."""
    return _starting(incomplete, {name: "" for result in _results(ctx) for name in result.labels})


def metrics(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete the name of a metric in the results on the line."""
    names = {n: q.plain for result in _results(ctx) for n, q in result.comparable.items()}
    return _starting(incomplete, names)


def panels(ctx: typer.Context, incomplete: str) -> Completions:
    """Complete the name of a signal over time, which a panel shows, in the results on the line."""
    shown = {n: r.long_name(n) for r in _results(ctx) for n in r.names if "time" in r.dims(n)}
    return _starting(incomplete, shown)


def _results(ctx: typer.Context) -> Iterator["Result"]:
    """Yield the results on the line; none that cannot be read."""
    from eqt_cli.results.result import open_result

    first = ctx.params.get("result") or ()
    for path in [*(first if isinstance(first, list | tuple) else [first]), *ctx.args]:
        with suppress(EqtError, OSError), open_result(path) as opened:
            yield opened


def _starting(incomplete: str, texts: dict[str, str]) -> Completions:
    return [(word, text) for word, text in texts.items() if word.startswith(incomplete)]


# Keys in a file -----------------------------------------------------------------------------------


def _written(path: Path | None) -> list[str]:
    """Return the keys in a file; none if it cannot be read."""
    from eqt_cli.base.files import content_of
    from eqt_cli.base.yaml_source import MAX_BYTES, load

    try:
        data = load(content_of(path, MAX_BYTES), "").data if path else {}
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


# What eqt knows -----------------------------------------------------------------------------------


_CACHED = ("state", "names", "keys", "figure_options")


@cache
def _completions() -> dict[str, Any]:
    """Return component names, configuration keys and figure options, cached or collected anew."""
    caches = os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache"
    state, file = _state(), Path(caches) / "eqt" / "completion.json"
    with suppress(OSError):
        cached = read_record(file, *_CACHED)
        if cached and cached["state"] == state:
            return cached
    from eqt_cli.base.option_types import option_names
    from eqt_cli.config.json_schema import json_schema, keys_of

    collected = {
        "state": state,
        "names": {
            kind: {one.name: summary(one) for one in registry(kind).all()} for kind in all_kinds()
        },
        "keys": {entry.key: entry.meaning for entry in keys_of(json_schema())},
        "figure_options": {one.name: option_names(one) for one in registry("figures").all()},
    }
    with suppress(OSError):
        file.parent.mkdir(parents=True, exist_ok=True)
        write_record(file, collected)
    return collected


def _state() -> list[int]:
    """Return when eqt's own files and the installed packages last changed."""
    package = Path(__file__).parents[1]
    times = [path.stat().st_mtime_ns for path in package.rglob("*.py")]
    return [len(times), max(times), Path(sysconfig.get_path("purelib")).stat().st_mtime_ns]
