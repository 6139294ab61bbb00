# %% [markdown]
"""From a tuned comparison to a table of the paper.

At the end you have `tuned.tex` and `tuned.md`: laws at their best gains, with intervals.
Run it from the root of a checkout; it needs `pip install '.[xarray]'` and some seconds.
"""

# %% Each law is tuned on five training samples, at equal effort; held-out runs compare the laws.
from pathlib import Path

import eqt_cli

search = {
    "name": "fair",
    "group": "SO3",
    "inertia": [2, 1, 3],
    "gains": {"kp": 1.0, "kd": 0.5},
    "reference": {"torque": ["cos(t)", "sin(t)", "0"]},
    "controllers": ["eqt", "gt"],
    "initial": {"pose": "haar", "velocity": "normal"},
    "ensemble": {"runs": 8, "seed": 1},
    "time": {"duration": 10, "samples": 51},
    "solver": {"rtol": 1e-6},
    "tune": {
        "over": {"gains.kp": {"log": [0.1, 10]}, "gains.kd": {"log": [0.1, 10]}},
        "objective": "mean_attitude_error",
        "equal": {"effort": 60},
        "confirm": {"runs": 40, "seed": 999},
    },
}
tuned = eqt_cli.tune(search, "results/fair-tuned")
print(tuned)  # the error in the search is that of the runs on which the gains were chosen

# %% The folder is the result of held-out runs, on which no gains were chosen: compare laws on it.
# It also holds the gains at which the searches began, which are left out here.
comparison = eqt_cli.compare(tuned, ["mean_attitude_error", "effort"], without_start=True)
print("\n".join(comparison.answer()))

# %% One row per law: its gains, and its means with intervals of 95 %.
table = tuned.to_dataframe().set_index("law")[["gains.kp", "gains.kd"]].round(2)
table.columns = ["$k_p$", "$k_d$"]
heads = {"mean_attitude_error": "attitude error (deg)", "effort": r"effort (N$^2$ m$^2$ s)"}
for level in comparison.levels:
    shown = f"{level.mean:.1f} [{level.low:.1f}, {level.high:.1f}]"
    table.loc[level.controller, heads[level.measured.quantity.name]] = shown

# %% The last column: the difference in effort, run by run from the same starts.
pairs = comparison.to_dataframe().set_index(["metric", "first"])
effort = pairs.loc[("effort", "gt")]
column = "difference in effort (%)"
table.loc["eqt", column] = "--"
table.loc["gt", column] = (
    f"{100 * effort.relative:.0f} "
    f"[{100 * effort.relative_low:.0f}, {100 * effort.relative_high:.0f}]"
)
print(table.loc["gt", column], effort.word)

# %% For LaTeX, with `booktabs`.
named = table.rename(index={"eqt": "EqT", "gt": "GT"}).rename_axis(None)
latex = named.to_latex(column_format="lrrlll", float_format="%.2f")
Path("tuned.tex").write_text(latex, encoding="utf-8")
print(latex)

# %% For Markdown.
rows = [["law", *table.columns], ["---"] * (1 + len(table.columns))]
rows += [[law, *map(str, values)] for law, values in zip(table.index, table.values, strict=True)]
markdown = "\n".join(f"| {' | '.join(row)} |" for row in rows)
Path("tuned.md").write_text(markdown, encoding="utf-8")
print(markdown)
