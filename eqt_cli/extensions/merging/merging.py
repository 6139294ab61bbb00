"""A configuration and those that it extends, as one: later text wins, and every place is kept.

Mappings merge, and everything else is replaced: numbers, texts and lists. A mapping with another
`kind` replaces the earlier one, whose options belong to the other kind. null takes a key away.
"""

from __future__ import annotations

import os
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final

from eqt_cli.base import purposes, yaml_source
from eqt_cli.base.errors import ConfigError, InputError, KeyPath, Problems, suggestion
from eqt_cli.base.files import YAML, content_of, near, refusals
from eqt_cli.base.option_types import shown
from eqt_cli.config import shipped
from eqt_cli.config.document import EXTENDS, Document
from eqt_cli.runs.part_files import MANIFEST

MOST_LEVELS: Final = 8
"""Largest number of files from a configuration to the last one that it extends."""

MOST_FILES: Final = 64
"""Largest number of files that are read for one configuration; one that is named twice counts
twice."""

OWN: Final = ("name", EXTENDS)
"""Keys that no other file takes over: a result is named after the file that was run."""


@dataclass
class Text:
    """The data of one file, or of several that are merged, and where each part is written.

    Attributes
    ----------
    data
        The data, without `extends`.
    places
        ``file:line:column`` by path: of every value, and of each mapping its first place.
    """

    data: dict[str, Any]
    places: dict[KeyPath, str]

    def merged(self, later: Text) -> Text:
        """Return the data of both, of which `later` wins."""
        places = dict(self.places)
        data = _merged(self.data, later.data, (), places, later.places)
        return Text(data, places)


def _merged(
    old: dict[str, Any],
    new: dict[str, Any],
    path: KeyPath,
    places: dict[KeyPath, str],
    later: dict[KeyPath, str],
) -> dict[str, Any]:
    """Merge two mappings at a path, whose places change with them."""
    data = dict(old)
    for key, value in new.items():
        at, before = (*path, key), old.get(key)
        if isinstance(before, dict) and _fits(before, value):
            data[key] = _merged(before, value, at, places, later)
            continue
        for inner in [other for other in places if other[: len(at)] == at]:
            del places[inner]
        if value is None and key in old:
            del data[key]
            continue
        data[key] = value
        places |= {other: x for other, x in later.items() if other[: len(at)] == at}
    return data


def _fits(old: dict[str, Any], new: Any) -> bool:
    """Return whether a value is merged into a mapping, of which it changes some keys."""
    return isinstance(new, dict) and ("kind" not in new or new["kind"] == old.get("kind"))


@dataclass
class Reading:
    """Reads a configuration and the files that it extends.

    Attributes
    ----------
    folder
        The folder of the configuration, to which the names of data files will be relative.
    texts
        The texts that were read, by their names relative to that folder.
    count
        How many files were read.
    """

    folder: Path
    texts: dict[str, str] = field(default_factory=dict)
    count: int = 0

    def whole(self, source: yaml_source.Source, folder: Path, chain: tuple[Path, ...]) -> Text:
        """Return the data of a file with those of all that it extends.

        Parameters
        ----------
        chain
            The files that led here, of which this one is the last.
        """
        problems = Problems(source.key_place)
        data = {key: x for key, x in source.data.items() if key not in OWN or len(chain) < 2}
        data.pop(EXTENDS, None)
        if folder != self.folder:
            data = _moved(data, folder, self.folder)
        text = Text({}, {})
        for path, name in _named(source.data.get(EXTENDS), problems.at(EXTENDS)):
            with problems.catching(EXTENDS, *path):
                text = text.merged(self._read(name, folder, chain))
        problems.raise_if_any()
        return text.merged(Text(data, {path: source.key_place(path) for path in source.paths}))

    def _read(self, name: str, folder: Path, chain: tuple[Path, ...]) -> Text:
        path = folder / name
        if not path.is_file() and name in shipped.names():
            path = shipped.folder() / f"{name}.yaml"
        # `Path.resolve` raises an error of its own for a link to itself, which cannot be read.
        if os.path.realpath(path) in map(os.path.realpath, chain):
            way = " → ".join(source.name for source in (*chain, path))
            raise InputError(f"{path} extends itself: {way}")
        if len(chain) >= MOST_LEVELS:
            raise InputError(f"expected at most {MOST_LEVELS} files that extend one another")
        self.count += 1
        if self.count > MOST_FILES:
            raise InputError(f"expected at most {MOST_FILES} files in all")
        content = _content(path)
        source = yaml_source.load(content, str(path))
        self.texts[os.path.relpath(path, self.folder)] = content.decode("utf-8-sig")
        return self.whole(source, path.parent, (*chain, path))


def _named(value: Any, problems: Problems) -> Iterator[tuple[KeyPath, str]]:
    """Yield the names of the files that a file extends, each with its place in the list."""
    names = value if isinstance(value, list) else [] if value is None else [value]
    for index, name in enumerate(names):
        path = (index,) if isinstance(value, list) else ()
        if isinstance(name, str) and name:
            yield path, name
        else:
            expected = "expected the path of a YAML file, relative to this one, or a list of them"
            problems.at(*path).add(f"{expected}, got {shown(name)}")


def _content(path: Path) -> bytes:
    with refusals(path, "read", "extends takes a YAML file", InputError):
        try:
            return content_of(path, yaml_source.MAX_BYTES)
        except FileNotFoundError:
            hint = near(path, lambda entry: entry.suffix in YAML)
            hint = hint or suggestion(path.stem, shipped.names())
            hint = hint or "; names are relative to the file that extends"
            raise InputError(f"{path}: not found{hint}") from None


def _moved(data: Any, folder: Path, to: Path) -> Any:
    """Return data in which names of files in a folder are relative to another folder."""
    if isinstance(data, dict):
        return {
            key: x if key in ("name", "label") else _moved(x, folder, to) for key, x in data.items()
        }
    if isinstance(data, list):
        return [_moved(x, folder, to) for x in data]
    if not isinstance(data, str) or not {".", "/"} & {*data} or len(data) > 255:
        return data
    try:
        exists = (folder / data).exists()
    except (OSError, ValueError):
        exists = False
    return os.path.relpath(folder / data, to) if exists else data


@purposes.extends
def extended(document: Document) -> Document:
    """Return a configuration with all that it extends, with the place of each part.

    Raises
    ------
    ConfigError
        If a file cannot be read, or files extend one another in a circle.
    """
    home, path = document.home, Path(document.path)
    if home.is_complete or home.is_result or (home.folder / MANIFEST).exists():
        message = "a result holds its whole configuration and reads no other file; remove this key"
        raise ConfigError([document.problem((EXTENDS,), message)])
    reading = Reading(home.folder)
    whole = reading.whole(document.source, home.folder, (path,))
    written = set(document.source.paths)
    changes = {at: place for at, place in whole.places.items() if at not in written}
    if document.source.located:
        reading.texts[path.name] = _content(path).decode("utf-8-sig")
    files = home.files | reading.texts
    return replace(document, data=whole.data, home=replace(home, files=files), changes=changes)
