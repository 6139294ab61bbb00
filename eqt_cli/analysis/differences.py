"""The keys and stored files in which the configurations of two results differ."""

from collections.abc import Iterator, Mapping, Sequence
from itertools import chain
from typing import Any

from eqt_cli.base.errors import KeyPath, dotted
from eqt_cli.config.document import document_of
from eqt_cli.config.experiment import renamed
from eqt_cli.results.origin import KnownResult


def changed_keys(first: KnownResult, second: KnownResult) -> list[dict[str, Any]]:
    """Return the keys in which the configurations of two results differ, with both values."""
    return configurations((first, second))[0]


def changed_files(first: KnownResult, second: KnownResult) -> list[str]:
    """Return the names of stored files, such as plugins, that differ or that one result lacks."""
    _, texts, renamings = configurations((first, second))
    named = zip(texts, renamings, strict=True)
    return [change["key"] for change in changes(*({n[k]: x[k] for k in x} for x, n in named))]


Texts = list[dict[str, str]]
"""A mapping of texts by their names for each of two results."""


def configurations(both: Sequence[KnownResult]) -> tuple[list[dict[str, Any]], Texts, Texts]:
    """Return the changed keys, the texts of stored files, and their names in the first result."""
    documents = [document_of(result) for result in both]
    texts = [{**(x.home.plugins or {}), **x.home.files} for x in documents]
    in_first = {text: name for name, text in texts[0].items()}
    renamings = [{name: in_first.get(text, name) for name, text in x.items()} for x in texts]
    renaming = zip(documents, renamings, strict=True)
    keys = [dict(leaves(renamed(document.data, names))) for document, names in renaming]
    return changes(*keys), texts, renamings


# Keys ---------------------------------------------------------------------------------------------


def leaves(data: Any, path: KeyPath = ()) -> Iterator[tuple[str, Any]]:
    """Yield the values of nested mappings and lists with their dotted keys."""
    inner: Any = None
    if isinstance(data, dict):
        inner = data.items()
    elif isinstance(data, list):
        inner = enumerate(data)
    if not inner or not data:
        yield dotted(path), data
        return
    for key, value in inner:
        yield from leaves(value, (*path, key))


def changes(first: Mapping[str, Any], second: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Return the keys of unequal values: a `key`, with its value where a mapping has it."""
    sides = {"first": first, "second": second}
    return [
        {"key": key} | {side: values[key] for side, values in sides.items() if key in values}
        for key in dict.fromkeys(chain(first, second))
        if repr(first.get(key, ...)) != repr(second.get(key, ...))
    ]
