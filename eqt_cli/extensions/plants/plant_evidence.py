"""How a plant differs from the model: sums of terms, and the sentences that these give.

Plant and model are evaluated at the same states. Where they differ, least squares over the same
terms explain both, with as few terms as can be, and the coefficients are compared. No law of motion
is written here, but for the names of its terms.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Collection, Iterator, Sequence
from functools import partial
from itertools import combinations_with_replacement, permutations, product
from typing import NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from eqt_cli.base.arrays import Array, Arrays, apply_matrix, least_squares, transpose
from eqt_cli.base.errors import InputError
from eqt_cli.base.reporting import listed
from eqt_cli.extensions.plants.plant import Model, Plant, StatePart, States
from eqt_cli.numbers.leaves import with_fields

STATES = 250
"""Number of random states."""

SPEED = 2.0  # standard deviation of velocities, m/s and rad/s

LEFT = 1e-6
"""Share of a rate that may be left unexplained, and below which no term is seen."""

FEW = 30  # states at which it is tried what something depends on, and how a step is computed

MOST_ROTORS = 6  # whose orders are tried

XYZ = "xyz"

# Terms --------------------------------------------------------------------------------------------


def _named(pattern: str, x: Array) -> dict[str, Array]:
    """Return the entries of vectors by names with their axes."""
    return {pattern.format(axis): x[:, k] for k, axis in enumerate(XYZ)}


def _frames(vectors: Arrays) -> dict[str, Array]:
    return {name: x for of, y in vectors.items() for name, x in _named(of, y).items()}


def _products(a: str, x: Array, b: str, y: Array) -> dict[str, Array]:
    """Return the products of entries; of a vector with itself, those that differ."""
    pairs = combinations_with_replacement(range(3), 2) if a == b else product(range(3), repeat=2)
    names = {
        (i, j): f"{a}{XYZ[i]}²" if (a, i) == (b, j) else f"{a}{XYZ[i]} {b}{XYZ[j]}"
        for i, j in pairs
    }
    return {name: x[:, i] * y[:, j] for (i, j), name in names.items()}


def _entries(R: Array, name: str = "R{}{}") -> dict[str, Array]:
    return {name.format(i + 1, j + 1): R[:, i, j] for i, j in product(range(3), repeat=2)}


class Scene:
    """States with what terms are made of.

    Attributes
    ----------
    R, w
        Attitudes, and angular velocities in the body.
    v
        Velocities by frame, the one of the user's state first; none on SO(3).
    """

    def __init__(self, model: Model, s: States, frame: str = "body") -> None:
        self.model = model
        self.R, self.w, self.inputs = s.Q[:, :3, :3], s.V[:, :3], s.inputs
        v, self.wrench = s.V[:, 3:], apply_matrix(model.columns, s.inputs)
        both = {"body": v, "space": apply_matrix(self.R, v)} if v.size else {}
        self.v = dict(sorted(both.items(), key=lambda item: item[0] != frame))

    def push(self, axis: int) -> Arrays:
        """Return the terms of the inputs in the acceleration along an axis."""
        live = [k for k in range(self.wrench.shape[1]) if np.any(self.model.columns[k])]
        forces, names = [k for k in live if k >= 3], ["τx", "τy", "τz", "Fx", "Fy", "Fz"]
        plain = {names[k]: self.wrench[:, k] for k in live}
        turned = dict[str, Array]()
        for k in forces:
            name = "R{}{}" + (f" {names[k]}" if len(forces) > 1 else "")
            turned |= _entries(self.R * self.wrench[:, k, None, None], name)
        return plain | turned if next(iter(self.v)) == "body" else turned | plain

    def push_of_thrusters(self, axis: int) -> Arrays:
        """Return the terms of the thrusters one by one."""
        B, in_body = self.model.columns[3:], next(iter(self.v)) == "body"
        of = [(c, k) for c, k in product(range(3), range(B.shape[1])) if B[c, k]]
        if in_body:
            return {f"f{k + 1}": self.inputs[:, k] for _, k in of}
        R = self.R[:, axis]
        return {
            f"R{axis + 1}{c + 1} f{k + 1}": R[:, c] * B[c, k] * self.inputs[:, k] for c, k in of
        }

    def no_push(self, axis: int) -> Arrays:
        """Return the terms of weight, drag and rotation in the acceleration along an axis."""
        (frame, v), (far, u) = self.v.items()
        R, w, size = self.R, self.w, np.linalg.norm(v, axis=1, keepdims=True)
        turn = (
            R[:, axis] if frame == "space" else R[:, :, axis]
        )  # the other frame's axes along this
        to = "b" if far == "body" else "e"
        return {
            "1": np.ones(len(v)),
            **_entries(R),
            **_named("v{}", v),
            **_named("|v{0}|v{0}", np.abs(v) * v),
            **_named(f"v{{0}} {to}{{0}}", turn * u),
            **_named(f"|v{{0}}|v{{0}} {to}{{0}}", turn * np.abs(u) * u),
            **_named("‖v‖v{}", size * v),
            **_named(f"v{{}} in {far}", u),
            **_named(f"v{{0}} in {frame} {to}{{0}}", turn * v),
            **_products("ω", w, "v", v),
            **_products("v", v, "v", v),
            **_named("ω{}", w),
            **_products("ω", w, "ω", w),
            **{f"{name} in {far}": x for name, x in _products("ω", w, "v", u).items()},
        }

    def torque(self, axis: int) -> Arrays:
        """Return the terms of the angular acceleration about an axis."""
        w, R, parts, tau = self.w, self.R, self.model.thrusters, self.wrench[:, :3]
        terms = dict(zip(self.model.input_names, self.inputs.T, strict=True)) | _products(
            "ω", w, "ω", w
        )
        for frame, v in self.v.items():
            rates = {**_named("v{}", v), **_named("|v{0}|v{0}", np.abs(v) * v)}
            if frame == "body":
                rates |= _products("v", v, "v", v) | _products("ω", w, "v", v)
            terms |= {
                f"{name}{' in space' if frame == 'space' else ''}": x for name, x in rates.items()
            }
        in_space = apply_matrix(R, w)
        terms |= _named("ω{}", w) | _named("|ω{0}|ω{0}", np.abs(w) * w)
        terms |= _named("ω{} in space", in_space)
        terms |= {
            f"{name} in space": x for name, x in _products("ω", in_space, "ω", in_space).items()
        }
        terms |= {f"R{axis + 1}{k + 1} τ{XYZ[k]}": R[:, axis, k] * tau[:, k] for k in range(3)}
        terms |= {f"R{k + 1}{axis + 1} τ{XYZ[k]}": R[:, k, axis] * tau[:, k] for k in range(3)}
        if parts is not None and parts.thrust_constant is not None:
            spin = self.model.speeds(self.inputs) @ np.sign(self.model.columns[2])
            terms |= {"Σ±n": spin} | _named("Σ±n ω{}", spin[:, None] * w)
        return terms | {"1": np.ones(len(w))} | _entries(R)

    def turning(self, axis: int) -> Arrays:
        """Return the terms of the rate at which the attitude turns."""
        R, w = self.R, self.w
        return _frames(
            {"ω{}": w, "Rω{}": apply_matrix(R, w), "Rᵀω{}": apply_matrix(transpose(R), w)}
        )

    def moving(self, axis: int) -> Arrays:
        """Return the terms of the rate of the position."""
        R, v, in_space = self.R, self.v["body"], self.v["space"]
        vectors = {"v{}": in_space, "v{} of the body": v, "RRv{}": apply_matrix(R, in_space)}
        return _frames(vectors | {"Rᵀv{}": apply_matrix(transpose(R), v)})


# As few terms as can be ---------------------------------------------------------------------------


def size_of(x: Array) -> float:
    """Return the root mean square."""
    return float(np.sqrt((x**2).mean())) if x.size else 0.0


def fewest(
    terms: Arrays, y: Array, scale: float, preferred: Collection[str] = ()
) -> dict[str, float] | None:
    """Return the coefficients of few terms whose sum is y; None if no sum is.

    Terms are left out one by one as long as the sum is y, the last ones first, `preferred` last.
    """

    def rest(names: Sequence[str]) -> float:
        return size_of(y - sum((factors(names)[n] * terms[n] for n in names), 0 * y))

    def factors(names: Sequence[str]) -> dict[str, float]:
        return least_squares({name: terms[name] for name in names}, y)

    if rest([*terms]) > LEFT * scale:
        return None
    ways = []
    for along in (True, False):  # a drag alike along all axes is one of the body and of space
        order = sorted(
            terms, key=lambda n: (along and n not in preferred, along and n[-2:-1] not in "be")
        )
        shares = factors(order)
        chosen = [n for n in order if abs(shares[n]) * size_of(terms[n]) > LEFT * scale]
        chosen = chosen if rest(chosen) <= LEFT * scale else order
        for name in reversed(chosen):
            fewer = [n for n in chosen if n != name]
            chosen = fewer if rest(fewer) <= LEFT * scale else chosen
        ways.append(factors(chosen))
    return min(ways, key=len)


class Term(NamedTuple):
    """A term of a rate along an axis, with its coefficients in the plant and in the model."""

    axis: str
    name: str
    plant: float
    model: float
    differs: bool

    @property
    def ratio(self) -> float:
        """The coefficient in that of the model; NaN of a term that the model has not."""
        return self.plant / self.model if self.model else math.nan


def compared(
    terms: Callable[[int], Arrays], plant: Array, model: Array, axes: Sequence[str] = XYZ
) -> list[Term] | None:
    """Return the terms of rates, ``(n, axes)`` each; None where no sum of them explains both."""
    scale, rows = size_of(model) or size_of(plant) or 1.0, list[Term]()
    for axis, name in enumerate(axes):
        columns, y, x = terms(axis), plant[:, axis], model[:, axis]
        expected, equal = fewest(columns, x, scale), size_of(y - x) <= LEFT * scale
        if expected is None and not equal:
            return None
        fitted = expected if equal else fewest(columns, y, scale, expected or ())
        if fitted is None and not equal:
            return None
        for term in [n for n in columns if n in (fitted or ()) or n in (expected or ())]:
            a, b = (factors.get(term, 0.0) for factors in (fitted or {}, expected or {}))
            rows.append(Term(name, term, a, b, abs(a - b) * size_of(columns[term]) > LEFT * scale))
    return rows


# Sentences ----------------------------------------------------------------------------------------


def number(x: float, digits: int = 4) -> str:
    """Return a number in few digits."""
    return f"{x:.{digits}g}".replace("-", "−")


def sum_of(rows: Sequence[Term], of: str, scale: float = 1.0, digits: int = 4) -> str:
    """Return a sum in words, of the plant or of the model: ``−1 R23``."""
    pairs = [(getattr(row, of) / scale, row.name) for row in rows]
    words = [f"{number(x, digits)} {name}".removesuffix(" 1") for x, name in pairs if x]
    return " + ".join(words).replace("+ −", "− ") or "0"


def coefficient(ratio: float) -> str:
    """Return a coefficient of 1 in so many digits that it differs."""
    return f"coefficient {number(ratio, 4 if number(ratio) != '1' else 9)} of 1"


def near(a: float, b: float) -> bool:
    """Return whether coefficients are equal, as far as sums with an error of 1e-6 tell."""
    return math.isclose(a, b, rel_tol=1e-4)


Note = Callable[[Sequence[Term]], str]
"""Returns the cause of wrong terms, or "" if it is not known."""


def common_ratio(rows: Sequence[Term]) -> float:
    """Return the ratio that all terms have; NaN if they have none."""
    ratios = [row.ratio for row in rows]
    return ratios[0] if ratios and all(near(x, ratios[0]) for x in ratios) else math.nan


def usual(rows: Sequence[Term]) -> str:
    """Return the usual causes of a factor."""
    causes = {-1.0: "the sign is wrong", math.sqrt(2): "√2", math.sqrt(0.5): "1/√2"}
    causes |= {math.degrees(1): "degrees for rad", math.radians(1): "rad for degrees"}
    return next((words for x, words in causes.items() if near(common_ratio(rows), x)), "")


def _mirrored(name: str) -> str:
    """Return the name of a term of R with the other entry; "" of any other."""
    return f"R{name[2]}{name[1]}{name[3:]}" if re.match(r"R\d\d", name) else ""


def sentences_of(
    title: str, rows: Sequence[Term], note: Note = usual, scale: float = 1.0
) -> Iterator[str]:
    """Yield how the terms of one kind differ, in as few sentences as can be."""
    wrong, expected = [row for row in rows if row.differs], [row for row in rows if row.model]
    mirrored = {(row.axis, _mirrored(row.name)) for row in wrong if row.plant}
    ways = dict[str, list[str]]()

    def cause(terms: Sequence[Term]) -> str:
        words = usual(terms) or note(terms)
        return f" ({words})" if words else ""

    if wrong and wrong == expected and not any(row.plant for row in wrong):
        yield f"lacks {title}"
    elif wrong and wrong == expected and math.isfinite(ratio := common_ratio(wrong)):
        yield f"{title}: {coefficient(ratio)}{cause(wrong)}"
    elif wrong and mirrored == {(row.axis, row.name) for row in wrong if row.model}:
        yield f"{title}: R is transposed"
    else:
        for axis in dict.fromkeys(row.axis for row in wrong):
            line = [row for row in rows if row.axis == axis]
            for digits in (4, 9):  # so many that they differ
                plant, model = (sum_of(line, of, scale, digits) for of in ("plant", "model"))
                if plant != model:
                    break
            words = f"is {plant}, expected {model}" if model != "0" else f"has {plant}"
            ways.setdefault(f"{words}{cause(line)}", []).append(axis)
    short = {re.sub(rf"(?<=[ωv|)]){a}(?=[ |,²]|$)", "", w) for w, x in ways.items() for a in x}
    if sum(map(len, ways.values())) == 3 and 1 in (len(short), len(ways)):  # alike along all axes
        ways = {(short if len(short) == 1 else {*ways}).pop(): []}
    along = {words: f" along {listed(axes)}" if axes else "" for words, axes in ways.items()}
    if extra := [f"{words[4:]}{axes}" for words, axes in along.items() if words[:4] == "has "]:
        yield f"has {listed(extra)} as {title}"
    yield from (f"{title}{axes} {words}" for words, axes in along.items() if words[:3] == "is ")


def _values(rows: Sequence[Term]) -> str:
    """Return a factor of the weight by its values."""
    return f"{number(rows[0].plant)} for {number(rows[0].model)} m/s²" if len(rows) == 1 else ""


MOMENT = "v × 𝕀v, the moment of the added mass"

TERMS = {
    "torque": r"[fFτ]|.*τ",
    "weight": r"1$|R\d",
    "gyroscopic torque of the rotors": "Σ",
    "ω × v": r".*ω.*v|.*v.*ω",
    MOMENT: r"v\w(²| v)",
    "drag": r".*v",
    "ω × Jω": r"ω\w(²| ω)",
    "damping": "",
}
"""Kinds of terms, by their names."""


def by_kind(rows: Sequence[Term]) -> dict[str, list[Term]]:
    """Return terms by what they are."""
    kinds = dict[str, list[Term]]()
    for row in rows:
        kind = next(kind for kind, names in TERMS.items() if re.match(names, row.name))
        kinds.setdefault(kind, []).append(row)
    return kinds


# The judge ----------------------------------------------------------------------------------------


class Judge:
    """Judges a plant at random states, of any attitude.

    Attributes
    ----------
    rows
        Part, coefficients of the plant and of the model, and finding, in words.
    sentences
        The findings.
    unseen
        What such states cannot show.
    steps
        How a step computes each part.
    """

    def __init__(self, plant: Plant) -> None:
        self.plant, self.model, self.random = plant, plant.model, np.random.default_rng(1)
        self.rows, self.sentences = list[tuple[str, str, str, str]](), list[str]()
        self.unseen, self.steps, states = list[str](), dict[str, str](), self.drawn()
        a, b = self.drawn().inputs, states.inputs
        self.states = [states._replace(inputs=inputs) for inputs in (a, b, (a + b) / 2)]
        answers = [plant.derivatives(states) for states in self.states]
        self.rates, self.slopes = [rates for rates, _ in answers], answers[0][1]
        backwards = self.states[0].of(slice(FEW)).of(slice(None, None, -1))
        if not np.array_equal(plant.derivatives(backwards)[0][::-1], self.rates[0][:FEW]):
            raise InputError(
                f"{plant.name} gives unequal answers to equal inputs; it draws noise, or keeps "
                "something from call to call: set all of it in the call"
            )

    def drawn(self) -> States:
        """Draw states."""
        G = self.model.group
        Q = np.tile(G.identity, (STATES, 1, 1))
        Q[:, :3, :3] = Rotation.random(STATES, random_state=self.random).as_matrix()
        Q[:, :3, 3:] = self.random.standard_normal((STATES, 3, G.size - 3))
        V = SPEED * self.random.standard_normal((STATES, G.dimension))
        return States(Q, V, self.model.drawn_inputs(self.plant.limits, STATES, self.random))

    def add(self, title: str, rows: Sequence[Term], words: Sequence[str], unit: float = 1) -> None:
        """Add a part, with a row for each axis."""
        self.sentences += words
        for axis in dict.fromkeys(row.axis for row in rows):
            line = [row for row in rows if row.axis == axis]
            sums = sum_of(line, "plant", unit), sum_of(line, "model", unit)
            finding = "differs" if any(x.differs for x in line) else ""
            self.rows.append((f"{title} {axis}", *sums, finding))

    def note(self, title: str, words: str, finding: str) -> None:
        """Add a part without coefficients."""
        self.sentences.append(words)
        self.rows.append((title, "", "", finding))

    def judge(self) -> None:
        """Judge the kinematics, the push, what is left of it, and the angular acceleration."""
        self._attitude()
        if "position" in self.plant.parts:
            scene = Scene(self.model, self.states[0])
            self._explained("ṗ", "position", scene.moving, *self.rate("position", 0))
        if "velocity" in self.plant.parts:
            self._velocity()
        self._torque()
        self._unseen()
        if self.plant.adapter.step:
            self._steps()

    def rate(self, kind: str, which: int) -> tuple[Array, Array]:
        """Return a rate at the states with one of the inputs, of the plant and of the model."""
        return self.compare(kind, self.states[which], self.rates[which])

    def compare(self, kind: str, states: States, values: Array) -> tuple[Array, Array]:
        """Return a rate of the plant, which is among `values`, and of the model, ``(n, 3)``."""
        part, where = self.plant.parts[kind]
        R, w, v = states.Q[:, :3, :3], states.V[:, :3], states.V[:, 3:]
        if kind == "attitude":
            turns = np.linalg.pinv(self.plant.turned(states)[1])
            return (turns @ values[:, where, None])[..., 0] * self.plant.signs, w
        plant = values[:, where] / part.factor * self.plant.signs
        if kind == "position":
            return plant, apply_matrix(R, v)
        V_dot, in_space = self.model.acceleration(states), part.frame == "space"
        if kind == "rates":
            return apply_matrix(transpose(R), plant) if in_space else plant, V_dot[:, :3]
        v_dot = V_dot[:, 3:]
        return plant, apply_matrix(R, v_dot + np.cross(w, v)) if in_space else v_dot

    def _explained(
        self, title: str, kind: str, terms: Callable[[int], Arrays], plant: Array, model: Array
    ) -> list[Term] | None:
        """Return the terms of a rate; without such a sum, say on what the difference depends."""
        rows = compared(terms, plant, model)
        if rows is not None:
            if kind in ("position", "attitude"):
                self.add(title, rows, [*sentences_of(title, rows)])
            return rows
        (a, b, c), size = (self.rate(kind, k)[0] for k in range(3)), size_of(model)
        if size_of((a + b) / 2 - c) > LEFT * size:
            raise InputError(
                f"{self.plant.name}: {title} is not affine in the input: it clips, or the input is "
                "not thrust; give `range` or `as` in `input` of the adapter"
            )
        base, drawn = self.states[0].of(slice(FEW)), self.drawn().of(slice(FEW))
        axes, turns = np.arange(base.V.shape[1]) < 3, np.zeros(base.Q.shape[1:], dtype=bool)
        turns[:3, :3] = True

        def difference(states: States) -> Array:
            return np.subtract(*self.compare(kind, states, self.plant.derivatives(states)[0]))

        changes = {
            "position": base._replace(Q=np.where(turns, base.Q, drawn.Q)),
            "attitude": base._replace(Q=np.where(turns, drawn.Q, base.Q)),
            "velocity": base._replace(V=np.where(axes, base.V, drawn.V)),
            "ω": base._replace(V=np.where(axes, drawn.V, base.V)),
            "input": base._replace(inputs=drawn.inputs),
        }
        at_base = difference(base)
        names = [n for n, x in changes.items() if size_of(difference(x) - at_base) > LEFT * size]
        words = f"{title} is unexplained: its difference depends on {listed(names or ['nothing'])}"
        self.note(title, words, "unexplained")
        return None

    def _attitude(self) -> None:
        """Judge the rate of the attitude, in the user's axes."""
        states, title = self.states[0].signed(self.plant.signs), "rate of the attitude"
        part, where = self.plant.parts["attitude"]
        w, raw = states.V[:, :3], self.rates[0][:, where]
        (q, turns), words, rate = self.plant.turned_as(part, states), "", 0 * raw
        if part.as_ == "roll-pitch-yaw":
            words, rate = "the rates of roll, pitch, yaw are set to ω", w * part.factor
        elif part.as_.startswith("quaternion"):
            order = "xyzw" if part.as_.endswith("wxyz") else "wxyz"
            Q, reordered = np.array(states.Q), with_fields(part, as_=f"quaternion {order}")
            Q[:, :3, :3] = reordered.in_code.rotation(q)
            p, of_other = self.plant.turned_as(reordered, states._replace(Q=Q))
            words = f"the quaternion ({part.as_[-4:]}) is multiplied as if it were {order}"
            rate = apply_matrix(of_other, w) * np.sign((p * q).sum(axis=1))[:, None]
        if words and size_of(raw - rate) <= LEFT * size_of(raw):
            self.note(title, words, "differs")
            return
        terms, pair = Scene(self.model, self.states[0]).turning, self.rate("attitude", 0)
        off = raw - (turns @ np.linalg.pinv(turns) @ raw[..., None])[..., 0]
        is_turn = size_of(off) <= LEFT * size_of(raw)
        if not is_turn or compared(terms, *pair) is None:
            rows = self._entries(part, q, turns, raw, w)
            if 0 < len({row.axis for row in rows if row.differs}) <= raw.shape[1] / 2:
                self.add(title, rows, [*sentences_of(title, rows)])
                return
        if not is_turn:
            raise InputError(
                f"{self.plant.name}: the rate of the attitude belongs to no rotation; check `as` "
                "and the order of the state in the adapter"
            )
        self._explained(title, "attitude", terms, *pair)

    def _entries(
        self, part: StatePart, q: Array, turns: Array, raw: Array, w: Array
    ) -> Sequence[Term]:
        """Return the terms of each entry of the rate, which may have a slip."""
        names = [f"R{i}{j}" for i in (1, 2, 3) for j in (1, 2, 3)]
        if part.as_.startswith("quaternion"):
            names = [f"q{x}" for x in part.as_[-4:]]
        elif part.as_ == "roll-pitch-yaw":
            names = part.as_.split("-")

        def entry(k: int) -> Arrays:
            if part.as_ == "roll-pitch-yaw":
                return {f"its term of ω{XYZ[i]}": turns[:, k, i] * w[:, i] for i in range(3)}
            pairs = product(enumerate(names), range(3))
            return {f"{name} ω{XYZ[i]}": q[:, a] * w[:, i] for (a, name), i in pairs}

        return compared(entry, raw, apply_matrix(turns, w), names) or ()

    def _velocity(self) -> None:
        frame = "space" if self.plant.parts["velocity"][0].frame == "space" else "body"
        a, b, mean = self.states
        difference = Scene(self.model, a._replace(inputs=a.inputs - b.inputs), frame)
        pushed = np.subtract(self.rate("velocity", 0), self.rate("velocity", 1))
        terms_of = Scene.push
        sums = compared(difference.push, *pushed)
        of_torque = sums is None or any(row.differs and row.name[0] == "τ" for row in sums)
        if of_torque and self.model.thrusters is not None:
            terms_of = Scene.push_of_thrusters
        push = self._explained("push", "velocity", partial(terms_of, difference), *pushed)
        if push is None:
            return
        M = np.diag(self.model.inertia.matrix)[3:]
        unit = 1.0 if np.ptp(M) > 0 else 1 / M[0]
        before, said = len(self.sentences), [*sentences_of("push", push, self._mass, unit)]
        self.add("push", push, said, unit)
        scene, (plant, model) = Scene(self.model, mean, frame), self.rate("velocity", 2)
        for row in push:
            k = XYZ.index(row.axis)
            term = terms_of(scene, k)[row.name]
            plant[:, k] -= row.plant * term
            model[:, k] -= row.model * term
        title, of_R = "acceleration without the push", [x for x in push if x.name[0] == "R"]
        is_wrong = any(row.differs for row in of_R) and math.isnan(common_ratio(of_R))
        if is_wrong and not compared(scene.no_push, plant, model):
            self.rows.append((title, "", "", "not judged, as R is wrong"))
            return
        rows = self._explained(title, "velocity", scene.no_push, plant, model) or ()
        masses = {row.axis: row.ratio for row in push if row.differs and row.model}
        weighed = {row.axis for row in push if row.model}  # along which the push tells the mass
        weighed |= {*XYZ} if weighed and not np.ptp(M) else set()
        kinds = by_kind(rows)
        kinds["drag"] = kinds.get("drag", []) + kinds.pop(MOMENT, [])
        steady = [row for row in kinds["drag"] if row.model]
        if steady and not any(row.differs for row in steady):  # which shows the mass right
            said_of = sentences_of("push", push, self._undivided, unit)
            self.sentences[before : before + len(said)] = said_of
        for kind, terms in kinds.items():
            title = kind.replace("× v", "× 𝕀v") if np.ptp(M) > 0 else kind
            note = self._gravity if title == "weight" else self._mass
            if weighed.issuperset(row.axis for row in terms):
                note = self._of_weight if title == "weight" else self._undivided
            # A wrong mass is said once.
            news = [
                x for x in terms if not (x.differs and near(x.ratio, masses.get(x.axis, math.nan)))
            ]
            self.add(title, terms, [*sentences_of(title, news, note)])

    def _gravity(self, rows: Sequence[Term]) -> str:
        """Return how a factor of the weight follows from the mass, or the values."""
        words = self._mass(rows)
        return _values(rows) if words.startswith("mass") and len(rows) == 1 else words

    def _of_weight(self, rows: Sequence[Term]) -> str:
        """Return how a factor of the weight follows from the mass that the push shows, or g."""
        return self._undivided(rows) or _values(rows)

    def _undivided(self, rows: Sequence[Term]) -> str:
        """Return how a factor of a force follows from the mass that the push shows."""
        return "" if (words := self._mass(rows)).startswith("mass") else words

    def _mass(self, rows: Sequence[Term]) -> str:
        """Return how a factor of a force follows from masses."""
        ratio, k, I = common_ratio(rows), XYZ.index(rows[0].axis) + 3, self.model.inertia
        m, dry = I.matrix[k, k], I.matrix[k, k] - (0.0 if I.added is None else I.added[k, k])
        if near(ratio, m) or near(ratio, 1 / m):
            return "not divided by the mass" if near(ratio, m) else "divided by the mass twice"
        without = ", that without the added mass" if near(m / ratio, dry) and dry < m else ""
        return f"mass {number(m / ratio)} of {number(m)}{without}" if ratio > 0 else ""

    def _torque(self) -> None:
        plant, model = map(
            np.concatenate, zip(*(self.rate("rates", k) for k in range(3)), strict=True)
        )
        states = States(*map(np.concatenate, zip(*self.states, strict=True)))
        terms = Scene(self.model, states).torque
        kinds = by_kind(self._explained("angular acceleration", "rates", terms, plant, model) or ())
        names, J = self.model.input_names, np.diag(self.model.inertia.matrix)[:3]
        inputs = {(row.axis, row.name): row for row in kinds.get("torque", ())}
        A, E = (
            np.array([[getattr(inputs.get((a, n)), of, 0.0) for n in names] for a in XYZ])
            for of in ("plant", "model")
        )
        squares = (E * E).sum(axis=1)
        ratios = np.where(squares > 0, (A * E).sum(axis=1) / np.where(squares > 0, squares, 1), 1)
        K = J / np.where(ratios == 0, np.nan, ratios)  # what the moments of inertia would be
        moved = {
            (XYZ[a], f"ω{XYZ[b]} ω{XYZ[c]}"): (-1) ** a * (K[b] - K[c]) / K[a]
            for a, b, c in ((0, 1, 2), (1, 0, 2), (2, 0, 1))
        }
        products = kinds.get("ω × Jω", ())
        of_inertia = {(r.axis, r.name) for r in products} <= moved.keys() and all(
            abs(r.plant - moved[r.axis, r.name]) < 1e-4 for r in products
        )
        for kind, rows in kinds.items():
            title = f"torque of the {kind}" if kind == "weight" else kind
            words = [*sentences_of(title, rows, self._moments)]
            if kind == "torque" and all(row.name[0] == "R" for row in rows if row.plant):
                x = sum_of([row for row in rows if row.axis == "x"], "plant")
                words = [f"torque is carried to another frame: along x it is {x}"]
            elif kind == "torque" and words and all(row.name in names for row in rows):
                words = self._allocation(A, E, ratios, J if of_inertia else 0 * J) or words
            elif kind == "ω × Jω" and of_inertia and not np.allclose(A, E, rtol=1e-4):
                words = []
            self.add(title, rows, words)

    def _allocation(self, A: Array, E: Array, ratios: Array, J: Array) -> list[str]:
        """Return what exchanges thrusters, signs, arms or moments of inertia; none if nothing does.

        J are the moments of inertia if all of ω̇ follows from others, else 0.
        """

        def is_plant(X: Array) -> bool:
            return np.allclose(A, X, rtol=1e-4, atol=1e-6 * np.abs(E).max())

        if is_plant(E):
            return []
        signs = [x for x in product((1, -1), repeat=3) if is_plant(np.array(x)[:, None] * E)]
        axes = [[XYZ[i] for i in range(3) if x[i] < 0 and E[i].any()] for x in signs]
        ways = [f"torque {listed(x)}: coefficient −1 of 1 (the sign is wrong)" for x in axes[:1]]
        orders = [" ".join(str(i + 1) for i in x) for x in self._orders() if is_plant(E[:, x])]
        ways += [f"the thrusters are in the order {x}" for x in orders[:2]]
        if ways or not (is_plant(ratios[:, None] * E) and ratios.all()):
            return [", or ".join(ways)] if ways else []
        odd = [i for i in range(3) if not near(ratios[i], 1.0)]
        if J.any() and len(odd) < 3:
            a, b = odd[0], odd[-1]
            if near(J[a] / ratios[a], J[b]) and near(J[b] / ratios[b], J[a]):
                return [f"J{XYZ[a]} and J{XYZ[b]} are exchanged"]
            K = [number(x) for x in J / ratios]
            return [f"J{XYZ[i]} is {K[i]}, expected {number(J[i])}" for i in odd]
        factors = dict[str, list[str]]()
        for i in odd:
            row = Term(XYZ[i], "", float(ratios[i]), 1.0, True)
            words = usual([row]) or self._moments([row])
            words = f"{coefficient(row.ratio)}{f' ({words})' if words else ''}"
            factors.setdefault(words, []).append(XYZ[i])
        return [f"torque {listed(axes)}: {words}" for words, axes in factors.items()]

    def _orders(self) -> Iterator[tuple[int, ...]]:
        """Return the orders of the thrusters, if they are few."""
        k = self.model.columns.shape[1] if self.model.thrusters is not None else 0
        return permutations(range(k)) if 0 < k <= MOST_ROTORS else iter(())

    def _moments(self, rows: Sequence[Term]) -> str:
        """Return how a factor of a torque, or a product of ω, follows from moments of inertia."""
        J, row = np.diag(self.model.inertia.matrix)[:3], rows[0]
        if near(common_ratio(rows), J[XYZ.index(row.axis)]):
            return f"not divided by J{row.axis}"
        for (a, b), c in product(permutations(range(3), 2), range(3)):
            if len(rows) == 1 and " ω" in row.name and near(row.plant, (J[a] - J[b]) / J[c]):
                return f"J{XYZ[a]} − J{XYZ[b]} over J{XYZ[c]}"
        return ""

    # What cannot be seen, and steps.

    def _unseen(self) -> None:
        M, B, unseen = np.diag(self.model.inertia.matrix), self.model.columns[:3], list[str]()
        for a, b, c in ((0, 1, 2), (0, 2, 1), (1, 2, 0)):
            if near(M[a], M[b]):
                x, y = XYZ[a], XYZ[b]
                unseen.append(f"J{x} = J{y} hides ω{x} ω{y} in ω̇{XYZ[c]}, and J{x} for J{y}")
        if near(M[-1], 1.0) and len(M) > 3:
            unseen.append("1 kg hides factors of the mass")
        moved = [B[:, order] for order in self._orders()]
        if any(not np.allclose(x, B) and np.allclose(np.abs(x), np.abs(B)) for x in moved):
            unseen.append("thrusters in another order can equal wrong signs of torques")
        self.unseen = [*unseen, "terms below 1e-6 of a rate; other times and inputs"]

    def _steps(self) -> None:
        """Find by the slope of (x(h) − x)/h how a step computes each part."""
        states, h, ends = self.states[0].of(slice(FEW)), 1e-4, []
        w_dot, R = self.compare("rates", states, self.rates[0][:FEW])[0], states.Q[:, :3, :3]
        V_dot = w_dot
        if "velocity" in self.plant.parts:
            v_dot = self.compare("velocity", states, self.rates[0][:FEW])[0]
            if self.plant.parts["velocity"][0].frame == "space":
                turned = np.cross(states.V[:, :3], states.V[:, 3:])
                v_dot = apply_matrix(transpose(R), v_dot) - turned
            V_dot = np.hstack([w_dot, v_dot])
        for k in (-h, h):
            Q = states.Q @ self.model.group.exp(k * states.V + k * k / 2 * V_dot)
            ends.append(self.plant.derivatives(States(Q, states.V + k * V_dot, states.inputs))[0])
        second, slopes = (ends[1] - ends[0]) / (2 * h), self.slopes[:FEW]
        for kind, (_, where) in self.plant.parts.items():
            a, b = slopes[:, where, None], second[:, where, None]
            if kind == "attitude":  # without what normalises it
                turns = self.plant.turned(states)[1]
                a, b = (np.linalg.pinv(turns) @ x for x in (a, b))
            share = float((a * b).sum() / ((b * b).sum() or 1.0))
            exact = size_of(a - share * b) < 0.05 * size_of(b)
            words = (x for y, x in SCHEMES.items() if abs(share - y) < 0.02 and exact)
            constant = size_of(b) <= LEFT * size_of(self.rates[0])
            self.steps[kind] = "constant rate" if constant else next(words, "another scheme")


SCHEMES = {0.0: "explicit Euler", 0.5: "order 2 or more", 1.0: "order 1, with the new rate"}
"""Schemes by the slope of (x(h) − x)/h in that of the derivative."""
