"""What a section of a configuration is, and what eqt knows of each of its keys.

Extensions describe their keys with this: `eqt_cli.config.schema` imports their classes.
"""

from dataclasses import dataclass
from enum import Enum

from pydantic import BaseModel, ConfigDict


class Mark(Enum):
    """What the program knows of a key of `Config`, besides its type, default and meaning."""

    WORDS = "changes texts about an experiment, and none of its numbers"
    SEARCH = "says what a search looks for; changes no run"
    ON_GROUP = "holds numbers that can be checked only on a group"
    VEHICLE = "describes the vehicle between the laws and the motion"
    PLANT = "holds numbers of the plant, which a recording determines"
    SHAPES = "determines the shapes of arrays, or the sample times"
    STARTS = "changes the initial states"
    DESIRED = "changes the desired trajectory"


WORDS, SEARCH, ON_GROUP, VEHICLE, PLANT, SHAPES, STARTS, DESIRED = Mark


@dataclass(frozen=True)
class NotSwept:
    """Marks a key that no sweep can change, and says why."""

    why: str


class Section(BaseModel):
    """A mapping with known keys only."""

    # Built when first used: a section inside another is built with that one, and never alone.
    model_config = ConfigDict(extra="forbid", strict=True, defer_build=True)
