"""What all components that a configuration names have in common; it knows no kind of them."""

from abc import ABC
from typing import Any, ClassVar

from eqt_cli.core.problems import Problems, parse_key


def option_of_field(name: str) -> str:
    """The option that a field stands for: `from` for ``from_``, which Python reserves."""
    return name.removesuffix("_")


LATER = {"later": True}
"""Metadata of an option that a component has got after results with it were written."""


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

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if "problems" in vars(cls) and "check" not in vars(cls):
            cls.check = _check_by_problems  # type: ignore[attr-defined]  # each kind has its own

    def problems(self, *group: Any) -> list[tuple[str, str]]:
        """What `check` notes, as (option, message).

        A plugin of the first version says here what is wrong, and may ask the class above it.
        """
        kinds = [kind for kind in type(self).__mro__ if kind is not Component]
        listing = [index for index, kind in enumerate(kinds) if "problems" in vars(kind)]
        above = kinds[listing[-1] + 1 :] if listing else kinds
        check = next(vars(kind)["check"] for kind in above if "check" in vars(kind))
        found = Problems()
        check(self, *group, found)
        return [(problem.path, problem.message) for problem in found]


def _check_by_problems(component: Any, *given: Any) -> None:
    *group, problems = given
    for option, message in component.problems(*group):
        problems.at(*parse_key(option)).add(message)
