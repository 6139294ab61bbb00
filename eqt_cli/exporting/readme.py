"""The README of a folder with exported laws."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from eqt_cli.analysis.certificate_table import tally
from eqt_cli.analysis.certificates.base import Row
from eqt_cli.config.signal_path import loop_in_words
from eqt_cli.core.registry import description
from eqt_cli.core.version import __version__
from eqt_cli.exporting.files import TOLD_MEANINGS, bounds_in_words, meaning
from eqt_cli.exporting.laws import Exported, ExportedLaw
from eqt_cli.exporting.measured import MISSING, Measured
from eqt_cli.exporting.text import above, filled

NAME = "README.md"


def readme(found: Exported, costs: Mapping[str, Measured | None]) -> str:
    """Return the text of the README."""
    experiment, laws = found.experiment, found.laws
    first, G = laws[0], experiment.group
    known = next((cost for cost in costs.values() if cost), None)
    reference = ""
    if first.reference:
        reference = (
            f" `{first.name}_reference` sets the time and what is desired; the rest is measured."
        )
    if first.filter:
        reference += (
            f" `{first.name}_update` does all of a period: it estimates pose and velocity from "
            f"what is measured by the filter `{first.filter.kind}`, and calls the law."
        )
    return filled(
        NAME,
        version=__version__,
        experiment=experiment.name,
        group=G.name,
        real=first.by.name,
        digest=experiment.digest,
        loop=loop_in_words(experiment.resolved),
        laws="\n".join(
            f"- **{experiment.titles[law.label]}** (`{law.name}.h`, `{law.name}.c`): "
            f"{description(type(law.loop.controller))}"
            for law in laws
        ),
        spelled=_spelled(laws),
        first=first.name,
        reference=reference,
        inputs="\n".join(
            f"| `{each.name}` | {each.size} | {each.unit}: {TOLD_MEANINGS[each.name]} |"
            for each in first.program.told
        ),
        axes=", ".join(G.axis_names),
        torque=f"{first.program.torque.size} numbers, in {first.program.torque.unit}",
        bounds="\n".join(_bounds(law) for law in laws),
        costs="\n".join(_cost(law, costs[law.label]) for law in laws),
        compiler=f"Measured with {known.compiler}, -O2."
        if known
        else f"Cost on Cortex-M4: {MISSING}.",
        numbers="\n\n".join(_numbers(law) for law in laws),
        certificates="\n".join(_certificates(law, found.rows) for law in laws),
    )


def _spelled(laws: Sequence[ExportedLaw]) -> str:
    """Return a sentence on labels that are no names in C; empty without such labels."""
    changed = [f"`{law.label}` is `{law.name}`" for law in laws if law.label != law.name]
    return f"\nIn C, {', '.join(changed)}.\n" if changed else ""


def _bounds(law: ExportedLaw) -> str:
    count, singular = law.states.count, int(np.count_nonzero(law.singular))
    apart = "none"
    if singular:
        apart = f"{singular} states, up to {above(float(law.singular_bound.max()))}"
    return f"| `{law.name}` | {count} | {bounds_in_words(law)} | {apart} |"


def _cost(law: ExportedLaw, cost: Measured | None) -> str:
    flash, stack = (f"{cost.flash} bytes", f"{cost.stack} bytes") if cost else ("-", "-")
    return f"| `{law.name}` | {law.program.step.operations} | {flash} | {stack} |"


def _numbers(law: ExportedLaw) -> str:
    lines = [f"### {law.name}", "", "| number | value | |", "|---|---|---|"]
    for entry in law.program.numbers:
        values = ", ".join(f"{value:.9g}" for value in law.numbers[entry.name].flat)
        unit = f"{entry.unit}; " * bool(entry.unit)
        lines.append(f"| `{entry.name}` | {values} | {unit}{meaning(law, entry)} |")
    return "\n".join(lines)


def _certificates(law: ExportedLaw, rows: Sequence[Row]) -> str:
    own = [row for row in rows if row.controller == law.label]
    controller = law.loop.controller
    claim = controller.claims(law.loop.group, law.loop.gains)
    said = {
        True: f"L = {controller.energy} falls along every motion of the ideal loop, in "
        f"continuous time ({controller.theorem})",
        False: f"L = {controller.energy} is not claimed to fall",
        None: "nothing is claimed",
    }[claim]
    return f"- **{law.experiment.titles[law.label]}**: {said}. Identities: {tally(own)}."
