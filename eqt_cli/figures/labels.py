"""Symbols, units and names as text that Matplotlib sets; it knows no layout.

Texts of a user go through `free_text`.
"""

import re
import textwrap
from itertools import groupby

import numpy as np
from matplotlib.mathtext import MathTextParser

from eqt_cli.base.arrays import Array
from eqt_cli.components.groups import MatrixLieGroup, Part
from eqt_cli.figures import style
from eqt_cli.figures.style import mathematical, shift
from eqt_cli.results.result import Result
from eqt_cli.results.summary import part_units

_DESIRED = re.compile(r"\b(\w)_d\b")
"""Symbol of a desired value among words."""
_LONGEST = 30
"""Most characters in a line of a user's name of a signal."""
_PLAIN_UNIT = re.compile(r"(?:[A-Za-z0-9/() ]|\^-?[0-9])+")
_DESCRIPTIVE = re.compile(r"_\{?([Ed])(?:\}|(?!\w))")
"""Index that describes, such as of an error or a desired value, and is therefore upright."""


def quantity(symbol: str, unit: str) -> str:
    """Return an axis label: the symbol with its unit in parentheses, if it has one.

    Parameters
    ----------
    symbol
        Symbol in Matplotlib's mathematical notation, without dollar signs.
    unit
        Unit as in a result file: ``rad/s``, ``N m``, ``m/s^2``; ``1`` or nothing for a pure number,
        and ``mixed`` for a norm over parts with different units.
    """
    symbol = _DESCRIPTIVE.sub(r"_{\\mathrm{\1}}", symbol)
    if unit in ("", "1"):
        return f"${symbol}$"
    if unit == "mixed":
        return f"${symbol}$ (mixed units)"
    if not _PLAIN_UNIT.fullmatch(unit):
        return f"${symbol}$ ({_literal(unit)})"
    left, right = "[]" if "(" in unit else "()"
    return rf"${symbol}$ ${left}{_upright(unit)}{right}$"


def _upright(unit: str) -> str:
    powers = re.sub(r"\^(-?\d+)", r"^{\1}", unit).replace(" ", r"\,")
    return rf"\mathrm{{{powers}}}"


def in_words(words: str, unit: str) -> str:
    """Return an axis label in words, with the unit in parentheses as in `quantity`.

    Indices are mathematics, too, whose font has no letters for them.
    """
    if not style.DOLLAR.search(words):
        words = "".join(f"${style.command(x)}$" if shift(x) else x for x in words)
    return words + quantity("", unit).removeprefix("$$")


def _labelled(result: Result, name: str, symbol: str, unit: str) -> str:
    """Return a symbol with its unit; with mixed units of parts, ``‖τ‖ (N m and N)``."""
    several = part_units(result, name) if unit == "mixed" else []
    units = " and ".join(f"${_upright(symbol)}$" for symbol in several)
    return f"{quantity(symbol, '')} ({units})" if several else quantity(symbol, unit)


def signal_label(result: Result, signal: str) -> str:
    """Return the axis label of a signal: its symbol with its unit."""
    if signal in result.custom_names:
        return in_words(free_text(result.custom_names[signal], _LONGEST), result.units(signal))
    text = _labelled(result, signal, result.quantity(signal).symbol.latex, result.units(signal))
    per_law = signal == "lyapunov" and result.lyapunov_functions
    return f"{text},\neach law's own" if per_law else text


def metric_label(result: Result, metric: str, characters: int) -> str:
    """Return the name of a metric with its unit, in lines of at most `characters`."""
    unit = result.units(metric)
    # Else it is computed from stored signals.
    of = result.quantity(metric) if result.has(metric) else result.comparable_named(metric)
    words = result.custom_names.get(metric, "")
    if "{}" in of.label and not words:
        return of.label.replace("{}", _labelled(result, metric, of.symbol.latex, unit)) + of.when
    words = free_text((words or of.label or of.long_name) + of.when, characters)
    return words + _labelled(result, metric, "", unit).removeprefix("$$")


def force_component(axis: str, unit: str) -> str:
    r"""Return the symbol of a torque or force: ``\tau_{x}`` along ``ωx``, ``f_{x}`` along ``vx``.

    An axis that is neither a turn nor a velocity gives its whole name as the index.
    """
    if axis.startswith("v") and unit == "N":
        return component("f", axis[1:])
    return component(r"\tau", axis.removeprefix("ω"))


def component(symbol: str, axis: str) -> str:
    r"""Return a symbol with an axis name as its index: ``\tau_{\omega x,1}`` for ``ωx₁``.

    An index of an index would be too small to read.
    """
    pieces: list[str] = []
    for place, letters in groupby(filter(str.isalnum, axis), shift):
        text = " ".join(map(mathematical, letters))
        nested = f",{text}" if symbol and place == "_" else f"{place}{{{text}}}"
        pieces.append(nested if place and pieces else text)
    return f"{symbol}_{{{''.join(pieces)}}}" if pieces else symbol


def notation(text: str) -> str:
    r"""Return words with symbols of desired values typeset: ``$\tau_{\mathrm{d}}$`` for ``τ_d``."""
    return _DESIRED.sub(lambda symbol: quantity(f"{mathematical(symbol[1])}_d", ""), text)


