"""What a user asks for beside the file."""

from __future__ import annotations

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from eqt_cli.base.errors import EqtError, suggestion
from eqt_cli.extensions.vehicles.elements import LARGEST

KINDS = ("quadrotor", "satellite", "auv")


@dataclass
class Request:
    """A vehicle file, and the options of the command.

    Attributes
    ----------
    path
        The file.
    bandwidth
        Both poles of each small error, rad/s.
    kind
        `quadrotor`, `auv` or `satellite`, where the user says so.
    models
        Folders in which included models are searched.
    thrust
        Limits of the thrust of each rotor, N, ``LOW,HIGH``; as numbers in `limits`.
    reversible
        Whether rotors push both ways.
    without
        Links and included models that are left out.
    wingless
        Whether the lift and drag of wings are left out.
    arg
        Arguments of a xacro file, ``name=value`` or ``name:=value``.
    """

    path: Path
    bandwidth: float
    kind: str | None = None
    models: Sequence[Path] = ()
    thrust: str | None = None
    reversible: bool = False
    without: Sequence[str] = ()
    wingless: bool = False
    arg: Sequence[str] = ()
    limits: tuple[float, float] | None = field(default=None, init=False)
    _left_out: set[str] = field(default_factory=set)
    _offered: set[str] = field(default_factory=set)

    def __post_init__(self) -> None:
        """Read the numbers of `thrust`.

        Raises
        ------
        EqtError
            For numbers that are none, or an unknown kind.
        """
        if not self.bandwidth > 0:
            raise EqtError(f"--bandwidth: expected a positive number, got {self.bandwidth:g}")
        if self.kind not in (None, *KINDS):
            raise EqtError(f"--vehicle: expected {', '.join(KINDS)} with a file, got {self.kind}")
        if self.thrust is not None:
            words = self.thrust.split(",")
            try:
                low, high = (float(word) for word in words)
            except ValueError:
                low = high = 0.0
            if not -LARGEST < low < high < LARGEST or high <= 0 or low > 0:
                raise EqtError(
                    f"--thrust: expected newtons from 0 or less to more than 0, such as "
                    f"--thrust=-40,50, got '{self.thrust}'"
                )
            self.limits = low, high

    @property
    def arguments(self) -> dict[str, str]:
        """The arguments of a xacro file.

        Raises
        ------
        EqtError
            For one without a value.
        """
        pairs = [text.replace(":=", "=", 1).partition("=") for text in self.arg]
        for text, (_, sign, _) in zip(self.arg, pairs, strict=True):
            if not sign:
                raise EqtError(f"--arg {text}: expected NAME=VALUE")
        return {name: value for name, _, value in pairs}

    @property
    def folders(self) -> list[Path]:
        """The folders whose files a file may name: its own, that around it, and those of models."""
        folder = self.path.resolve().parent
        around = [] if folder.parent == folder.parent.parent else [folder.parent]
        return [folder, *around, *(Path(os.path.realpath(models)) for models in self.models)]

    def leaves_out(self, *names: str) -> bool:
        """Whether a link or an included model of these names is left out."""
        self._offered |= set(names)
        met = set(names) & set(self.without)
        self._left_out |= met
        return bool(met)

    def leave_out(self, name: str) -> None:
        """Leave out what hangs on something that is left out."""
        self._left_out.add(name)

    def left_out(self, name: str) -> str | None:
        """Return what `--without` names that has a link, joint or frame, or is it."""
        scopes = name.split("::")
        for count in range(1, len(scopes) + 1):
            for whole in ("::".join(scopes[:count]), scopes[count - 1]):
                if whole in self._left_out:
                    return whole
        return None

    @property
    def names_left_out(self) -> frozenset[str]:
        """The names that were left out."""
        return frozenset(self._left_out)

    @property
    def names_offered(self) -> frozenset[str]:
        """The names that could be."""
        return frozenset(self._offered)

    def take_over(self, left_out: Sequence[str], offered: Sequence[str]) -> None:
        """Note names that another process has left out or could have."""
        self._left_out |= set(left_out)
        self._offered |= set(offered)

    def check_inside(self, path: Path, place: str, more: Sequence[Path] = ()) -> Path:
        """Return the path of a file that a file names, without links.

        Raises
        ------
        EqtError
            If it is in none of the `folders`.
        """
        there = Path(os.path.realpath(path))  # of a link to itself, too
        if not any(there.is_relative_to(folder) for folder in (*self.folders, *more)):
            raise EqtError(
                f"{place}: {path.name} is outside of the folder of the file; copy it there, or "
                "give the folder that has it with --models DIR"
            )
        return there

    def check_left_out(self) -> None:
        """Refuse names of `--without` that are not in the file."""
        for name in self.without:
            if name not in self._left_out:
                hint = suggestion(name, self._offered) or "; give the name of a link or of a model"
                raise EqtError(f"--without {name}: not in {self.path}{hint}")
