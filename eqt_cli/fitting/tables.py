"""What a replay or a fit found, as tables of text."""

from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.fitting.growth import Growth
from eqt_cli.fitting.plant_fit import PlantFit


def growth_table(found: Growth) -> TextTable:
    """The error of each part at each horizon: median, quantiles, and what noise alone gives."""
    header = ["horizon, s", "median", "10 %", "90 %", "rms", "noise"]
    blocks = []
    for k, (part, unit) in enumerate(zip(found.parts, found.units, strict=True)):
        columns = (found.median, found.low, found.high, found.rms, found.noise)
        rows = [
            [f"{horizon:.4g}", *(f"{column[k, h]:.3g}" for column in columns)]
            for h, horizon in enumerate(found.horizons)
        ]
        blocks.append(Block(f"{part}, {unit}", rows))
    failed = f"; the runs of {found.failed} more failed" if found.failed else ""
    title = f"Error of the prediction of {found.name} over {found.windows} windows{failed}"
    notes = [
        "Each window starts in a recorded state. noise: the rms that the noise of the recording "
        "alone gives a perfect model.",
        *found.notes,
    ]
    return TextTable("growth", title, header, blocks, notes)


def fit_tables(found: PlantFit) -> list[TextTable]:
    """The numbers with their intervals, and the errors before and after."""
    numbers = [
        [n.key, f"{n.start:.5g}", f"{n.value:.5g}", f"[{n.low:.5g}, {n.high:.5g}]"]
        for n in found.numbers
    ]
    errors = [
        [f"{r.part}, {r.unit}", *(f"{x:.3g}" for x in (r.before, r.after, r.noise))]
        for r in found.residuals
    ]
    values = ", ".join(f"{value:.3g}" for value in found.singular_values)
    title = f"Fitted to {found.windows} windows of {found.horizon:.4g} s of {found.name}"
    return [
        TextTable(
            "numbers",
            title,
            ["key", "start", "found", "95 % interval"],
            [Block("", numbers)],
            [
                f"Singular values of the scaled Jacobian: {values}. Near 0, numbers are not told "
                "apart.",
                *found.notes,
            ],
        ),
        TextTable(
            "residuals",
            "Root mean square of the errors",
            ["error", "before", "after", "noise"],
            [Block("", errors)],
        ),
    ]
