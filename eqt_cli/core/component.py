"""Base class of all components that a configuration can name."""

from abc import ABC
from typing import Any, ClassVar


def option_of_field(name: str) -> str:
    """Return the option of a field: `from` for ``from_``, because Python reserves the former."""
    return name.removesuffix("_")


class Component(ABC):
    """A dataclass whose fields are its options in a configuration, ``from_`` for `from`.

    A component checks its options in `check`, and notes errors in the problems of its place:
    ``problems.at("std").add("expected …")``.
    """

    name: ClassVar[str]
    # Read by pydantic when a configuration gives options: no other keys, no silent conversions.
    __pydantic_config__: ClassVar[dict[str, Any]] = {
        "extra": "forbid",
        "strict": True,
        "alias_generator": option_of_field,
    }
