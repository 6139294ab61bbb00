"""What a word leads to: rows of the table of topics, and components whose text has the word."""

from __future__ import annotations

import re
from collections.abc import Collection, Iterator
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple

from eqt_cli.base import purposes
from eqt_cli.base.errors import bare


class Topic(NamedTuple):
    """What somebody has and wants.

    Attributes
    ----------
    have, want
        In words.
    command
        The command for it.
    page
        The page for it, within `docs`, also with the anchor of a heading.
    words
        What somebody may search for.
    group
        The heading of the page that it stands under.
    """

    have: str
    want: str
    command: str
    page: str
    words: list[str]
    group: str

    @property
    def file(self) -> str:
        """The page as somebody finds it in a checkout."""
        return f"docs/{self.page}"


@cache
def topics() -> tuple[Topic, ...]:
    """Return the table of topics."""
    import yaml  # loaded by no help page

    path = Path(__file__).with_name("topics.yaml")
    groups = yaml.safe_load(path.read_text("utf-8"))
    return tuple(Topic(**row, group=group) for group, rows in groups.items() for row in rows)


def _exactly(word: str) -> list[Topic]:
    """Return the topics that have a word or phrase, in any spelling."""
    return [topic for topic in topics() if bare(word) in {bare(one) for one in topic.words}]


def topics_for(word: str) -> list[Topic]:
    """Return the topics that have a word or phrase, in any spelling; else those that have parts.

    A part is a word of four letters or more, at the beginning of a word of the topic.
    """
    letters, exact = bare(word), _exactly(word)
    if exact or len(letters) < 3:
        return exact
    parts = [part for part in re.findall(r"\w+", word.casefold()) if len(part) > 3] or [letters]

    def has_all(topic: Topic) -> bool:
        text = " ".join([topic.have, topic.want, *topic.words]).casefold()
        return all(re.search(rf"\b{re.escape(part)}", text) for part in parts)

    return [topic for topic in topics() if has_all(topic)]


def components_with(word: str, but: Collection[str]) -> Iterator[dict[str, str]]:
    """Yield components and configurations whose name or summary has a word, without some names.

    Beside a component that is told already, only those whose name has it.
    """
    from eqt_cli.base.extensions import all_kinds
    from eqt_cli.base.registry import registry, summary
    from eqt_cli.config import shipped

    listed = [
        (kind, component.name, summary(component))
        for kind in all_kinds()
        for component in registry(kind).all()
    ]
    listed += [("configs", name, shipped.summary(name)) for name in shipped.names()]
    pattern = re.compile(rf"\b{re.escape(word)}", re.IGNORECASE)
    for kind, name, text in listed:
        where = f"{name.replace('_', ' ')} {name}" + ("" if but else f" {text}")
        if name not in but and pattern.search(where):
            yield {"kind": kind, "name": name, "summary": text}


@purposes.meaning_of_a_word
def meaning(word: str, but: Collection[str]) -> tuple[dict[str, Any], list[Any]]:
    """Return what a word leads to, as data, and as text and tables for `eqt list`.

    Parameters
    ----------
    but
        Names of components that are told already.
    """
    from eqt_cli.cli.output import table

    leads, named = topics_for(word), list(components_with(word, but)) if len(word) > 2 else []
    texts: list[Any] = []
    if leads:
        rows = [[lead.have, lead.want, lead.command, lead.file] for lead in leads]
        texts += ["", f"about {word}:", table(["you have", "you want", "command", "page"], rows)]
    if named:
        names = [[*record.values()] for record in named]
        texts += ["", f"named or described with {word}:", table(["kind", "name", "meaning"], names)]
    topic_records = [topic._asdict() for topic in leads]
    if not leads and not named:
        return {}, []
    return {"topics": topic_records, "described": named}, texts[1:] if not but else texts


@purposes.command_for_a_word
def hint(word: str) -> str:
    """Return the command and the page for a word that is no command; empty if there is none."""
    leads = _exactly(word)
    return f"; for {word}: `{leads[0].command}` ({leads[0].file})" if leads else ""
