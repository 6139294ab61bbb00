"""What all components that a configuration names have in common; it knows no kind of them."""

from abc import ABC
from typing import Any, ClassVar


def option_of_field(name: str) -> str:
    """The option that a field stands for: `from` for ``from_``, which Python reserves."""
    return name.removesuffix("_")


class Component(ABC):
    """A dataclass whose fields are its options in a configuration, ``from_`` for `from`.

    A kind of component says in `check` what of its options will not do: it notes that in the
    problems of its place, ``problems.at("std").add("expected …")``.
    """

    name: ClassVar[str]
    # Read by pydantic when a configuration gives options: no other keys, no silent conversions.
    __pydantic_config__: ClassVar[dict[str, Any]] = {
        "extra": "forbid",
        "strict": True,
        "alias_generator": option_of_field,
    }