def free_text(name: str, characters: int) -> str:
    """Return a user's text as it is drawn, in lines of at most `characters`.

    ``$…$`` is mathematics if Matplotlib can typeset it, and is else shown verbatim.
    """
    text = "".join(c if c.isprintable() else " " for c in name)
    if style.DOLLAR.search(text):  # else parsing would warn of letters that the font lacks
        try:
            MathTextParser("path").parse(text)
        except ValueError:
            return _literal(text)
        return text
    text = text.replace(r"\$", "$")
    return _literal(text) if "$" in text else "\n".join(textwrap.wrap(text, characters))


def part_name(suffix: str) -> str:
    """Return the words in the suffix of a norm over a part: ``rotation`` for ``_rotation``."""
    return suffix.removeprefix("_").replace("_", " ")


def _literal(text: str) -> str:
    """Escape text, so that no character is a command."""
    return text.replace("$", r"\$")


def axis_labels(G: MatrixLieGroup) -> list[str]:
    """Return the label of the k-th curve of a panel: a direction, or axis names in all parts.

    ``x`` stands for ωx and vx: the scales name the quantity.
    """
    names = [G.axis_names[part.axes] for part in G.parts]
    labels = []
    for k in range(max(map(len, names))):
        here = [axes[k] for axes in names if k < len(axes)]
        directions = {axis[1:] for axis in here}
        shown = directions if len(directions) == 1 and "" not in directions else here
        labels.append(", ".join(f"${component('', axis).lstrip('_')}$" for axis in shown))
    return labels


def symbols(G: MatrixLieGroup, part: Part, index: str = "") -> tuple[str, str, str]:
    """Return the symbols of pose, velocity and force in a part, with an index if given."""
    vectors = [pose_part for pose_part in G.parts if not pose_part.turns]
    if len(G.parts) == 1 or not (part.turns or part.pose_unit.startswith("m")):
        pose, velocity, force = ("p" if part.pose_unit == "m" else "Q"), "V", r"\tau"
    elif part.turns:
        pose, velocity, force = "R", r"\omega", r"\tau"
    elif len(vectors) == 1:
        pose, velocity, force = "p", "v", "f"
    else:
        initial = part.name[0]
        pose, velocity = initial, str(G.axis_names[part.axes][0])[0]
        return _indexed(pose, index), _indexed(velocity, index), _indexed("f", initial + index)
    return _indexed(pose, index), _indexed(velocity, index), _indexed(force, index)


def _indexed(symbol: str, index: str) -> str:
    return f"{symbol}_{{{','.join(index)}}}" if index else symbol


def pose_coordinates(
    G: MatrixLieGroup, part: Part, pose: Array, index: str = "", near: Array | None = None
) -> tuple[Array, str, str]:
    """Return a part of poses ``(n, d, d)`` as curves ``(n, coordinates)``, their symbol and unit.

    `near` holds curves of about the same poses, as for `without_jumps`.
    """
    entries = pose[(..., *part.entries)].reshape(len(pose), -1)
    symbol = symbols(G, part, index)[0]
    if entries.shape[1] == len(G.axis_names[part.axes]):
        return entries, symbol, part.pose_unit
    with np.errstate(all="ignore"):
        logarithm = np.full((len(pose), G.dimension), np.nan)
        real = np.isfinite(pose).all(axis=(1, 2))
        logarithm[real] = G.log(pose[real])
    turns = logarithm[:, part.axes]
    if not part.turns:
        return turns, rf"\log {symbol}", ""
    curves = without_jumps(turns, near)
    more = r",\ \mathrm{unwrapped}" if np.nanmax(abs(curves - turns)) > 1 else ""
    return curves, rf"\log {_indexed('R', index)}{more}", "rad"


def part_curves(
    G: MatrixLieGroup,
    part: Part,
    name: str,
    values: Array,
    *,
    degrees: bool,
    index: str = "",
    near: Array | None = None,
) -> tuple[Array, str]:
    """Return a part of poses, errors, velocities or wrenches as curves, and the label of its scale.

    Parameters
    ----------
    name
        ``pose``, ``error``, ``difference``, ``velocity``, or ``wrench`` or ``torque``.
    degrees
        Whether angles and rates of rotations are in degrees.
    index, near
        As of `pose_coordinates`.
    """
    degrees = degrees and part.turns
    if name == "pose":
        near = np.radians(near) if degrees and near is not None else near
        curves, symbol, unit = pose_coordinates(G, part, values, index, near)
    elif name in ("error", "difference"):
        curves, symbol, unit = values[:, part.axes], "", part.error_unit
    else:
        _, velocity, force = symbols(G, part, index)
        of_velocity = name == "velocity"
        curves, symbol = values[:, part.axes], velocity if of_velocity else force
        unit = part.velocity_unit if of_velocity else part.force_unit
    if degrees and unit.startswith("rad"):
        curves, unit = np.degrees(curves), unit.replace("rad", "deg")
    return curves, quantity(symbol, unit) if symbol else in_words(name, unit)


def without_jumps(vectors: Array, near: Array | None = None) -> Array:
    """Return rotation vectors ``(n, k)``, unwrapped by whole turns about their axes.

    Each is as close as possible to its counterpart in `near`; without `near`, to the one before.
    """
    unwrapped = vectors.copy()
    pairs = zip(unwrapped[1:], unwrapped[:-1], strict=True)
    for now, other in pairs if near is None else zip(unwrapped, near, strict=True):
        angle = np.linalg.norm(now)
        axis = now / angle if angle > 0 else other / max(np.linalg.norm(other), 1.0)
        turns = np.round((other @ axis - angle) / (2 * np.pi))
        if np.isfinite(turns):
            now += 2 * np.pi * turns * axis
    return unwrapped
