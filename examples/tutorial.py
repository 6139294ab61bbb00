"""eqt from Python: the paper's experiment, changed, run, looked at and compared.

Run it from the root of a checkout, `python examples/tutorial.py`, or cell by cell in an editor that
knows the marks `# %%`. It takes some seconds and writes to results/.
"""

# %% A configuration from a file, with some values of our own. Everything is checked here, and what
# is wrong is reported all at once.
import eqt_cli

experiment = eqt_cli.load_experiment(
    "configs/paper.yaml",
    {"name": "tutorial", "ensemble.runs": 40, "solver.rtol": 1e-6, "solver.atol": 1e-9},
)
print(experiment)
print("damping", experiment.resolved["gains"]["kd"])

# %% Run it. The result is a folder, results/tutorial; running the same again finds it there.
result = eqt_cli.run(experiment)
print(result)
assert result.failed == 0

# %% Look at the numbers: named dimensions, units, and the metrics of every run. Values are read
# from the file when they are asked for.
print("variables", ", ".join(result.names[:7]), "…")
torque = result.read("torque_norm", controller=0)  # runs × samples
print(f"mean torque of {result.labels[0]}: {torque.mean():.2f} {result.units('torque_norm')}")

# %% With pandas and xarray installed, a table of all runs, and signals by name.
try:
    import xarray  # noqa: F401
except ImportError:
    print("pip install xarray h5netcdf for the next lines")
else:
    print(result.metrics().groupby("controller").mean_attitude_error.mean().round(1).to_dict())
    with result.to_xarray() as dataset:
        early = dataset.torque_norm.sel(time=slice(0, 5)).mean(["run", "time"])
        print(early.to_series().round(2).to_dict())

# %% Compare controllers run by run: they all start from the same initial states.
comparison = eqt_cli.compare(result, metrics=["mean_torque", "mean_pose_error"], windows=["0:5"])
for pair in comparison.pairs:
    if (pair.first, pair.second) == ("gt", "eqt"):
        name = pair.measured.quantity.name
        interval = f"[{pair.low:.3f}, {pair.high:.3f}]"
        print(f"{name}, gt − eqt: {pair.difference:.3f} {interval}, {pair.word}")
for claim in comparison.judgements:
    if claim.pair is not None:
        less = f"{claim.pair.first} has less {claim.pair.measured.quantity.plain}"
        print(f"{less} than {claim.pair.second}: {claim.verdict}")

# %% Configurations are plain data, so a study is a loop; each experiment has a folder of its own.
for kd in (0.25, 1.0):
    damped = eqt_cli.load_experiment(
        experiment.resolved, {"name": f"tutorial-kd{kd:g}", "gains.kd": kd, "ensemble.runs": 10}
    )
    with eqt_cli.run(damped) as results:
        error = results.read("final_pose_error", controller=0).mean()
    print(f"kd = {kd}: final attitude error of eqt {error:.3f}")
