# %% [markdown]
"""From a sweep to a figure of your own.

At the end you have `gains.pdf`: the error of two laws over the gains, beside a figure of eqt.
Run it from the root of a checkout; it needs `pip install '.[xarray]'` and some seconds.
"""

# %% A sweep is a configuration with a section `sweep`; here, three by two gains.
import matplotlib.pyplot as plt

import eqt_cli

experiment = eqt_cli.load_experiment(
    "configs/paper.yaml",
    {
        "name": "gains",
        "controllers": ["eqt", "gt"],
        "ensemble.runs": 12,
        "time": {"duration": 10, "samples": 101},
        "solver.rtol": 1e-6,
        "sweep": [{"grid": {"gains.kp": [0.5, 1, 2], "gains.kd": [0.5, 1]}}],
    },
)
print(experiment)

# %% Run it; the same again finds the result in its folder.
result = eqt_cli.run(experiment)
print(result)

# %% The numbers of all runs are one table, with the swept gains as columns.
table = result.metrics()
error = table.groupby(["controller", "gains.kd", "gains.kp"]).mean_attitude_error
print(error.mean().unstack().round(1))
unit = table.attrs["units"]["mean_attitude_error"]

# %% The signals over time are one dataset.
with result.to_xarray() as data:
    torque = data.torque_norm.sel(controller="eqt", time=slice(0, 5))
    print(torque.mean(["run", "time"]).round(2).values, torque.attrs["units"])

# %% On the right, a figure of eqt, drawn into your own axes: the laws at one point of the sweep.
figure, (left, right) = plt.subplots(1, 2, figsize=(7.2, 3), layout="constrained")
point = table[(table["gains.kp"] == 2) & (table["gains.kd"] == 1)].point.iloc[0]
eqt_cli.figure(result, "summary", point=int(point), options={"panels": ["pose_error"]}, axes=right)
colours = {line.get_label(): line.get_color() for line in right.lines}

# %% On the left, a panel of your own: the mean over runs, and the middle half of them.
of_kd = table[table["gains.kd"] == 1].groupby(["controller", "gains.kp"]).mean_attitude_error
for law in result.labels:
    low, mean, high = of_kd.quantile(0.25)[law], of_kd.mean()[law], of_kd.quantile(0.75)[law]
    left.plot(mean.index, mean, marker="o", color=colours[law])
    left.fill_between(mean.index, low, high, color=colours[law], alpha=0.2)
left.set(xlabel="$k_p$ (N m)", ylabel=f"mean attitude error ({unit})", title="$k_d$ = 1 N m s")
figure.savefig("gains.pdf")
print([axes.get_title() for axes in figure.axes])
