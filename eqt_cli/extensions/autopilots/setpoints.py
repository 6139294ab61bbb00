"""Setpoints as missions and pilots give them: positions that are held, without derivatives."""

import csv
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from hashlib import sha256
from typing import Annotated, Any, ClassVar, Self

import numpy as np

from eqt_cli.base.arrays import Array, cos, sin, stack
from eqt_cli.base.errors import InputError, Problems
from eqt_cli.base.option_types import Real, Unit, unknown_key
from eqt_cli.base.registry import Keys
from eqt_cli.components.groups import MatrixLieGroup
from eqt_cli.components.matrix_groups import rigid, rigid_motions
from eqt_cli.components.motions import FlatOutput, piece_at
from eqt_cli.components.references import ClosedReference, check_rising
from eqt_cli.numbers.leaves import with_fields

HEADING = "heading"


@dataclass(frozen=True)
class Setpoint(Keys):
    """A position from a time on.

    Attributes
    ----------
    t
        Time, s.
    position
        Position in space, m.
    heading
        ψ, rad.
    """

    t: Annotated[Real, Unit("s")]
    position: Annotated[list[Real], Unit("m")]
    heading: Annotated[Real, Unit("rad")] = 0.0


@dataclass(frozen=True)
class SetpointsReference(ClosedReference):
    """Positions with a heading, each held until the next, as missions command them; SE2 and SE3.

    Between two times, the pose stands still: velocity and acceleration are 0, and so no law has a
    feedforward. The first one also holds before its time. The attitude is upright.

    Attributes
    ----------
    points
        Setpoints `{t: 0, position: [0, 0, 1], heading: 0}` in the order of time.
    file
        Instead: a file with a row for each, with a header and commas, relative to the
        configuration: t in s; x, y and z in m; if there is one, heading in rad.
    columns
        What the file calls them, such as `{x: setpoint_x, y: setpoint_y, z: setpoint_z}`.
    """

    name: ClassVar[str] = "setpoints"
    jumps: ClassVar[bool] = True

    points: list[Setpoint] | None = None
    file: str | None = None
    columns: dict[str, str] | None = None
    text: str | None = field(default=None, init=False, repr=False)
    digest: str = field(default="", init=False)
    now: Any = field(default=None, init=False, repr=False)  # position and heading, held

    def motion(self, G: MatrixLieGroup, t: Any) -> tuple[Array, Array, Array]:
        """Return the upright pose, at rest."""
        row, G = self._now(G, t), rigid(G)
        n, still = G.space, 0.0 * stack([row[..., 0]] * G.dimension)
        c, s = cos(row[..., n]), sin(row[..., n])
        zero = 0.0 * c
        columns = [stack([c, s]), stack([-s, c])]
        if n == 3:
            columns = [stack([c, s, zero]), stack([-s, c, zero]), stack([zero, zero, zero + 1.0])]
        return G.assemble(stack(columns), row[..., :n, None]), still, still

    def flat_output(self, G: MatrixLieGroup, t: Any) -> FlatOutput:
        """Return position and heading, whose derivatives are 0."""
        row, n = self._now(G, t), rigid(G).space
        p, psi = row[..., :n], row[..., n]
        heading = None if n == 2 else stack([psi, 0.0 * psi, 0.0 * psi])
        return FlatOutput(stack([stack([p[..., k], *[0.0 * psi] * 4]) for k in range(n)]), heading)

    def _now(self, G: MatrixLieGroup, t: Any) -> Any:
        if self.now is not None:
            return self.now
        times, rows = self.prepared(G, self._rows)
        return rows[piece_at(times, t)]

    def held(self, G: MatrixLieGroup, t: Any) -> Self:
        """Return the reference with the setpoint at a time, or at each of some."""
        return with_fields(self, now=np.asarray(with_fields(self, now=None)._now(G, t)))

    def instants(self, G: MatrixLieGroup, until: float) -> Array:
        """Return the times of the setpoints."""
        return self.prepared(G, self._rows)[0]

    def _rows(self, G: MatrixLieGroup) -> tuple[Array, Array]:
        """Return the times, and a row of position and heading for each."""
        if self.points is not None:
            rows = [[*point.position, point.heading] for point in self.points]
            return np.array([point.t for point in self.points]), np.array(rows, dtype=float)
        names = self._names(G)
        called = {name: (self.columns or {}).get(name, name) for name in names}
        table = list(csv.reader((self.text or "").splitlines()))
        header = [entry.strip() for entry in table[0]] if table else []
        missing = [called[name] for name in names[:-1] if called[name] not in header]
        if missing:
            has = f"its columns are {', '.join(header) or 'none'}"
            raise InputError(
                f"{self.file}:1: missing column {', '.join(missing)}; {has}; say which is which by "
                "`columns`, such as {x: setpoint_x}"
            )
        numbered = enumerate(table[1:], 2)
        rows = [list(self._row(k, entries, header, called, names)) for k, entries in numbered]
        numbers = np.array(rows).reshape(-1, len(names))
        if not len(numbers):
            raise InputError(f"{self.file}: expected a row for each setpoint, got a header only")
        late = np.flatnonzero(np.diff(numbers[:, 0]) <= 0)
        if late.size:
            t, before = numbers[late[0] + 1, 0], numbers[late[0], 0]
            raise InputError(
                f"{self.file}:{late[0] + 3}: expected a time after {before:g} s, got {t:g} s"
            )
        return numbers[:, 0], numbers[:, 1:]

    def _row(
        self,
        k: int,
        entries: list[str],
        header: list[str],
        called: dict[str, str],
        names: list[str],
    ) -> Iterator[float]:
        """Yield the numbers of a row; a heading that no column gives is 0."""
        for name in names:
            if called[name] not in header:
                yield 0.0
                continue
            column = header.index(called[name])
            entry = entries[column].strip() if column < len(entries) else ""
            try:
                number = float(entry)
            except ValueError:
                number = np.nan
            if not np.isfinite(number):
                said = f"{self.file}:{k}: {called[name]}: expected a number"
                raise InputError(f"{said}, got {entry or 'nothing'}")
            yield number

    def _names(self, G: MatrixLieGroup) -> list[str]:
        return ["t", *"xyz"[: rigid(G).space], HEADING]

    @property
    def files(self) -> dict[str, str]:
        """The file, if there is one, by the option that names it."""
        return {} if self.file is None else {"file": self.file}

    def with_files(self, texts: Mapping[str, str]) -> Self:
        """Return the reference with the content of its file."""
        if self.file is None or self.file not in texts:
            return self
        text = texts[self.file]
        return with_fields(self, text=text, digest=sha256(text.encode()).hexdigest())

    def check(self, G: MatrixLieGroup, problems: Problems) -> None:
        """Note groups without a position, setpoints that are missing, and invalid ones."""
        if not rigid_motions(G):
            problems.add(f"setpoints needs group SE2 or SE3, got {G.name}")
            return
        if (self.points is None) == (self.file is None):
            which = "neither" if self.file is None else "both"
            problems.add(f"expected the setpoints as `points` or in a `file`, got {which}")
            return
        if self.columns is not None and self.file is None:
            problems.at("columns").add("describes a `file`; remove this key")
        for name in {**(self.columns or {})}:
            if name not in self._names(G):
                problems.at("columns", name).add(unknown_key(name, self._names(G)))
        for index, point in enumerate(self.points or ()):
            if len(point.position) != G.space:
                got = f"expected {G.space} numbers, got {len(point.position)}"
                problems.at("points", index, "position").add(got)
        if self.points is not None and len(self.points) != 1:
            check_rising(self.points, problems.at("points"))
        if self.text is not None and not problems:
            with problems.catching("file"):
                self.prepared(G, self._rows)
