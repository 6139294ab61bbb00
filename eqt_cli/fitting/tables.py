"""Lays out the results of a replay or a fit as tables of text."""

from eqt_cli.analysis.comparison.notation import significant
from eqt_cli.analysis.text_tables import Block, TextTable
from eqt_cli.fitting.growth import Growth
from eqt_cli.fitting.plant_fit import PlantFit


def growth_table(result: Growth) -> TextTable:
    """Return the error of each part at each horizon: median, quantiles, rms, and that by noise."""
    header = ["horizon, s", "median", "10 %", "90 %", "rms", "noise"]
    blocks = []
    for k, (part, unit) in enumerate(zip(result.parts, result.units, strict=True)):
        columns = (result.median, result.low, result.high, result.rms, result.noise)
        rows = [
            [f"{horizon:.4g}", *(significant(column[k, h], 3) for column in columns)]
            for h, horizon in enumerate(result.horizons)
        ]
        blocks.append(Block(f"{part}, {unit}", rows))
    failed = f"; the runs of {result.failed} more failed" if result.failed else ""
    title = f"Error of the prediction of {result.name} over {result.windows} windows{failed}"
    notes = [
        "Each window starts in a recorded state. noise: the rms that the noise of the recording "
        "alone gives a perfect model.",
        *result.notes,
    ]
    return TextTable("growth", title, header, blocks, notes)


def fit_tables(result: PlantFit) -> list[TextTable]:
    """Return the numbers with their intervals, and the errors before and after the fit."""
    numbers = [
        [
            n.key,
            significant(n.start, 5),
            significant(n.value, 5),
            f"[{significant(n.low, 5)}, {significant(n.high, 5)}]",
        ]
        for n in result.numbers
    ]
    errors = [
        [f"{r.part}, {r.unit}", *(significant(x, 3) for x in (r.before, r.after, r.noise))]
        for r in result.residuals
    ]
    values = ", ".join(f"{value:.3g}" for value in result.singular_values)
    title = f"Fitted to {result.windows} windows of {result.horizon:.4g} s of {result.name}"
    return [
        TextTable(
            "numbers",
            title,
            ["key", "start", "found", "95 % interval"],
            [Block("", numbers)],
            [
                f"Singular values of the scaled Jacobian: {values}. Near 0, the recording cannot "
                "distinguish the numbers.",
                *result.notes,
            ],
        ),
        TextTable(
            "residuals",
            "Root mean square of the errors",
            ["error", "before", "after", "noise"],
            [Block("", errors)],
        ),
    ]
