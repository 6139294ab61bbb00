"""The key of a configuration that takes over others."""

from typing import Annotated

from eqt_cli.config.marks import WORDS, NotSwept, Section


class Keys(Section):
    """The key of configurations that are taken over.

    Attributes
    ----------
    extends
        Configurations to take over, relative to this file: mappings merge, lists are replaced, the
        later text wins (`eqt config show`).
    """

    extends: Annotated[str | list[str] | None, NotSwept("is read at first"), WORDS] = None
