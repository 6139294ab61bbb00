"""What `eqt config check` says of the numbers of an experiment."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import TYPE_CHECKING

import numpy as np

from eqt_cli.base.stored import SmallErrors
from eqt_cli.cli.output import table
from eqt_cli.config.experiment import Experiment
from eqt_cli.config.remarks import gains_flown
from eqt_cli.engines.horizon import Horizon
from eqt_cli.extensions.proofs.authority import authority_table
from eqt_cli.loop.small_errors import by_axis

if TYPE_CHECKING:
    from rich.text import Text


def meaning(experiment: Experiment, shown: Horizon) -> Iterator[str | Text]:
    """Yield the bandwidth and damping of each law, and what limits leave, as tables and lines."""
    rows, gains = _gains(experiment)
    lines = [*gains, *_poles(experiment, gains_flown(experiment, shown))]
    if rows:
        yield from ("", table(["law", "axis", "bandwidth, rad/s", "damping"], rows), "")
    yield from lines
    if left := authority_table(experiment):
        yield from ("", left, "")


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
    rows = [[", ".join(titles), *row] for row, titles in laws.items()]
    return rows, [f"{', '.join(titles)}: {words}" for words, titles in lines.items() if words]


def _poles(experiment: Experiment, flown: Mapping[str, SmallErrors]) -> Iterator[str]:
    """Yield the slowest pole of each law along the reference, and which laws fly with others."""
    laws = dict[tuple[str, str], list[str]]()
    for label, errors in flown.items():
        laws.setdefault((errors.poles, errors.departs), []).append(experiment.titles[label])
    for (poles, departs), titles in laws.items():
        yield f"slowest pole of {', '.join(titles)} at rest: {poles}"
        if departs:
            yield f"  {departs}"
    if any(departs for _, departs in laws):
        yield "  to keep them: a law with its error in the body, or on SO3 equal gains on all axes"
