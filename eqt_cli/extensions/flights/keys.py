"""The key of a configuration for what flights say of it."""

from typing import Annotated

from eqt_cli.config.marks import WORDS, NotSwept, Section


class Keys(Section):
    """The key of a validation.

    Attributes
    ----------
    validation
        The `validation.json` of `eqt validate`, of the same plant and laws, relative to this file:
        `compare`, `show` and `report` add what flights said.
    """

    validation: Annotated[str | None, NotSwept("states what flights said"), WORDS] = None
