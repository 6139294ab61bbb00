"""Tables of what is wrong and of what is said of it, as text."""

import pytest
import yaml

from eqt_cli.base.errors import EqtError


def said_of(table):
    """The messages by what is wrong: of lines `WRONG → MESSAGE`, or with the message below.

    There, what is indented by four is a line of the message, and what is indented further goes on.
    """
    messages, wrong = {}, None
    for line in filter(None, table.splitlines()):
        text = line.strip()
        if line.startswith(8 * " "):
            messages[wrong] += f" {text}"
        elif line.startswith(4 * " "):
            messages[wrong] = f"{messages[wrong]}\n{text}".lstrip("\n")
        elif not line.startswith("#"):
            wrong, _, message = line.partition(" →")
            assert wrong not in messages, wrong
            messages[wrong] = message[1:]
    return messages


def sections_of(line):
    """The sections of a configuration that a line replaces, or leaves out where they are empty."""
    parts = (section.partition(": ") for section in line.split("; "))
    return {name: value or None for name, _, value in parts}


def cases(table):
    """The same as tuples, of what is written in YAML with commas between."""
    return [(*yaml.safe_load(f"[{wrong}]"), said) for wrong, said in said_of(table).items()]


def error_of(call, *arguments, kind=EqtError, **options):
    """What the error says that a call ends with."""
    with pytest.raises(kind) as caught:
        call(*arguments, **options)
    return str(caught.value)
