"""Configurations that are wrong, and what errors say."""

import re

import pytest

from eqt_cli.extend import EqtError


def sections_of(line):
    """The sections of a configuration that a line replaces, or leaves out where they are empty."""
    parts = (section.partition(": ") for section in line.split("; "))
    return {name: value or None for name, _, value in parts}


def says(text, facts):
    """Whether a text is these facts: a place, a key, a value; … is any text within a line."""
    return re.fullmatch(_pattern(facts), text) is not None


def mentions(text, facts):
    """Whether a text holds these facts somewhere."""
    return re.search(_pattern(facts), text) is not None


def _pattern(facts):
    return ".*".join(map(re.escape, facts.split("…")))


def error_of(call, *arguments, kind=EqtError, **options):
    """What the error says that a call ends with."""
    with pytest.raises(kind) as caught:
        call(*arguments, **options)
    return str(caught.value)
