"""What `eqt config check` says of the numbers of an experiment."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from eqt_cli.base import purposes
from eqt_cli.base.stored import SmallErrors
from eqt_cli.cli.output import table
from eqt_cli.components.matrix_groups import rigid
from eqt_cli.components.mechanics import hessian_at_identity
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.remarks import gains_flown
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.proofs.authority import authority_table
from eqt_cli.loop.closed_loop import ClosedLoop
from eqt_cli.loop.small_errors import SAME, STEP, at_rest

if TYPE_CHECKING:
    from rich.text import Text

LONG, LONGEST = 30, 60
"""Most characters of a title among others, and of all titles of a row or line."""


@purposes.meaning_of_an_experiment
def meaning(experiment: Experiment, shown: Horizon) -> Iterator[str | Text]:
    """Yield the bandwidth and damping of each law, and what limits leave, as tables and lines."""
    rows, gains = _gains(experiment)
    lines = [*gains, *_poles(experiment, gains_flown(experiment, shown))]
    if rows:
        yield from ("", table(["law", "axis", "bandwidth, rad/s", "damping"], rows), "")
    yield from lines
    if left := authority_table(experiment):
        yield from ("", left, "")


def by_axis(loop: ClosedLoop) -> tuple[dict[str, tuple[float, float]], list[str]]:
    """Return how errors at rest decay along each axis alone, and which of K and K_d act.

    Bandwidth ω, rad/s, and damping ζ solve 𝕀ε̈ + Dε̇ + Hε = 0 at Q_d = I, with H and D of the law's
    torque, where it tells them, else of kp and kd; and for a cascade with the position's gains.
    Left out: couplings, limits, lags and delays.
    """
    inner, position, acting = loop.inside, getattr(loop.controller, "position", None), ["K", "K_d"]
    G, J, gains = inner.group, inner.inertia.at(0.0).matrix, inner.gains
    H, D = hessian_at_identity(G, inner.task.weight(gains.K)), gains.K_d
    doubled = replace(loop, gains=replace(gains, K=2 * gains.K, K_d=2 * gains.K_d))
    at = np.zeros(1), loop.group.identity[None]
    one, two = at_rest(loop, *at), at_rest(doubled, *at)
    if one and two:
        flown = J @ one.stiffness[0], J @ one.damping[0]  # with the rounding of differences
        same = [
            np.abs(a - b).max() <= SAME * np.abs(a).max() for a, b in ((H, flown[0]), (D, flown[1]))
        ]
        H, D = (H if same[0] else flown[0]), (D if same[1] else flown[1])
        # Options that follow the gains have followed them when the law was built.
        acting = acting if inner.controller.defaults(G, gains) else one.changes(two)
    J, H, D = map(np.diagonal, (J, H, D))
    oscillators = list(zip(G.axis_names, H / J, D / J, strict=True))
    if position is not None:
        kx, kv = (np.broadcast_to(k, rigid(loop.group).space) for k in (position.kx, position.kv))
        oscillators += zip("xyz", kx, kv, strict=False)
    least = STEP**4 * max(k for _, k, _ in oscillators)
    sizes = {axis: (math.sqrt(k), d) for axis, k, d in oscillators if k > least}
    return {axis: (w, d / (2 * w)) for axis, (w, d) in sizes.items()}, acting


def _gains(experiment: Experiment) -> tuple[list[list[str]], list[str]]:
    """Return what the gains mean for each axis, a row each, and lines as papers write them."""
    laws, lines = dict[tuple[str, ...], list[str]](), dict[str, list[str]]()
    for title, loop in zip(experiment.titles.values(), experiment.loops.values(), strict=True):
        inner, gains, axes = loop.inside, loop.inside.gains, dict[tuple[str, ...], list[str]]()
        if not inner.controller.reads_gains:
            continue
        errors, acting = by_axis(loop)
        for axis, (bandwidth, damping) in errors.items():
            axes.setdefault((f"{bandwidth:.3g}", f"{damping:.2g}"), []).append(axis)
        for numbers, names in axes.items():
            laws.setdefault((", ".join(names), *numbers), []).append(title)
        words = [f"{key} is not read" for k, key in (("K", "kp"), ("K_d", "kd")) if k not in acting]
        kp, kd = gains.K[0, 0], gains.K_d[0, 0]
        multiples = all((k == k[0, 0] * np.eye(len(k))).all() for k in (gains.K, gains.K_d))
        if multiples and len(acting) == 2 and all(part.turns for part in inner.group.parts):
            words.append(f"kp {kp:.4g}, kd {kd:.4g} (k_R {2 * kp:.4g}, k_Omega {kd:.4g})")
        if free := loop.task.words(loop.gains):
            barrier = loop.task.barrier(loop.controller, loop.gains, loop.reference)
            claim = f"claimed: from L < 2k = {barrier:.4g} J the axis arrives"
            claimed = barrier and loop.claims_decrease
            words += [f"{free} is free", claim if claimed else "nothing is claimed"]
        lines.setdefault("; ".join(words), []).append(title)
    rows = [[_names(titles, experiment), *row] for row, titles in laws.items()]
    said = [f"{_names(titles, experiment)}: {words}" for words, titles in lines.items() if words]
    return rows, said


def _names(titles: list[str], experiment: Experiment) -> str:
    """Return the titles of laws, long ones shortened; of many in a short form, if it is all."""
    short = [title if len(title) <= LONG else f"{title[: LONG - 1]}…" for title in titles]
    names = ", ".join(short)
    is_all = len(titles) == len(experiment.loops)
    return f"all {len(titles)} laws" if is_all and len(names) > LONGEST else names


def _poles(experiment: Experiment, flown: Mapping[str, SmallErrors]) -> Iterator[str]:
    """Yield the slowest pole of each law along the reference, and which laws fly with others."""
    laws = dict[tuple[str, str, str], list[str]]()
    for label, errors in flown.items():
        loop, without = experiment.loops[label], ""
        inner, title = loop.inside, experiment.titles[label]
        if inner.controller.memory(inner.group):
            without = ", without the law's own states (`eqt margins` includes them)"
        said = without, errors.poles, errors.departs
        laws.setdefault(said, []).append(
            title if inner is loop else f"the attitude loop of {title}"
        )
    for (without, poles, departs), titles in laws.items():
        yield f"slowest pole of {_names(titles, experiment)} at rest{without}: {poles}"
        if departs:
            yield f"  {departs}"
    if any(departs for *_, departs in laws):
        yield "  to keep them: a law with its error in the body, or on SO3 equal gains on all axes"
