"""Prints medians and shares of lost runs of the laws in a result of flights.yaml."""

import sys

import numpy as np

import eqt_cli

NAMES = "reward", "steady_error", "first_second", "yaw_rms", "position_rms", "lost"

with eqt_cli.open_result(sys.argv[1]) as result:
    sweep = result.to_xarray()
laws = {str(law): sweep.sel(controller=law) for law in sweep.controller.values}
values = {law: {name: of[name].values.ravel() for name in NAMES} for law, of in laws.items()}
for law, of in values.items():
    for name in NAMES[:-1]:
        x = of[name]
        print(f"{law} {name}: median {np.median(x):.4g}, mean {x.mean():.4g} ± {x.std():.3g}")
    print(f"{law} lost: {of['lost'].sum():.0f} of {len(of['lost'])}")
for one in values:
    for other in values:
        if one != other:
            of, to = values[one], values[other]
            better = (of["reward"] > to["reward"]).sum()
            closer = (of["steady_error"] < to["steady_error"]).sum()
            print(f"{one} against {other}: more reward {better}, less steady error {closer}")
